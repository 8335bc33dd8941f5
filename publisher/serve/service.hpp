// SPDX-License-Identifier: Apache-2.0
#pragma once
// The publisher service: answers the region subscriptions of any number of peers from model files
// (or, in a replay, from what was recorded of them).
// Takes RegionSubscription, gives SplitBatchMessage, through a Channel; knows nothing of DDS. A
// peer says where its bodies are and the digest of what it holds. The service has a mirror of that
// state, or asks the peer for it, and chooses what certifies the peer's answers (core/certificate).
// Where it cannot choose, the peer names its unresolved nodes and a region. So a mirror is a memory
// that may be lost at any time, and a batch that was lost is simply asked for again. What else it
// keeps of a peer is its pace, its newest requests, and the batches that wait for it. No peer can
// take more than its share: an answer is made part by part, the peer that has had least of the time
// first, and only while little of it waits to be sent; so whoever asks for everything, floods
// requests or reads slowly costs the others one part (AnswerMaker, below a millisecond) for as much
// of their own, and no memory beyond the requests, what is sorted of one answer (262 kB) and
// kEnoughQueuedBytes and a part of batches.
// The channel bounds how many peers there are.
// Source: the paper, section 3.3 (Server Collect VSplits).

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "channel.hpp"
#include "core/certificate/certificate.hpp"
#include "core/world/world_source.hpp"
#include "idl/messages/status_keeper.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "pacing.hpp"

namespace nearmesh::publisher {

struct ServiceOptions {
  std::uint32_t max_window_bytes = 256 * 1024;  ///< cap on what a peer may have under way
  PacingOptions pacing;
};

struct ServiceStats {
  std::uint64_t requests = 0, refused = 0, batches = 0, bytes = 0, peers = 0;
};

class Service {
 public:
  /// The channel must outlive the service.
  Service(Channel& channel, wire::SessionId session, ServiceOptions options = {});

  /// Serves a model under a name unique to this publisher. `replaces`: peers that hold that content
  /// under the name go over to this one; or none. `epoch`: and only from its beginning on, all in
  /// the same frame. Goes before an answerer of that content. Errors: kInvalidArgument (name, or it
  /// would replace itself), kConflict (name taken).
  [[nodiscard]] Status add_model(const std::string& name, ModelFile file, ContentHash replaces = {},
                                 const wire::Epoch& epoch = {});
  /// Serves a world under a name: pages, tiles' headers and detail, as they are asked for; at most
  /// OpenTiles::kMostTiles tiles are open. Errors: as add_model(); those of WorldSource::open(),
  /// naming the file.
  [[nodiscard]] Status add_world(const std::string& name, const std::string& folder,
                                 ContentHash replaces = {}, const wire::Epoch& epoch = {});
  /// What a part takes, where it is not known better.
  static constexpr double kTurn_s = 2e-4;
  /// Encoded batches; none where nothing is to be sent, or none is made yet.
  struct Part {
    ContentHash content;  ///< which they are of
    std::vector<std::vector<std::uint8_t>> batches;
    bool last = false;
    bool are_pieces = false;    ///< of a content's own bytes, instead of batches
    bool is_of_mirror = false;  ///< it made a part of a mirror, and nothing else
    /// About, without sending; by no clock, so turns are alike in each run.
    double took_s = kTurn_s;
    /// In the place of all that: the peer is to ask otherwise.
    std::optional<wire::SplitBatchMessage> instead = std::nullopt;
    /// Of other contents, after those.
    struct Other {
      ContentHash content;
      std::vector<std::vector<std::uint8_t>> batches;
    };
    std::vector<Other> others = {};
  };
  /// The next part of one answer; a status that is not ok refuses, and nothing follows.
  using Parts = std::function<Result<Part>()>;
  /// What answers requests for a model. A status that is not ok refuses.
  using Answerer = std::function<Result<Parts>(const RegionRequest&)>;
  /// Requests for this content are answered so, and peers are told to ask for regions of it; it is
  /// announced elsewhere.
  void add_answerer(const ContentHash& content_hash, Answerer answerer);
  /// Announces all models that were added by add_model(); call once they are.
  void announce();
  /// Takes what arrived, makes and sends what credit allows, for some milliseconds at most. Never
  /// blocks. `now_s` is any steady clock. Returns one line for refused requests, of each peer at
  /// most one in kRefusalPeriod_s, and for each complaint of the channel, for the log.
  std::vector<std::string> step(double now_s);
  /// The last step() left something that could have been done: call it again without waiting.
  [[nodiscard]] bool is_behind() const { return is_behind_; }
  static constexpr double kRefusalPeriod_s = 10;
  /// Of a peer and urgency: nothing more is made while so much waits to be sent.
  static constexpr std::size_t kEnoughQueuedBytes = 16 * 1024;

  [[nodiscard]] const ServiceStats& stats() const { return stats_; }
  /// As of the last full second of step().
  [[nodiscard]] const wire::ProcessStatus& status() const { return status_; }

 private:
  struct Model {
    std::string name;
    ModelFile file;
    ContentHash replaces;
    wire::Epoch epoch;
  };
  struct World {
    std::string name, path;
    std::unique_ptr<WorldSource> source;
    ContentHash replaces;
    wire::Epoch epoch;
  };
  enum class Kind : std::uint8_t { kRegion, kAudit, kCertificate };  ///< of a request
  static Kind kind_of(const wire::RegionSubscription& request);
  struct Waiting {
    wire::SplitBatchMessage message;
    std::uint8_t priority = 0;
    Kind kind = Kind::kRegion;  ///< of the request that it answers
  };
  /// A request that is not answered in full.
  struct Open {
    wire::RegionSubscription subscription;
    Parts parts;                 ///< empty until it is begun
    bool is_collecting = false;  ///< begun, and nothing has come of it yet
    bool is_making = false;      ///< a mirror
    bool makes_mirrors = false;  ///< before it can be answered, as it seemed when it came
    Kind kind = Kind::kRegion;
    double may_begin_s = 0;  ///< later than now where too much was done for its peer of late
    double restarts_s = 0;   ///< of which what was given up when begun has its part
  };
  struct Peer {
    explicit Peer(const PacingOptions& options) : pacing(options) {}
    /// By content hash, none for all that are not served, for certificates, which are about
    /// several, and for parts of worlds beyond kMaxOpenOfPeer; and kind.
    std::map<std::pair<ContentHash, Kind>, Open> open;
    double served_s = 0;          ///< on the service's clock served_s_: when its turn is over
    std::uint64_t last_turn = 0;  ///< of equals the one whose last turn is longest ago is next
    double said_refusal_s = 0;
    std::optional<std::uint64_t> unsaid_refusals;  ///< none: nothing was ever said of it
    std::deque<Waiting> queue;                     // by priority, then arrival
    Pacing pacing;
    std::uint32_t next_sequence = 1;
    std::uint32_t last_request = 0;
    double told_s = 0;  ///< paid with time for what it said that it holds, up to then
  };

  using Peers = std::map<wire::SessionId, Peer>;

  [[nodiscard]] Status check_new(const std::string& name, const std::string& path,
                                 const ContentHash& content, const ContentHash& replaces) const;
  [[nodiscard]] static Result<Parts> answer(ModelFile& file, const RegionRequest& request);
  [[nodiscard]] WorldSource* world_with(const ContentHash& content) const;
  [[nodiscard]] std::shared_ptr<ModelFile> file_of(const ContentHash& content);
  [[nodiscard]] Result<std::shared_ptr<ModelFile>> open_tile(WorldSource& world,
                                                             const ContentHash& content);
  [[nodiscard]] Result<Parts> answer(WorldSource& world, const wire::RegionSubscription& asked);
  void take_requests(double now_s);
  [[nodiscard]] bool makes_mirrors(const wire::RegionSubscription& asked) const;
  void take_rivals(const Inbox& inbox);
  void find_conflicts(std::vector<std::string>& lines);
  using OpenRequests = decltype(Peer::open);
  struct Room {
    bool for_answer, for_mirror;
  };
  [[nodiscard]] OpenRequests::iterator most_urgent(Peer& peer, const Room& room) const;
  struct Turn {
    Peers::iterator peer;
    OpenRequests::iterator open;
  };
  [[nodiscard]] std::optional<Turn> next_in_turn();
  void serve(const Turn& turn, double now_s, std::vector<std::string>& lines);
  [[nodiscard]] Result<Parts> begin(wire::SessionId id, Peer& peer, const Open& open);
  [[nodiscard]] Parts certify(wire::SessionId id, Peer& peer,
                              const wire::RegionSubscription& asked);
  void refuse(wire::SessionId id, Peer& peer, const Open& open, const std::string& why,
              double now_s, std::vector<std::string>& lines);
  [[nodiscard]] std::vector<wire::SplitBatchMessage> messages_of(std::uint32_t request,
                                                                 Part&& part) const;
  void enqueue(Peer& peer, const Open& open, std::vector<wire::SplitBatchMessage> messages);
  bool send(double now_s);
  bool send_next(wire::SessionId id, Peer& peer, double now_s);
  void tell_status(double now_s);

  Channel& channel_;
  const wire::SessionId session_;
  const ServiceOptions options_;
  std::map<ContentHash, std::shared_ptr<Model>> models_;  // by content hash
  std::map<ContentHash, World> worlds_;
  std::map<ContentHash, Answerer> answerers_;  // of models, and others
  std::set<ContentHash> by_region_;            // of which others answer
  Peers peers_;
  Mirrors mirrors_;
  wire::Hello hello_;                              // as announced
  std::map<wire::SessionId, wire::Hello> rivals_;  // other publishers that are there
  bool has_news_of_rivals_ = false;
  std::set<std::string> conflicts_;  // of names with them, as they were said
  std::uint64_t turns_ = 0;
  /// Goes on from turn to turn, with whoever has had least: who waits for nothing saves nothing up.
  double served_s_ = 0;
  double now_s_ = 0;  ///< of the last step()
  bool is_behind_ = false;
  ServiceStats stats_;
  std::optional<double> began_s_;
  wire::StatusKeeper keeper_;
  wire::ProcessStatus status_;
};

}  // namespace nearmesh::publisher
