// SPDX-License-Identifier: Apache-2.0
// Secured programs over real sockets on 127.0.0.1: who may join, who may serve, and whose a body
// is. Each refusal stands beside somebody who is let in, so that a bus on which nobody hears
// anybody passes no test.

#include <set>

#include "idl/dds/fastdds.hpp"
#include "secured_fixture.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;
using test::kDomain;
using test::kFalse;
using test::kQuiet_s;
using test::kTrue;
using test::Process;
using test::Secured;
using Peer = test::SecuredPeer;

TEST_F(Secured, ParticipantWithoutIdentityMatchesNothing) {
  const std::string set = make_set("set");
  const auto stranger = serve("", kFalse);
  const auto publisher = serve(set + "/serve", kTrue);
  Peer peer = join(set + "/bob"), outside = join("");
  expect_unheard(*stranger, peer);
  ASSERT_TRUE(outside.hears(kFalse));
  move(outside, "arm", 1);
  EXPECT_FALSE(test::await(
      [&] {
        outside.say_again();
        return !peer.collect().poses.empty();
      },
      kQuiet_s));
  for (const wire::Hello& hello : outside.collect().hellos) EXPECT_EQ(hello.publisher, kFalse);
}

TEST_F(Secured, IdentityOfAnotherAuthorityMatchesNothing) {
  const std::string set = make_set("set"), others = make_set("others");
  const auto stranger = serve(others + "/serve", kFalse);
  const auto publisher = serve(set + "/serve", kTrue);
  Peer peer = join(set + "/bob"), outside = join(others + "/bob");
  expect_unheard(*stranger, peer);
  ASSERT_TRUE(outside.hears(kFalse));
  for (const wire::Hello& hello : outside.collect().hellos) EXPECT_EQ(hello.publisher, kFalse);
}

TEST_F(Secured, PermissionsOfAnotherAuthorityGrantNothing) {
  // Alice is known here as a subscriber; elsewhere she signed herself the permissions of a
  // publisher.
  const std::string set = make_set("set"), own = make_set("own", wire::Role::kPublisher);
  const std::string forged = folder.file("forged");
  fs::copy(set + "/alice", forged);
  for (const char* file : {"permissions_ca.cert.pem", "governance.p7s", "permissions.p7s"})
    fs::copy_file(own + "/alice/" + file, forged + "/" + file,
                  fs::copy_options::overwrite_existing);
  const auto stranger = serve(forged, kFalse);
  const auto publisher = serve(set + "/serve", kTrue);
  Peer peer = join(set + "/bob");
  expect_unheard(*stranger, peer);
}

TEST_F(Secured, RoleIsRefusedWhatItMayNotDo) {
  const std::string set = make_set("set");
  for (const char* name : {"/alice", "/rec"}) {
    const auto made = join_as_publisher(set + name);
    ASSERT_FALSE(made.is_ok()) << name;
    EXPECT_NE(made.status().message().find("permissions"), std::string::npos)
        << made.status().message();
  }
  for (const char* name : {"/serve", "/rec"}) {
    subscriber::DdsChannelOptions options;
    options.transport = transport(set + name);
    EXPECT_FALSE(subscriber::DdsChannel::create(options).is_ok()) << name;
  }
}

TEST_F(Secured, BrokenSetIsRefusedWithTheFileAndTheCure) {
  const std::string set = make_set("set");
  fs::permissions(set + "/serve/key.pem", fs::perms::group_read, fs::perm_options::add);
  const auto made = join_as_publisher(set + "/serve");
  ASSERT_FALSE(made.is_ok());
  EXPECT_NE(made.status().message().find("chmod 600"), std::string::npos)
      << made.status().message();
}

TEST_F(Secured, BodyStaysWithItsIdentity) {
  const std::string set = make_set("set");
  Peer watcher = join(set + "/carol"), bob = join(set + "/bob");
  {
    Peer alice = join(set + "/alice");
    move(alice, "arm", 1);
    ASSERT_TRUE(watcher.hears(alice, "arm", 1));
    move(bob, "arm", 2);
    move(bob, "leg", 3);
    ASSERT_TRUE(watcher.hears(bob, "leg", 3));
    EXPECT_EQ(test::heard_in(watcher.all), test::Heard({{"arm", 1}, {"leg", 3}}));
    ASSERT_EQ(watcher.all.complaints.size(), 1U);
    EXPECT_NE(watcher.all.complaints[0].find("body arm"), std::string::npos);
  }
  move(bob, "arm", 4);
  move(bob, "leg", 5);
  ASSERT_TRUE(watcher.hears(bob, "leg", 5));
  EXPECT_EQ(test::heard_in(watcher.all), test::Heard({{"arm", 1}, {"leg", 3}, {"leg", 5}}));
  Peer again = join(set + "/alice");  // another participant and session, the same identity
  move(again, "arm", 6);
  EXPECT_TRUE(watcher.hears(again, "arm", 6));
}

// The more come in one moment, the more of them are introduced to each other by two threads at
// once.
TEST_F(Secured, WhoJoinsAtOnceHearsAllOthers) {
  constexpr std::size_t kPeers = 6;
  constexpr int kRounds = 5;
  const std::string set = make_set("set");
  const std::vector<std::string> identities = {"/alice", "/bob", "/carol"};
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Peer> peers(kPeers);
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < kPeers; ++i)
      threads.emplace_back([&, i] { peers[i] = join(set + identities[i % identities.size()]); });
    for (std::thread& thread : threads) thread.join();
    for (const Peer& peer : peers) ASSERT_NE(peer.channel, nullptr);
    std::uint64_t frame = 0;
    const auto hears_all = [](const Peer& peer) { return peer.all.movers.size() == kPeers - 1; };
    EXPECT_TRUE(test::await([&] {
      ++frame;
      for (std::size_t i = 0; i < kPeers; ++i) move(peers[i], "body" + std::to_string(i), frame);
      for (Peer& peer : peers) peer.collect();
      return std::all_of(peers.begin(), peers.end(), hears_all);
    })) << "round "
        << round;
    for (std::size_t i = 0; i < kPeers; ++i)
      EXPECT_TRUE(hears_all(peers[i])) << "peer " << i << " heard " << peers[i].all.movers.size();
    if (HasFailure()) return;
  }
}

/// A publisher and a peer whose handshake is long.
class LongHandshake : public Secured {
 protected:
  LongHandshake() { process_name = std::string(63, 'n'); }
  [[nodiscard]] wire::SecurityPlan longest_plan() const {
    return plan_of({{publisher_, wire::Role::kPublisher}, {peer_, wire::Role::kSubscriber}});
  }
  void expect_to_pass(const wire::SecurityPlan& plan) const {
    const Status made = wire::make_security(folder.file("set"), plan);
    ASSERT_TRUE(made.is_ok()) << made.message();
    const auto publisher = serve(folder.file("set/" + publisher_), kTrue);
    Peer peer = join(folder.file("set/" + peer_));
    EXPECT_TRUE(peer.hears(kTrue));
  }

 private:
  const std::string publisher_ = std::string(63, 'p'), peer_ = std::string(63, 's');
};

TEST_F(LongHandshake, OfTheLongestNamesPasses) {
  prefix += std::string(100 - prefix.size(), 'x');
  expect_to_pass(longest_plan());
}

TEST_F(LongHandshake, OfAsManyTopicsAsAreTakenPasses) {
  wire::SecurityPlan plan = longest_plan();
  plan.force = true;
  while (wire::make_security(folder.file("set"), plan).is_ok() && plan.topics.size() < 1000)
    plan.topics.emplace_back(20, 't');
  EXPECT_GT(plan.topics.size(), 5U);
  EXPECT_LT(plan.topics.size(), 1000U);
  plan.topics.pop_back();
  expect_to_pass(plan);
}

/// Programs on a secured bus: an aircraft over a ground, served, flown, recorded, checked and
/// verified.
class SecuredPrograms : public Secured {
 protected:
  // Out: how many of 40 answers were certified.
  void fly_over(const std::string& ground, std::uint64_t& certified) {
    const std::string set = folder.file("set");
    const auto on_bus = [&](std::vector<std::string> words, const std::string& identity) {
      words.insert(words.end(), {"--domain", std::to_string(kDomain), "--prefix", prefix});
      if (!identity.empty())
        words.insert(words.end(), {"--interface", "127.0.0.1", "--security", set + "/" + identity});
      return words;
    };
    std::string out, err;
    ASSERT_EQ(test::run(folder, "nearmesh-publisher",
                        on_bus({"make-security", set, "--publisher", "serve", "--subscriber",
                                "alice", "--recorder", "rec"},
                               ""),
                        &out, &err),
              0)
        << err;
    const std::string aircraft = test::model_file("aircraft", 600);
    Process publisher(folder, "nearmesh-publisher", on_bus({"serve", ground, aircraft}, "serve"));
    ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
    Process recorder(folder, "nearmesh-subscriber",
                     on_bus({"record", "-o", folder.file("session.db3")}, "rec"));
    ASSERT_EQ(
        test::run(folder, "nearmesh-demo-flights",
                  {folder.path(), "--size", "48", "--frames", "40", "--rate", "50"}, nullptr, &err),
        0)
        << err;
    folder.write("scene.yaml",
                 "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
                 "  - {name: one, model: aircraft}\nmoves:\n"
                 "  - {body: one, trajectory: flight1.csv}\npairs: [[ground, one]]\n"
                 "frame_rate_hz: 50\nbudget_ms: 5\nlookahead_s: 0.2\n");
    Process peer(folder, "nearmesh-subscriber",
                 on_bus({"run", folder.file("scene.yaml"), "--wait-recorder", "--answers",
                         folder.file("a.jsonl")},
                        "alice"));
    ASSERT_EQ(peer.wait(), 0) << peer.err();
    recorder.signal(SIGINT);
    ASSERT_EQ(recorder.wait(), 0) << recorder.err();
    const test::CheckedAnswers checked =
        test::check_answers(folder, {ground, aircraft}, folder.file("a.jsonl"));
    certified = checked.certified;
    EXPECT_EQ(checked.answers, 40U);
    EXPECT_EQ(checked.wrong, 0U);
    EXPECT_EQ(test::run(folder, "nearmesh-subscriber",
                        {"verify", folder.file("session.db3"), "--allow-unproved"}, &out, &err),
              0)
        << out << err;
  }
};

TEST_F(SecuredPrograms, ReachCertifiedAnswers) {
  std::uint64_t certified = 0;
  fly_over(test::model_file("terrain", 48), certified);
  EXPECT_GT(certified, 20U);
}

// Pages and headers come on demand, and whoever recorded them proves what was said of the tiles.
TEST_F(SecuredPrograms, AreServedAWorldTileByTile) {
  std::string out, err;
  const std::string mesh = folder.file("mesh.ply"), world = folder.file("terrain");
  ASSERT_EQ(test::run(folder, "nearmesh-model", {"generate", "terrain", "--size", "48", "-o", mesh},
                      nullptr, &err),
            0)
      << err;
  ASSERT_EQ(test::run(folder, "nearmesh-model",
                      {"build-world", mesh, "--faces", "200", "-o", world}, nullptr, &err),
            0)
      << err;
  std::uint64_t certified = 0;
  fly_over(world, certified);
  EXPECT_GT(certified, 0U);
  std::set<std::string> tiles;
  for (const std::string& line : test::lines_of(test::read_text(folder.file("a.jsonl"))))
    if (const std::size_t at = line.find("\"tiles\":"); at != std::string::npos)
      tiles.insert(line.substr(at, line.find_first_of(",}", at) - at));
  EXPECT_GT(tiles.size(), 2U) << "tiles come and go";
}

}  // namespace
}  // namespace nearmesh

int main(int argc, char** argv) {
  nearmesh::wire::speak_through_transports();
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
