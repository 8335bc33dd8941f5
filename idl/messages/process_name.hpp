// SPDX-License-Identifier: Apache-2.0
#pragma once
// What processes are called, for people: in logs, status and reports a name stands beside the
// session's number. Nothing else depends on it, and several may have the same one.

#include <cstddef>
#include <string>
#include <string_view>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::wire {

/// ASCII, and more than a control character.
[[nodiscard]] constexpr bool is_printable(char c) { return c >= 0x20 && c <= 0x7e; }

/// Errors: kInvalidArgument unless the name is 1 to kMaxNameBytes of printable ASCII without blanks
/// at its ends; the line says which byte does not fit.
[[nodiscard]] Status check_process_name(std::string_view name);
/// HOST/PROCESS of this process: what it is called where nobody gave it a name.
[[nodiscard]] std::string default_process_name();
/// What this process is called: `given`, where that is not "".
[[nodiscard]] std::string name_of_process(const std::string& given);
/// What its participant is called in discovery: HOST/PROCESS, and before it the name that was
/// given: so whoever cannot talk with it, as one of another wire version, can say where it is.
[[nodiscard]] std::string announced_name(const std::string& given);
/// The host's name, as it may stand in a ProcessStatus.
[[nodiscard]] std::string host_name();
/// A name that another process gave itself as it may be shown: cut, other bytes than printable
/// ASCII replaced, blanks at its ends left out. "" stays so.
[[nodiscard]] std::string shown_name(std::string name, std::size_t most_bytes = kMaxNameBytes);
/// The same of a participant's name: room for all of an announced_name().
[[nodiscard]] std::string shown_participant(std::string name);
/// "e3a90c5b11d8a7f0 (rig-2)"; without a name, the number alone.
[[nodiscard]] std::string called(SessionId session, const std::string& name);

}  // namespace nearmesh::wire
