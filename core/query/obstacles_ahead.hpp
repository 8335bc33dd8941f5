// SPDX-License-Identifier: Apache-2.0
#pragma once
// Why a node lacks: what of the other body its box may meet at some instants ahead, and no
// half-space keeps clear. For whoever holds the full mesh and looks at one node after the other:
// frames are made once for all of them.

#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "choose_half_spaces.hpp"
#include "swept_frames.hpp"

namespace nearmesh {

/// What stands in the way of nodes of body a. Threads: one at a time. The trees must outlive it and
/// not change.
class ObstaclesAhead {
 public:
  /// Motions, duration and margin as for lacking_ahead(). Errors: those of sweep().
  [[nodiscard]] static Result<std::unique_ptr<ObstaclesAhead>> make(
      const TreeView& a, const Motion& motion_a, std::string_view name_a, const TreeView& b,
      const Motion& motion_b, std::string_view name_b, double duration_s, double margin_m);

  /// Appends obstacles of a node of a's that none of `told` keeps clear, whatever a holds of the
  /// node: until there are `most` in `to`, or so many tests were made. Where none is left, and
  /// there were tests enough, lacking_ahead() with these motions finds nothing that the node lacks
  /// once it is told these half-spaces. They refer to this object.
  /// Out: tests made; more than `max_tests` where they did not suffice. Deterministic.
  [[nodiscard]] std::uint64_t find(NodeSpan node, std::span<const HalfSpace> told, std::size_t most,
                                   std::uint64_t max_tests, std::vector<Obstacle>& to);

 private:
  ObstaclesAhead(const TreeView& a, const TreeView& b, const AheadOf& ahead, double margin_m);
  const SweptFrame& frame(std::uint32_t part);

  /// A part of b's, as it stands in its node.
  struct Pending {
    std::uint32_t part;  ///< of the time
    TreePlace place;
    bool is_tested;  ///< its box meets the node's in that part of the time
  };

  const TreeView a_, b_;
  const AheadOf ahead_;
  const Mover mover_a_, mover_b_;
  const SweptFrames frames_;
  const double cell_a_m_, cell_b_m_;
  /// Parts of the time by number: part i has the halves 2 i and 2 i + 1, 1 is all of it. Made when
  /// first met.
  std::vector<std::unique_ptr<SweptFrame>> parts_;
  std::vector<Pending> stack_;
  std::vector<BoundedPart> told_;
};

}  // namespace nearmesh
