// SPDX-License-Identifier: Apache-2.0
// Secured programs whose certificate stops to count while they run: revoked, or at its end.

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/base/stopwatch.hpp"
#include "idl/security/security_crypto.hpp"
#include "secured_fixture.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;
using test::kDomain;
using test::kQuiet_s;
using test::kTrue;
using test::Process;

class Revoked : public test::Secured {
 protected:
  void revoke(const std::string& set, const std::string& name) const {
    const auto report =
        wire::revoke_identities(set, {static_cast<std::uint32_t>(kDomain), prefix, {name}});
    EXPECT_TRUE(report.is_ok()) << report.status().message();
  }
  // A certificate of alice's that ends so soon, with her name and a key of its own.
  static void shorten(const std::string& set, int seconds) {
    constexpr std::time_t kDay_s = 24 * 3600;
    const std::string authority = set + "/private/identity_ca";
    auto certificate = wire::crypto::read_certificate(authority + ".cert.pem");
    auto key = wire::crypto::read_key(authority + ".key.pem");
    ASSERT_TRUE(certificate.is_ok() && key.is_ok());
    const wire::crypto::Issuer issuer{std::move(key).value(), std::move(certificate).value()};
    const auto made =
        wire::crypto::make_identity("alice", 1, std::time(nullptr) - kDay_s + seconds, &issuer);
    ASSERT_TRUE(made.is_ok());
    std::ofstream(set + "/alice/cert.pem") << wire::crypto::to_pem(*made.value().certificate);
    std::ofstream(set + "/alice/key.pem") << wire::crypto::to_pem(*made.value().key).value();
  }
  static bool becomes(test::SecuredPeer& peer, const std::string& body, wire::Mover mover) {
    return test::await([&] { return peer.collect().movers[body] == mover; });
  }
  static int count(const test::SecuredPeer& peer, const std::string& words) {
    return static_cast<int>(std::count_if(
        peer.all.complaints.begin(), peer.all.complaints.end(),
        [&](const std::string& line) { return line.find(words) != std::string::npos; }));
  }
  /// A complaint with these words is made, once.
  static bool comes(test::SecuredPeer& peer, const std::string& words) {
    return test::await([&] {
             static_cast<void>(peer.collect());
             return count(peer, words) > 0;
           }) &&
           count(peer, words) == 1;
  }
  // Alice moves the arm and bob the leg; all others, and the publisher, hear both.
  void fly(const std::string& set, const std::function<void()>& end_alice, const char* why) {
    const auto publisher = serve(set + "/serve", kTrue);
    test::SecuredPeer alice = join(set + "/alice"), bob = join(set + "/bob"),
                      carol = join(set + "/carol");
    ASSERT_TRUE(alice.hears(kTrue) && bob.hears(kTrue) && carol.hears(kTrue));
    move(alice, "arm", 1);
    ASSERT_TRUE(carol.hears(alice, "arm", 1) && bob.hears(alice, "arm", 1));
    move(bob, "leg", 2);
    ASSERT_TRUE(carol.hears(bob, "leg", 2));
    ASSERT_TRUE(becomes(bob, "arm", wire::Mover::kThere));
    alice.channel->send(request_of(alice, kTrue));
    ASSERT_TRUE(test::await([&] { return !publisher->take().subscriptions.empty(); }));

    end_alice();
    const Stopwatch since;
    const wire::SessionId lost = alice.channel->own_id();
    EXPECT_TRUE(test::await([&] {
      const auto peers = publisher->take().lost_peers;
      return std::find(peers.begin(), peers.end(), lost) != peers.end();
    }));
    EXPECT_FALSE(publisher->send(lost, wire::SplitBatchMessage{}));
    EXPECT_TRUE(becomes(carol, "arm", wire::Mover::kBarred));
    EXPECT_TRUE(becomes(bob, "arm", wire::Mover::kBarred));
    EXPECT_TRUE(test::await([&] { return !alice.channel->identity().is_ok(); }));
    RecordProperty("seconds", std::to_string(since.seconds()));
    EXPECT_NE(alice.channel->identity().message().find(why), std::string::npos)
        << alice.channel->identity().message();
    // She cannot bring herself back, and nobody else notices anything.
    move(alice, "arm", 3);
    bob.channel->send(request_of(bob, kTrue));
    EXPECT_TRUE(test::await([&] { return !publisher->take().subscriptions.empty(); }));
    move(bob, "leg", 4);
    alice.say_again();
    ASSERT_TRUE(carol.hears(bob, "leg", 4));
    EXPECT_FALSE(test::heard_in(carol.all).contains({"arm", 3}));
    EXPECT_EQ(carol.all.movers["leg"], wire::Mover::kThere);
    EXPECT_EQ(carol.all.movers["arm"], wire::Mover::kBarred);
    EXPECT_TRUE(comes(carol, why));
    EXPECT_TRUE(carol.channel->identity().is_ok());
    EXPECT_TRUE(comes(alice, "this program's identity alice"));
  }
};

TEST_F(Revoked, EndsAtAllOthers) {
  const std::string set = make_set("set");
  fly(
      set, [&] { revoke(set, "alice"); }, "was revoked");
}

TEST_F(Revoked, ExpiredEndsAtAllOthers) {
  const std::string set = make_set("set");
  shorten(set, 30);  // by then all have met, on a slow machine too
  ASSERT_TRUE(wire::check_security(set + "/alice", kDomain, prefix).empty());
  fly(
      set, [] {}, "expired on");
}

// By starting again, with the list or without it.
TEST_F(Revoked, CannotComeBackUntilItIsRenewed) {
  const std::string set = make_set("set"), stolen = folder.file("stolen");
  fs::copy(set + "/alice", stolen);
  test::SecuredPeer bob = join(set + "/bob"), carol = join(set + "/carol");
  // Carol has read no list when she started; Fast DDS will not read another.
  move(bob, "leg", 1);
  ASSERT_TRUE(carol.hears(bob, "leg", 1));
  revoke(set, "alice");
  ASSERT_TRUE(comes(carol, "list 1 is in force"));
  subscriber::DdsChannelOptions options;
  options.transport = transport(set + "/alice");
  const auto refused = subscriber::DdsChannel::create(options);
  ASSERT_FALSE(refused.is_ok());
  EXPECT_NE(refused.status().message().find("revoked on"), std::string::npos)
      << refused.status().message();
  test::SecuredPeer thief = join(stolen);
  move(thief, "arm", 2);
  EXPECT_TRUE(comes(carol, "identity alice: its certificate"));
  EXPECT_FALSE(test::await(
      [&] {
        thief.say_again();
        return test::heard_in(carol.collect()).size() > 1;
      },
      2 * kQuiet_s));
  EXPECT_EQ(count(carol, "identity alice: its certificate"), 1);
  wire::SecurityPlan again;
  again.domain = kDomain;
  again.prefix = prefix;
  again.identities = {{"alice", wire::Role::kSubscriber}};
  again.force = true;
  const Status made = wire::make_security(set, again);
  ASSERT_TRUE(made.is_ok()) << made.message();
  test::SecuredPeer alice = join(set + "/alice");
  move(alice, "arm", 3);
  EXPECT_TRUE(carol.hears(alice, "arm", 3));
  EXPECT_EQ(test::heard_in(carol.all), test::Heard({{"leg", 1}, {"arm", 3}}));
}

TEST_F(Revoked, EndsEachVerbOnTheBus) {
  const std::string set = make_set("set");
  const auto start = [&](const std::string& program, const std::string& identity,
                         std::vector<std::string> words) {
    words.insert(words.end(),
                 {"--domain", std::to_string(kDomain), "--prefix", prefix, "--interface",
                  "127.0.0.1", "--security", set + "/" + identity, "--identity-period-s", "0.5"});
    return std::make_unique<Process>(folder, program, words);
  };
  const auto player = start("nearmesh-publisher", "serve",
                            {"replay", NEARMESH_SESSION_DATA "/session_v1.db3", "--loop",
                             "--topics", "hello,mesh_header"});
  const auto looker =
      start("nearmesh-subscriber", "alice", {"status", "--watch", "--seconds", "0.3"});
  const auto doctor = start("nearmesh-subscriber", "bob", {"doctor", "--seconds", "600"});
  ASSERT_TRUE(player->says("replaying")) << player->err();
  ASSERT_TRUE(test::await([&] { return looker->out().find("publishers") != std::string::npos; }));
  // One that meets it shows that it is there.
  std::unique_ptr<Process> other;
  ASSERT_TRUE(test::await([&] {
    other = start("nearmesh-subscriber", "carol", {"doctor", "--seconds", "8"});
    static_cast<void>(other->wait());  // on a machine that is very busy it measures losses
    return other->out().find("another doctor after") != std::string::npos;
  })) << other->out()
      << other->err();
  for (const char* name : {"serve", "alice", "bob"}) revoke(set, name);
  EXPECT_EQ(player->wait(), 5) << player->err();
  EXPECT_EQ(looker->wait(), 5) << looker->err();
  EXPECT_EQ(doctor->wait(), 5) << doctor->out() << doctor->err();
}

TEST_F(Revoked, OthersFlyOnCertified) {
  // Alice's folder is no part of the set. It gets the list when bob has barred her, or she might
  // leave by herself before.
  const std::string set = folder.file("set"), elsewhere = folder.file("elsewhere");
  const auto on_bus = [&](std::vector<std::string> words, const std::string& identity) {
    words.insert(words.end(), {"--domain", std::to_string(kDomain), "--prefix", prefix});
    if (!identity.empty())
      words.insert(words.end(), {"--interface", "127.0.0.1", "--security",
                                 identity == "alice" ? elsewhere : set + "/" + identity,
                                 "--identity-period-s", "0.5"});
    return words;
  };
  std::string out, err;
  ASSERT_EQ(test::run(folder, "nearmesh-publisher",
                      on_bus({"make-security", set, "--publisher", "serve", "--subscriber", "alice",
                              "bob", "--recorder", "rec"},
                             ""),
                      &out, &err),
            0)
      << err;
  const std::string terrain = test::model_file("terrain", 48),
                    aircraft = test::model_file("aircraft", 600);
  ASSERT_EQ(test::run(folder, "nearmesh-demo-flights",
                      {folder.path(), "--size", "48", "--frames", "300", "--rate", "25", "--rounds",
                       "20"},
                      nullptr, &err),
            0)
      << err;
  const auto scene = [&](const char* own, const char* pairs) {
    return std::string(
               "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
               "  - {name: one, model: aircraft}\n  - {name: two, model: aircraft}\nmoves:\n") +
           own + "pairs: " + pairs + "\nframe_rate_hz: 25\nbudget_ms: 5\nlookahead_s: 0.2\n";
  };
  folder.write("alice.yaml",
               scene("  - {body: one, trajectory: flight1.csv}\n", "[[ground, one]]"));
  folder.write("bob.yaml",
               scene("  - {body: two, trajectory: flight2.csv}\n", "[[ground, two], [one, two]]"));
  fs::copy(set + "/alice", elsewhere);
  Process publisher(folder, "nearmesh-publisher", on_bus({"serve", terrain, aircraft}, "serve"));
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  Process recorder(folder, "nearmesh-subscriber",
                   on_bus({"record", "-o", folder.file("session.db3")}, "rec"));
  Process alice(folder, "nearmesh-subscriber", on_bus({"run", folder.file("alice.yaml")}, "alice"));
  Process bob(folder, "nearmesh-subscriber",
              on_bus({"run", folder.file("bob.yaml"), "--answers", folder.file("a.jsonl")}, "bob"));
  const std::string answers = folder.file("a.jsonl");
  ASSERT_TRUE(test::answers_come(answers, 0, 150, [](const std::string&) { return true; }))
      << bob.err();
  ASSERT_EQ(test::run(folder, "nearmesh-publisher",
                      on_bus({"make-security", set, "--revoke", "alice"}, ""), &out, &err),
            0)
      << err;
  EXPECT_NE(out.find("alice/identity_crl.pem"), std::string::npos) << out;
  const std::string barred_words = "was revoked or has expired";
  ASSERT_TRUE(test::answers_come(answers, 0, 1, [&](const std::string& line) {
    return line.find(barred_words) != std::string::npos;
  })) << bob.err();
  fs::copy_file(set + "/alice/identity_crl.pem", elsewhere + "/identity_crl.pem");
  EXPECT_EQ(alice.wait(), 5) << alice.err();
  EXPECT_NE(alice.err().find("this program's identity alice was revoked"), std::string::npos)
      << alice.err();
  constexpr std::size_t kEnough = 50;
  const auto is_certified = [](const nlohmann::json& answer) {
    return answer["status"] != "uncertain" && answer["status"] != "partial";
  };
  const std::size_t until_now = test::lines_of(test::read_text(answers)).size();
  EXPECT_TRUE(test::answers_come(answers, until_now, kEnough, [&](const std::string& line) {
    const auto answer = nlohmann::json::parse(line);
    return answer["a"] == "ground" && is_certified(answer);
  })) << bob.err();
  bob.signal(SIGINT);
  ASSERT_EQ(bob.wait(), 0) << bob.err();
  // From the first answer that knows it, to the end.
  int since = 0, barred = 0;
  for (const std::string& line : test::lines_of(test::read_text(answers))) {
    const auto answer = nlohmann::json::parse(line);
    if (!answer.contains("frame")) continue;
    const bool is_barred = answer.value("reason", "").find(barred_words) != std::string::npos;
    if (answer["a"] == "ground" || (since == 0 && !is_barred)) continue;
    EXPECT_EQ(answer["status"], "uncertain");
    ++since;
    barred += is_barred ? 1 : 0;
  }
  EXPECT_GT(since, 0);
  EXPECT_EQ(barred, since);
  // The others' list is in force too: the publisher ends by its own.
  ASSERT_EQ(test::run(folder, "nearmesh-publisher",
                      on_bus({"make-security", set, "--revoke", "serve", "rec"}, ""), &out, &err),
            0)
      << err;
  EXPECT_EQ(publisher.wait(), 5) << publisher.err();
  EXPECT_EQ(recorder.wait(), 5) << recorder.err();
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber",
                      {"verify", folder.file("session.db3"), "--allow-unproved"}, &out, &err),
            0)
      << out << err;
}

}  // namespace
}  // namespace nearmesh
