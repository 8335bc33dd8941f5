// SPDX-License-Identifier: Apache-2.0
#pragma once
// Plays a recording to live peers: recorded samples go out as they were, when they are due, and
// live subscriptions to the recorded publishers are answered with what had been delivered by then.
// Takes a recording, gives bytes to an outlet; knows nothing of DDS.
// What a peer that joins at a moment finds (hellos, headers, poses, detail) depends on the moment
// alone, however the replay came there: played, sought, or looped. A seek back withdraws what was
// not yet said. What no recorded peer was sent is not sent here either, unless the models' files
// are at hand: a live peer that needs it says "uncertain".
// A live peer with the id of a recorded one is refused: answers to it would mix with what the
// recorded one was sent.

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/spm/model_folder.hpp"
#include "playhead.hpp"
#include "publisher/serve/service.hpp"
#include "replay_index.hpp"

namespace nearmesh::publisher {

/// Where a replay's samples go, and live subscriptions come from. Two implementations: DDS
/// (dds_replay.cpp) and one in memory, in the tests. Streams are named by their place in the index.
class ReplayOutlet {
 public:
  virtual ~ReplayOutlet() = default;

  /// False when it could not be sent, for good.
  virtual bool publish(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) = 0;
  /// Late joiners shall not get the latest sample of this one's key any more.
  virtual void withdraw(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) = 0;
  /// True once after all endpoints were made anew, so that nothing is latched.
  [[nodiscard]] virtual bool take_restart() = 0;

  /// As Channel's, for all recorded publishers together.
  [[nodiscard]] virtual Inbox take() = 0;
  [[nodiscard]] virtual bool send(wire::SessionId peer, const wire::SplitBatchMessage& batch) = 0;
  virtual void wait(double seconds) = 0;
  [[nodiscard]] virtual std::vector<std::string> take_complaints() = 0;
};

/// How late messages were, in classes of four to an octave from a microsecond up.
class LateTimes {
 public:
  void add(double late_s);
  /// The least bound of a class below which lies at least this share; 0 when nothing was added.
  [[nodiscard]] double quantile(double share) const;

 private:
  static constexpr std::size_t kClasses = 128;
  std::array<std::uint64_t, kClasses> counts_{};
  std::uint64_t total_ = 0;
};

struct ReplayStats {
  struct Topic {
    std::uint64_t messages = 0, bytes = 0;
  };
  std::array<Topic, wire::kTopicCount> topics{};  ///< played, by place; not what a seek restored
  std::uint64_t restored = 0;  ///< sent after a start within the session, a seek, or a loop
  std::uint64_t failed = 0;    ///< not taken by the outlet
  std::uint64_t loops = 0;     ///< begun again so many times
  LateTimes late;
  std::uint64_t live_peers = 0;                              ///< that ask now
  std::uint64_t requests = 0, batches = 0, batch_bytes = 0;  ///< of live peers, and the answers

  [[nodiscard]] std::uint64_t messages() const;
};

/// Threads: one at a time. Whatever it is given must outlive it.
class Replay {
 public:
  Replay(RecordingReader& recording, ReplayIndex& index, ReplayOutlet& outlet, Playhead playhead,
         bool loop);
  ~Replay();

  /// Live peers are answered from these files where they have the content, with all of its detail
  /// at any time: so new trajectories that are flown against the recording get certified answers.
  /// Before begin(). Errors: those of the files.
  /// Out: so many of the recorded contents have a file.
  [[nodiscard]] Result<std::size_t> serve_from(const ModelFolder& models);
  /// Sends what holds at the start. Errors: the reader's.
  [[nodiscard]] Status begin();
  /// Sends what is due, at most kBurst messages, and answers live peers. Never blocks but on the
  /// disk.
  [[nodiscard]] Status step(double now_s);
  /// Prepares answers to live peers, for some milliseconds; step() does so too. Live peers are
  /// answered when all is prepared, which an hour of ten peers takes a second of.
  [[nodiscard]] Status prepare();
  /// Blocks until something is due or came in, at most `seconds`; not while answers are to be
  /// prepared.
  void wait(double seconds, double now_s);
  /// When paused: plays on up to the next pose, and with it.
  [[nodiscard]] Status step_to_pose(double now_s);
  /// Clamped to the part that is played.
  [[nodiscard]] Status seek(double time_s, double now_s);

  [[nodiscard]] Playhead& playhead() { return playhead_; }
  /// All was played; never in a loop, nor while paused, from where one may still go back.
  [[nodiscard]] bool is_done() const {
    return !loop_ && !playhead_.is_paused() && playhead_.at_end();
  }
  [[nodiscard]] const ReplayStats& stats() const { return stats_; }
  /// One line each since the last call.
  [[nodiscard]] std::vector<std::string> take_complaints();

 private:
  static constexpr int kBurst = 256;
  static constexpr std::size_t kPreparedBatches = 64;  ///< at once: some 3 ms
  class Branch;
  struct Publisher {
    std::unique_ptr<Branch> channel;
    std::unique_ptr<Service> service;
  };

  void play(const Playhead::Due& due);
  [[nodiscard]] Status restore(std::optional<std::int64_t> before);
  void answer(double now_s);
  void refuse(const wire::RegionSubscription& subscription);

  RecordingReader& recording_;
  ReplayIndex& index_;
  ReplayOutlet& outlet_;
  Playhead playhead_;
  const bool loop_;
  std::map<wire::SessionId, Publisher> publishers_;
  std::set<wire::SessionId> refused_;            ///< live peers with ids of recorded ones
  std::vector<wire::RegionSubscription> early_;  ///< that came before answers were prepared
  ReplayStats stats_;
  std::vector<std::string> complaints_;
};

}  // namespace nearmesh::publisher
