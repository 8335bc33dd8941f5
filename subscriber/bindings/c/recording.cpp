// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <atomic>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "answers.hpp"
#include "handle.hpp"
#include "nearmesh/core/recording/recording.hpp"
#ifdef NEARMESH_C_WITH_DDS
#include "nearmesh/idl/dds/recorded_samples.hpp"
#endif

struct nearmesh_recording {
  static constexpr nearmesh::c::Kind kKind = nearmesh::c::Kind::kRecording;
  nearmesh::c::Kind kind = kKind;
  std::atomic<bool> in_use = false;
  std::unique_ptr<nearmesh::RecordingReader> reader;
  nearmesh_recording_facts facts{};

  std::int64_t next = 1;                          // id of the message to give
  std::deque<nearmesh::RecordedMessage> ahead;    // from `next` on, as they were read
  std::optional<nearmesh::RecordedMessage> last;  // that was given
  nearmesh_recorded_message message{};
#ifdef NEARMESH_C_WITH_DDS
  std::optional<nearmesh::wire::RecordedSamples> samples;
  nearmesh::wire::ContactReport said;
  std::vector<nearmesh_face_pair> pairs;
  nearmesh_recorded_report report{};
#endif
};

namespace nearmesh::c {
namespace {

/// Read at once: a message at a time would be a query of the database each.
constexpr std::int64_t kReadAhead = 64;

nearmesh_recording_facts told_of(const RecordingReader& reader) {
  nearmesh_recording_facts facts{};
  facts.session = reader.facts().session;
  facts.parts = reader.parts();
  facts.wire_version = reader.facts().wire_version;
  facts.prefix = reader.facts().prefix.c_str();
  facts.idl = reader.facts().idl.c_str();
  facts.message_count = reader.message_count();
  facts.begin_ns = reader.begin_ns();
  facts.end_ns = reader.end_ns();
  facts.topic_count = reader.topics().size();
  facts.writer_count = reader.writers().size();
  facts.gap_count = reader.gaps().size();
  facts.model_count = reader.models().size();
  return facts;
}

void go_to(nearmesh_recording& recording, std::int64_t id) {
  recording.ahead.clear();
  recording.last.reset();
  recording.next = id;
}

/// The next one into `last`; none after the last.
Status advance(nearmesh_recording& recording) {
  recording.last.reset();
  if (recording.ahead.empty()) {
    const std::int64_t end =
        std::min(recording.next + kReadAhead, recording.reader->message_count() + 1);
    if (recording.next >= end) return Status::ok();
    const Status read = recording.reader->read(recording.next, end,
                                               [&](std::int64_t, const RecordedMessage& message) {
                                                 recording.ahead.push_back(message);
                                                 return true;
                                               });
    if (!read.is_ok()) recording.ahead.clear();
    NEARMESH_RETURN_IF_ERROR(read);
    if (recording.ahead.empty())
      return {StatusCode::kCorrupt, "message " + std::to_string(recording.next) + " is not there"};
  }
  recording.last = std::move(recording.ahead.front());
  recording.ahead.pop_front();
  ++recording.next;
  return Status::ok();
}

Result<const nearmesh_recorded_message*> next_message(nearmesh_recording& recording) {
  NEARMESH_RETURN_IF_ERROR(advance(recording));
  if (!recording.last) return static_cast<const nearmesh_recorded_message*>(nullptr);
  const RecordedMessage& of = *recording.last;
  const RecordedWriter& writer = recording.reader->writers().at(of.writer);
  const RecordedTopic& topic = recording.reader->topics().at(writer.topic);
  nearmesh_recorded_message& out = recording.message;
  out.id = recording.next - 1;
  out.topic = topic.name.c_str();
  out.type = topic.type.c_str();
  out.partition = writer.partition.c_str();
  std::copy(writer.guid.begin(), writer.guid.end(), out.writer);
  out.sequence = of.sequence;
  out.received_ns = of.received_ns;
  out.source_ns = of.source_ns;
  out.cdr_bytes = of.cdr.size();
  out.cdr = of.cdr.data();
  return static_cast<const nearmesh_recorded_message*>(&out);
}

#ifdef NEARMESH_C_WITH_DDS
void fill_report(nearmesh_recording& recording) {
  const wire::ContactReport& of = recording.said;
  recording.pairs.clear();
  for (const auto& pair : of.pairs) recording.pairs.push_back(to_c(FacePair{pair[0], pair[1]}));
  nearmesh_recorded_report& out = recording.report;
  out.id = recording.next - 1;
  out.received_ns = recording.last->received_ns;
  out.peer = of.peer;
  out.body_a = of.body_a.c_str();
  out.body_b = of.body_b.c_str();
  out.frame = of.frame;
  out.time_s = of.time_s;
  out.status = of.status;
  out.asked = of.asked;
  out.clearance_m = of.clearance_m;
  out.uncertainty_m = of.uncertainty_m;
  out.pair_total = of.pair_count;
  out.answer_digest = of.answer_digest;
  out.pair_count = recording.pairs.size();
  out.pairs = recording.pairs.data();
  out.put_off = of.put_off;
  out.cut = of.cut;
}

Result<const nearmesh_recorded_report*> next_report(nearmesh_recording& recording) {
  if (!recording.samples) {
    Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(*recording.reader);
    NEARMESH_RETURN_IF_ERROR(samples);
    recording.samples = std::move(samples).value();
  }
  while (true) {
    NEARMESH_RETURN_IF_ERROR(advance(recording));
    if (!recording.last) return static_cast<const nearmesh_recorded_report*>(nullptr);
    std::optional<wire::ContactReport> report =
        recording.samples->read<wire::ContactReport>(*recording.last);
    if (!report) continue;
    recording.said = std::move(*report);
    fill_report(recording);
    return static_cast<const nearmesh_recorded_report*>(&recording.report);
  }
}
#else
Result<const nearmesh_recorded_report*> next_report(nearmesh_recording&) {
  return Status{
      StatusCode::kUnsupported,
      "this libnearmesh was built without DDS (NEARMESH_WITH_DDS=OFF), whose codec reports "
      "need; messages can be read as bytes"};
}
#endif

}  // namespace
}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C

nearmesh_status nearmesh_recording_open(const char* path, nearmesh_recording** recording,
                                        nearmesh_error* error) noexcept {
  if (recording != nullptr) *recording = nullptr;
  return c::guarded(error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(recording, "recording"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(path, "path"));
    Result<std::unique_ptr<RecordingReader>> reader = RecordingReader::open(path);
    NEARMESH_RETURN_IF_ERROR(reader);
    auto opened = std::make_unique<nearmesh_recording>();
    opened->reader = std::move(reader).value();
    opened->facts = c::told_of(*opened->reader);
    *recording = opened.release();
    return Status::ok();
  });
}

void nearmesh_recording_close(nearmesh_recording* recording) noexcept {
  if (!c::is_handle(recording)) return;
  recording->kind = c::Kind::kNone;
  delete recording;
}

const nearmesh_recording_facts* nearmesh_recording_get_facts(
    const nearmesh_recording* recording) noexcept {
  return c::is_handle(recording) ? &recording->facts : nullptr;
}

nearmesh_status nearmesh_recording_seek(nearmesh_recording* recording, int64_t id,
                                        nearmesh_error* error) noexcept {
  return c::guarded(recording, error, [&]() -> Status {
    if (id < 1)
      return {StatusCode::kInvalidArgument,
              "id is " + std::to_string(id) + ", messages are numbered from 1"};
    c::go_to(*recording, std::min(id, recording->reader->message_count() + 1));
    return Status::ok();
  });
}

nearmesh_status nearmesh_recording_seek_time(nearmesh_recording* recording, int64_t received_ns,
                                             nearmesh_error* error) noexcept {
  return c::guarded(recording, error, [&]() -> Status {
    const Result<std::int64_t> id = recording->reader->find(received_ns);
    NEARMESH_RETURN_IF_ERROR(id);
    c::go_to(*recording, id.value());
    return Status::ok();
  });
}

nearmesh_status nearmesh_recording_next(nearmesh_recording* recording,
                                        const nearmesh_recorded_message** message,
                                        nearmesh_error* error) noexcept {
  if (message != nullptr) *message = nullptr;
  return c::guarded(recording, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(message, "message"));
    const Result<const nearmesh_recorded_message*> next = c::next_message(*recording);
    NEARMESH_RETURN_IF_ERROR(next);
    *message = next.value();
    return Status::ok();
  });
}

nearmesh_status nearmesh_recording_next_report(nearmesh_recording* recording,
                                               const nearmesh_recorded_report** report,
                                               nearmesh_error* error) noexcept {
  if (report != nullptr) *report = nullptr;
  return c::guarded(recording, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(report, "report"));
    const Result<const nearmesh_recorded_report*> next = c::next_report(*recording);
    NEARMESH_RETURN_IF_ERROR(next);
    *report = next.value();
    return Status::ok();
  });
}
