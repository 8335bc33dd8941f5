// SPDX-License-Identifier: Apache-2.0
#pragma once
// What endpoints, their participants and return codes are called in messages. For the rooms named
// dds alone.

#include <fastdds/dds/subscriber/DataReader.hpp>

#include <string>

#include "fastdds_api.hpp"
#include "mailbox.hpp"

namespace nearmesh::wire {

/// The participant that an endpoint belongs to.
[[nodiscard]] ParticipantKey participant_of(const Handle& endpoint);
/// Short name of a Fast DDS return code, for messages.
[[nodiscard]] const char* name_of(const ReturnCode& code);
/// Do two endpoints belong to one participant?
[[nodiscard]] bool have_one_participant(const Handle& a, const Handle& b);
/// The endpoint's GUID, for messages.
[[nodiscard]] std::string name_of(const Handle& endpoint);
/// What its participant is called, where discovery told it; else "".
[[nodiscard]] std::string participant_name(const Handle& endpoint, const Mailbox& mailbox);
/// The GUID with the name of its participant, where discovery told one.
[[nodiscard]] std::string name_of(const Handle& endpoint, const Mailbox& mailbox);

/// The name of its topic on the bus.
[[nodiscard]] std::string topic_heard_by(const fdds::DataReader& reader);

}  // namespace nearmesh::wire
