// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a query lacks, without the query: for who splits it and asks again.

#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

/// What query() would name as missing for the surfaces' sake, in missing_a and missing_b; uncertain
/// whatever it finds. Where two unresolved nodes may meet, query() may name the other one. Faces
/// are not held against faces, and what holds nothing but exact faces on both sides is passed over,
/// so bodies that touch in millions of pairs cost no more than others. In: as for query(). Where
/// `max_tests` are spent it is exhausted, with what was found by then. Deterministic. Threads:
/// views may be shared.
[[nodiscard]] Answer find_missing(const TreeView& a, const PosedFrame& frame_a, const TreeView& b,
                                  const PosedFrame& frame_b, std::uint64_t max_tests = kAllTests);

}  // namespace nearmesh
