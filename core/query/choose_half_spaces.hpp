// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which half-spaces of an unresolved node prove it clear of the other body: for whoever holds the
// full mesh and chooses what to tell a peer. Takes points and obstacles, gives half-spaces in
// stored form, each held against the obstacles by the tests that the peer makes.

#include <optional>
#include <span>
#include <vector>

#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"

namespace nearmesh {

/// A part of the other body that a node's box may meet, at one instant. Of one body at several
/// instants: several.
struct Obstacle {
  const RelativeFrame* other_in_own = nullptr;  ///< "own" is the node's grid
  std::optional<DoubleTriangle> face;           ///< an exact face, by to_a_units
  CenteredBox box;                              ///< else a box in the other's grid
  Drift drift;  ///< in own units; what it may move about the instant
};
/// Whether the half-space of a node whose vertex stands at `from` keeps it clear: as a peer sees
/// it.
[[nodiscard]] bool keeps_clear(const HalfSpace& half_space, const GridPoint& from,
                               const Obstacle& obstacle);

/// The narrowest one across a direction that holds these points, the corners of all faces of the
/// full mesh that have a vertex in the node; nothing where they reach farther than one can say.
/// `from`: the place of the node's vertex.
[[nodiscard]] std::optional<HalfSpace> tightest_half_space(std::span<const GridPoint> points,
                                                           const GridPoint& from,
                                                           std::uint16_t direction);

struct ChosenHalfSpaces {
  /// Ascending; each parts an obstacle that none of the others parts.
  std::vector<HalfSpace> half_spaces;
  std::size_t left = 0;  ///< obstacles that none of them parts
};
/// `points`: the corners of all faces of the full mesh that have a vertex in the node; so what is
/// chosen is true. `from`: the place of the node's vertex. At most `most` half-spaces, fewest
/// first: one for all obstacles where there is one. It ends where the nearest that is left cannot
/// be parted: then the node has to be split. Source: E. G. Gilbert 1966, "An iterative procedure
/// for computing the minimum of a quadratic form on a convex set", on the difference of two hulls.
/// Deterministic: follows from the order of points and obstacles. Cost: O(points + obstacles) some
/// hundred times at most.
[[nodiscard]] ChosenHalfSpaces choose_half_spaces(std::span<const GridPoint> points,
                                                  const GridPoint& from,
                                                  std::span<const Obstacle> obstacles,
                                                  std::size_t most = kMaxHalfSpaces,
                                                  std::optional<std::uint16_t> hint = {});

}  // namespace nearmesh
