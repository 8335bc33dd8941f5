// SPDX-License-Identifier: Apache-2.0
#pragma once
// A recorded session, lived through again: each peer takes in its recorded batches just as far as each of its reports says,
// and what it then is may be looked at (takes a recording, gives visits). What verify and scenes share.
// No network, no clock: the same on every machine, build and number of threads.

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "core/query/answer.hpp"
#include "core/replica/replica.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

struct RecordedReport {
  std::int64_t id = 0;  ///< of the message
  std::int64_t received_ns = 0;
  wire::ContactReport message;
};

/// Why its answer cannot be certified: that the pose of a body was too far from the frame's time, or its mover gone. Empty
/// where that is not so, or no pose had come.
[[nodiscard]] std::string why_stale(const wire::ContactReport& report);

using RecordedHeaders = std::map<ContentHash, SpmHeader>;  ///< by content hash

/// One peer.
class RecordedPeer {
 public:
  RecordedPeer() = default;
  RecordedPeer(const RecordedPeer&) = delete;
  RecordedPeer& operator=(const RecordedPeer&) = delete;
  virtual ~RecordedPeer() = default;

  void take(wire::SplitBatchMessage&& batch);
  void take(RecordedReport&& report) { reports_.push_back(std::move(report)); }
  /// Visits reports, in order, as far as what they speak of is here. `final`: nothing more comes.
  void work(const RecordedHeaders& headers, bool final);
  [[nodiscard]] std::uint64_t batches() const { return batches_; }

 protected:
  /// What there is to a report.
  enum class Standing {
    kReached,   ///< this peer has taken in what the report's had
    kNotAsked,  ///< the peer lacked a header or a pose, so there is nothing to reach
    kStale,  ///< by the times that the report has, or the mover was gone: nothing can be certified, whatever was here
    kGaveUp,   ///< the peer had given up detail, which is not recorded
    kLacking,  ///< batches or a header that the peer had are not in the recording
  };
  virtual void visit(const RecordedReport& report, Standing standing) = 0;

  // Of a report that is reached, inside visit():
  [[nodiscard]] const Replica& replica(const wire::ContactReport::Asked& asked) const;
  /// What Session says of this pair.
  [[nodiscard]] Result<Answered> ask(const wire::ContactReport& report,
                                     const AnswerOptions& options = {}) const;

 private:
  /// What the peer was sent of one model, and how much of it is taken in: more than a report says, where reports came out
  /// of order.
  struct Stream {
    std::optional<Replica> replica;
    std::deque<wire::SplitBatchMessage> waiting;
    std::uint32_t received = 0;
  };
  bool reach(const wire::ContactReport::Asked& asked, const RecordedHeaders& headers);

  std::map<ContentHash, Stream> streams_;                   // by content hash
  std::map<wire::SessionId, std::uint32_t> last_sequence_;  // by publisher
  bool gap_ = false;
  std::deque<RecordedReport> reports_;
  std::uint64_t batches_ = 0;
};

/// What of a recording is to be lived through.
struct PlayPlan {
  unsigned threads = 1;  ///< peers are spread over so many
  /// A new peer, by its partition; nullptr: of no interest, its batches are not kept.
  std::function<std::unique_ptr<RecordedPeer>(const std::string& partition)> make_peer;
  /// Which reports to visit, by their messages; none given: all.
  std::function<bool(std::int64_t id)> wants;
  /// Whether the rest may be left out; none given: never.
  std::function<bool()> has_enough;
};

struct Played {
  std::map<std::string, std::unique_ptr<RecordedPeer>> peers;  ///< by partition
  std::uint64_t reports = 0, malformed = 0;
};

/// Visits of one peer come in order, those of different peers at once. Memory: the peers' replicas, a few thousand messages,
/// and batches that no wanted report speaks of yet.
/// Errors: those of the reader; kUnsupported for another wire version; kIo where there is no memory for replicas.
[[nodiscard]] Result<Played> play(RecordingReader& recording, const PlayPlan& plan);

}  // namespace nearmesh::subscriber
