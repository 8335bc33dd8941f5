// SPDX-License-Identifier: Apache-2.0
#include "survey.hpp"

#include <algorithm>

#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"

namespace nearmesh::subscriber {

Result<Survey> survey(RecordingReader& recording) {
  const Result<wire::RecordedSamples> opened = wire::RecordedSamples::of(recording);
  if (!opened.is_ok()) return opened.status();
  const wire::RecordedSamples& samples = opened.value();
  Survey survey;
  survey.topics.resize(recording.topics().size());
  survey.duration_s = static_cast<double>(recording.end_ns() - recording.begin_ns()) * 1e-9;
  CertifiedTimes open;
  const auto take = [&](std::int64_t, const RecordedMessage& message) {
    const std::uint32_t topic = recording.writers()[message.writer].topic;
    ++survey.topics[topic].samples;
    survey.topics[topic].bytes += message.cdr.size();
    if (const auto report = samples.read<wire::ContactReport>(message)) {
      survey.peers.insert(report->peer);
      ++survey.by_status[report->status];
      survey.contact_pairs += report->pair_count;
      if (const auto began = open.add(*report, {.source_ns = message.source_ns}))
        survey.to_certified_s.push_back(static_cast<double>(message.source_ns - began->source_ns) *
                                        1e-9);
    } else if (const auto pose = samples.read<wire::BodyPose>(message)) {
      survey.peers.insert(pose->peer);
    } else if (const auto asked = samples.read<wire::RegionSubscription>(message)) {
      survey.peers.insert(asked->peer);
    } else if (const auto hello = samples.read<wire::Hello>(message)) {
      survey.publishers.insert(hello->publisher);
    } else if (const auto header = samples.read<wire::MeshHeader>(message)) {
      if (const auto decoded = decode_header(header->bytes); decoded.is_ok())
        survey.models[header->content_hash] = {header->name, decoded.value().face_count};
    }
    return true;
  };
  NEARMESH_RETURN_IF_ERROR(recording.read(1, recording.message_count() + 1, take));
  for (const RecordingGap& gap : recording.gaps())
    survey.topics[recording.writers()[gap.writer].topic].missing += gap.count;
  std::sort(survey.to_certified_s.begin(), survey.to_certified_s.end());
  return survey;
}

}  // namespace nearmesh::subscriber
