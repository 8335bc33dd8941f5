// SPDX-License-Identifier: Apache-2.0
#pragma once
// Contacts for who has a frame to keep.

#include <optional>

#include "nearmesh/core/query/contacts.hpp"

namespace nearmesh {

/// find_contacts(), or nothing where `is_over` said so before the end: contacts that depend on when
/// it ended would be none. Asked each kPairsALook pairs of faces, some 60 us.
[[nodiscard]] std::optional<Contacts> find_contacts(const TreeView& a, const PosedFrame& frame_a,
                                                    const TreeView& b, const PosedFrame& frame_b,
                                                    const Answer& answer, const IsOver* is_over);
inline constexpr std::size_t kPairsALook = 64;

}  // namespace nearmesh
