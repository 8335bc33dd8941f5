// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where will the other body be? Regions of interest in a model's grid, for the demand walk. Takes
// trees and motions, gives boxes.
// Source: the paper, section 3.2 (prediction by coherence); departure: swept boxes of the other
// body instead of grid cells.

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "core/demand/collect.hpp"
#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/geometry/motion.hpp"

namespace nearmesh {

/// Parts of a region in the grid of `own` that cover where the faces of `other` may be during [now,
/// now + lookahead_s] at constant velocities, and `margin_m` around, as far as that is near one of
/// the boxes `near` (own's grid). At most `max_parts` (>= 1): the other tree is opened largest box
/// first, only where it is near, into some times as many items, down to single faces, which are
/// then grouped alike in number. Cost: O(max_parts (near + log max_parts)).
[[nodiscard]] std::vector<RegionPart> swept_region(const TreeView& own, const Motion& own_motion,
                                                   const TreeView& other,
                                                   const Motion& other_motion, double lookahead_s,
                                                   double margin_m, std::size_t max_parts,
                                                   std::span<const GridBox> near);

/// What covers a region of at most so many parts, as far as it is near the boxes: swept_region, of
/// one body or several.
using RegionMaker =
    std::function<std::vector<RegionPart>(std::size_t max_parts, std::span<const GridBox> near)>;

/// At most so many parts (>= 1) that cover all that the given ones do: those close together become
/// one box.
/// Cost: O(n log n) for each doubling of `most`.
[[nodiscard]] std::vector<RegionPart> merge_by_place(std::vector<RegionPart> parts,
                                                     std::size_t most);

/// Where a model may be at all, in its grid: boxes of its roots.
[[nodiscard]] std::vector<GridBox> root_reach(const SplitStore& store);

/// By so many parts a region is described where it is not yet known what of it matters.
inline constexpr std::size_t kCoarseParts = 8;
/// By so many parts a region is described in a request.
inline constexpr std::size_t kRegionParts = 96;
/// So many splits at most are asked for at a time where they are needed now.
inline constexpr std::uint32_t kRequestSplits = 4096;
/// So many splits at most are asked for ahead at a time: some 5 KB arrive, which a frame can take,
/// since half as much comes as is expected where a region only grazes nodes. What is ahead has
/// time.
inline constexpr std::uint32_t kMaxAheadSplits = 1280;

/// What a request leaves for the next one where more is expected than it may bring.
enum class Portion : std::uint8_t {
  /// Small nodes: everything is known a little better first, which bounds an answer soonest.
  kLargestNodes,
  /// All below some nodes: what comes is whole, so that the next request need not name what this
  /// one cut, nor its answer repeat boxes and open edges. Where what is asked for has time.
  kWholeNodes,
};

/// What a peer asks next: `missing` (ascending) in any case, then what other unresolved nodes of
/// the store meet the region, the largest first, as far as a request has room. Nothing where
/// nothing is missing. A region of a few parts finds the unresolved nodes that matter; only near
/// these it is made finer, by so many parts that they weigh no more than the answer that is
/// expected.
[[nodiscard]] std::optional<RegionRequest> make_request(
    const SplitStore& store, const RegionMaker& region, std::vector<NodeSpan> missing,
    std::size_t max_parts, std::uint32_t max_splits, Portion portion = Portion::kLargestNodes);

}  // namespace nearmesh
