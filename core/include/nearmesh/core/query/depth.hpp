// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// How deep two bodies are in each other: how far B has to be moved, and which way, until it is
// certified free of A.
//
// The depth of B in A along a direction n is the least s >= 0 such that B, moved by s n, is free of
// A. It is a question about the way out that is nearest along n, so a wheel that has sunk into the
// floor of a tunnel is out when it leaves the floor.
//
// Both bounds are proofs. Below: two faces that touch both before and after B is moved touch all
// along, since both are convex; the search goes from such pair to such pair, and each is decided by
// integers. Above: B was asked about where the answer puts it, and is certified free there; a solid
// has nothing inside. Nothing is assumed of normals, thickness or closed surfaces.

#include <array>
#include <cstdint>
#include <limits>
#include <string_view>
#include <vector>

#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/query/contacts.hpp"

namespace nearmesh {

/// DepthOptions::max_tests unless it is set: some 1 to 2 ms.
inline constexpr std::uint64_t kDepthTests = 500'000;

struct DepthOptions {
  /// Ways for B that are tried, world frame, each of any length but 0. None: the normals of the
  /// patches, the four longest ones, and the mean of all, by length.
  std::vector<std::array<double, 3>> directions;
  bool solid_a = false, solid_b = false;  ///< as in QueryOptions
  /// The search ends after so many tests (tests_of), some 2 to 5 ns each; the bracket is then as
  /// wide as it is.
  std::uint64_t max_tests = kDepthTests;
  /// As in QueryOptions: the search ends as if max_tests were spent.
  const IsOver* is_over = nullptr;
};

struct Depth {
  /// Unit vector, world frame: of the ways tried the one that has B free soonest (with the least
  /// at_most_m; of equals the first).
  std::array<double, 3> direction{};
  /// The depth along `direction` is at least so much, metres: B, moved as a whole along a path that
  /// keeps within a step of that line, touches A until here. A step is a cell of the pair's lattice
  /// (geometry/pose.hpp), or, where it is more, what the doubles of B's translation tell apart:
  /// 2^-23 m at 10^9 m. 0: nothing is proved.
  double at_least_m = 0;
  /// And at most so much. Infinite where no free place was found.
  double at_most_m = std::numeric_limits<double>::infinity();
  /// Where at_most_m is finite: with this added to the translation of B's pose, coordinate by
  /// coordinate in doubles, query() certifies that the full meshes are free of each other. As long
  /// as at_most_m, to a step. Metres, world frame.
  std::array<double, 3> separation_m{};
  std::vector<NodeSpan> missing_a, missing_b;  ///< ascending; what would narrow the bracket
  bool exhausted = false;                      ///< max_tests were spent, or is_over said so
  QueryStats stats;
};

/// In: `answer`, which query() gave for these trees and poses, and its contacts; with pairs, else
/// all but at_most_m stays as it is made.
/// Deterministic. Threads: views may be shared.
/// Errors: those of pose_pair; kInvalidArgument for a direction that is 0 or not finite.
/// Cost: max_tests in all, and one query of 4,096 tests more for each direction that finds them
/// spent. Of a direction: a query for each pair of faces that the search goes along from below, so
/// two or three where faces are larger than the depth; then one for each fourfold of the way, until
/// B is free; then one for each halving of the bracket, to a 256th of the way or one cell. None
/// lists more than 128 pairs.
[[nodiscard]] Result<Depth> find_depth(const TreeView& a, const Pose& pose_a,
                                       std::string_view name_a, const TreeView& b,
                                       const Pose& pose_b, std::string_view name_b,
                                       const Answer& answer, const Contacts& contacts,
                                       const DepthOptions& options = {});

/// The same of two models at hand: splits what is missing, until nothing is or max_tests were
/// spent. Errors: also those of certify().
/// Cost: find_depth() for each round; a round splits at least one node.
[[nodiscard]] Result<Depth> certify_depth(LocalModel& a, const Pose& pose_a,
                                          const Require& require_a, LocalModel& b,
                                          const Pose& pose_b, const Require& require_b,
                                          const Answer& answer, const Contacts& contacts,
                                          const DepthOptions& options = {});

}  // namespace nearmesh
