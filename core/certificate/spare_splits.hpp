// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which splits a server need not send, since half-spaces of a node keep all below it clear, in
// fewer bytes. Takes a mirror on which all was split that stood in the way, gives it back with
// less.

#include <optional>
#include <vector>

#include "core/certificate/mirror.hpp"
#include "core/query/obstacles_ahead.hpp"
#include "nearmesh/core/geometry/motion.hpp"
#include "node_hull.hpp"

namespace nearmesh {

/// What the nodes of a model are to stay clear of: another, as its mirror has it. Both move in one
/// frame.
struct ToClear {
  const Mirror* other = nullptr;
  Motion own_motion, other_motion;
  double duration_s = 0, margin_m = 0;
};

/// Goes from the smallest nodes up, since a node can be kept clear only where its parts can.
/// Threads: one at a time.
class SplitSparer {
 public:
  /// `splits`: done for this request. `kept`: nodes that stay split. The mirrors must not change
  /// until apply().
  SplitSparer(Mirror& mirror, std::span<const VertexId> splits, std::vector<NodeSpan> kept,
              std::vector<ToClear> others);

  [[nodiscard]] bool is_done() const { return at_ == 0; }
  /// Looks at one node more. Out: what it took, in tests. Errors: those of reading the file.
  [[nodiscard]] Result<std::uint64_t> look();
  /// Takes back the splits that are spared, among the nodes looked at, and tells the half-spaces
  /// instead. Out: the nodes told of, ascending.
  [[nodiscard]] std::vector<NodeSpan> apply();

 private:
  struct Node {
    TreeletSplit split;
    std::size_t count = 1;  ///< of splits at it and below
    bool can_be_spared = false, is_spared = false;
    std::vector<HalfSpace> half_spaces;
    NodeHull hull;                 ///< until the node above takes it over; or none was needed
    std::uint32_t split_bits = 0;  ///< of its split, and of its parts that are not split
    std::uint32_t box_bits = 0;    ///< of it where it is not split
    std::uint32_t bits = 0;        ///< of the cheapest way
  };
  /// What came of a look.
  struct Looked {
    bool is_to_be_split = false;  ///< half-spaces cannot keep it clear, as far as is known
    std::uint64_t tests = 0;
  };
  [[nodiscard]] bool may_be_spared(std::size_t i) const;
  Status find_hull(std::size_t i);
  Status find_obstacles(std::size_t i, std::span<const HalfSpace> told, std::vector<Obstacle>& to,
                        Looked& looked);
  [[nodiscard]] std::vector<HalfSpace> guess(std::span<const GridPoint> points,
                                             const GridPoint& from) const;
  std::optional<std::vector<HalfSpace>> choose(std::span<const GridPoint> points,
                                               const GridPoint& from,
                                               std::span<const Obstacle> obstacles, Looked& looked);
  Status look_at_pair(std::size_t i, Looked& looked);
  Status look_at(std::size_t i, Looked& looked);

  Mirror* mirror_;
  std::vector<Node> nodes_;  // in preorder
  std::vector<NodeSpan> kept_;
  std::vector<ToClear> others_;
  // Of each of these; made when first asked.
  std::vector<std::unique_ptr<ObstaclesAhead>> obstacles_;
  std::vector<Obstacle> in_the_way_;  // of the last node that could not be kept clear
  std::optional<std::uint16_t> last_direction_;
  std::size_t at_;  // those from here on have been looked at
};

/// Some splits as a treelet. In: splits that the store knows, each once.
[[nodiscard]] Treelet treelet_of(const SplitStore& store, std::span<const VertexId> splits);

}  // namespace nearmesh
