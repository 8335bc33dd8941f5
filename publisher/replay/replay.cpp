// SPDX-License-Identifier: Apache-2.0
#include "replay.hpp"

#include <algorithm>
#include <bit>
#include <utility>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::publisher {
namespace {

/// A peer asks again as soon as it is answered, if that did not help. Where the recording has
/// nothing for it, it is told so only so often.
constexpr double kNothingPeriod_s = 0.1;

}  // namespace

// A class is named by the highest bit of the microseconds and the two below it.
void LateTimes::add(double late_s) {
  const auto us = static_cast<std::uint64_t>(std::clamp(late_s * 1e6 + 0.5, 0.0, 1e9));
  const auto top = static_cast<unsigned>(std::bit_width(us));
  const std::uint64_t place = us < 4 ? us : 4 * (top - 2) + (us >> (top - 3) & 3);
  ++counts_[std::min<std::uint64_t>(kClasses - 1, place)];
  ++total_;
}

double LateTimes::quantile(double share) const {
  std::uint64_t below = 0;
  for (std::size_t i = 0; i < kClasses; ++i) {
    below += counts_[i];
    if (total_ == 0 || static_cast<double>(below) < share * static_cast<double>(total_)) continue;
    const std::uint64_t bound_us = i < 4 ? i + 1 : (i % 4 + 5) << (i / 4 - 1);
    return 1e-6 * static_cast<double>(bound_us);
  }
  return 0;
}

std::uint64_t ReplayStats::messages() const {
  std::uint64_t sum = 0;
  for (const Topic& topic : topics) sum += topic.messages;
  return sum;
}

/// One recorded publisher's share of the outlet.
class Replay::Branch final : public Channel {
 public:
  explicit Branch(ReplayOutlet& outlet) : outlet_(outlet) {}

  Inbox inbox;

  void set_time(double now_s) {
    now_s_ = now_s;
    std::erase_if(held_, [this](const Held& held) {
      return now_s_ >= held.due_s && outlet_.send(held.peer, held.batch);
    });
  }

  /// Hellos and headers are recorded samples.
  void announce(const wire::Hello&, const std::vector<wire::MeshHeader>&) override {}
  Inbox take() override {
    for (const wire::SessionId peer : inbox.lost_peers)
      std::erase_if(held_, [peer](const Held& held) { return held.peer == peer; });
    return std::exchange(inbox, {});
  }
  bool send(wire::SessionId peer, const wire::SplitBatchMessage& batch) override {
    // In order: what follows one that is held waits too.
    const bool waits = std::any_of(held_.begin(), held_.end(),
                                   [peer](const Held& held) { return held.peer == peer; });
    if (waits) return false;
    if (!batch.bytes.empty()) return outlet_.send(peer, batch);
    held_.push_back({peer, batch, now_s_ + kNothingPeriod_s});
    return true;
  }
  void wait(double) override {}

 private:
  struct Held {
    wire::SessionId peer = 0;
    wire::SplitBatchMessage batch;
    double due_s = 0;
  };
  ReplayOutlet& outlet_;
  std::vector<Held> held_;
  double now_s_ = 0;
};

Replay::Replay(RecordingReader& recording, ReplayIndex& index, ReplayOutlet& outlet,
               Playhead playhead, bool loop)
    : recording_(recording),
      index_(index),
      outlet_(outlet),
      playhead_(std::move(playhead)),
      loop_(loop) {
  for (const wire::SessionId id : index.publishers()) {
    Publisher& publisher = publishers_[id];
    publisher.channel = std::make_unique<Branch>(outlet);
    publisher.service = std::make_unique<Service>(*publisher.channel, id);
    for (auto& [hash, detail] : index.details())
      publisher.service->add_answerer(
          hash,
          [this, &detail = detail,
           content = hash](const RegionRequest& request) -> Result<Service::Parts> {
            if (request.is_audit())
              return Status{StatusCode::kUnsupported, "a replay has no file to prove detail from"};
            // At once: what was delivered by now may not be what was delivered by then.
            auto batches = detail.answer(request, playhead_.next_id());
            NEARMESH_RETURN_IF_ERROR(batches);
            return Service::Parts(
                [content, whole = std::move(batches).value()]() mutable -> Result<Service::Part> {
                  return Service::Part{content, std::move(whole), true};
                });
          });
  }
}
Replay::~Replay() = default;

Result<std::size_t> Replay::serve_from(const ModelFolder& models) {
  std::size_t found = 0;
  for (const auto& [content, detail] : index_.details()) {
    const std::optional<std::string> path = models.path_of(content);
    if (!path) continue;
    ++found;
    for (auto& [id, publisher] : publishers_) {
      Result<ModelFile> file = ModelFile::open(*path);
      NEARMESH_RETURN_IF_ERROR(file);
      NEARMESH_RETURN_IF_ERROR(
          publisher.service->add_model(to_hex(content), std::move(file).value()));
    }
  }
  return found;
}

Status Replay::begin() { return restore(std::nullopt); }

Status Replay::step(double now_s) {
  if (outlet_.take_restart()) NEARMESH_RETURN_IF_ERROR(restore(std::nullopt));
  for (int i = 0; i < kBurst; ++i) {
    const Result<std::optional<Playhead::Due>> due = playhead_.take(now_s);
    NEARMESH_RETURN_IF_ERROR(due);
    if (!due.value()) break;
    stats_.late.add(due.value()->late_s);
    play(*due.value());
  }
  NEARMESH_RETURN_IF_ERROR(prepare());
  answer(now_s);
  if (loop_ && playhead_.at_end() && !playhead_.is_paused()) {
    ++stats_.loops;
    return seek(playhead_.start_s(), now_s);
  }
  return Status::ok();
}

Status Replay::prepare() { return index_.take_batches(recording_, kPreparedBatches); }

void Replay::wait(double seconds, double now_s) {
  outlet_.wait(index_.has_all_batches() ? std::min(seconds, playhead_.wait_s(now_s)) : 0);
}

Status Replay::step_to_pose(double now_s) {
  for (bool at_pose = false; !at_pose;) {
    const Result<std::optional<Playhead::Due>> due = playhead_.take_early(now_s);
    NEARMESH_RETURN_IF_ERROR(due);
    if (!due.value()) break;
    play(*due.value());
    const std::uint32_t stream = index_.stream_of(due.value()->message.writer);
    at_pose =
        stream != ReplayIndex::kNotPlayed && index_.streams()[stream].carries<wire::BodyPoses>();
  }
  return Status::ok();
}

Status Replay::seek(double time_s, double now_s) {
  const std::int64_t before = playhead_.next_id();
  NEARMESH_RETURN_IF_ERROR(playhead_.seek(time_s, now_s));
  return restore(before);
}

void Replay::play(const Playhead::Due& due) {
  const std::uint32_t stream = index_.stream_of(due.message.writer);
  if (stream == ReplayIndex::kNotPlayed) return;
  if (!outlet_.publish(stream, due.message.cdr)) {
    ++stats_.failed;
    return;
  }
  ReplayStats::Topic& topic = stats_.topics[index_.streams()[stream].topic];
  ++topic.messages;
  topic.bytes += due.message.cdr.size();
}

/// `before`: where the replay was until now, none where nothing was said yet.
Status Replay::restore(std::optional<std::int64_t> before) {
  const std::int64_t now = playhead_.next_id();
  const auto each = [this](const std::vector<std::int64_t>& ids, const auto& use) {
    for (const std::int64_t id : ids)
      NEARMESH_RETURN_IF_ERROR(
          recording_.read(id, id + 1, [&](std::int64_t, const RecordedMessage& message) {
            use(index_.stream_of(message.writer), message.cdr);
            return true;
          }));
    return Status::ok();
  };
  std::vector<std::int64_t> to_say = index_.latched(now);
  if (before) {
    NEARMESH_RETURN_IF_ERROR(
        each(index_.not_yet(now, *before),
             [this](std::uint32_t stream, const auto& cdr) { outlet_.withdraw(stream, cdr); }));
    // What holds already is not said again: headers are large.
    const std::vector<std::int64_t> said = index_.latched(*before);
    std::erase_if(to_say, [&said](std::int64_t id) {
      return std::binary_search(said.begin(), said.end(), id);
    });
  }
  return each(to_say, [this](std::uint32_t stream, const auto& cdr) {
    ++(outlet_.publish(stream, cdr) ? stats_.restored : stats_.failed);
  });
}

void Replay::answer(double now_s) {
  Inbox inbox = outlet_.take();
  std::erase_if(early_, [&](const wire::RegionSubscription& early) {
    return std::find(inbox.lost_peers.begin(), inbox.lost_peers.end(), early.peer) !=
           inbox.lost_peers.end();
  });
  for (wire::RegionSubscription& subscription : inbox.subscriptions)
    early_.push_back(std::move(subscription));
  std::vector<wire::RegionSubscription> subscriptions;
  if (index_.has_all_batches()) subscriptions.swap(early_);
  for (wire::RegionSubscription& subscription : subscriptions) {
    const auto publisher = publishers_.find(subscription.publisher);
    if (index_.peers().contains(subscription.peer)) {
      refuse(subscription);
    } else if (publisher != publishers_.end())
      publisher->second.channel->inbox.subscriptions.push_back(std::move(subscription));
  }
  stats_.live_peers = stats_.requests = stats_.batches = stats_.batch_bytes = 0;
  for (auto& [id, publisher] : publishers_) {
    publisher.channel->inbox.lost_peers = inbox.lost_peers;
    publisher.channel->set_time(now_s);
    for (std::string& line : publisher.service->step(now_s)) complaints_.push_back(std::move(line));
    const ServiceStats& stats = publisher.service->stats();
    stats_.live_peers = std::max(stats_.live_peers, stats.peers);
    stats_.requests += stats.requests;
    stats_.batches += stats.batches;
    stats_.batch_bytes += stats.bytes;
  }
}

void Replay::refuse(const wire::RegionSubscription& subscription) {
  const std::string peer = wire::partition_of(subscription.peer);
  if (refused_.insert(subscription.peer).second)
    complaints_.push_back("peer " + peer +
                          " is live and in the recording too, and is refused: end one of the two, "
                          "or replay elsewhere (--domain, --prefix)");
  // What asks another publisher is none of ours.
  if (subscription.request == 0 || !publishers_.contains(subscription.publisher)) return;
  wire::SplitBatchMessage refusal = wire::refusal_message(
      subscription.publisher, subscription,
      "a replayed session has a peer with the id " + peer + ", which is refused live");
  refusal.sequence = 1;
  // Where it is not matched yet: it asks again.
  static_cast<void>(outlet_.send(subscription.peer, refusal));
}

std::vector<std::string> Replay::take_complaints() {
  std::vector<std::string> lines = std::exchange(complaints_, {});
  for (std::string& line : outlet_.take_complaints()) lines.push_back(std::move(line));
  return lines;
}

}  // namespace nearmesh::publisher
