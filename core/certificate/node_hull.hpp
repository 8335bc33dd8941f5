// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where the faces lie that a node stands for: what a true half-space of it has to hold. Takes a
// model's file and a node, gives points. Reads what is near the node, never all of the model.

#include <vector>

#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh {

/// Points whose hull holds every face of the full mesh that has a vertex in a node: vertices of
/// these faces where parts of the node are small, corners of boxes where they are large.
struct NodeHull {
  std::vector<VertexId> vertices;  ///< ascending, each once; the store knows where they are
  std::vector<GridPoint> corners;

  [[nodiscard]] std::size_t size() const { return vertices.size() + corners.size(); }
  /// That of two nodes together.
  void add(const NodeHull& other);
  [[nodiscard]] std::vector<GridPoint> points(const SplitStore& store) const;
};
/// In: a node that file.store() knows (SplitStore::is_node). Errors: those of ModelFile::require().
/// Deterministic.
/// Cost: some microseconds a vertex up to 512 vertices, then no more.
[[nodiscard]] Result<NodeHull> hull_of_node(ModelFile& file, NodeSpan node);
/// Some of these points, for less: the node's vertices, and those of the faces of splits below it.
[[nodiscard]] Result<NodeHull> hull_below(ModelFile& file, NodeSpan node);

}  // namespace nearmesh
