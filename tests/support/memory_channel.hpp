// SPDX-License-Identifier: Apache-2.0
#pragma once
// Both channels without a network: one bus, any number of publishers and peers, in one thread. Each
// kind of message may be lost, repeated and delayed (unequally, which reorders) by a seeded policy.
// A transport without a server: publisher::Service serves, where subscriber::LocalChannel is a
// server without a transport. Announcements and the news that somebody is gone arrive as DDS has
// it: late joiners get the former, and a hello is not delivered once its sender is gone. Everything
// the code under test sends must pass wire::check, as it would have to with DDS. Peers acknowledge
// what they take (not counted in `subscriptions`).

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "core/base/random.hpp"
#include "nearmesh/subscriber/peer/channel.hpp"
#include "publisher/serve/channel.hpp"

namespace nearmesh::test {

/// Shares are of messages, in [0, 1]. A delay is drawn from [0, max_delay] ticks for each copy.
struct Faults {
  double lose = 0, repeat = 0;
  std::uint32_t max_delay = 0;
};

class MemoryBus {
 public:
  explicit MemoryBus(std::uint64_t seed = 1) : random_(seed) {}

  Faults on_batches, on_subscriptions, on_poses, on_promises;
  /// Sees every promise before the faults do; may change it; false drops it.
  std::function<bool(wire::BodyPromise&)> promise_filter;
  std::vector<wire::BodyPromises> promises;  ///< all that were sent
  std::vector<wire::WantedPoses> wanted;     ///< all that were sent
  std::uint64_t common_poses = 0,
                near_poses = 0;  ///< of bodies: sent to all; delivered to who wants them
  /// Sees every batch before the faults do; may change it; false drops it.
  std::function<bool(wire::SessionId peer, wire::SplitBatchMessage&)> batch_filter;
  bool accept_batches = true;   ///< false: send() says "not now"
  bool deliver_headers = true;  ///< false: headers are kept back until release_headers()
  std::vector<wire::ContactReport> reports;                 ///< all that were sent
  std::vector<wire::RegionSubscription> subscriptions;      ///< all that were sent, also those lost
  std::map<wire::SessionId, wire::ProcessStatus> statuses;  ///< the last of each process
  std::vector<wire::HeldDetail> held;                       ///< all that were told
  std::vector<wire::WatchedBodies> watched;                 ///< all that were told
  std::vector<wire::BoundsReport> bounds;                   ///< all that were told

  /// The bus must outlive its channels. A channel that goes away is news to the other side, see
  /// keep_quiet.
  std::unique_ptr<publisher::Channel> make_publisher(wire::SessionId id);
  std::unique_ptr<subscriber::Channel> make_peer(wire::SessionId id);

  /// One step of time for delayed messages.
  void tick() { ++now_; }
  /// A message that no code of ours would send.
  void inject(const wire::RegionSubscription& message) { to_publishers(message); }
  void inject(wire::SessionId peer, const wire::SplitBatchMessage& message) {
    if (const auto at = peers_.find(peer); at != peers_.end())
      at->second.batches.push(now_, message);
  }
  void inject(const wire::BodyPose& pose) { to_peers(pose); }
  /// Of bodies that a directory has named, as all that peers send are. What happens on the way to a
  /// peer happens to all of the sample.
  void inject(const wire::BodyPoses& poses) {
    std::vector<wire::BodyPose> sample;
    for (const wire::BodyPoses::Body& body : poses.bodies) {
      const auto told = directories_.find({poses.peer, body.number});
      if (told == directories_.end()) continue;
      begin_to_move(poses.peer, told->second);
      ++common_poses;
      sample.push_back(pose_of(poses, body, told->second));
    }
    for (auto& [id, box] : peers_)
      if (id != poses.peer) post(box.poses, sample, on_poses);
  }
  /// As the writer's filter does it.
  void inject(const wire::NearPoses& poses) {
    for (const auto& [who, wish] : wishes_) {
      if (wish.mover != poses.peer) continue;
      const auto box = peers_.find(wish.peer);
      if (box == peers_.end()) continue;
      for (const wire::BodyPoses::Body& body : poses.bodies) {
        const auto told = directories_.find({poses.peer, body.number});
        if (told == directories_.end() || !wish.wants(body.number)) continue;
        ++near_poses;
        wire::BodyPose near = pose_of(poses, body, told->second);
        near.is_near = true;
        post(box->second.poses, near, on_poses);
      }
    }
  }
  void inject(const wire::BodyPromises& message) {
    for (const wire::BodyPromises::Body& body : message.bodies) {
      const auto told = directories_.find({message.peer, body.number});
      if (told == directories_.end()) continue;
      begin_to_move(message.peer, told->second);
      wire::BodyPromise promise = wire::promise_of(message, body, told->second);
      if (promise_filter && !promise_filter(promise)) continue;
      for (auto& [id, box] : peers_)
        if (id != message.peer) post(box.promises, promise, on_promises);
    }
  }
  void inject(const wire::WantedPoses& message) {
    wishes_[{message.peer, message.mover}] = message;
    if (const auto at = peers_.find(message.mover); at != peers_.end())
      at->second.inbox.wanted.push_back(message);
  }
  /// Who a part of a peer's bodies are, from now on.
  void tell(const wire::BodyDirectory& directory) {
    const std::uint32_t first = directory.part * wire::kBodiesPerPart;
    for (std::uint32_t number = first; number < first + wire::kBodiesPerPart; ++number) {
      const auto before = directories_.extract({directory.peer, number});
      const auto now = std::find_if(directory.bodies.begin(), directory.bodies.end(),
                                    [&](const auto& body) { return body.number == number; });
      if (now != directory.bodies.end()) directories_[{directory.peer, number}] = *now;
      if (before.empty() || !moved_[directory.peer].contains(before.mapped().name)) continue;
      const bool is_gone = now == directory.bodies.end();
      if (is_gone) moved_[directory.peer].erase(before.mapped().name);
      for (auto& [id, box] : peers_) {
        if (id == directory.peer) continue;
        box.inbox.bodies.push_back({is_gone ? before.mapped() : *now, is_gone});
        if (is_gone) forget_said(box, directory.peer, before.mapped().name);
      }
    }
  }
  void inject(const wire::Hello& hello) {
    for (auto& [id, box] : peers_) box.inbox.hellos.push_back(hello);
  }
  void inject(wire::SessionId from, const wire::MeshHeader& header) {
    for (auto& [id, box] : peers_) box.inbox.headers.push_back({from, header});
  }
  /// Who records must be told what is held.
  void bring_recorder() {
    for (auto& [id, box] : peers_) box.inbox.recorder_came = true;
  }
  void release_headers() {
    deliver_headers = true;
    for (const auto& [id, station] : publishers_)
      for (const wire::MeshHeader& header : station.headers) inject(id, header);
  }
  /// A publisher that is lost while its channel goes on, as when its process was frozen beyond the
  /// lease.
  void lose_publisher(wire::SessionId id);
  void lose_peer(wire::SessionId id) {
    for (auto& [publisher, station] : publishers_) station.lost_peers.push_back(id);
  }
  /// What becomes of who moves bodies: the others hear it of all that it has moved.
  void tell_of_mover(wire::SessionId id, wire::Mover what);
  /// What the peer takes next of what is never delayed, for a test to add to.
  [[nodiscard]] subscriber::Channel::Inbox& inbox_of(wire::SessionId peer);
  /// True: a channel that goes away is not noticed before lose_publisher says so.
  bool keep_quiet = false;
  /// No answer is larger, whatever a peer asks for: a flight then takes many.
  std::uint32_t most_splits = std::numeric_limits<std::uint32_t>::max();

 private:
  class PublisherEnd;
  class PeerEnd;

  template <class Message>
  struct Post {
    struct Item {
      std::uint64_t due;
      Message message;
    };
    std::vector<Item> items;
    void push(std::uint64_t due, const Message& message) { items.push_back({due, message}); }
    std::vector<Message> take(std::uint64_t now) {
      std::stable_sort(items.begin(), items.end(),
                       [](const Item& a, const Item& b) { return a.due < b.due; });
      std::vector<Message> due;
      std::size_t count = 0;
      for (; count < items.size() && items[count].due <= now; ++count)
        due.push_back(std::move(items[count].message));
      items.erase(items.begin(), items.begin() + static_cast<std::ptrdiff_t>(count));
      return due;
    }
  };
  struct Station {
    wire::Hello hello;  // publisher 0: nothing announced yet
    std::vector<wire::MeshHeader> headers;
    Post<wire::RegionSubscription> subscriptions;
    std::vector<wire::SessionId> lost_peers;
    publisher::Inbox others;  // what it hears of other publishers
  };
  struct PeerBox {
    subscriber::Channel::Inbox inbox;  // what is never delayed
    Post<wire::SplitBatchMessage> batches;
    Post<wire::BodyPose> poses;
    Post<wire::BodyPromise> promises;
  };

  template <class Use>
  static void for_each_kind(PeerBox& box, const Use& use) {
    use(box.poses.items);
    use(box.promises.items);
  }
  /// Of a body that is gone, or of all of a mover's.
  static void forget_said(PeerBox& box, wire::SessionId mover, const std::string& body = "") {
    for_each_kind(box, [&](auto& items) {
      std::erase_if(items, [&](const auto& item) {
        return item.message.peer == mover && (body.empty() || item.message.body == body);
      });
    });
  }
  void begin_to_move(wire::SessionId mover, const wire::BodyDirectory::Body& body) {
    if (!moved_[mover].insert(body.name).second) return;
    for (auto& [id, box] : peers_)
      if (id != mover) box.inbox.bodies.push_back({body, false});
  }

  template <class Message>
  void post(Post<Message>& to, const Message& message, const Faults& faults) {
    post(to, std::vector{message}, faults);
  }
  /// All at once.
  template <class Message>
  void post(Post<Message>& to, const std::vector<Message>& messages, const Faults& faults) {
    if (random_.unit() < faults.lose) return;
    for (int copies = random_.unit() < faults.repeat ? 2 : 1; copies > 0; --copies) {
      const auto at = now_ + random_.below(faults.max_delay + 1);
      for (const Message& message : messages) to.push(at, message);
    }
  }
  void to_publishers(wire::RegionSubscription message) {
    message.region.max_splits = std::min(message.region.max_splits, most_splits);
    for (auto& [id, station] : publishers_) post(station.subscriptions, message, on_subscriptions);
  }
  static wire::BodyPose pose_of(const wire::BodyPoses& poses, const wire::BodyPoses::Body& body,
                                const wire::BodyDirectory::Body& told) {
    return {.peer = poses.peer,
            .body = told.name,
            .frame = poses.frame,
            .time_s = body.time_s,
            .pose = body.motion.pose,
            .linear_velocity_mps = body.motion.linear_velocity_mps,
            .angular_velocity_radps = body.motion.angular_velocity_radps,
            .number = body.number,
            .sequence = poses.sequence,
            .links = told.links,
            .first_link = told.first_link};
  }
  void to_peers(const wire::BodyPose& pose) {
    for (auto& [id, box] : peers_)
      if (id != pose.peer) post(box.poses, pose, on_poses);
  }
  void keep(const wire::ProcessStatus& status) {
    EXPECT_EQ(wire::check(status).message(), "");
    statuses[status.session] = status;
  }
  void announce(wire::SessionId id, PeerBox& box) const {
    const Station& station = publishers_.at(id);
    if (station.hello.publisher == 0) return;
    box.inbox.hellos.push_back(station.hello);
    if (!deliver_headers) return;
    for (const wire::MeshHeader& header : station.headers)
      box.inbox.headers.push_back({id, header});
  }

  Random random_;
  std::uint64_t now_ = 0;
  std::map<wire::SessionId, Station> publishers_;
  std::map<wire::SessionId, PeerBox> peers_;
  std::map<std::pair<wire::SessionId, wire::SessionId>, wire::WantedPoses> wishes_;
  std::map<wire::SessionId, std::set<std::string>> moved_;  ///< bodies, by who moves them
  std::map<std::pair<wire::SessionId, std::uint32_t>, wire::BodyDirectory::Body> directories_;
};

class MemoryBus::PublisherEnd : public publisher::Channel {
 public:
  PublisherEnd(MemoryBus& bus, wire::SessionId id) : bus_(bus), id_(id) {
    Station& own = bus.publishers_[id];
    for (const auto& [other, station] : bus.publishers_)
      if (station.hello.publisher != 0) own.others.rivals.push_back(station.hello);
  }
  ~PublisherEnd() override {
    if (!bus_.keep_quiet) bus_.lose_publisher(id_);
    bus_.publishers_.erase(id_);
  }
  void announce(const wire::Hello& hello, const std::vector<wire::MeshHeader>& headers) override {
    EXPECT_EQ(wire::check(hello).message(), "");
    for (const wire::MeshHeader& header : headers) EXPECT_EQ(wire::check(header).message(), "");
    Station& station = bus_.publishers_.at(id_);
    station.hello = hello;
    station.headers = headers;
    for (auto& [id, box] : bus_.peers_) bus_.announce(id_, box);
    for (auto& [id, other] : bus_.publishers_)
      if (id != id_) other.others.rivals.push_back(hello);
  }
  publisher::Inbox take() override {
    Station& station = bus_.publishers_.at(id_);
    publisher::Inbox inbox = std::exchange(station.others, {});
    inbox.lost_peers = std::exchange(station.lost_peers, {});
    inbox.subscriptions = station.subscriptions.take(bus_.now_);
    return inbox;
  }
  bool send(wire::SessionId peer, const wire::SplitBatchMessage& batch) override {
    EXPECT_EQ(wire::check(batch).message(), "");
    if (!bus_.accept_batches) return false;
    const auto at = bus_.peers_.find(peer);
    wire::SplitBatchMessage copy = batch;
    if (bus_.batch_filter && !bus_.batch_filter(peer, copy)) return true;
    if (at == bus_.peers_.end()) return true;
    // What happens on the way happens to all of a sample.
    bus_.post(at->second.batches, wire::take_apart(std::move(copy)), bus_.on_batches);
    return true;
  }
  void wait(double) override {}
  void tell(wire::ProcessStatus& status) override { bus_.keep(status); }

 private:
  MemoryBus& bus_;
  const wire::SessionId id_;
};

class MemoryBus::PeerEnd : public subscriber::Channel {
 public:
  PeerEnd(MemoryBus& bus, wire::SessionId id) : bus_(bus), id_(id) {
    PeerBox& box = bus.peers_[id];
    for (const auto& [publisher, station] : bus.publishers_) bus.announce(publisher, box);
    for (const auto& [mover, body] : bus.directories_)
      if (mover.first != id && bus.moved_[mover.first].contains(body.name))
        box.inbox.bodies.push_back({body, false});
  }
  ~PeerEnd() override {
    if (!bus_.keep_quiet) {
      bus_.lose_peer(id_);
      bus_.tell_of_mover(id_, wire::Mover::kLeft);
    }
    bus_.peers_.erase(id_);
  }
  wire::SessionId own_id() const override { return id_; }
  void send(const wire::RegionSubscription& subscription) override {
    EXPECT_EQ(wire::check(subscription).message(), "");
    window_bytes_[subscription.publisher] = subscription.window_bytes;
    bus_.subscriptions.push_back(subscription);
    bus_.to_publishers(subscription);
  }
  void send(const wire::BodyDirectory& directory) override {
    EXPECT_EQ(wire::check(directory).message(), "");
    bus_.tell(directory);
  }
  void send(const wire::BodyPoses& poses) override {
    EXPECT_EQ(wire::check(poses).message(), "");
    bus_.inject(poses);
  }
  void promise(const wire::BodyPromises& promises) override {
    EXPECT_EQ(wire::check(promises).message(), "");
    bus_.promises.push_back(promises);
    bus_.inject(promises);
  }
  void send_near(const wire::NearPoses& poses) override {
    EXPECT_EQ(wire::check(poses).message(), "");
    bus_.inject(poses);
  }
  void want(const wire::WantedPoses& wanted) override {
    EXPECT_EQ(wire::check(wanted).message(), "");
    bus_.wanted.push_back(wanted);
    bus_.inject(wanted);
  }
  void send(const wire::ContactReport& report) override {
    EXPECT_EQ(wire::check(report).message(), "");
    bus_.reports.push_back(report);
  }
  void tell(wire::ProcessStatus& status) override { bus_.keep(status); }
  void tell_held(const wire::HeldDetail& held) override {
    EXPECT_EQ(wire::check(held).message(), "");
    bus_.held.push_back(held);
  }
  void tell_watched(const wire::WatchedBodies& watched) override {
    EXPECT_EQ(wire::check(watched).message(), "");
    bus_.watched.push_back(watched);
  }
  void tell_bounds(const wire::BoundsReport& bounds) override {
    EXPECT_EQ(wire::check(bounds).message(), "");
    bus_.bounds.push_back(bounds);
  }
  Inbox take() override {
    PeerBox& box = bus_.peers_.at(id_);
    Inbox inbox = std::exchange(box.inbox, {});
    inbox.batches = box.batches.take(bus_.now_);
    inbox.poses = box.poses.take(bus_.now_);
    inbox.promises = box.promises.take(bus_.now_);
    std::map<wire::SessionId, std::uint32_t> last;
    for (const wire::SplitBatchMessage& batch : inbox.batches)
      last[batch.publisher] = batch.sequence;
    for (const auto& [publisher, sequence] : last) {
      const auto asked = window_bytes_.find(publisher);
      if (asked == window_bytes_.end()) continue;
      wire::RegionSubscription credit;
      credit.peer = id_;
      credit.publisher = publisher;
      credit.acknowledged_sequence = sequence;
      credit.window_bytes = asked->second;
      bus_.to_publishers(credit);
    }
    return inbox;
  }

 private:
  MemoryBus& bus_;
  const wire::SessionId id_;
  std::map<wire::SessionId, std::uint32_t> window_bytes_;  // by publisher that was asked
};

inline std::unique_ptr<publisher::Channel> MemoryBus::make_publisher(wire::SessionId id) {
  return std::make_unique<PublisherEnd>(*this, id);
}

inline std::unique_ptr<subscriber::Channel> MemoryBus::make_peer(wire::SessionId id) {
  return std::make_unique<PeerEnd>(*this, id);
}

/// Nothing of one that left comes any more.
inline void MemoryBus::tell_of_mover(wire::SessionId id, wire::Mover what) {
  for (auto& [peer, box] : peers_) {
    if (peer == id) continue;
    if (what == wire::Mover::kLeft) forget_said(box, id);
    for (const std::string& body : moved_[id]) box.inbox.movers[body] = what;
  }
}

inline subscriber::Channel::Inbox& MemoryBus::inbox_of(wire::SessionId peer) {
  return peers_.at(peer).inbox;
}

inline void MemoryBus::lose_publisher(wire::SessionId id) {
  for (auto& [peer, box] : peers_) {
    std::erase_if(box.inbox.hellos,
                  [&](const wire::Hello& hello) { return hello.publisher == id; });
    box.inbox.lost_publishers.push_back(id);
  }
  for (auto& [other, station] : publishers_) {
    std::erase_if(station.others.rivals,
                  [&](const wire::Hello& hello) { return hello.publisher == id; });
    station.others.lost_rivals.push_back(id);
  }
}

}  // namespace nearmesh::test
