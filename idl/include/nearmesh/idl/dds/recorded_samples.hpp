// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// The samples of a recording as messages: which topic each is of, and what it says. No Fast DDS
// here.

#include <cstdint>
#include <optional>
#include <vector>

#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/dds/payload.hpp"

namespace nearmesh::wire {

/// Threads: any number may read of one. It holds nothing but the places of the topics; samples come
/// from RecordingReader::read().
class RecordedSamples {
 public:
  /// The recording must outlive it. Errors: as check_recorded_version.
  [[nodiscard]] static Result<RecordedSamples> of(const RecordingReader& recording);

  /// By index into the recording's topics (RecordingReader::topics()), which must be one of these;
  /// none for a topic that is not in the table.
  [[nodiscard]] std::optional<TopicPlace> place_of(std::uint32_t topic) const {
    return places_[topic];
  }
  /// Whether the sample is of the topic that carries such messages. In: a sample of that recording.
  template <class Message>
  [[nodiscard]] bool is(const RecordedMessage& sample) const {
    return places_[recording_->writers()[sample.writer].topic] == wire::place_of<Message>();
  }
  /// The sample as a message. Nothing where it is of another topic, or does not decode:
  /// decode_payload() says why. Cost: of decoding it.
  template <class Message>
  [[nodiscard]] std::optional<Message> read(const RecordedMessage& sample) const {
    if (!is<Message>(sample)) return std::nullopt;
    Result<Message> message = decode_payload<Message>(sample.cdr);
    if (!message.is_ok()) return std::nullopt;
    return std::move(message).value();
  }
  /// The same of either topic of poses, body_poses and near_poses.
  [[nodiscard]] std::optional<BodyPoses> read_poses(const RecordedMessage& sample) const {
    if (std::optional<NearPoses> near = read<NearPoses>(sample)) return std::move(*near);
    return read<BodyPoses>(sample);
  }

 private:
  explicit RecordedSamples(const RecordingReader& recording);

  const RecordingReader* recording_;
  std::vector<std::optional<TopicPlace>> places_;  ///< by index into the recording's topics
};

}  // namespace nearmesh::wire
