// SPDX-License-Identifier: Apache-2.0
#include "survey.hpp"

#include <algorithm>

#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/idl/dds/payload.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber {

Result<Survey> survey(RecordingReader& recording) {
  NEARMESH_RETURN_IF_ERROR(wire::check_recorded_version(recording.facts().wire_version));
  Survey survey;
  survey.topics.resize(recording.topics().size());
  survey.duration_s = static_cast<double>(recording.end_ns() - recording.begin_ns()) * 1e-9;
  const wire::TopicNames names(recording.facts().prefix);
  CertifiedTimes open;
  const auto take = [&](std::int64_t, const RecordedMessage& message) {
    const std::uint32_t topic = recording.writers()[message.writer].topic;
    ++survey.topics[topic].samples;
    survey.topics[topic].bytes += message.cdr.size();
    const std::string& name = recording.topics()[topic].name;
    if (name == names.contact_report) {
      if (const auto report = wire::decode_payload<wire::ContactReport>(message.cdr);
          report.is_ok()) {
        survey.peers.insert(report.value().peer);
        ++survey.by_status[report.value().status];
        survey.contact_pairs += report.value().pair_count;
        if (const auto began = open.add(report.value(), {.source_ns = message.source_ns}))
          survey.to_certified_s.push_back(
              static_cast<double>(message.source_ns - began->source_ns) * 1e-9);
      }
    } else if (name == names.body_pose) {
      if (const auto pose = wire::decode_payload<wire::BodyPose>(message.cdr); pose.is_ok())
        survey.peers.insert(pose.value().peer);
    } else if (name == names.region_subscription) {
      if (const auto asked = wire::decode_payload<wire::RegionSubscription>(message.cdr);
          asked.is_ok())
        survey.peers.insert(asked.value().peer);
    } else if (name == names.hello) {
      if (const auto hello = wire::decode_payload<wire::Hello>(message.cdr); hello.is_ok())
        survey.publishers.insert(hello.value().publisher);
    } else if (name == names.mesh_header) {
      if (const auto header = wire::decode_payload<wire::MeshHeader>(message.cdr); header.is_ok())
        if (const auto decoded = decode_header(header.value().bytes); decoded.is_ok())
          survey.models[header.value().content_hash] = {header.value().name,
                                                        decoded.value().face_count};
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
