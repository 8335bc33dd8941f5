// SPDX-License-Identifier: Apache-2.0
#pragma once
// sweep() where the query at its start has been asked already.

#include "nearmesh/core/query/sweep.hpp"

namespace nearmesh {

/// In: `now` is the answer of query() at the motions' poses, of the surfaces alone unless it is
/// certified or has pairs; nullptr where it is not known. `start_error_m`: the bodies' true places
/// at the start are off from the motions' poses by so much at most, both together. Out: what
/// sweep() says, of the true places, too; the statistics leave out what `now` took.
[[nodiscard]] Result<SweptAnswer> sweep_from(const Answer* now, const TreeView& a,
                                             const Motion& motion_a, std::string_view name_a,
                                             const TreeView& b, const Motion& motion_b,
                                             std::string_view name_b, const SweepOptions& options,
                                             double start_error_m = 0);

}  // namespace nearmesh
