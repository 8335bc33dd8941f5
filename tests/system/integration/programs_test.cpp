// SPDX-License-Identifier: Apache-2.0
// nearmesh-publisher and nearmesh-subscriber as a user runs them: processes that talk over UDP on
// 127.0.0.1. Every test has a domain of its own, and topics of its own in case another checkout
// tests at the same time.

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>
#include <thread>

#include "core/base/stopwatch.hpp"
#include "process.hpp"

namespace nearmesh {
namespace {

using nlohmann::json;
using test::Folder;
using test::Process;

constexpr int kTerrainCells = 48;

std::string terrain() { return test::model_file("terrain", kTerrainCells); }
std::string aircraft() { return test::model_file("aircraft", 600); }

// What tests share: a bus of their own, a publisher, scenes, and the check of recorded answers.
class Programs : public ::testing::Test {
 protected:
  Folder folder;

  // `words` and how to reach the bus.
  std::vector<std::string> on_bus(std::vector<std::string> words) const {
    // One domain a test, by its place in this file.
    const auto& all = *::testing::UnitTest::GetInstance();
    int place = 0, tests = 0;
    for (int suite = 0; suite < all.total_test_suite_count(); ++suite)
      for (int i = 0; i < all.GetTestSuite(suite)->total_test_count(); ++i, ++tests)
        if (all.GetTestSuite(suite)->GetTestInfo(i) == all.current_test_info()) place = tests;
    words.insert(words.end(),
                 {"--domain", std::to_string(100 + place), "--prefix",
                  "programs-" + std::to_string(::getpid()), "--interface", "127.0.0.1"});
    return words;
  }
  std::unique_ptr<Process> serve(const std::string& ground = terrain()) const {
    auto publisher = std::make_unique<Process>(folder, "nearmesh-publisher",
                                               on_bus({"serve", ground, aircraft()}));
    EXPECT_TRUE(publisher->says("ready on domain")) << publisher->err();
    return publisher;
  }
  std::unique_ptr<Process> fly(const std::string& scene, std::vector<std::string> more = {}) const {
    std::vector<std::string> words{"run", folder.file(scene + ".yaml"), "--answers",
                                   folder.file(scene + ".jsonl")};
    words.insert(words.end(), more.begin(), more.end());
    return std::make_unique<Process>(folder, "nearmesh-subscriber", on_bus(words));
  }
  /// Two peers fly "first" and "second" to their ends, recorded.
  void fly_recorded(const std::string& session);

  // Writes flight1.csv and flight2.csv: so many frames there, and as many back, and so on.
  void write_flights(int frames, int rounds = 1) const {
    std::string err;
    ASSERT_EQ(
        test::run(folder, "nearmesh-demo-flights",
                  {folder.path(), "--size", std::to_string(kTerrainCells), "--frames",
                   std::to_string(frames), "--rate", "50", "--rounds", std::to_string(rounds)},
                  nullptr, &err),
        0)
        << err;
  }
  // A scene with the ground and two aircraft, of which this peer moves some.
  void write_scene(const std::string& name, const std::vector<std::string>& moves,
                   const std::string& pairs, const std::string& more = "",
                   const std::string& model = "aircraft") const {
    std::string text =
        "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
        "  - {name: one, model: " +
        model + "}\n  - {name: two, model: aircraft}\nmoves:\n";
    for (const std::string& body : moves)
      text +=
          "  - {body: " + body + ", trajectory: flight" + (body == "one" ? "1" : "2") + ".csv}\n";
    text += "pairs: " + pairs + "\nframe_rate_hz: 50\nbudget_ms: 5\nlookahead_s: 0.2\n" + more;
    folder.write(name + ".yaml", text);
  }

  using Checked = test::CheckedAnswers;
  // What nearmesh-model check says of a scene's answers.
  Checked check(const std::string& scene, const std::string& ground = terrain()) const {
    return test::check_answers(folder, {ground, aircraft()}, folder.file(scene + ".jsonl"));
  }
  std::vector<json> answers_of(const std::string& scene) const {
    std::vector<json> answers;
    for (const std::string& line : test::lines_of(test::read_text(folder.file(scene + ".jsonl"))))
      if (json parsed = json::parse(line); !parsed.contains("summary")) answers.push_back(parsed);
    return answers;
  }
  static bool is_certified(const json& answer) {
    const std::string status = answer.value("status", "");
    return status == "free" || status == "contact";
  }
  /// Waits for so many answers of a scene that flies, from a line of its file on, of which
  /// `is_wanted` holds.
  bool answers_come(const std::string& scene, std::size_t from_line, std::size_t count,
                    bool (*is_wanted)(const json&) = is_certified) const {
    return test::answers_come(
        folder.file(scene + ".jsonl"), from_line, count,
        [&](const std::string& line) { return is_wanted(json::parse(line)); });
  }
  /// Waits until a recording that goes on has so many reports, whatever they say.
  bool is_recorded(const std::string& session, std::uint64_t reports) const {
    std::string out;
    return test::run_until(folder, "nearmesh-subscriber", {"info", session, "--json"}, out, [&] {
      std::uint64_t count = 0;
      const json by_status = json::parse(out).at("reports");
      for (const json& reported : by_status) count += reported.get<std::uint64_t>();
      return count >= reports;
    });
  }
  /// Frames of a flight that outlasts what is awaited in it: 160 s.
  static constexpr int kLong = 8000;
};

const std::string kAllPairs = "[[ground, one], [ground, two], [one, two]]";

TEST_F(Programs, OnePeerFliesAndEveryAnswerIsRight) {
  write_flights(100);
  write_scene("both", {"one", "two"}, kAllPairs);
  const auto publisher = serve();
  const auto peer = fly("both");
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  const Checked checked = check("both");
  EXPECT_EQ(checked.answers, 300U);
  EXPECT_EQ(checked.wrong, 0U);
  EXPECT_GT(checked.certified, 60U);
  const auto answers = answers_of("both");
  for (const char* status : {"free", "contact"})
    EXPECT_TRUE(std::any_of(answers.begin(), answers.end(),
                            [&](const json& a) { return a.at("status") == status; }))
        << "no answer is " << status;
  EXPECT_NE(peer->out().find("touching face pairs"), std::string::npos) << peer->out();
}

TEST_F(Programs, TwoPeersHearOfEachOther) {
  write_flights(100);
  write_scene("first", {"one"}, "[[ground, one], [one, two]]");
  write_scene("second", {"two"}, "[[ground, two], [one, two]]");
  const auto publisher = serve();
  const auto first = fly("first"), second = fly("second");
  ASSERT_EQ(first->wait(), 0) << first->err();
  ASSERT_EQ(second->wait(), 0) << second->err();
  for (const char* scene : {"first", "second"}) {
    const Checked checked = check(scene);
    EXPECT_EQ(checked.answers, 200U);
    EXPECT_EQ(checked.wrong, 0U);
    EXPECT_GT(checked.certified, 40U);
  }
}

TEST_F(Programs, AWorldIsServedTileByTile) {
  constexpr std::uint64_t kFrames = 40;
  const std::string world = folder.file("terrain");
  std::string err;
  ASSERT_EQ(test::run(folder, "nearmesh-model",
                      {"generate", "terrain", "--size", std::to_string(kTerrainCells), "-o",
                       folder.file("mesh.ply")},
                      nullptr, &err),
            0)
      << err;
  ASSERT_EQ(test::run(folder, "nearmesh-model",
                      {"build-world", folder.file("mesh.ply"), "--faces", "200", "-o", world},
                      nullptr, &err),
            0)
      << err;
  write_flights(kFrames);
  write_scene("first", {"one"}, "[[ground, one], [one, two]]");
  write_scene("second", {"two"}, "all");
  const auto publisher = serve(world);
  const auto recorder = std::make_unique<Process>(
      folder, "nearmesh-subscriber", on_bus({"record", "-o", folder.file("session.db3")}));
  const auto first = fly("first", {"--wait-recorder"}), second = fly("second", {"--wait-recorder"});
  ASSERT_EQ(first->wait(), 0) << first->err();
  ASSERT_EQ(second->wait(), 0) << second->err();
  std::set<std::uint64_t> tiles;
  for (const char* scene : {"first", "second"}) {
    EXPECT_EQ(check(scene, world).wrong, 0U);
    EXPECT_GT(check(scene, world).certified, 0U);
    std::set<std::string> said;
    for (const json& line : answers_of(scene))
      if (line.contains("tiles")) {
        tiles.insert(line.at("tiles").get<std::uint64_t>());
        said.insert(line.at("status"));
      }
    EXPECT_TRUE(said.contains("contact")) << scene;
  }
  EXPECT_GT(tiles.size(), 3U) << "tiles come and go";

  recorder->signal(SIGINT);
  EXPECT_EQ(recorder->wait(), 0) << recorder->err();
  // What was said of the world, too.
  std::string out;
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber",
                      {"verify", folder.file("session.db3"), "--json"}, &out, &err),
            0)
      << out << err;
  const json verified = json::parse(out);
  EXPECT_GT(verified.at("proved"), 0) << out;
  EXPECT_EQ(verified.at("proved"), verified.at("answers")) << out;
  EXPECT_TRUE(verified.at("complaints").empty()) << out;
}

TEST_F(Programs, LateJoinerIsAnsweredToo) {
  write_flights(200);
  const std::string short_flight = test::read_text(folder.file("flight2.csv"));
  write_flights(kLong);  // the first one is there until the late one has ended
  folder.write("flight2.csv", short_flight);
  write_scene("first", {"one"}, "[[ground, one]]");
  write_scene("late", {"two"}, "[[ground, two], [one, two]]");
  const auto publisher = serve();
  const auto first = fly("first");
  ASSERT_TRUE(answers_come("first", 0, 50)) << first->err();
  const auto late = fly("late");
  ASSERT_EQ(late->wait(), 0) << late->err();
  first->signal(SIGINT);
  ASSERT_EQ(first->wait(), 0) << first->err();
  for (const char* scene : {"first", "late"}) {
    const Checked checked = check(scene);
    EXPECT_EQ(checked.wrong, 0U);
    EXPECT_GT(checked.certified, checked.answers / 2);
  }
  // It came seconds later, and has the other's time; up to a frame behind, since it takes that from
  // what it hears.
  int fresh = 0;
  for (const json& answer : answers_of("late"))
    if (answer.at("a") == "one" && is_certified(answer))
      fresh += std::abs(answer.at("age_a_s").get<double>()) < 0.5 ? 1 : 0;
  EXPECT_GT(fresh, 50);
}

TEST_F(Programs, KilledPublisherIsReplacedInFlight) {
  // Over the same ground again and again, which is forgotten each time.
  write_flights(400, 20);
  write_scene("both", {"one", "two"}, kAllPairs, "max_held_splits: 200\n");
  auto publisher = serve();
  const auto peer = fly("both");
  ASSERT_TRUE(answers_come("both", 0, 200)) << peer->err();
  publisher->signal(SIGKILL);
  ASSERT_EQ(publisher->wait(), 1000 + SIGKILL);
  publisher = serve();
  // It is the new one that is asked, once the other is missed.
  std::string told;
  ASSERT_TRUE(test::run_until(folder, "nearmesh-subscriber",
                              on_bus({"status", "--json", "--seconds", "1.5"}), told,
                              [&] {
                                const json status = json::parse(told);
                                for (const json& one : status.at("publishers"))
                                  if (one.value("process_id", 0) == publisher->id())
                                    return one.at("batches") > 0;
                                return false;
                              }))
      << told << peer->err();
  ASSERT_TRUE(answers_come("both", answers_of("both").size(), 75)) << peer->err();
  peer->signal(SIGINT);
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  const Checked checked = check("both");
  EXPECT_EQ(checked.wrong, 0U);
  const auto answers = answers_of("both");
  EXPECT_EQ(checked.answers, answers.size());
  for (const json& answer : answers)
    EXPECT_NE(is_certified(answer), answer.contains("reason") || answer.contains("awaited"))
        << answer.dump();
  publisher->signal(SIGINT);
  EXPECT_EQ(publisher->wait(), 0) << publisher->err();
}

// Nothing is certified about the dead one's body once its pose has aged; and the recording proves
// what was said.
TEST_F(Programs, KilledPeerIsNotVouchedForAndDoesNotDisturbTheOther) {
  write_flights(kLong);
  write_scene("first", {"one"}, "[[ground, one], [one, two]]");
  write_scene("second", {"two"}, "[[ground, two], [one, two]]");
  const std::string session = folder.file("session.db3");
  Process recorder(folder, "nearmesh-subscriber", on_bus({"record", "-o", session}));
  ASSERT_TRUE(recorder.says("recording domain")) << recorder.err();
  const auto publisher = serve();
  const auto first = fly("first"), second = fly("second");
  constexpr int kEnough = 100;
  const auto is_aged = [](const json& answer) {
    return answer.value("a", "") == "one" && answer.at("age_b_s") > 2;
  };
  ASSERT_TRUE(answers_come("first", 0, kEnough, [](const json& answer) {
    return answer.value("a", "") == "one" && answer.at("age_b_s") <= 2;
  })) << first->err();
  second->signal(SIGKILL);
  EXPECT_EQ(second->wait(), 1000 + SIGKILL);
  ASSERT_TRUE(answers_come("first", answers_of("first").size(), kEnough, is_aged)) << first->err();
  first->signal(SIGINT);
  ASSERT_EQ(first->wait(), 0) << first->err();
  const Checked checked = check("first");
  EXPECT_EQ(checked.answers, answers_of("first").size());
  EXPECT_EQ(checked.wrong, 0U);
  int vouched = 0, ground = 0;
  double last_s = -1;
  for (const json& answer : answers_of("first")) {
    EXPECT_GE(answer.at("time_s"), last_s);
    last_s = answer.at("time_s");
    if (answer.at("a") == "ground") {
      EXPECT_EQ(answer.at("age_a_s"), 0);
      ground += is_certified(answer) ? 1 : 0;
      continue;
    }
    if (!is_aged(answer)) continue;
    vouched += is_certified(answer) ? 1 : 0;
    EXPECT_NE(answer.at("reason").get<std::string>().find("body two"), std::string::npos);
  }
  EXPECT_EQ(vouched, 0);
  EXPECT_GT(ground, kEnough);
  publisher->signal(SIGINT);
  EXPECT_EQ(publisher->wait(), 0) << publisher->err();
  recorder.signal(SIGINT);
  EXPECT_EQ(recorder.wait(), 0) << recorder.err();
  std::string verdict;
  EXPECT_EQ(
      test::run(folder, "nearmesh-subscriber", {"verify", session, "--allow-unproved"}, &verdict),
      0)
      << verdict;
  EXPECT_NE(verdict.find(" 0 different"), std::string::npos) << verdict;
}

TEST_F(Programs, UnknownModelEndsTheStartWithItsName) {
  write_flights(20);
  const auto publisher = serve();
  // Until it has found the publisher it says that there is none: on a busy machine it is given more
  // time.
  const std::string expected = "model spectre of body one: no publisher serves it";
  std::string said;
  for (int seconds = 2; seconds <= 64 && said.find(expected) == std::string::npos; seconds *= 2) {
    write_scene("both", {"one", "two"}, kAllPairs,
                "start_timeout_s: " + std::to_string(seconds) + "\n", "spectre");
    const auto peer = fly("both");
    EXPECT_EQ(peer->wait(), 1);
    said = peer->err();
    EXPECT_NE(said.find("no certified answer within " + std::to_string(seconds)), std::string::npos)
        << said;
  }
  EXPECT_NE(said.find(expected), std::string::npos) << said;
}

TEST_F(Programs, NoPublisherEndsTheStartWithAReason) {
  write_flights(20);
  write_scene("both", {"one", "two"}, kAllPairs, "start_timeout_s: 1\n");
  const auto peer = fly("both");
  EXPECT_EQ(peer->wait(), 1);
  EXPECT_NE(peer->err().find("no publisher found"), std::string::npos) << peer->err();
  EXPECT_NE(peer->err().find("model "), std::string::npos) << peer->err();
}

TEST_F(Programs, InterruptEndsBothCleanly) {
  write_flights(5000);
  write_scene("both", {"one", "two"}, kAllPairs);
  const auto publisher = serve();
  const auto peer = fly("both", {"--json"});
  ASSERT_TRUE(test::await([&] {
    return peer->out().find("\"frame\":5,") != std::string::npos || peer->is_over();
  })) << peer->err();
  peer->signal(SIGINT);
  EXPECT_EQ(peer->wait(test::kEnd_s), 0) << peer->err();
  const auto lines = test::lines_of(peer->out());
  EXPECT_TRUE(json::parse(lines.back()).contains("summary"));
  EXPECT_LT(json::parse(lines.back()).at("summary").at("frames").get<int>(), 5000);
  publisher->signal(SIGINT);
  EXPECT_EQ(publisher->wait(test::kEnd_s), 0) << publisher->err();
  EXPECT_NE(publisher->err().find("stopping"), std::string::npos);
}

TEST_F(Programs, InterruptEndsAPeerThatStillWaits) {
  write_flights(20);
  write_scene("both", {"one", "two"}, kAllPairs);
  const auto peer = fly("both", {"--json"});
  ASSERT_TRUE(test::await([&] { return peer->err().find("joined domain") != std::string::npos; }))
      << peer->err();
  peer->signal(SIGINT);
  EXPECT_EQ(peer->wait(test::kEnd_s), 0) << peer->err();
}

TEST_F(Programs, CorruptModelIsRefused) {
  std::string bytes = test::read_text(aircraft());
  const std::string original = bytes;
  bytes[100] = static_cast<char>(bytes[100] ^ 0x10);
  folder.write("corrupt.spm", bytes);
  folder.write("cut.spm", original.substr(0, original.size() / 2));
  folder.write("text.spm", "not a model\n");
  for (const char* name : {"corrupt.spm", "cut.spm", "text.spm", "missing.spm"}) {
    std::string err;
    EXPECT_EQ(test::run(folder, "nearmesh-publisher",
                        on_bus({"serve", terrain(), folder.file(name)}), nullptr, &err),
              1)
        << name;
    EXPECT_NE(err.find("nearmesh-publisher: " + folder.file(name) + ": "), std::string::npos)
        << err;
  }
}

TEST_F(Programs, WhatIsNoFileIsRefusedAtOnce) {
  ASSERT_EQ(::mkfifo(folder.file("fifo.spm").c_str(), 0600), 0);
  ASSERT_EQ(::symlink("/dev/zero", folder.file("device.spm").c_str()), 0);
  std::filesystem::create_directory(folder.file("folder.spm"));
  for (const char* name : {"fifo.spm", "device.spm", "folder.spm"}) {
    Process publisher(folder, "nearmesh-publisher",
                      on_bus({"serve", terrain(), folder.file(name)}));
    EXPECT_EQ(publisher.wait(), 1) << name;
    EXPECT_NE(publisher.err().find(folder.file(name) + ": not a regular file"), std::string::npos)
        << publisher.err();
  }
}

// What nearmesh-model writes is renamed into place; other tools write over a file, or cut it first.
TEST_F(Programs, ModelReplacedUnderAPublisherIsServedAsItWasOrRefused) {
  namespace fs = std::filesystem;
  fs::copy_file(terrain(), folder.file("renamed.spm"));
  fs::copy_file(test::model_file("terrain", kTerrainCells + 1), folder.file("cut.spm"));
  Process serving(
      folder, "nearmesh-publisher",
      on_bus({"serve", folder.file("renamed.spm"), folder.file("cut.spm"), aircraft()}));
  ASSERT_TRUE(serving.says("ready on domain")) << serving.err();
  fs::copy_file(test::model_file("terrain", kTerrainCells + 2), folder.file("next.spm"));
  fs::rename(folder.file("next.spm"), folder.file("renamed.spm"));
  fs::resize_file(folder.file("cut.spm"), 100);
  // All the time where the aircraft touches the ground, so that detail is needed.
  write_flights(100);
  const auto rows = test::lines_of(test::read_text(folder.file("flight1.csv")));
  std::string low = rows[0] + "\n";
  for (int i = 0; i < 20; ++i) low += rows[88] + "\n";
  folder.write("low.csv", low);
  const auto scene = [&](const std::string& model) {
    folder.write(model + ".yaml",
                 "bodies:\n  - {name: ground, model: " + model +
                     ", pose: {translation: [0, 0, 0]}}\n  - {name: one, model: aircraft}\nmoves:\n"
                     "  - {body: one, trajectory: low.csv}\npairs: [[ground, one]]\n"
                     "frame_rate_hz: 50\nstart_timeout_s: 20\n");
  };
  scene("cut");
  const auto refused = fly("cut");
  EXPECT_EQ(refused->wait(), 1);
  for (const Process* process : std::initializer_list<const Process*>{refused.get(), &serving})
    EXPECT_NE(process->err().find("was changed after it was opened"), std::string::npos)
        << process->err();
  scene("renamed");
  const auto served = fly("renamed");
  EXPECT_EQ(served->wait(), 0) << served->err();
  fs::copy_file(terrain(), folder.file("renamed.spm"), fs::copy_options::overwrite_existing);
  std::string out, err;
  EXPECT_EQ(test::run(folder, "nearmesh-model",
                      {"check", folder.file("renamed.spm"), aircraft(), "--answers",
                       folder.file("renamed.jsonl")},
                      &out, &err),
            0)
      << err;
  EXPECT_EQ(out.find("answers 20, wrong 0, certified"), 0U) << out;
  EXPECT_FALSE(serving.is_over()) << serving.err();
}

// Nothing here may wait for, or compare, what the machine's clock says: it is set while all runs.
TEST_F(Programs, ClockThatJumpsDisturbsNobody) {
  constexpr char kFakeTime[] = "/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1";
  if (!std::filesystem::exists(kFakeTime)) GTEST_SKIP() << "libfaketime is not installed";
  write_flights(400);
  write_scene("first", {"one"}, "[[ground, one], [one, two]]");
  write_scene("second", {"two"}, "[[ground, two], [one, two]]");
  const auto set_clock = [&](const std::string& offset) {
    folder.write("offset.next", offset);
    std::filesystem::rename(folder.file("offset.next"), folder.file("offset"));
  };
  set_clock("+0");
  ::setenv("LD_PRELOAD", kFakeTime, 1);
  ::setenv("FAKETIME_TIMESTAMP_FILE", folder.file("offset").c_str(), 1);
  ::setenv("FAKETIME_NO_CACHE", "1", 1);
  ::setenv("FAKETIME_DONT_FAKE_MONOTONIC", "1", 1);
  const auto publisher = serve();
  const auto first = fly("first");
  for (const char* name : {"LD_PRELOAD", "FAKETIME_TIMESTAMP_FILE", "FAKETIME_NO_CACHE",
                           "FAKETIME_DONT_FAKE_MONOTONIC"})
    ::unsetenv(name);
  const auto second = fly("second");  // its clock stays right
  for (const char* offset : {"+3600", "-3600", "+86400", "+0", "-86400"}) {
    std::this_thread::sleep_for(std::chrono::milliseconds(800));
    set_clock(offset);
  }
  ASSERT_EQ(first->wait(), 0) << first->err();
  ASSERT_EQ(second->wait(), 0) << second->err();
  for (const char* scene : {"first", "second"}) {
    const Checked checked = check(scene);
    EXPECT_EQ(checked.answers, 800U);
    EXPECT_EQ(checked.wrong, 0U);
    EXPECT_GT(checked.certified, 400U);
  }
  // Whoever joins a publisher whose clock is a day behind.
  write_flights(20);
  write_scene("both", {"one", "two"}, kAllPairs);
  const auto late = fly("both");
  EXPECT_EQ(late->wait(), 0) << late->err();
  publisher->signal(SIGINT);  // killed, libfaketime would leave files in /dev/shm
  EXPECT_EQ(publisher->wait(), 0) << publisher->err();
}

TEST_F(Programs, OneModelTwiceIsRefused) {
  std::string err;
  EXPECT_EQ(test::run(folder, "nearmesh-publisher", on_bus({"serve", terrain(), terrain()}),
                      nullptr, &err),
            1);
  EXPECT_NE(err.find("terrain"), std::string::npos) << err;
}

TEST_F(Programs, JsonParsesLineByLine) {
  write_flights(20);
  write_scene("both", {"one", "two"}, kAllPairs, "sweep_s: 0.04\n");
  const auto publisher = serve();
  const auto peer = fly("both", {"--json"});
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  const std::string out = peer->out();
  EXPECT_EQ(out, test::read_text(folder.file("both.jsonl")));
  const auto lines = test::lines_of(out);
  ASSERT_EQ(lines.size(), 61U);
  for (std::size_t i = 0; i < 60; ++i) {
    const json line = json::parse(lines[i]);
    EXPECT_EQ(line.at("frame").get<std::size_t>(), i / 3);
    EXPECT_EQ(line.at("a"), i % 3 == 2 ? "one" : "ground");
    EXPECT_EQ(line.at("pose_b").size(), 12U);
    for (const char* key :
         {"b", "model_a", "model_b", "content_a", "content_b", "status", "pairs", "pairs_digest",
          "clearance_m", "uncertainty_m", "safe_horizon_s", "missing", "pose_a"})
      EXPECT_TRUE(line.contains(key)) << key;
    if (line.contains("put_off")) continue;  // a slow machine: not asked, so not swept
    for (const char* key : {"swept_status", "free_until_s", "hit_s"})
      EXPECT_TRUE(line.contains(key)) << key << " in " << line;
    EXPECT_EQ(line.at("swept_status") == "free", line.at("free_until_s") == 0.04) << line;
    if (line.at("status") == "contact" && line.at("age_a_s") == 0 && line.at("age_b_s") == 0) {
      EXPECT_EQ(line.at("hit_s"), 0) << line;
    }
  }
  const json summary = json::parse(lines.back()).at("summary");
  EXPECT_EQ(summary.at("frames"), 20);
  EXPECT_EQ(summary.at("free").get<int>() + summary.at("contact").get<int>() +
                summary.at("partial").get<int>() + summary.at("uncertain").get<int>(),
            60);
  EXPECT_GT(summary.at("batch_bytes").get<int>(), 0);
  EXPECT_GT(summary.at("first_certified_s").get<double>(), 0);
}

// Two peers that each move one body of three: of each frame's three pairs each is answered, free by
// bounds, or unknown.
TEST_F(Programs, AllPairsAreAnsweredOrToldTogether) {
  constexpr std::uint64_t kFrames = 60;
  write_flights(kFrames);
  write_scene("first", {"one"}, "all");
  write_scene("second", {"two"}, "all");
  const auto publisher = serve();
  const auto first = fly("first"), second = fly("second");
  ASSERT_EQ(first->wait(), 0) << first->err();
  ASSERT_EQ(second->wait(), 0) << second->err();
  for (const char* scene : {"first", "second"}) {
    std::uint64_t listed = 0, together = 0, frames = 0, known = 0;
    for (const json& line : answers_of(scene)) {
      if (!line.contains("free_by_bounds")) {
        ++listed;
        continue;
      }
      ++frames;
      const json& free = line.at("free_by_bounds");
      known += free.at("pairs").get<std::uint64_t>();
      together +=
          free.at("pairs").get<std::uint64_t>() + line.at("unknown_pairs").get<std::uint64_t>();
      EXPECT_EQ(line.at("unknown").empty(), line.at("unknown_pairs") == 0) << line;
      EXPECT_GE(free.at("safe_horizon_s"), 0) << line;
    }
    EXPECT_EQ(frames, kFrames);
    EXPECT_EQ(listed + together, 3 * kFrames);
    EXPECT_GT(listed, 0U);  // they fly through the ground
    EXPECT_GT(known, 0U);   // and apart from each other
    EXPECT_EQ(check(scene).wrong, 0U);
    EXPECT_EQ(check(scene).answers, listed);
  }
}

TEST_F(Programs, SceneMistakesAreNamed) {
  folder.write("bad.yaml", "bodies:\n  - {name: one, mesh: aircraft}\n");
  std::string err;
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber", on_bus({"run", folder.file("bad.yaml")}),
                      nullptr, &err),
            1);
  EXPECT_NE(err.find("bad.yaml:2: body: unknown key mesh"), std::string::npos) << err;
  EXPECT_EQ(
      test::run(folder, "nearmesh-subscriber", on_bus({"run", "/nowhere.yaml"}), nullptr, &err), 1);
  EXPECT_NE(err.find("/nowhere.yaml: cannot open"), std::string::npos) << err;
}

TEST_F(Programs, AnswersThatCannotBeWrittenAreNamed) {
  write_flights(20);
  write_scene("both", {"one", "two"}, kAllPairs);
  std::string err;
  EXPECT_EQ(
      test::run(folder, "nearmesh-subscriber",
                on_bus({"run", folder.file("both.yaml"), "--answers", "/nowhere/answers.jsonl"}),
                nullptr, &err),
      1);
  EXPECT_NE(err.find("/nowhere/answers.jsonl"), std::string::npos) << err;
}

TEST_F(Programs, SolidBodyWithAnOpenModelEndsTheStartWithTheReason) {
  write_flights(20);
  folder.write(
      "solid.yaml",
      "bodies:\n  - {name: ground, model: terrain, solid: true, pose: {}}\n"
      "  - {name: one, model: aircraft}\nmoves:\n  - {body: one, trajectory: flight1.csv}\n"
      "pairs: [[ground, one]]\n");
  const auto publisher = serve();
  const auto peer = fly("solid");
  EXPECT_EQ(peer->wait(), 1);
  EXPECT_NE(peer->err().find("body ground cannot be solid"), std::string::npos) << peer->err();
  EXPECT_NE(peer->err().find("192 boundary edges"), std::string::npos) << peer->err();
  EXPECT_EQ(peer->err().find("no certified answer"), std::string::npos) << peer->err();
}

TEST_F(Programs, AircraftUnderSolidGroundIsContained) {
  const std::string mesh = folder.file("sunk.ply"), model = folder.file("sunk.spm");
  ASSERT_EQ(test::run(folder, "nearmesh-model",
                      {"generate", "terrain", "--size", "48", "--floor-m", "-3000", "-o", mesh}),
            0);
  ASSERT_EQ(test::run(folder, "nearmesh-model", {"build", mesh, "-o", model}), 0);
  std::string rows = "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n";
  for (int frame = 0; frame < 20; ++frame)
    rows += "1,0,0,0,1,0,0,0,1," + std::to_string(10 * frame) + ",40,-2500\n";
  folder.write("dive.csv", rows);
  folder.write("sunk.yaml",
               "bodies:\n  - {name: ground, model: sunk, solid: true, pose: {}}\n"
               "  - {name: one, model: aircraft}\nmoves:\n  - {body: one, trajectory: dive.csv}\n"
               "pairs: [[ground, one]]\n");
  Process publisher(folder, "nearmesh-publisher", on_bus({"serve", model, aircraft()}));
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  const auto peer = fly("sunk");
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  const auto answers = answers_of("sunk");
  ASSERT_EQ(answers.size(), 20U);
  EXPECT_EQ(answers.front().at("status"), "contained");
  EXPECT_EQ(answers.front().at("contained"), "b_in_a");
  std::string out;
  EXPECT_EQ(test::run(folder, "nearmesh-model",
                      {"check", model, aircraft(), "--answers", folder.file("sunk.jsonl")}, &out),
            0);
  EXPECT_NE(out.find("answers 20, wrong 0"), std::string::npos) << out;
}

TEST_F(Programs, WrongUsageExitsWithTwo) {
  using Words = std::vector<std::string>;
  for (const auto& [program, words] : std::vector<std::pair<std::string, Words>>{
           {"nearmesh-publisher", {}},
           {"nearmesh-publisher", {"serve"}},
           {"nearmesh-publisher", {"server", "x.spm"}},
           {"nearmesh-publisher", {"serve", "x.spm", "--domain", "300"}},
           {"nearmesh-publisher", {"serve", "x.spm", "--domian", "3"}},
           {"nearmesh-subscriber", {}},
           {"nearmesh-subscriber", {"run"}},
           {"nearmesh-subscriber", {"run", "scene.yaml", "--domain", "x"}},
           {"nearmesh-subscriber", {"run", "scene.yaml", "--jsonl"}},
           {"nearmesh-model", {"check"}}}) {
    std::string err;
    EXPECT_EQ(test::run(folder, program, words, nullptr, &err), 2) << program;
    EXPECT_FALSE(err.empty());
  }
  for (const char* program : {"nearmesh-publisher", "nearmesh-subscriber", "nearmesh-model"}) {
    std::string out;
    EXPECT_EQ(test::run(folder, program, {"--help"}, &out), 0);
    EXPECT_NE(out.find(program), std::string::npos);
  }
}

// ---- recorded sessions

// A recorder that is ready, and one that was told to end.
std::unique_ptr<Process> record(const Folder& folder, std::vector<std::string> words) {
  auto recorder = std::make_unique<Process>(folder, "nearmesh-subscriber", std::move(words));
  EXPECT_TRUE(recorder->says("recording domain")) << recorder->err();
  return recorder;
}

// What verify says of a session, whose exit code must fit it.
json verify(const Folder& folder, const std::string& session, std::vector<std::string> more = {}) {
  std::vector<std::string> words{"verify", session, "--json"};
  words.insert(words.end(), more.begin(), more.end());
  std::string out, err;
  const int code = test::run(folder, "nearmesh-subscriber", words, &out, &err);
  const json v = json::parse(out, nullptr, false);
  EXPECT_TRUE(v.is_object()) << out << err;
  const json& bounds = v.at("free_by_bounds");
  const bool is_wrong =
      v.at("different") != 0 || bounds.at("wrong") != 0 || bounds.at("broken_promises") != 0;
  const bool is_amiss = v.at("malformed") != 0 || v.at("missing") != 0 ||
                        bounds.at("malformed") != 0 || bounds.at("missing") != 0 ||
                        bounds.at("unreported") != 0;
  const bool is_all = v.at("proved") == v.at("answers") && bounds.at("not_provable") == 0;
  EXPECT_EQ(code, is_wrong ? 1 : is_amiss ? 4 : is_all ? 0 : 3) << v << err;
  return v;
}

// None of what can be proved is different. On a machine that is very busy a recorder may miss
// batches, and what depends on them cannot be proved; that it hears them all is tested by itself
// (dds_channel_test.cpp).
void expect_proved(const Folder& folder, const std::string& session, std::uint64_t least) {
  const json v = verify(folder, session);
  EXPECT_EQ(v.at("different"), 0U);
  EXPECT_GT(v.at("proved"), 0U);
  EXPECT_GT(v.at("answers"), least);
}

void Programs::fly_recorded(const std::string& session) {
  const auto recorder = record(folder, on_bus({"record", "-o", session}));
  const auto publisher = serve();
  const auto first = fly("first"), second = fly("second");
  ASSERT_EQ(first->wait(), 0) << first->err();
  ASSERT_EQ(second->wait(), 0) << second->err();
  recorder->signal(SIGINT);
  ASSERT_EQ(recorder->wait(), 0) << recorder->err();
}

TEST_F(Programs, RecordedSessionComesOutAgain) {
  write_flights(100);
  write_scene("first", {"one"}, "[[ground, one], [one, two]]");
  write_scene("second", {"two"}, "[[ground, two], [one, two]]");
  const std::string session = folder.file("session.db3");
  ASSERT_NO_FATAL_FAILURE(fly_recorded(session));

  std::string out, err;
  ASSERT_EQ(test::run(folder, "nearmesh-subscriber", {"info", session, "--json"}, &out, &err), 0)
      << err;
  const json info = json::parse(out);
  EXPECT_EQ(info.at("peers").size(), 2U);
  EXPECT_EQ(info.at("publishers").size(), 1U);
  ASSERT_EQ(info.at("models").size(), 2U);
  EXPECT_EQ(info.at("topics").size(), 13U);
  for (const json& topic : info.at("topics")) {
    const std::string name = topic.at("name");
    const bool is_of_many =  // nobody watches all pairs, or has a greatest speed
        name.ends_with("watched_bodies") || name.ends_with("bounds_report") ||
        name.ends_with("near_poses") || name.ends_with("body_promises");
    EXPECT_EQ(topic.at("samples") > 0U, !is_of_many) << topic;
  }
  EXPECT_GT(info.at("duration_s"), 1.0);
  EXPECT_GT(info.at("reports").at("contact"), 0U);
  expect_proved(folder, session, 300);  // 2 peers, 100 frames, 2 pairs
}

/// Two peers fly "first" and "second", recorded; of what bounds prove free most is proved again.
class RecordedFlights : public Programs {
 protected:
  void fly_and_prove(const std::string& session) {
    ASSERT_NO_FATAL_FAILURE(fly_recorded(session));
    std::uint64_t said = 0;
    for (const char* scene : {"first", "second"})
      for (const json& line : answers_of(scene))
        if (line.contains("free_by_bounds"))
          said += line.at("free_by_bounds").at("pairs").get<std::uint64_t>();
    const json v = verify(folder, session);
    const json& bounds = v.at("free_by_bounds");
    EXPECT_EQ(bounds.at("wrong"), 0U) << bounds;
    EXPECT_EQ(bounds.at("broken_promises"), 0U) << bounds;
    // Of a busy machine some may be missing, or rest on a pose that is.
    EXPECT_GT(bounds.at("proved").get<std::uint64_t>(), said / 2) << bounds << " of " << said;
    EXPECT_GT(said, 0U);
  }
};

// Each knows the other's body by its poses on the bus, as the recorder does.
TEST_F(RecordedFlights, WhatWasFreeByBoundsIsProvedFromTheRecordedPoses) {
  write_flights(100);
  write_scene("first", {"one"}, "all");
  write_scene("second", {"two"}, "all");
  fly_and_prove(folder.file("session.db3"));
}

// One of the two makes promises; the recorder hears all of its full poses.
TEST_F(RecordedFlights, WhatWasFreeByPromisesIsProvedFromTheRecording) {
  write_flights(100);
  write_scene("first", {"one"}, "own", "", "aircraft, max_speed_mps: 2000");
  write_scene("second", {"two"}, "own");
  const std::string session = folder.file("session.db3");
  fly_and_prove(session);
  std::string out, err;
  ASSERT_EQ(test::run(folder, "nearmesh-subscriber", {"info", session, "--json"}, &out, &err), 0)
      << err;
  const json info = json::parse(out);
  for (const json& topic : info.at("topics"))
    if (const std::string name = topic.at("name");
        name.ends_with("near_poses") || name.ends_with("body_promises")) {
      EXPECT_GT(topic.at("samples"), 0U) << topic;
    }
}

// A trajectory that is made up for, frame upon frame, is faster than its body may be.
TEST_F(Programs, WhoWasHeldUpGoesNoFasterThanWasPromised) {
  write_flights(100);
  write_scene("first", {"one"}, "[[ground, one]]", "", "aircraft, max_speed_mps: 2000");
  const auto publisher = serve();
  const auto peer = fly("first");
  ASSERT_TRUE(peer->says("frame 25 of 100")) << peer->err();
  peer->signal(SIGSTOP);
  std::this_thread::sleep_for(std::chrono::milliseconds(4200));  // a promise is due
  peer->signal(SIGCONT);
  EXPECT_EQ(peer->wait(), 0) << peer->err();
}

TEST_F(Programs, WhoStaysWhereItsTrajectoryEndsIsAtRest) {
  folder.write("flight1.csv", "QW,QX,QY,QZ,T0,T1,T2\n1,0,0,0,0,0,3000\n1,0,0,0,0,0,2990\n");
  write_scene("short", {"one"}, "[[ground, one]]", "duration_s: 0.2\n");
  const auto publisher = serve();
  const auto peer = fly("short");
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  const std::vector<json> answers = answers_of("short");
  ASSERT_EQ(answers.size(), 10U);
  for (const json& answer : answers) {
    EXPECT_EQ(answer.at("status"), "free");
    EXPECT_EQ(answer.at("safe_horizon_s").is_null(), answer.at("frame") > 1) << answer;
  }
}

TEST_F(Programs, LateRecorderProvesWhatFollowsAndCountsWhatWasBefore) {
  write_flights(300, 30);
  write_scene("both", {"one", "two"}, kAllPairs);
  const std::string session = folder.file("session.db3");
  const auto publisher = serve();
  const auto peer = fly("both");
  ASSERT_TRUE(answers_come("both", 225, 1)) << peer->err();
  const auto recorder = record(folder, on_bus({"record", "-o", session}));
  ASSERT_TRUE(is_recorded(session, 900)) << peer->err();
  peer->signal(SIGINT);
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  recorder->signal(SIGINT);
  ASSERT_EQ(recorder->wait(), 0) << recorder->err();

  const std::string models = folder.file("models");
  std::filesystem::create_directory(models);
  std::filesystem::copy_file(terrain(), models + "/terrain.spm");
  std::filesystem::copy_file(aircraft(), models + "/aircraft.spm");
  const json proved = verify(folder, session, {"--models", models});
  EXPECT_EQ(proved.at("different"), 0U);
  EXPECT_GT(proved.at("before"), 100U);  // of the first 225 reports and more
  EXPECT_GT(proved.at("answers"), 300U);
  // All but what was said until the peer had told what it holds: half a second after it heard of
  // the recorder, which takes another second where the first announcement was lost, out of forty.
  EXPECT_GT(proved.at("proved"), proved.at("answers").get<double>() * 0.5) << proved;
  EXPECT_EQ(proved.at("proved").get<int>() + proved.at("lacking_batches").get<int>(),
            proved.at("answers").get<int>());
  EXPECT_TRUE(proved.at("wanted").empty());
  const json wanting = verify(folder, session);
  // Where it held nothing of a model when the recorder came, no file of that is wanted.
  EXPECT_LT(wanting.at("proved"), proved.at("proved"));
  EXPECT_FALSE(wanting.at("wanted").empty());
  std::string out, err;
  EXPECT_EQ(
      test::run(folder, "nearmesh-subscriber", {"verify", session, "--allow-unproved"}, &out, &err),
      0);
  EXPECT_NE(out.find("wanted: the file of model terrain, content "), std::string::npos) << out;

  ASSERT_EQ(test::run(folder, "nearmesh-subscriber", {"info", session, "--json"}, &out, &err), 0);
  std::set<std::string> late;
  const json info = json::parse(out);
  for (const json& writer : info.at("late")) {
    const std::string topic = writer.at("topic");
    late.insert(topic.substr(topic.rfind('/') + 1));
    EXPECT_GT(writer.at("from_sample"), 1U);
    EXPECT_GE(writer.at("who").get<std::string>().size(), 16U);
  }
  EXPECT_TRUE(late.contains("contact_report"));
  EXPECT_TRUE(late.contains("body_poses"));
}

TEST_F(Programs, WaitsForARecorderSoThatNothingIsMissed) {
  write_flights(50);
  write_scene("both", {"one", "two"}, kAllPairs);
  const std::string session = folder.file("session.db3");
  const auto publisher = serve();
  const auto hasty = fly("both", {"--wait-recorder=0.5"});
  EXPECT_EQ(hasty->wait(), 1);
  EXPECT_NE(hasty->err().find("no recorder came within 0.5"), std::string::npos) << hasty->err();
  const auto stopped = fly("both", {"--wait-recorder"});
  ASSERT_TRUE(stopped->says("waiting for a recorder")) << stopped->err();
  stopped->signal(SIGINT);
  EXPECT_EQ(stopped->wait(), 0) << stopped->err();

  const auto peer = fly("both", {"--wait-recorder"});
  ASSERT_TRUE(peer->says("waiting for a recorder")) << peer->err();
  const auto recorder = record(folder, on_bus({"record", "-o", session}));
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  recorder->signal(SIGINT);
  ASSERT_EQ(recorder->wait(), 0) << recorder->err();
  const json v = verify(folder, session);
  EXPECT_EQ(v.at("before"), 0U);
  EXPECT_EQ(v.at("missing"), 0U);
  EXPECT_EQ(v.at("different"), 0U);
  EXPECT_GE(v.at("reports"), 150U);  // of each frame and pair
  EXPECT_GT(v.at("proved"), 100U);
  EXPECT_EQ(check("both").answers, 150U);
}

TEST_F(Programs, KilledRecorderLeavesWhatItHeard) {
  write_flights(200, 40);
  write_scene("both", {"one", "two"}, kAllPairs);
  const std::string session = folder.file("session.db3");
  const auto recorder = record(folder, on_bus({"record", "-o", session}));
  const auto publisher = serve();
  const auto peer = fly("both");
  // What it writes down at last is on disk a second later.
  ASSERT_TRUE(is_recorded(session, 450)) << peer->err();
  recorder->signal(SIGKILL);
  ASSERT_EQ(recorder->wait(), 1000 + SIGKILL);
  expect_proved(folder, session, 200);
  peer->signal(SIGINT);
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  EXPECT_EQ(check("both").wrong, 0U);
}

TEST_F(Programs, FrozenRecorderHoldsUpNobody) {
  write_flights(250);  // 5 s: a frozen process is missed after 3
  write_scene("both", {"one", "two"}, kAllPairs);
  const auto recorder = record(folder, on_bus({"record", "-o", folder.file("session.db3")}));
  const auto publisher = serve();
  const auto peer = fly("both");
  ASSERT_TRUE(peer->says("frame 62 of 250")) << peer->err();
  recorder->signal(SIGSTOP);
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  const Checked checked = check("both");
  EXPECT_EQ(checked.answers, 750U);
  EXPECT_EQ(checked.wrong, 0U);
  EXPECT_GT(checked.certified, 500U);
  recorder->signal(SIGCONT);
  recorder->signal(SIGTERM);
  EXPECT_EQ(recorder->wait(), 0) << recorder->err();
  EXPECT_EQ(verify(folder, folder.file("session.db3")).at("different"), 0U);
}

TEST_F(Programs, RecorderSplitsAndRefuses) {
  write_flights(150);
  write_scene("both", {"one", "two"}, kAllPairs);
  const std::string session = folder.file("session.db3");
  const auto recorder =
      record(folder, on_bus({"record", "-o", session, "--max-size", "300KB", "--split"}));
  const auto publisher = serve();
  const auto peer = fly("both");
  ASSERT_EQ(peer->wait(), 0) << peer->err();
  recorder->signal(SIGTERM);
  ASSERT_EQ(recorder->wait(), 0) << recorder->err();
  std::error_code ignored;
  EXPECT_TRUE(std::filesystem::exists(folder.file("session_1.db3"), ignored));
  EXPECT_LE(std::filesystem::file_size(session), 300'000U);
  expect_proved(folder, session, 350);

  const std::vector<std::pair<std::vector<std::string>, std::string>> refusals{
      {{"-o", session}, "exists"},
      {{"-o", folder.file("no/such.db3")}, "No such file"},
      {{"-o", folder.file("new.db3"), "--topics", "poses"}, "topic poses"},
      {{"-o", folder.file("new.db3"), "--max-size", "10"}, "max-size"},
      {{"-o", folder.file("new.db3"), "--split"}, "split"}};
  for (const auto& [words, message] : refusals) {
    std::vector<std::string> all{"record"};
    all.insert(all.end(), words.begin(), words.end());
    std::string err;
    EXPECT_EQ(test::run(folder, "nearmesh-subscriber", on_bus(all), nullptr, &err), 1);
    EXPECT_NE(err.find(message), std::string::npos) << err;
  }
  EXPECT_FALSE(std::filesystem::exists(folder.file("new.db3"), ignored));
  std::string err;
  EXPECT_EQ(
      test::run(folder, "nearmesh-subscriber", {"info", folder.file("both.yaml")}, nullptr, &err),
      1);
  EXPECT_NE(err.find("not a recorded session"), std::string::npos) << err;
}

// In a crowd each waits for the others, which need the processor.
TEST_F(Programs, WhoWaitsForAPublisherLooksSeldomForIt) {
  write_flights(10);
  write_scene("alone", {"one"}, "[[ground, one]]", "start_timeout_s: 600\n");
  const auto peer = fly("alone");
  // So often its main thread has slept.
  const auto sleeps = [&] {
    const std::string status = test::read_text("/proc/" + std::to_string(peer->id()) + "/status");
    const std::string_view label = "\nvoluntary_ctxt_switches:";
    const std::size_t at = status.find(label);
    return at == std::string::npos ? 0 : std::stoi(status.substr(at + label.size()));
  };
  ASSERT_TRUE(peer->says("joined domain")) << peer->err();
  std::this_thread::sleep_for(std::chrono::seconds(4));
  // Before the count: who is held up in between counts too few, not too many.
  const Stopwatch clock;
  const int before = sleeps();
  EXPECT_GT(before, 0);
  std::this_thread::sleep_for(std::chrono::seconds(2));
  const int after = sleeps();
  EXPECT_LT(after - before, 100 * clock.seconds());
  EXPECT_FALSE(peer->is_over()) << peer->err();
}

}  // namespace
}  // namespace nearmesh
