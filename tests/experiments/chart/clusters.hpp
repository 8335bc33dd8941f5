// SPDX-License-Identifier: Apache-2.0
#pragma once
// Faces under boxes, without a progressive mesh: what the rivals stream (rivals.cpp).

#include <cstdint>
#include <utility>
#include <vector>

#include "face_codes.hpp"
#include "tests/experiments/perf/workloads.hpp"

namespace nearmesh::chart {

struct Node {
  GridBox box;  // as the peer knows it: rounded outward
  std::vector<std::uint32_t> children;
  std::vector<TreeFace> faces;  // of a cluster
  double bits = 0;              // of the children's boxes, or the faces
};

// Faces as a tree of boxes, eight children a node, clusters of at most so many; with bits where
// they are to be sent.
class Clusters {
 public:
  Clusters(const perf::Model& model, std::size_t cluster_faces, bool coded);
  [[nodiscard]] const Node& node(std::uint32_t i) const { return nodes_[i]; }
  [[nodiscard]] std::size_t size() const { return nodes_.size(); }
  // Bits of these faces as one piece, near `from`.
  [[nodiscard]] double bits(const std::vector<TreeFace>& faces, const GridPoint& from) const;

 private:
  std::uint32_t build(std::vector<TreeFace>& faces, std::size_t begin, std::size_t end,
                      const GridBox& box);
  template <class Emit>
  void code_node(const Node& node, const Emit& emit) const;
  void train();

  const SpmHeader* header_;
  std::size_t cluster_faces_;
  std::vector<Node> nodes_;
  SymbolCosts costs_;
};

// What both ends open: all nodes of a and b that a walk of both trees visits, parents first, and
// pairs of clusters.
struct Walk {
  std::vector<std::uint32_t> a, b;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> clusters;
};
[[nodiscard]] Walk walk(const Clusters& a, const Clusters& b, const PosedPair& posed);

}  // namespace nearmesh::chart
