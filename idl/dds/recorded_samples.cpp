// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/dds/recorded_samples.hpp"

namespace nearmesh::wire {

Result<RecordedSamples> RecordedSamples::of(const RecordingReader& recording) {
  NEARMESH_RETURN_IF_ERROR(check_recorded_version(recording.facts().wire_version));
  return RecordedSamples(recording);
}

RecordedSamples::RecordedSamples(const RecordingReader& recording) : recording_(&recording) {
  const TopicNames names(recording.facts().prefix);
  for (const RecordedTopic& topic : recording.topics()) places_.push_back(names.find(topic.name));
}

}  // namespace nearmesh::wire
