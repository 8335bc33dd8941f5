// SPDX-License-Identifier: Apache-2.0
// Of codec.hpp: what processes tell of themselves, and what is sent to come back.
#include <string>
#include <utility>

#include "codec.hpp"
#include "codec_fields.hpp"
#include "idl/messages/process_name.hpp"

namespace nearmesh::wire {

namespace {

constexpr std::uint8_t kFlagPublisher = 1;
constexpr std::uint8_t kFlagDoor = 2;
constexpr std::uint8_t kFlagReply = 1;

}  // namespace

void encode(const ProcessStatus& message, wire_types::ProcessStatusSample& sample) {
  sample.wire_version(message.wire_version);
  sample.flags(static_cast<std::uint8_t>((message.is_publisher ? kFlagPublisher : 0) |
                                         (message.has_door ? kFlagDoor : 0)));
  sample.process_id(message.process_id);
  sample.session(message.session);
  sample.name(message.name.c_str());
  sample.host(message.host.c_str());
  sample.uptime_s(message.uptime_s);
  sample.bytes_per_s(message.bytes_per_s);
  sample.uncertainty_m(message.uncertainty_m);
  sample.peers(message.peers);
  sample.watched_pairs(message.watched_pairs);
  sample.certified_pairs(message.certified_pairs);
  sample.requests(message.requests);
  sample.refused(message.refused);
  sample.batches(message.batches);
  sample.bytes(message.bytes);
  sample.lost_batches(message.lost_batches);
  sample.waiting_batches(message.waiting_batches);
  sample.resident_bytes(message.resident_bytes);
  sample.moved_bodies(message.moved_bodies);
  sample.heard_bodies(message.heard_bodies);
  sample.stale_bodies(message.stale_bodies);
  sample.oldest_body(message.oldest_body.c_str());
  sample.oldest_age_s(message.oldest_age_s);
  sample.moved().clear();
  for (const std::string& body : message.moved) append_line(body, sample.moved());
  sample.door_refused(message.door_refused);
  sample.names().clear();
  sample.content_hashes().clear();
  sample.faces().clear();
  sample.held_splits().clear();
  sample.splits().clear();
  for (const ProcessStatus::Model& model : message.models) {
    append_line(model.name, sample.names());
    append_content(model.content_hash, sample.content_hashes());
    sample.faces().push_back(model.faces);
    sample.held_splits().push_back(model.held_splits);
    sample.splits().push_back(model.splits);
  }
  sample.complaints().clear();
  for (const std::string& line : message.complaints) append_line(line, sample.complaints());
}

Result<ProcessStatus> decode(const wire_types::ProcessStatusSample& sample) {
  ProcessStatus message;
  message.wire_version = sample.wire_version();
  NEARMESH_RETURN_IF_ERROR(check_bits(sample.flags(), kFlagPublisher | kFlagDoor, "flags"));
  message.is_publisher = (sample.flags() & kFlagPublisher) != 0;
  message.has_door = (sample.flags() & kFlagDoor) != 0;
  message.process_id = sample.process_id();
  message.session = sample.session();
  message.name = shown_name(sample.name().to_string());
  message.host = sample.host().to_string();
  message.uptime_s = sample.uptime_s();
  message.bytes_per_s = sample.bytes_per_s();
  message.uncertainty_m = sample.uncertainty_m();
  message.peers = sample.peers();
  message.watched_pairs = sample.watched_pairs();
  message.certified_pairs = sample.certified_pairs();
  message.requests = sample.requests();
  message.refused = sample.refused();
  message.batches = sample.batches();
  message.bytes = sample.bytes();
  message.lost_batches = sample.lost_batches();
  message.waiting_batches = sample.waiting_batches();
  message.resident_bytes = sample.resident_bytes();
  message.moved_bodies = sample.moved_bodies();
  message.heard_bodies = sample.heard_bodies();
  message.stale_bodies = sample.stale_bodies();
  message.oldest_body = sample.oldest_body().to_string();
  message.oldest_age_s = sample.oldest_age_s();
  auto moved = split_lines(sample.moved(), 0, kMaxStatusBodies, "moved");
  NEARMESH_RETURN_IF_ERROR(moved);
  message.moved = std::move(moved).value();
  message.door_refused = sample.door_refused();
  const std::size_t count = sample.faces().size();
  if (count > kMaxModels || sample.content_hashes().size() != kWordsPerContent * count ||
      sample.held_splits().size() != count || sample.splits().size() != count)
    return malformed("models: lists that do not belong together");
  const auto names = split_lines(sample.names(), count, count, "model names");
  NEARMESH_RETURN_IF_ERROR(names);
  for (std::size_t i = 0; i < count; ++i)
    message.models.push_back({names.value()[i], content_at(sample.content_hashes(), i),
                              sample.faces()[i], sample.held_splits()[i], sample.splits()[i]});
  auto lines = split_lines(sample.complaints(), 0, kMaxStatusLines, "complaints");
  NEARMESH_RETURN_IF_ERROR(lines);
  message.complaints = std::move(lines).value();
  return checked(std::move(message));
}

void encode(const Echo& message, wire_types::EchoSample& sample) {
  sample.wire_version(message.wire_version);
  sample.flags(message.is_reply ? kFlagReply : 0);
  sample.number(message.number);
  sample.from(message.from);
  sample.to(message.to);
  sample.bytes(message.bytes);
}

Result<Echo> decode(const wire_types::EchoSample& sample) {
  Echo message;
  message.wire_version = sample.wire_version();
  NEARMESH_RETURN_IF_ERROR(check_bits(sample.flags(), kFlagReply, "flags"));
  message.is_reply = (sample.flags() & kFlagReply) != 0;
  message.number = sample.number();
  message.from = sample.from();
  message.to = sample.to();
  message.bytes = sample.bytes();
  return checked(std::move(message));
}

}  // namespace nearmesh::wire
