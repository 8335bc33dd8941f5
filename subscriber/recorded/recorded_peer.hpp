// SPDX-License-Identifier: Apache-2.0
#pragma once
// A recorded session, lived through again: each peer takes in its recorded batches just as far as
// each of its reports says, and what it then is may be looked at (takes a recording, gives visits).
// What verify and scenes share. Where batches are missing, a peer is taken up again from where it
// said what it held, with the model's file. No network, no clock: the same on every machine, build
// and number of threads.

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/query/answer.hpp"
#include "core/replica/replica.hpp"
#include "core/spm/coding_sets.hpp"
#include "core/world/content_bytes.hpp"
#include "core/world/tile_sum.hpp"
#include "detail_folder.hpp"
#include "idl/messages/asked_publishers.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

struct RecordedReport {
  std::int64_t id = 0;  ///< of the message
  std::int64_t received_ns = 0;
  wire::ContactReport message;
};

/// Why its answer cannot be certified: that the pose of a body was too far from the frame's time,
/// or its mover gone; or that no pose had come, and it was asked all the same. Empty where that is
/// not so.
[[nodiscard]] std::string why_stale(const wire::ContactReport& report);

/// Whether all that it says is what a session says where nothing is known: that nobody knows.
[[nodiscard]] bool claims_nothing(const wire::ContactReport& report);

/// Of an answer that was cut, since it may have been for its cost: some 10 to 50 ms.
inline constexpr std::uint64_t kCutTests = 2'000'000;

/// What replicas are made of, beside batches.
class ModelSources {
 public:
  explicit ModelSources(DetailFolder* given) : files(given) {}
  DetailFolder* const files;  ///< none given: what a peer says it held is no help

  void take(const wire::MeshHeader& header);
  /// A piece of a page or of a tile's header, whomever it was sent to.
  void take_piece(const wire::SplitBatchMessage& message);
  /// Of those that were recorded; none.
  [[nodiscard]] std::optional<SpmHeader> header(const ContentHash& content) const;
  /// Null where it is neither recorded nor among the files.
  [[nodiscard]] const WorldRecord* world(const ContentHash& content) const;
  [[nodiscard]] const std::string& name_of_world(const ContentHash& content) const;
  /// Null where it is not recorded.
  [[nodiscard]] const WorldPage* page(const ContentHash& content) const;

 private:
  std::map<ContentHash, std::vector<std::uint8_t>> headers_;  // as they travel
  mutable SharedTables tables_;                               // of those that are in use
  std::map<ContentHash, std::pair<WorldRecord, std::string>> worlds_;
  std::map<ContentHash, WorldPage> pages_;
  std::map<ContentHash, ContentReader> unread_;
};

/// A model without whose file reports of a peer cannot be reached.
struct WantedModel {
  std::string name;
  std::uint64_t reports = 0;
};

/// One peer.
class RecordedPeer {
 public:
  RecordedPeer() = default;
  RecordedPeer(const RecordedPeer&) = delete;
  RecordedPeer& operator=(const RecordedPeer&) = delete;
  virtual ~RecordedPeer() = default;

  void take(const wire::RegionSubscription& asked);
  void take(wire::SplitBatchMessage&& batch);
  void take(wire::HeldDetail&& held);
  void take(RecordedReport&& report) { reports_.push_back(std::move(report)); }
  /// Visits reports, in order, as far as what they speak of is here. `final`: nothing more comes.
  void work(const ModelSources& sources, bool final);
  [[nodiscard]] std::uint64_t batches() const { return batches_; }
  /// By content hash.
  [[nodiscard]] const std::map<ContentHash, WantedModel>& wanted() const { return wanted_; }
  /// One line each: why a peer could not be taken up again from what it said it held.
  [[nodiscard]] const std::vector<std::string>& complaints() const { return complaints_; }

 protected:
  /// What there is to a report.
  enum class Standing {
    kReached,   ///< this peer has taken in what the report's had
    kNotAsked,  ///< the peer lacked a header or a pose, so there is nothing to reach
    /// By the times that the report has, or the mover was gone: nothing can be certified, whatever
    /// was here.
    kStale,
    kGaveUp,   ///< the peer had given up detail, and what it held from then on is not recorded
    kLacking,  ///< batches or a header that the peer had are not in the recording
    kNoFile,   ///< the same, but with a model's file it might be reached
    kPutOff,   ///< its turn did not come within the frame's budget, so there is nothing to reach
  };
  virtual void visit(const RecordedReport& report, Standing standing) = 0;

  // Of a report that is reached, inside visit():
  /// Whether both bodies are replicas that have the states which the report names. Never where one
  /// is a world.
  [[nodiscard]] bool is_rebuilt(const wire::ContactReport& report, Standing standing) const;
  /// One line on the first replica that has another state; empty where all have theirs.
  [[nodiscard]] std::string why_not_rebuilt(const wire::ContactReport& report) const;
  [[nodiscard]] const Replica& replica(const ContentHash& content) const;
  /// What Session says of this pair. Of an answer that was cut the search is bounded too, by
  /// kCutTests. Precondition: none is a world.
  [[nodiscard]] Result<Answered> ask(const wire::ContactReport& report,
                                     const AnswerOptions& options = {}) const;
  /// Of a report about a world: the other body, and each tile that was asked, in the tile's place.
  struct AskedTile {
    const WorldEntry* entry = nullptr;  ///< of `around`
    bool asked = false;                 ///< else nothing more is known of it
    Grid grid;
    [[nodiscard]] TreeView view(const Replica& tile) const {
      TreeView view = tile.view();
      view.grid = &grid;
      return view;
    }
  };
  struct AskedWorld {
    const WorldRecord* record = nullptr;
    bool is_found = false;  ///< else the pages or poses that it is about contradict each other
    TilesAround around;
    std::vector<AskedTile> tiles;
  };
  [[nodiscard]] const AskedWorld& asked_world() const { return world_; }
  /// What Session says of the tile and the other body.
  [[nodiscard]] Result<Answered> ask_tile(const wire::ContactReport& report, const AskedTile& tile,
                                          const AnswerOptions& options = {}) const;

 private:
  struct Batch {
    wire::SessionId publisher = 0;
    std::uint32_t sequence = 0, request = 0;
    ContentHash content_hash;
    std::shared_ptr<const std::vector<std::uint8_t>> bytes;  ///< none: the peer takes nothing in
  };
  /// The last of a publisher's batches, and the highest request that any of them answers.
  struct Heard {
    std::uint32_t sequence = 0, request = 0;
  };
  /// Follows the numbers of batches, by publisher, for as long as none is missing.
  struct Numbers {
    std::map<wire::SessionId, Heard> heard;
    bool whole = true;
    /// Out: whether the batch is the next one.
    bool follow(const Batch& batch);
  };
  /// What the peer was sent of one model without a gap: from the base mesh, or from what it said it
  /// held.
  struct Stretch {
    std::optional<wire::HeldDetail> held;
    Numbers numbers;
    std::uint32_t era = 0;
    std::uint32_t first = 0;      ///< so many batches had been taken in at its begin
    std::uint32_t received = 0;   ///< since
    std::deque<Batch> waiting{};  ///< the last of them
    std::optional<Replica> replica{};
    std::uint32_t before = 0;  ///< what the replica's own count lacks
    int rounds = 0;            ///< of work, since another stretch followed it
    bool failed = false;       ///< its begin cannot be made
    bool no_file = false;      ///< for want of a file

    [[nodiscard]] std::uint32_t end() const { return first + received; }
    [[nodiscard]] std::uint32_t taken() const { return replica->taken_batches() + before; }
    void follow(const Batch& batch, const ContentHash& content_hash);
    [[nodiscard]] bool has_heard(const wire::HeldDetail& told) const;
  };
  using Stream = std::deque<Stretch>;  ///< of one model; ascending, never empty
  enum class Reach { kThere, kNotYet, kNever, kNoFile, kGaveUp };
  /// What of a model is to be reached.
  struct Wanted {
    ContentHash content;
    std::uint32_t applied_batches = 0, era = 0;
  };

  void note_asked(wire::SessionId publisher, std::uint32_t since_request);
  void follow(Batch&& batch);
  Stream& stream_of(const ContentHash& content_hash);
  static void drop_followed(Stream& stream);
  [[nodiscard]] Standing look(const wire::ContactReport& report, const ModelSources& sources,
                              bool final, bool& waits);
  [[nodiscard]] Reach reach(const Wanted& wanted, const ModelSources& sources, bool final);
  [[nodiscard]] Reach reach_world(const wire::ContactReport& report, const ModelSources& sources,
                                  bool final);
  [[nodiscard]] Reach find_tiles(const wire::ContactReport& report, const ModelSources& sources);
  void want_world(const ContentHash& content, const ModelSources& sources);
  void hand_over(Stream& stream, const ContentHash& content, const ModelSources& sources);
  [[nodiscard]] bool is_past_patience() const { return waited_rounds_ > kPatientRounds; }
  [[nodiscard]] Reach begin(Stretch& stretch, const ContentHash& content_hash,
                            const ModelSources& sources);
  [[nodiscard]] Status take_up(Stretch& stretch, const Result<SplitBatch>& batch);

  /// What comes by several ways is waited for so many rounds of work.
  static constexpr int kPatientRounds = 2;

  std::map<ContentHash, Stream> streams_;
  std::map<ContentHash, WorldPage> pages_;  // out of files
  AskedWorld world_;
  std::int64_t waits_ = 0;  // the first report's message; and for so many rounds
  int waited_rounds_ = 0;
  Numbers from_start_;
  wire::AskedPublishers asked_;
  std::deque<Batch> unasked_;  // the last of who was not asked, by all that was recorded so far
  std::deque<Batch> latest_;   // that may have come before what was said to be held then
  std::deque<RecordedReport> reports_;
  std::map<ContentHash, WantedModel> wanted_;
  std::vector<std::string> complaints_;
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
  DetailFolder* models = nullptr;  ///< to take peers up again where batches are missing
};

struct Played {
  std::map<std::string, std::unique_ptr<RecordedPeer>> peers;  ///< by partition
  std::uint64_t reports = 0, malformed = 0;
};

/// A recording that still grows, lived through as far as it goes.
class Playing {
 public:
  explicit Playing(PlayPlan plan);
  /// Takes what came since the last call. In: the same recording each time, opened anew. `final`:
  /// nothing more comes.
  /// Errors: those of play(); after one nothing more may be asked.
  [[nodiscard]] Status go_on(RecordingReader& recording, bool final);
  [[nodiscard]] const Played& played() const { return played_; }
  [[nodiscard]] Played finish();

 private:
  PlayPlan plan_;
  ModelSources sources_;
  Played played_;
  std::int64_t next_ = 1;
};

/// Visits of one peer come in order, those of different peers at once. Memory: the peers' replicas,
/// a few thousand messages, and batches that no wanted report speaks of yet.
/// Errors: those of the reader; kUnsupported for another wire version; kIo where there is no memory
/// for replicas.
[[nodiscard]] Result<Played> play(RecordingReader& recording, const PlayPlan& plan);

}  // namespace nearmesh::subscriber
