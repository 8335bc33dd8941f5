// SPDX-License-Identifier: Apache-2.0
#include "survey.hpp"

#include <algorithm>
#include <type_traits>

#include "core/spm/coding_sets.hpp"
#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"

namespace nearmesh::subscriber {
namespace {

/// Tells what was sent before the recorder came from what was missed since.
class MissedSamples {
 public:
  MissedSamples(const RecordingReader& recording, const wire::RecordedSamples& samples)
      : recording_(recording), samples_(samples), writers_(recording.writers().size()) {}

  void take(const RecordedMessage& message) {
    Writer& writer = writers_[message.writer];
    if (writer.who.empty()) writer.who = speaker_of(message);
    // What is latched was sent before: its numbers have gaps.
    if (message.source_ns >= recording_.begin_ns())
      writer.first_live = std::min(writer.first_live, message.sequence);
  }
  void count(Survey& survey) const {
    for (const RecordingGap& gap : recording_.gaps()) {
      const Writer& writer = writers_[gap.writer];
      const std::size_t topic = recording_.writers()[gap.writer].topic;
      const bool is_first = gap.first_sequence == 1;
      const bool before = is_first || gap.first_sequence < writer.first_live;
      (before ? survey.topics[topic].before : survey.topics[topic].missing) += gap.count;
      if (is_first) survey.late.push_back({topic, writer.who, gap.count + 1});
    }
  }

 private:
  struct Writer {
    std::string who;
    std::uint64_t first_live = ~std::uint64_t{0};
  };

  [[nodiscard]] std::string speaker_of(const RecordedMessage& message) const {
    std::string who;
    wire::for_each_topic([&]<class Message>(const wire::Topic<Message>&) {
      if (!samples_.is<Message>(message)) return;
      const auto read = samples_.read<Message>(message);
      if (!read) return;
      if constexpr (std::is_same_v<Message, wire::SplitBatchMessage>)
        who = wire::partition_of(read->publisher) + " to " +
              wire::partition_of(wire::peer_of(recording_.writers()[message.writer].partition));
      else if constexpr (requires(const Message& m) { m.peer; })
        who = wire::partition_of(read->peer);
      else if constexpr (requires(const Message& m) { m.publisher; })
        who = wire::partition_of(read->publisher);
    });
    return who;
  }

  const RecordingReader& recording_;
  const wire::RecordedSamples& samples_;
  std::vector<Writer> writers_;
};

}  // namespace

Result<Survey> survey(RecordingReader& recording) {
  const Result<wire::RecordedSamples> opened = wire::RecordedSamples::of(recording);
  NEARMESH_RETURN_IF_ERROR(opened);
  const wire::RecordedSamples& samples = opened.value();
  Survey survey;
  survey.topics.resize(recording.topics().size());
  survey.duration_s = static_cast<double>(recording.end_ns() - recording.begin_ns()) * 1e-9;
  CertifiedTimes open;
  SharedTables tables;
  MissedSamples missed(recording, samples);
  const auto take = [&](std::int64_t, const RecordedMessage& message) {
    const std::uint32_t topic = recording.writers()[message.writer].topic;
    missed.take(message);
    ++survey.topics[topic].samples;
    survey.topics[topic].bytes += message.cdr.size();
    if (const auto report = samples.read<wire::ContactReport>(message)) {
      survey.peers.insert(report->peer);
      ++survey.by_status[report->status];
      survey.contact_pairs += report->pair_count;
      if (const auto began = open.add(*report, {.source_ns = message.source_ns}))
        survey.to_certified_s.push_back(static_cast<double>(message.source_ns - began->source_ns) *
                                        1e-9);
    } else if (const auto poses = samples.read_poses(message)) {
      survey.peers.insert(poses->peer);
    } else if (const auto promises = samples.read<wire::BodyPromises>(message)) {
      survey.peers.insert(promises->peer);
    } else if (const auto watched = samples.read<wire::WatchedBodies>(message)) {
      survey.peers.insert(watched->peer);
    } else if (const auto asked = samples.read<wire::RegionSubscription>(message)) {
      survey.peers.insert(asked->peer);
    } else if (const auto hello = samples.read<wire::Hello>(message)) {
      survey.publishers.insert(hello->publisher);
      if (!hello->name.empty()) survey.names[hello->publisher] = hello->name;
    } else if (const auto status = samples.read<wire::ProcessStatus>(message)) {
      if (!status->name.empty()) survey.names[status->session] = status->name;
    } else if (const auto header = samples.read<wire::MeshHeader>(message)) {
      if (const auto decoded = decode_header(header->bytes, &tables); decoded.is_ok())
        survey.models[header->content_hash] = {header->name, decoded.value().face_count};
    }
    return true;
  };
  NEARMESH_RETURN_IF_ERROR(recording.read(1, recording.message_count() + 1, take));
  missed.count(survey);
  std::sort(survey.to_certified_s.begin(), survey.to_certified_s.end());
  return survey;
}

}  // namespace nearmesh::subscriber
