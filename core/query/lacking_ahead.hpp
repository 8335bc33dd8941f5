// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which detail a pair will need: what stands in the way of a certified answer at some instant
// ahead.

#include <string_view>
#include <vector>

#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

/// So many tests a look takes at most, unless it is told otherwise.
inline constexpr std::uint64_t kLookTests = 200'000;

/// Unresolved nodes, ascending. None: every query ahead is certified, as far as surfaces go.
struct Lacking {
  std::vector<NodeSpan> a, b;
  std::uint64_t tests = 0;  ///< that it took

  [[nodiscard]] bool is_nothing() const { return a.empty() && b.empty(); }
};

/// The nodes that may come within `margin_m` of what is known of the other body at some instant of
/// [0, duration_s] of the motions, whether or not the bodies touch; of two unresolved ones the
/// larger. Split these, and ask again. Where tests run out, what was found by then: the nodes that
/// matter soonest. With `require_a` and `require_b`, for who has the whole models, also nodes below
/// those, as far as boxes alone tell: one look instead of one a level of the forest. Parents and
/// their parts may come in any order.
/// Errors: those of sweep() and of `require`. Deterministic. Threads: views may be shared. Cost:
/// that of a sweep without its faces' tests.
[[nodiscard]] Result<Lacking> lacking_ahead(const TreeView& a, const Motion& motion_a,
                                            std::string_view name_a, const TreeView& b,
                                            const Motion& motion_b, std::string_view name_b,
                                            double duration_s, double margin_m,
                                            const Require& require_a = {},
                                            const Require& require_b = {},
                                            std::uint64_t max_tests = kLookTests);

}  // namespace nearmesh
