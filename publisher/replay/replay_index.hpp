// SPDX-License-Identifier: Apache-2.0
#pragma once
// What must be known of a recording to play it from anywhere: who wrote, which samples hold at a
// moment, and what detail of the models had been delivered by then. Made from the recording's keys,
// without reading what holds nothing. No DDS here. Moments are ids of messages: "at `end`" is when
// all messages before `end` have been played, and none from there on.

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "core/spm/coding_sets.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "replay_detail.hpp"

namespace nearmesh::publisher {

/// One writer to be. The parts of a recording count their writers anew: the same endpoint in two
/// parts is one stream. So are the writers of one publisher's hello: had it joined twice, peers
/// would take the second for an impostor.
struct ReplayStream {
  wire::TopicPlace topic = 0;
  std::string partition;  ///< "" for none

  template <class Message>
  [[nodiscard]] bool carries() const {
    return topic == wire::place_of<Message>();
  }
};

class ReplayIndex {
 public:
  /// `topics`: what is to be played, last parts of names; empty: all. `progress`: told the share
  /// read, now and then; false ends it. Samples that do not decode have a place in their stream and
  /// no other effect.
  /// Errors: those of the reader; kUnsupported for another wire version; kInvalidArgument for a
  /// recording without messages; kNotFound for a topic that is not in the recording.
  [[nodiscard]] static Result<std::unique_ptr<ReplayIndex>> build(
      RecordingReader& recording, const std::vector<std::string>& topics,
      const std::function<bool(double share)>& progress);

  [[nodiscard]] const std::vector<ReplayStream>& streams() const { return streams_; }
  /// By index into the recording's writers; kNotPlayed where its topic is not wanted.
  [[nodiscard]] std::uint32_t stream_of(std::uint32_t writer) const {
    return stream_of_writer_[writer];
  }
  static constexpr std::uint32_t kNotPlayed = 0xffffffffU;

  [[nodiscard]] const std::set<wire::SessionId>& publishers() const { return publishers_; }
  [[nodiscard]] const std::set<wire::SessionId>& peers() const { return peers_; }
  /// By content hash. Those with a header in the recording, where batches are wanted at all.
  /// Complete once all batches were taken in.
  [[nodiscard]] std::map<ContentHash, RecordedDetail>& details() { return details_; }
  /// Takes in the batches of the next samples, at most `most` of these. Errors: the reader's; kIo
  /// where there is no memory for them.
  [[nodiscard]] Status take_batches(RecordingReader& recording, std::size_t most);
  [[nodiscard]] bool has_all_batches() const { return batches_.empty(); }

  /// Messages that hold at `end`, ascending: the latest of each hello, header and pose, and
  /// requests that are not answered in full. Cost: O(keys log messages).
  [[nodiscard]] std::vector<std::int64_t> latched(std::int64_t end) const;
  /// A message of each hello, header and pose of which there is none before `end`, though there is
  /// before `later`.
  [[nodiscard]] std::vector<std::int64_t> not_yet(std::int64_t end, std::int64_t later) const;

 private:
  struct Request {
    std::int64_t id = 0, answered = 0;  ///< answered: the message that ended the answer, 0 for none
    std::uint32_t number = 0;
  };
  using Latch = std::vector<std::int64_t>;  ///< ids, ascending

  ReplayIndex() = default;
  Status add_streams(const RecordingReader& recording, const wire::RecordedSamples& samples,
                     const std::vector<std::string>& topics);
  Status read_keys(RecordingReader& recording, const std::function<bool(double)>& progress);
  Status read_key(RecordingReader& recording, std::uint32_t key);
  void sort();
  void take(std::int64_t id, const RecordedMessage& message);
  void take_hello(std::int64_t id, const RecordedMessage& message);
  template <class Message>
  void take_part(std::int64_t id, std::uint32_t stream, const RecordedMessage& message);
  void add_detail(const RecordedMessage& message);
  void take_batch(std::int64_t id, std::uint32_t stream, const RecordedMessage& message);
  void note_answered(std::int64_t id, std::uint32_t stream, const wire::SplitBatchMessage& sent);

  std::vector<ReplayStream> streams_;
  std::vector<std::uint32_t> stream_of_writer_;
  std::set<wire::SessionId> publishers_, peers_;
  std::map<wire::SessionId, std::uint32_t> hello_stream_;
  SharedTables tables_;  // of these, since those of a world are many
  std::map<ContentHash, RecordedDetail> details_;
  std::map<std::pair<std::uint32_t, std::string>, Latch> latches_;  // by stream and key
  // By the peer's partition and content.
  std::map<std::pair<std::string, ContentHash>, std::vector<Request>> requests_;
  std::deque<std::int64_t> batches_;  ///< samples that are not in the details yet, ascending
  bool plays_batches_ = false;
};

}  // namespace nearmesh::publisher
