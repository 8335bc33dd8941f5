// SPDX-License-Identifier: Apache-2.0
// nearmesh-publisher replay as a user runs it: a session of a publisher and two peers is recorded
// once, then played into domains of its own.

#include <pty.h>
#include <utmp.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "process.hpp"

namespace nearmesh {
namespace {

using nlohmann::json;
using test::Folder;
using test::Process;
using Words = std::vector<std::string>;

constexpr int kTerrainCells = 48;
constexpr int kFrames = 200;  // 4 s

std::string terrain() { return test::model_file("terrain", kTerrainCells); }
std::string aircraft() { return test::model_file("aircraft", 600); }

class ReplayProgram : public ::testing::Test {
 protected:
  Folder folder;

  // Two domains a test, by its place in this file: where it was recorded, and where it is played.
  Words on_bus(Words words, int which) const {
    const auto& suite = *::testing::UnitTest::GetInstance()->current_test_suite();
    int place = 0;
    for (int i = 0; i < suite.total_test_count(); ++i)
      if (suite.GetTestInfo(i) == ::testing::UnitTest::GetInstance()->current_test_info())
        place = i;
    words.insert(words.end(), {"--domain", std::to_string(180 + 2 * place + which), "--prefix",
                               "replay-" + std::to_string(::getpid()), "--interface", "127.0.0.1"});
    return words;
  }
  void write_scene(const std::string& name, const std::string& moves, const std::string& pairs,
                   const std::string& more = "") {
    folder.write(name + ".yaml",
                 "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
                 "  - {name: one, model: aircraft}\n  - {name: two, model: aircraft}\n"
                 "  - {name: three, model: aircraft}\nmoves:\n" +
                     moves + "pairs: " + pairs +
                     "\nframe_rate_hz: 50\nbudget_ms: 5\nlookahead_s: 0.2\n" + more);
  }
  std::unique_ptr<Process> start(const std::string& program, const Words& words,
                                 const std::string& until) {
    auto process = std::make_unique<Process>(folder, program, words);
    EXPECT_TRUE(process->says(until)) << process->err();
    return process;
  }
  std::unique_ptr<Process> fly(const std::string& scene, int which, const Words& more = {}) {
    Words words{"run", folder.file(scene + ".yaml"), "--answers", folder.file(scene + ".jsonl")};
    words.insert(words.end(), more.begin(), more.end());
    return std::make_unique<Process>(folder, "nearmesh-subscriber", on_bus(words, which));
  }
  // Out: the file.
  std::string record_session() {
    std::string err;
    EXPECT_EQ(test::run(folder, "nearmesh-demo-flights",
                        {folder.path(), "--size", std::to_string(kTerrainCells), "--frames",
                         std::to_string(kFrames), "--rate", "50"},
                        nullptr, &err),
              0)
        << err;
    write_scene("first", "  - {body: one, trajectory: flight1.csv}\n",
                "[[ground, one], [one, two]]");
    write_scene("second", "  - {body: two, trajectory: flight2.csv}\n",
                "[[ground, two], [one, two]]");
    const std::string session = folder.file("session.db3");
    const auto recorder =
        start("nearmesh-subscriber", on_bus({"record", "-o", session}, 0), "recording domain");
    const auto publisher =
        start("nearmesh-publisher", on_bus({"serve", terrain(), aircraft()}, 0), "ready on domain");
    // On a machine that is very busy a recorder is found late, and what it missed cannot be played.
    const auto first = fly("first", 0, {"--wait-recorder"}),
               second = fly("second", 0, {"--wait-recorder"});
    EXPECT_EQ(first->wait(), 0) << first->err();
    EXPECT_EQ(second->wait(), 0) << second->err();
    recorder->signal(SIGINT);
    EXPECT_EQ(recorder->wait(), 0) << recorder->err();
    return session;
  }
  Words replay(const std::string& session, const Words& more) const {
    Words words{"replay", session};
    words.insert(words.end(), more.begin(), more.end());
    return on_bus(words, 1);
  }
};

/// Bytes of each writer, in order, by topic; but who took part, which is not replayed.
using Streams = std::multimap<std::string, std::vector<std::vector<std::uint8_t>>>;
Streams streams_of(const std::string& session) {
  const auto recording = RecordingReader::open(session).value();
  std::vector<std::vector<std::vector<std::uint8_t>>> bytes(recording->writers().size());
  EXPECT_TRUE(recording
                  ->read(1, recording->message_count() + 1,
                         [&](std::int64_t, const RecordedMessage& message) {
                           bytes[message.writer].push_back(message.cdr);
                           return true;
                         })
                  .is_ok());
  Streams streams;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const RecordedWriter& writer = recording->writers()[i];
    if (recording->topics()[writer.topic].name.ends_with("/process_status")) continue;
    streams.emplace(recording->topics()[writer.topic].name + " " + writer.partition,
                    std::move(bytes[i]));
  }
  return streams;
}

bool is_in_order_in(const std::vector<std::vector<std::uint8_t>>& part,
                    const std::vector<std::vector<std::uint8_t>>& whole) {
  std::size_t at = 0;
  for (const auto& bytes : whole)
    if (at < part.size() && part[at] == bytes) ++at;
  return at == part.size();
}

TEST_F(ReplayProgram, RecordedAgainItIsTheSame) {
  const std::string session = record_session(), copy = folder.file("copy.db3");
  const Streams played = streams_of(session);
  std::size_t played_count = 0;
  for (const auto& [name, stream] : played) played_count += stream.size();
  EXPECT_GT(played_count, 4U * kFrames);
  std::string out, err;
  // On a machine that is very busy a pose may be overtaken by the next: of many it is played again.
  std::size_t heard_count = 0;
  const std::size_t enough = played_count - played_count / 50;
  for (int i = 0; i < 5 && heard_count < enough && !HasFailure(); ++i) {
    for (const char* suffix : {"", "-wal", "-shm"}) std::filesystem::remove(copy + suffix);
    const auto recorder =
        start("nearmesh-subscriber", on_bus({"record", "-o", copy}, 1), "recording domain");
    ASSERT_EQ(test::run(folder, "nearmesh-publisher", replay(session, {"--rate", "0.5", "--json"}),
                        &out, &err),
              0)
        << err;
    recorder->signal(SIGINT);
    ASSERT_EQ(recorder->wait(), 0) << recorder->err();
    const Streams heard = streams_of(copy);
    heard_count = 0;
    for (const auto& [name, stream] : heard) {
      heard_count += stream.size();
      const auto [begin, end] = played.equal_range(name);
      EXPECT_TRUE(std::any_of(begin, end, [&stream = stream](const auto& entry) {
        return is_in_order_in(stream, entry.second);
      })) << name;
    }
    EXPECT_EQ(heard.size(), played.size());
  }
  EXPECT_GE(heard_count, enough);

  const json report = json::parse(test::lines_of(out).back()).at("replayed");
  EXPECT_EQ(report.at("messages"), played_count);
  EXPECT_EQ(report.at("failed"), 0);
  // Half as fast; never sooner, however late.
  EXPECT_GE(report.at("seconds").get<double>(), 1.98 * report.at("until_s").get<double>());
  EXPECT_GT(report.at("until_s"), 3.5);
  EXPECT_GT(report.at("late_p99_ms"), 0);
  ASSERT_EQ(report.at("topics").size(), 12U);
  const std::set<std::string> none{"watched_bodies", "bounds_report", "near_poses",
                                   "body_promises"};
  for (const json& topic : report.at("topics"))  // no peer watched all pairs, nothing was promised
    EXPECT_EQ(topic.at("bytes") > 0, !none.contains(topic.at("name").get<std::string>())) << topic;
  // It proves itself as the first did.
  std::string verdict;
  EXPECT_EQ(
      test::run(folder, "nearmesh-subscriber", {"verify", copy, "--allow-unproved"}, &verdict), 0)
      << verdict;
  EXPECT_NE(verdict.find(" 0 different"), std::string::npos) << verdict;
}

TEST_F(ReplayProgram, LateJoinerIsAnsweredRight) {
  const std::string session = record_session();
  // Moves a body that nobody asks about, and asks about those of the recording. Its time goes on as
  // that of the machine, the recording's at half the rate, and back.
  write_scene("late", "  - {body: three, trajectory: flight1.csv}\n",
              "[[ground, one], [ground, two], [one, two]]", "max_pose_age_s: 60\n");
  const auto player =
      start("nearmesh-publisher",
            replay(session, {"--start", "1", "--end", "2.5", "--loop", "--rate", "0.5", "--json"}),
            "replaying");
  const auto late = fly("late", 1);
  ASSERT_EQ(late->wait(), 0) << late->err();
  player->signal(SIGINT);
  ASSERT_EQ(player->wait(test::kEnd_s), 0) << player->err();
  const test::CheckedAnswers checked =
      test::check_answers(folder, {terrain(), aircraft()}, folder.file("late.jsonl"));
  EXPECT_EQ(checked.answers, 3U * kFrames);
  EXPECT_EQ(checked.wrong, 0U);
  EXPECT_GT(checked.certified, checked.answers / 2);
  const json report = json::parse(test::lines_of(player->out()).back()).at("replayed");
  EXPECT_GT(report.at("live_requests"), 0);
  EXPECT_GT(report.at("live_batches"), 0);
  EXPECT_GE(report.at("restored"), 5);  // two headers, a hello, two poses
  EXPECT_GE(report.at("loops"), 1);     // and so it was sought, back to the start
  // The recorded peers' subscriptions, which this process hears too, are nobody's.
  EXPECT_EQ(player->err().find("in the recording too"), std::string::npos) << player->err();
}

// It was there for longer than the session lasts, and follows the session's time all the same.
TEST_F(ReplayProgram, AnOnlookerThatHasWaitedFollowsWhatIsPlayed) {
  const std::string session = record_session();
  write_scene("onlooker", "  []\n", "[[ground, one], [ground, two], [one, two]]");
  const auto onlooker = fly("onlooker", 1);
  test::pause(1.2 * kFrames / 50);
  const auto player = start("nearmesh-publisher", replay(session, {"--rate", "0.25"}), "replaying");
  ASSERT_EQ(player->wait(), 0) << player->err();
  onlooker->signal(SIGINT);
  ASSERT_EQ(onlooker->wait(), 0) << onlooker->err();
  const test::CheckedAnswers checked =
      test::check_answers(folder, {terrain(), aircraft()}, folder.file("onlooker.jsonl"));
  EXPECT_EQ(checked.wrong, 0U);
  EXPECT_GT(checked.certified, 3U * kFrames / 2);
}

TEST_F(ReplayProgram, ALivePeerWithTheIdOfARecordedOneIsRefusedOnBothSides) {
  const std::string session = folder.file("golden.db3");
  std::filesystem::copy_file(NEARMESH_SESSION_DATA "/session_v1.db3", session);
  Words words = replay(session, {"--loop"});
  const auto player = start("nearmesh-publisher", words, "replaying");
  subscriber::DdsChannelOptions options;
  options.session = 0xb1;  // as the first peer of that session
  options.transport.interface = "127.0.0.1";
  for (std::size_t i = 0; i + 1 < words.size(); ++i) {
    if (words[i] == "--domain")
      options.transport.domain = static_cast<std::uint32_t>(std::stoul(words[i + 1]));
    if (words[i] == "--prefix") options.transport.prefix = words[i + 1];
  }
  subscriber::Session twin(subscriber::DdsChannel::create(options).value());
  const auto ground = twin.add_body({.name = "ground", .model = "terrain"}).value();
  const auto mine = twin.add_body({.name = "mine", .model = "aircraft", .own = true}).value();
  ASSERT_TRUE(twin.place_body(ground, {}).is_ok());
  ASSERT_TRUE(twin.watch(ground, mine).is_ok());
  // Up and down through the ground, so that it must ask.
  std::string heard;
  int updates = 0;
  EXPECT_TRUE(test::await([&] {
    Motion motion;
    motion.pose.translation_m = {0, 0, -330 + 5.0 * (++updates % 100)};
    const auto report = twin.update(0, 0, {{mine, motion}}, 0.01);
    EXPECT_TRUE(report.is_ok());
    for (const std::string& line : report.value().complaints) heard += line + "\n";
    return heard.find("a replayed session has a peer with the id 00000000000000b1") !=
           std::string::npos;
  })) << heard
      << player->err();
  EXPECT_TRUE(player->says("peer 00000000000000b1 is live and in the recording too"))
      << player->err();
  player->signal(SIGINT);
  EXPECT_EQ(player->wait(), 0) << player->err();
}

TEST_F(ReplayProgram, RefusesWithAReason) {
  const std::string session = record_session();
  folder.write("text.db3", "not a database, only a line of text\n");
  struct Case {
    Words words;
    int code;
    std::string message;
  };
  for (const Case& one :
       std::vector<Case>{{{folder.file("none.db3")}, 1, "none.db3"},
                         {{folder.file("text.db3")}, 1, "not a recorded session"},
                         {{session, "--start", "1000"}, 1, "recording's 0 to "},
                         {{session, "--end", "1000"}, 1, "recording's 0 to "},
                         {{session, "--start", "2", "--end", "1"}, 1, "after the start"},
                         {{session, "--remap", "lab"}, 1, "expected OLD:=NEW"},
                         {{session, "--remap", "lab:=x"}, 1, "has no lab"},
                         {{session, "--remap", "body_poses:=a b"}, 1, "remap body_poses"},
                         {{session, "--rate", "0"}, 2, "above 0"},
                         {{session, "--rate", "-2"}, 2, "above 0"},
                         {{session, "--rate", "nan"}, 2, "above 0"},
                         {{session, "--topics", "poses"}, 2, "poses"},
                         {{}, 2, "recording"}}) {
    Words words{"replay"};
    words.insert(words.end(), one.words.begin(), one.words.end());
    std::string err;
    EXPECT_EQ(test::run(folder, "nearmesh-publisher", words, nullptr, &err), one.code) << err;
    EXPECT_NE(err.find(one.message), std::string::npos) << one.message << "\n" << err;
  }
}

/// A replay on a terminal of its own.
class OnTerminal {
 public:
  explicit OnTerminal(Words words) {
    words.insert(words.begin(), NEARMESH_BIN_DIR "/nearmesh-publisher");
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    int slave = -1;
    EXPECT_EQ(::openpty(&master_, &slave, nullptr, nullptr, nullptr), 0);
    pid_ = ::fork();
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      ::login_tty(slave);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    slave_ = slave;  // stays open, or the terminal would go with the process
    ::fcntl(master_, F_SETFL, O_NONBLOCK);
  }
  ~OnTerminal() {
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      ::waitpid(pid_, nullptr, 0);
    }
    ::close(slave_);
    ::close(master_);
  }
  void type(std::string line) {
    forget();
    line += '\n';
    EXPECT_EQ(::write(master_, line.data(), line.size()), static_cast<ssize_t>(line.size()));
  }
  void forget() { shown_.clear(); }
  bool shows(const std::string& text) {
    return test::await([&] {
      char bytes[4096];
      for (ssize_t n = 0; (n = ::read(master_, bytes, sizeof bytes)) > 0;)
        shown_.append(bytes, static_cast<std::size_t>(n));
      return shown_.find(text) != std::string::npos;
    });
  }

  /// What the next progress line counts; while it is paused.
  long samples() {
    forget();
    const std::string mark = "paused: ";
    EXPECT_TRUE(shows(mark));
    const std::size_t begin = shown_.find(mark) + mark.size();
    EXPECT_TRUE(test::await([&] {
      return shows(" samples;") && shown_.find(" samples;", begin) != std::string::npos;
    }));
    return std::atol(shown_.c_str() + begin);
  }
  int wait() {
    int status = 0;
    const bool over = test::await([&] {
      shows_nothing_new();
      return ::waitpid(pid_, &status, WNOHANG) == pid_;
    });
    if (!over) return -1;
    pid_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
  }
  [[nodiscard]] const std::string& shown() const { return shown_; }

 private:
  void shows_nothing_new() {  // drains, so that the program is not held up
    char bytes[4096];
    while (::read(master_, bytes, sizeof bytes) > 0) {
    }
  }
  int master_ = -1, slave_ = -1;
  pid_t pid_ = 0;
  std::string shown_;
};

TEST_F(ReplayProgram, LinesPauseStepSeekAndEnd) {
  const std::string session = record_session();
  OnTerminal terminal(replay(session, {"--loop", "--rate", "0.1"}));
  ASSERT_TRUE(terminal.shows("samples;")) << terminal.shown();
  terminal.type("pause");
  ASSERT_TRUE(terminal.shows(", paused")) << terminal.shown();
  const long before = terminal.samples();
  EXPECT_EQ(terminal.samples(), before);
  // What is being typed stays where it is: the cursor is kept and given back.
  EXPECT_TRUE(terminal.shows("\x1b\x37\r[") && terminal.shows("\x1b\x38"));
  terminal.type("step");
  ASSERT_TRUE(test::await([&] { return terminal.samples() > before; })) << terminal.shown();
  terminal.type("2.5");
  ASSERT_TRUE(terminal.shows("] 2.5 of")) << terminal.shown();
  terminal.type("-1");
  ASSERT_TRUE(terminal.shows("] 1.5 of")) << terminal.shown();
  terminal.type("start");
  ASSERT_TRUE(terminal.shows("] 0.0 of")) << terminal.shown();
  terminal.type("+100");  // the end
  ASSERT_TRUE(terminal.shows("[========================]")) << terminal.shown();
  terminal.type("faster");
  ASSERT_TRUE(terminal.shows("'faster': expected pause, step")) << terminal.shown();
  terminal.type("quit");
  EXPECT_EQ(terminal.wait(), 0);
}

TEST_F(ReplayProgram, AScriptMayCommandIt) {
  const std::string session = record_session();
  folder.write("orders", "pause\n1.5\nquit");
  std::string command = NEARMESH_BIN_DIR "/nearmesh-publisher";
  for (const std::string& word : replay(session, {"--loop", "--json"}))
    command += " '" + word + "'";
  command += " <'" + folder.file("orders") + "' >'" + folder.file("out") + "'";
  ASSERT_EQ(std::system(command.c_str()), 0);
  const json report =
      json::parse(test::lines_of(test::read_text(folder.file("out"))).back()).at("replayed");
  EXPECT_NEAR(report.at("until_s").get<double>(), 1.5, 0.01);
  EXPECT_GT(report.at("restored"), 0);
}

}  // namespace
}  // namespace nearmesh
