// SPDX-License-Identifier: Apache-2.0
// Several publishers of one content, in processes of their own, and peers that ask them: who asks
// whom, and how soon another one answers when one is killed.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <map>
#include <set>
#include <utility>

#include "nearmesh/subscriber/peer/session.hpp"
#include "network_fixture.hpp"
#include "subscriber/peer/publisher_choice.hpp"

namespace nearmesh::test {
namespace {

constexpr std::size_t kPeers = 12;

/// Passes everything on, and remembers who was asked and who is there.
class Overheard final : public subscriber::Channel {
 public:
  explicit Overheard(std::unique_ptr<subscriber::DdsChannel> below) : below_(std::move(below)) {}
  [[nodiscard]] wire::SessionId own_id() const override { return below_->own_id(); }
  void send(const wire::RegionSubscription& request) override {
    ++asked[request.publisher];
    below_->send(request);
  }
  void send(const wire::BodyPoses& poses) override { below_->send(poses); }
  void send(const wire::BodyDirectory& bodies) override { below_->send(bodies); }
  void send(const wire::ContactReport& report) override { below_->send(report); }
  void tell_watched(const wire::WatchedBodies& watched) override { below_->tell_watched(watched); }
  void tell_bounds(const wire::BoundsReport& bounds) override { below_->tell_bounds(bounds); }
  [[nodiscard]] Inbox take() override {
    Inbox inbox = below_->take();
    for (const wire::Hello& hello : inbox.hellos) there.insert(hello.publisher);
    return inbox;
  }

  std::map<wire::SessionId, int> asked;  ///< since it was emptied
  std::set<wire::SessionId> there;       ///< publishers that were ever heard

 private:
  const std::unique_ptr<subscriber::DdsChannel> below_;
};

/// Goes from place to place over the terrain, where it lacks detail each time.
class Wanderer {
 public:
  Wanderer(const Exercise& exercise, wire::SessionId id) {
    subscriber::DdsChannelOptions options;
    options.transport.domain = exercise.domain;
    options.session = id;
    auto channel =
        std::make_unique<Overheard>(std::move(subscriber::DdsChannel::create(options)).value());
    heard = channel.get();
    session_ = std::make_unique<subscriber::Session>(
        std::move(channel), subscriber::SessionOptions{.lookahead_s = 0, .max_held_splits = 200});
    const auto ground = session_->add_body({.name = "ground", .model = "terrain"}).value();
    own_ =
        session_->add_body({.name = "own" + std::to_string(id), .model = "aircraft", .own = true})
            .value();
    EXPECT_TRUE(session_->place_body(ground, {}).is_ok());
    EXPECT_TRUE(session_->watch(ground, own_).is_ok());
    place_ = 37 * id;
  }

  /// One frame: at the place where it waits for an answer, or else at the next. `waits_s` takes the
  /// time of one that had to wait.
  void update(double now_s, std::vector<double>& waits_s) {
    std::vector<subscriber::Session::OwnMotion> motions;
    if (is_certified_) {
      ++place_;
      Motion motion;
      motion.pose.translation_m = {std::fmod(97.0 * static_cast<double>(place_), 1400.0) - 700,
                                   std::fmod(61.0 * static_cast<double>(place_), 1400.0) - 700,
                                   60.0};
      motions.push_back({own_, motion});
      asked_s_ = now_s;
      has_waited_ = false;
    }
    const auto report = session_->update(++frame_, now_s, motions, 0.005);
    ASSERT_TRUE(report.is_ok()) << report.status().message();
    is_certified_ = report.value().all_certified();
    if (is_certified_ && has_waited_) waits_s.push_back(now_s - asked_s_);
    has_waited_ = !is_certified_;
  }
  [[nodiscard]] double waits_since_s(double now_s) const {
    return is_certified_ ? 0 : now_s - asked_s_;
  }

  Overheard* heard = nullptr;

 private:
  std::unique_ptr<subscriber::Session> session_;
  subscriber::BodyId own_;
  std::uint64_t frame_ = 0, place_ = 0;
  double asked_s_ = 0;
  bool is_certified_ = true, has_waited_ = false;
};

class SharingTest : public NetworkFixture {
 protected:
  void begin(std::size_t publishers) {
    make_network();
    for (std::size_t i = 0; i < publishers; ++i) add_publisher();
    begin_to_fly();
  }
  void make_network() {
    models = exercise();
    lan = std::make_unique<Lan>(std::vector<Link>{{}, {}});
  }
  void begin_to_fly() {
    const Lan::Visit visit = lan->visit(1);
    for (wire::SessionId id = 1; id <= kPeers; ++id) peers.emplace_back(models, id);
    ASSERT_TRUE(await([this] {
      fly(0.1);
      return std::all_of(peers.begin(), peers.end(), [this](const Wanderer& peer) {
        return peer.heard->there.size() == processes.size();
      });
    }));
    names.assign(peers[0].heard->there.begin(), peers[0].heard->there.end());
    fly(1);
  }
  void add_publisher() { processes.push_back(serve(*lan, folder, models)); }
  /// One with that number.
  void add_publisher(wire::SessionId id) {
    const Lan::Visit visit = lan->visit(0);
    std::vector<std::string> words{std::to_string(models.domain), std::to_string(id)};
    words.insert(words.end(), models.models.begin(), models.models.end());
    processes.push_back(std::make_unique<Process>(folder, "nearmesh-network-publisher", words));
    ASSERT_TRUE(processes.back()->says("ready")) << processes.back()->err();
  }
  void kill(std::size_t publisher) {
    processes[publisher]->signal(SIGKILL);
    static_cast<void>(processes[publisher]->wait());
  }
  /// Flies for so long after a kill. Out: the longest wait of any peer, without the longest time in
  /// which this program was held up.
  double fly_after_kill(double seconds) {
    const double killed_s = clock.seconds();
    std::vector<double> waits_s;
    double worst_s = 0, held_up_s = 0, turn_s = killed_s;
    while (clock.seconds() - killed_s < seconds) {
      held_up_s = std::max(held_up_s, clock.seconds() - std::exchange(turn_s, clock.seconds()));
      for (Wanderer& peer : peers) {
        peer.update(clock.seconds(), waits_s);
        worst_s = std::max(
            worst_s, std::min(peer.waits_since_s(clock.seconds()), clock.seconds() - killed_s));
      }
      pause(0.01);
    }
    return worst_s - held_up_s;
  }
  /// Of each peer the publisher that it prefers.
  [[nodiscard]] std::vector<wire::SessionId> favourites() const {
    std::vector<wire::SessionId> all;
    for (const Wanderer& peer : peers) all.push_back(favourite(peer.heard->own_id()));
    return all;
  }

  /// Times of answers that had to wait.
  std::vector<double> fly(double seconds) {
    std::vector<double> waits_s;
    for (const Stopwatch watch; watch.seconds() < seconds;) {
      for (Wanderer& peer : peers) peer.update(clock.seconds(), waits_s);
      pause(0.01);
    }
    std::sort(waits_s.begin(), waits_s.end());
    return waits_s;
  }

  [[nodiscard]] wire::SessionId favourite(wire::SessionId peer) const {
    return *std::max_element(names.begin(), names.end(), [&](auto a, auto b) {
      return subscriber::preference(peer, a) < subscriber::preference(peer, b);
    });
  }
  /// Flies for a while. Every peer asks the one that it prefers among those there, and no other.
  void expect_shares(const char* what) {
    std::vector<double> waits_s;
    // Who is silent for half a second has its peers ask another one: a publisher that is held up.
    EXPECT_TRUE(await([&] {
      fly(1);
      for (Wanderer& peer : peers) peer.heard->asked.clear();
      waits_s = fly(3);
      return std::all_of(peers.begin(), peers.end(), [this](const Wanderer& peer) {
        const std::map<wire::SessionId, int>& asked = peer.heard->asked;
        return asked.size() == 1 && asked.contains(favourite(peer.heard->own_id()));
      });
    })) << what;
    std::map<wire::SessionId, int> load;
    for (const Wanderer& peer : peers) ++load[favourite(peer.heard->own_id())];
    std::printf("%s: peers of each", what);
    for (const wire::SessionId name : names) std::printf(" %d", load[name]);
    std::printf("; %zu answers waited, %.3f s (median), %.3f s (worst)\n", waits_s.size(),
                waits_s.empty() ? 0 : waits_s[waits_s.size() / 2],
                waits_s.empty() ? 0 : waits_s.back());
  }

  Exercise models;
  std::unique_ptr<Lan> lan;
  std::vector<std::unique_ptr<Process>> processes;
  std::vector<wire::SessionId> names;  ///< of the publishers that are there
  std::vector<Wanderer> peers;
  const Stopwatch clock;
};

TEST_F(SharingTest, PeersOfOneThatIsKilledAreServedByOthersWithinASecond) {
  begin(3);
  expect_shares("three publishers");

  kill(0);
  const double worst_s = fly_after_kill(6);
  std::printf("one of three killed: longest wait of any peer in the next 6 s %.3f s\n", worst_s);
  EXPECT_LT(worst_s, 1.5);  // of a machine at work; 1 s is promised
  // Who is gone is whom nobody asks any more.
  std::set<wire::SessionId> asked;
  EXPECT_TRUE(await([&] {
    for (Wanderer& peer : peers) peer.heard->asked.clear();
    fly(3);
    asked.clear();
    for (const Wanderer& peer : peers)
      for (const auto& [name, count] : peer.heard->asked) asked.insert(name);
    return asked.size() <= 2;
  }));
  std::vector<wire::SessionId> left;
  for (const wire::SessionId name : names)
    if (asked.contains(name)) left.push_back(name);
  names = left;
  expect_shares("two left");

  const std::set<wire::SessionId> known = peers[0].heard->there;
  add_publisher();
  ASSERT_TRUE(await([this] {
    fly(0.1);
    return std::all_of(peers.begin(), peers.end(),
                       [](const Wanderer& peer) { return peer.heard->there.size() == 4; });
  }));
  for (const wire::SessionId name : peers[0].heard->there)
    if (!known.contains(name)) names.push_back(name);
  expect_shares("a new one beside them");
}

/// Numbers that do not change from run to run, by which the hash gives each publisher the same:
/// whoever asks another one is noticed. One that comes or goes moves its own peers alone.
TEST_F(SharingTest, AFourthTakesItsShareWhileAllLiveAndGivesItBackWhenKilled) {
  const std::vector<wire::SessionId> three{101, 102, 106};
  static constexpr wire::SessionId kFourth = 109;
  make_network();
  for (const wire::SessionId id : three) add_publisher(id);
  begin_to_fly();
  ASSERT_EQ(names, three);
  const auto expect_even = [this](const std::vector<wire::SessionId>& asked) {
    for (const wire::SessionId name : names)
      EXPECT_EQ(std::count(asked.begin(), asked.end(), name),
                static_cast<std::ptrdiff_t>(kPeers / names.size()));
  };
  expect_shares("three publishers");
  const std::vector<wire::SessionId> before = favourites();
  expect_even(before);

  add_publisher(kFourth);
  ASSERT_TRUE(await([this] {
    fly(0.1);
    return std::all_of(peers.begin(), peers.end(),
                       [](const Wanderer& peer) { return peer.heard->there.contains(kFourth); });
  }));
  names.push_back(kFourth);
  expect_shares("a fourth beside them");
  const std::vector<wire::SessionId> with = favourites();
  expect_even(with);
  for (std::size_t i = 0; i < with.size(); ++i)
    EXPECT_TRUE(with[i] == before[i] || with[i] == kFourth) << "peer " << i + 1;

  kill(3);
  const double worst_s = fly_after_kill(6);
  std::printf("it is killed: longest wait of any peer in the next 6 s %.3f s\n", worst_s);
  EXPECT_LT(worst_s, 1.5);  // of a machine at work; 1 s is promised
  names.pop_back();
  expect_shares("three again");
  EXPECT_EQ(favourites(), before);
}

TEST_F(SharingTest, OneAloneServesAll) {
  begin(1);
  expect_shares("one publisher");
}

}  // namespace
}  // namespace nearmesh::test
