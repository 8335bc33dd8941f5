// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where a replay is in its recording, and which message is due. Takes a recording and a clock,
// gives messages in order. It knows nothing of what they mean; no DDS here.

#include <cstdint>
#include <deque>
#include <optional>

#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh::publisher {

struct PlayheadOptions {
  double rate = 1;  ///< recorded seconds a second; above 0
  /// Seconds since the recording's begin: what is played is in [start_s, end_s). end_s < 0: to the
  /// last message.
  double start_s = 0, end_s = -1;
};

/// Messages come in the order of the recording, each when its receive time is due; where a receive
/// time lies before that of an earlier message, as they do by milliseconds, it is due with that
/// one. `now_s` is any steady clock. Threads: one at a time. Reads a few hundred messages ahead.
class Playhead {
 public:
  /// Stands at start_s, and runs. The recording must outlive it, and hold a message.
  /// Errors: kInvalidArgument (rate; times outside of the recording, with its range); those of the
  /// reader.
  [[nodiscard]] static Result<Playhead> create(RecordingReader& recording,
                                               const PlayheadOptions& options, double now_s);

  struct Due {
    std::int64_t id = 0;
    RecordedMessage message;
    double late_s = 0;  ///< after it was due
  };
  /// The next message if it is due; when paused, none. Out: nothing, at the end too.
  [[nodiscard]] Result<std::optional<Due>> take(double now_s);
  /// The next message, due or not; time is then at it. Out: nothing at the end.
  [[nodiscard]] Result<std::optional<Due>> take_early(double now_s);
  /// Time until take() has something; 0 when it has. Great when paused or at the end.
  [[nodiscard]] double wait_s(double now_s);

  void pause(double now_s);
  void resume(double now_s);
  [[nodiscard]] bool is_paused() const { return paused_; }
  /// To a time within [start, end]; what lies beyond is taken to the nearer. Runs on, or stays
  /// paused.
  [[nodiscard]] Status seek(double time_s, double now_s);

  /// The first message that is not played yet.
  [[nodiscard]] std::int64_t next_id() const { return next_id_; }
  [[nodiscard]] bool at_end() const { return next_id_ >= end_id_; }
  /// Seconds since the recording's begin, within [start, end].
  [[nodiscard]] double time_s(double now_s) const;
  [[nodiscard]] double start_s() const { return start_s_; }
  [[nodiscard]] double end_s() const { return end_s_; }

 private:
  /// A process that was away for so long (stopped, or a machine asleep) goes on from where it was.
  static constexpr double kLongestGap_s = 1;
  static constexpr std::int64_t kReadAhead = 256;

  explicit Playhead(RecordingReader& recording) : recording_(&recording) {}
  [[nodiscard]] std::int64_t ns_of(double time_s) const;
  void tick(double now_s);
  void set_time(double time_s, double now_s);
  [[nodiscard]] Status read_ahead();
  [[nodiscard]] double due_s();
  Due pop(double late_s);

  RecordingReader* recording_;
  double rate_ = 1, start_s_ = 0, end_s_ = 0;
  std::int64_t next_id_ = 1, end_id_ = 1;
  std::deque<Due> ahead_;                    ///< messages from next_id_ on
  double played_s_ = 0;                      ///< when the last one was due
  double anchor_time_s_ = 0, anchor_s_ = 0;  ///< recording's time and clock, at the same moment
  double last_tick_s_ = 0;
  bool paused_ = false;
};

}  // namespace nearmesh::publisher
