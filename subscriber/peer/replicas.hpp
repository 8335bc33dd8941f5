// SPDX-License-Identifier: Apache-2.0
#pragma once
// The models of a peer: which content a name stands for, the replica and its tree, and the batches
// that wait.

#include <deque>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <utility>
#include <variant>

#include "core/base/lru_map.hpp"
#include "core/broadphase/body_bounds.hpp"
#include "core/replica/replica.hpp"
#include "core/spm/coding_sets.hpp"
#include "detail_cache.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "peer_world.hpp"

namespace nearmesh::subscriber {

/// Headers that are kept though no body uses their model yet, so that one may spawn: as many as a
/// publisher serves (kMaxModels), and together no more than this.
inline constexpr std::size_t kMaxSpareHeaderBytes = 16U << 20;
/// Contents of which nothing can be taken. Of more the first are asked for again.
inline constexpr std::size_t kMaxRefusedContents = 4096;
/// Of replicas that are gone: who is not asked for a content again.
inline constexpr std::size_t kMaxDistrusted = 4096;

struct AskedRequest {
  std::uint32_t request = 0;      ///< 0: none is open
  wire::SessionId publisher = 0;  ///< that was asked

  /// Anybody may write any number: it counts from who was asked.
  [[nodiscard]] bool is_answered_by(const wire::SplitBatchMessage& message) const {
    return request != 0 && request == message.request && publisher == message.publisher;
  }
};

/// Encoded batches of a model that wait to be taken in, in order of arrival.
class WaitingBatches {
 public:
  struct Batch {
    wire::SessionId publisher = 0;
    std::vector<std::uint8_t> bytes;
  };
  /// Of each publisher; some 20 MB. One that answers what it is asked sends far fewer.
  static constexpr std::size_t kMostOfOne = 16'384;

  /// Out: false where as many of its publisher wait: it takes no other's place.
  [[nodiscard]] bool add(Batch&& batch) {
    std::size_t& its = count_of_[batch.publisher];
    if (its == kMostOfOne) return false;
    ++its;
    batches_.push_back(std::move(batch));
    return true;
  }
  /// The oldest. Precondition: one waits.
  [[nodiscard]] Batch take() {
    Batch batch = std::move(batches_.front());
    batches_.pop_front();
    const auto its = count_of_.find(batch.publisher);
    if (--its->second == 0) count_of_.erase(its);
    return batch;
  }
  [[nodiscard]] bool empty() const { return batches_.empty(); }
  [[nodiscard]] std::size_t size() const { return batches_.size(); }

 private:
  std::deque<Batch> batches_;
  std::map<wire::SessionId, std::size_t> count_of_;  // by publisher; none is 0
};

/// A model that bodies of this peer use.
struct PeerModel {
  std::string name;
  ContentHash content_hash;  // none: no content may be taken for it yet
  ContentHash pinned;        // nothing else is ever taken; or none
  std::string conflict;      // what publishers disagree about, as it was said
  std::uint64_t mesh_bytes = 0;
  std::optional<Replica> replica;         // from the header on
  ModelBounds bounds;                     // of the same header
  std::optional<PeerWorld> world;         // instead of a replica: the model is a world
  std::optional<PeerWorld> world_before;  // whose place it takes, until its header comes
  wire::Epoch epoch;                      // of the content
  /// What the name will stand for in the next epoch.
  struct Coming {
    ContentHash content;
    std::optional<PeerWorld> world;  // where it is one, from its header on
  } coming;
  bool is_tile = false;    // of a world, and no name on the bus
  std::string of_world;    // that world's name
  Channel::Header header;  // of the replica: nobody sends it again
  WaitingBatches waiting;
  bool lacks_batches = false;         // some did not find a place, that recorders count as taken in
  std::set<wire::SessionId> damaged;  // publishers whose batches were, as was said
  /// The publisher that was told last where bodies of this model are: it knows what is held, unless
  /// something came or went since that it did not choose. Then it is told with the next request, if
  /// that is not too much.
  wire::SessionId told = 0;
  bool tells_held = false, is_too_much_to_tell = false;
  // By the session's clock: a request about it and others was refused.
  double by_region_until_s = 0;

  /// What probes lack, until it has been asked for.
  struct Probed {
    std::vector<NodeSpan> missing;
    std::vector<GridBox> where;
    bool had_turn = false;      // the last request was for probes: pairs come first now
    std::vector<GridBox> kept;  // where probes lacked something of late: it is not given up
    double kept_until_s = 0;
  } probed;

  struct Audit : AskedRequest {
    NodeSpan node;  // that it is about: another block proves nothing of it
    double sent_s = 0, due_s = 0;
    bool is_answered = false, is_proved = false;
    std::map<wire::SessionId, std::uint32_t> unproved;  // audits in a row, by who was asked
  } audit;

  std::uint64_t left = 0;  ///< in this turn the last body that had it went; 0: bodies have it
  std::optional<double> needed_s;  ///< the update's time when something was near it last
  /// As in wire::ContactReport::Asked. And so many of its replica's give-ups are counted in it.
  std::uint32_t era = 0, noted_give_ups = 0;
  std::uint32_t told_recorders = 0;  // so many of those that came know what is held
  std::uint32_t told_era = 0;        // then

  /// For the next time: batches that were taken in, up to the limits of a file.
  struct Cache {
    bool is_read = false, has_news = false;  // what the file does not hold
    Batches batches;
    std::size_t bytes = 0;

    void keep(std::vector<std::uint8_t>&& batch, bool is_new);
  } cache;
  /// What it has may be a lie: the file goes, too.
  void forget_cache() { cache = {.is_read = true, .has_news = true}; }

  [[nodiscard]] bool is_ready() const { return replica.has_value(); }
  /// Its header is here, of a model or a world.
  [[nodiscard]] bool is_held() const { return is_ready() || world.has_value(); }
};

/// T_L, T_R and T_B go to the report. Of a publisher whose batches are damaged on their way, or
/// contradict the model, one complaint each is made.
class ReplicaSet {
 public:
  /// For a body that has it.
  PeerModel& add(const std::string& name);
  /// No body has it any more. As many such models as a publisher serves stay, for bodies come back
  /// and recordings count their batches; of more, which other peers may name in weeks, those that
  /// were left first go. Nothing stays of one without a header. Out: the contents of models that
  /// are gone.
  std::vector<ContentHash> leave(PeerModel& model);
  [[nodiscard]] PeerModel* find(const std::string& name);
  [[nodiscard]] PeerModel* find(const ContentHash& content_hash);
  void remove(const std::string& name);
  [[nodiscard]] std::map<std::string, PeerModel>& all() { return models_; }
  [[nodiscard]] const std::map<std::string, PeerModel>& all() const { return models_; }

  /// What the model's name stands for from now on, or nothing. Another content than before drops
  /// the replica. Returns the size of a header that had waited for it and is used now.
  std::size_t assign(PeerModel& model, const ContentHash& content,
                     std::vector<std::string>& complaints);
  /// Fetches ahead of an epoch what its content will need first; or of none.
  static void expect(PeerModel& model, const ContentHash& coming);
  /// The worlds of these contents, once their headers are here.
  void prepare_coming();
  [[nodiscard]] PeerWorld* find_coming(const ContentHash& content);
  /// Before a header is kept for a model that no body uses yet: where there is no room for it those
  /// make some that came first of contents that nobody serves now. In weeks there are many of them,
  /// and their publishers, where they come back, send headers with their hellos.
  void make_room_for(const wire::MeshHeader& header,
                     const std::function<bool(const ContentHash&)>& is_served);
  /// A header: starts the replica of the model it belongs to, if any body uses it. Returns its size
  /// if it was used. One that contradicts itself is complained of once, and nothing is taken of
  /// that content any more; of a tile any that cannot be taken, since tiles are asked for until
  /// they are here.
  std::size_t take_header(const Channel::Header& header, std::vector<std::string>& complaints);
  [[nodiscard]] bool is_refused(const ContentHash& content) const {
    return refused_.find(content) != nullptr;
  }
  /// So many contents were refused, ever.
  [[nodiscard]] std::uint64_t refused_count() const { return refused_count_; }
  /// A batch of a content that is not here. What answers an audit of it that was open when it went
  /// proves nothing, and refutes nothing.
  void note_unread(const wire::SplitBatchMessage& message);
  /// Begins an era of each model of which detail was given up since the last call, or batches found
  /// no place.
  void note_given_up();
  /// Applies the oldest waiting batch of some model; false when none waits.
  bool apply_one(FrameReport& report);
  /// What is taken in from here on is kept there, and what was kept waits to be taken in once a
  /// header is there.
  void use_cache(std::string folder) { cache_folder_ = std::move(folder); }
  void read_caches(std::vector<std::string>& complaints);
  /// Replaces files that lack something. Errors: the last of those of write_cached().
  Status write_caches();

 private:
  std::map<std::string, PeerModel> models_;
  // Those that have one, and their names.
  std::map<std::pair<ContentHash, std::string>, PeerModel*> by_content_;
  struct Spare {
    Channel::Header header;
    std::uint64_t came = 0;  // in this turn
  };
  void keep_header(const Channel::Header& header);
  void refuse(const PeerModel& model, const Channel::Header& header, const Status& why,
              std::vector<std::string>& complaints);
  void drop(PeerModel& model);
  void note_gone(const PeerModel& model);
  void drop_spare(std::map<ContentHash, Spare>::iterator spare);
  [[nodiscard]] bool has_room_for(const wire::MeshHeader& header) const;

  std::string cache_folder_;                // none: nothing is kept
  SharedTables tables_;                     // of the tiles of worlds, which are alike
  std::map<ContentHash, Spare> unclaimed_;  // headers of contents that no model in use stands for
  std::size_t unclaimed_bytes_ = 0;
  std::uint64_t spares_that_came_ = 0;
  std::uint64_t models_left_ = 0;
  LruMap<ContentHash, std::monostate> refused_{kMaxRefusedContents};
  std::uint64_t refused_count_ = 0;
  LruMap<std::pair<ContentHash, wire::SessionId>, std::monostate> distrusted_{kMaxDistrusted};
  LruMap<ContentHash, PeerModel::Audit> gone_audits_{kMaxDistrusted};
  std::uint32_t last_era_ = 0;
  // A replica: the era when one was dropped last, for it may be of the same content.
  std::uint32_t begins_in_ = 0;
};

}  // namespace nearmesh::subscriber
