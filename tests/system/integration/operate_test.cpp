// SPDX-License-Identifier: Apache-2.0
// The programs as an operator meets them: settings, status, doctor, metrics, transports. Processes
// that talk over 127.0.0.1; every test has a domain and topics of its own.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>
#include <utility>

#include "idl/dds/bus.hpp"
#include "idl/dds/endpoints.hpp"
#include "idl/messages/process_name.hpp"
#include "process.hpp"

namespace nearmesh {
namespace {

using nlohmann::json;
using test::Folder;
using test::Process;

std::string terrain() { return test::model_file("terrain", 48); }
std::string aircraft() { return test::model_file("aircraft", 600); }

/// An environment variable for the children of one scope.
class Variable {
 public:
  Variable(const char* name, const std::string& value) : name_(name) {
    ::setenv(name, value.c_str(), 1);
  }
  ~Variable() { ::unsetenv(name_); }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;

 private:
  const char* name_;
};

/// A port that nobody listens at, of 127.0.0.1.
std::string free_port() {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(::bind(socket, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  socklen_t size = sizeof address;
  ::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size);
  ::close(socket);
  return std::to_string(ntohs(address.sin_port));
}

/// What http://127.0.0.1:PORT/metrics says; "" when nobody does.
std::string get_metrics(const std::string& port) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(port)));
  std::string text;
  if (::connect(socket, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0) {
    const std::string request = "GET /metrics HTTP/1.0\r\n\r\n";
    EXPECT_EQ(::write(socket, request.data(), request.size()),
              static_cast<ssize_t>(request.size()));
    char buffer[4096];
    for (ssize_t n; (n = ::read(socket, buffer, sizeof buffer)) > 0;)
      text.append(buffer, static_cast<std::size_t>(n));
  }
  ::close(socket);
  return text;
}

bool is_certified(const std::string& line) {
  const std::string status = json::parse(line).value("status", "");
  return status == "free" || status == "contact";
}

class Operate : public ::testing::Test {
 protected:
  /// Of 400 frames, of a flight that outlasts what is awaited in it: 400 s.
  static constexpr int kRounds = 50;
  Folder folder;

  std::vector<std::string> bus() const {
    const auto& suite = *::testing::UnitTest::GetInstance()->current_test_suite();
    int place = 0;
    for (int i = 0; i < suite.total_test_count(); ++i)
      if (suite.GetTestInfo(i) == ::testing::UnitTest::GetInstance()->current_test_info())
        place = i;
    return {"--domain", std::to_string(150 + place), "--prefix",
            "operate-" + std::to_string(::getpid())};
  }
  std::vector<std::string> with(std::vector<std::string> words,
                                const std::vector<std::string>& more = {"--interface",
                                                                        "127.0.0.1"}) const {
    for (const auto& list : {bus(), more}) words.insert(words.end(), list.begin(), list.end());
    return words;
  }
  std::unique_ptr<Process> serve(std::vector<std::string> words) const {
    words.insert(words.begin(), "serve");
    auto publisher = std::make_unique<Process>(folder, "nearmesh-publisher", words);
    EXPECT_TRUE(publisher->says("ready on domain")) << publisher->err();
    return publisher;
  }
  /// flight.yaml: an aircraft over ground, `frames` at 50 Hz, and as many back, and so on.
  void write_scene(int frames, int rounds = 1) const {
    std::string err;
    ASSERT_EQ(test::run(folder, "nearmesh-demo-flights",
                        {folder.path(), "--size", "48", "--frames", std::to_string(frames),
                         "--rate", "50", "--rounds", std::to_string(rounds)},
                        nullptr, &err),
              0)
        << err;
    folder.write("flight.yaml",
                 "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
                 "  - {name: one, model: aircraft}\n"
                 "moves:\n  - {body: one, trajectory: flight1.csv}\n"
                 "pairs: [[ground, one]]\nframe_rate_hz: 50\nbudget_ms: 5\nlookahead_s: 0.2\n"
                 "start_timeout_s: 90\n");
  }
  std::string told;  ///< by status, the last time that it was asked
  /// Asks status until `holds` of what it told.
  [[nodiscard]] bool status_tells(const std::function<bool()>& holds,
                                  const std::vector<std::string>& more = {}) {
    std::vector<std::string> words{"status", "--seconds", "1.5"};
    words.insert(words.end(), more.begin(), more.end());
    return test::run_until(folder, "nearmesh-subscriber", with(words), told, holds);
  }
  [[nodiscard]] bool status_tells(const std::string& text,
                                  const std::vector<std::string>& more = {}) {
    return status_tells([&] { return told.find(text) != std::string::npos; }, more);
  }
  static json finding(const json& report, const std::string& name) {
    for (const json& entry : report.at("findings"))
      if (entry.at("name") == name) return entry;
    ADD_FAILURE() << "no finding " << name << " in " << report.dump(1);
    return {};
  }
};

// --- Settings

TEST_F(Operate, PrintConfigTellsEachValueAndItsLayer) {
  folder.write("my.yaml", "lease_s: 20\nprefix: ours\nmodels: [a.spm, b.spm]\nmax_peers: 5\n");
  const Variable config("NEARMESH_CONFIG", folder.file("my.yaml"));
  const Variable prefix("NEARMESH_PREFIX", "theirs");
  std::string out, err;
  ASSERT_EQ(
      test::run(folder, "nearmesh-publisher",
                {"serve", "--max-peers", "6", "--transport", "thin", "--print-config", "--json"},
                &out, &err),
      0)
      << err;
  std::map<std::string, json> settings;
  for (const json& entry : json::parse(out)) settings[entry.at("key")] = entry;
  const auto expect = [&](const char* key, const json& value, const char* source,
                          const std::string& place) {
    EXPECT_EQ(settings[key].at("value"), value) << key;
    EXPECT_EQ(settings[key].at("source"), source) << key;
    EXPECT_EQ(settings[key].at("place"), place) << key;
  };
  expect("domain", 0, "built-in", "");
  expect("heartbeat_s", 0.3, "preset", "thin");
  expect("lease_s", 20, "file", folder.file("my.yaml") + ":1");
  expect("models", {"a.spm", "b.spm"}, "file", folder.file("my.yaml") + ":3");
  expect("prefix", "theirs", "environment", "NEARMESH_PREFIX");
  expect("max_peers", 6, "flag", "--max-peers");
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber",
                      {"run", "--print-config", "--config", "/dev/null"}, &out, &err),
            0)
      << err;
  EXPECT_NE(out.find("prefix: \"theirs\""), std::string::npos) << out;
  EXPECT_NE(out.find("# environment NEARMESH_PREFIX"), std::string::npos) << out;
}

TEST_F(Operate, WrongSettingsNameTheirPlace) {
  folder.write("typo.yaml", "domain: 3\nleas_s: 4\n");
  folder.write("range.yaml", "domain: 233\n");
  struct Case {
    std::vector<std::string> words;
    int code;
    std::string expected;
  };
  for (const Case& wrong : std::vector<Case>{
           {{"--config", folder.file("typo.yaml")},
            2,
            "typo.yaml:2: unknown key leas_s; the nearest is lease_s"},
           {{"--config", folder.file("range.yaml")},
            2,
            "range.yaml:1: domain: expected a whole number in [0, 232], found 233"},
           {{"--config", folder.file("absent.yaml")}, 2, "absent.yaml: cannot open"},
           {{"--transport", "pigeon"},
            2,
            "expected one of lan, thin, tcp, udp-only, same-host, found pigeon"},
           {{"--lease-s", "0"}, 2, "--lease-s: expected a number in"},
           {{"--log", "loud"}, 2, "--log: expected one of"},
           {{"--interface", "nowhere"}, 1, "interface \"nowhere\""},
           {{"--transport", "udp-only"},
            1,
            "udp-only: expected initial peers or a discovery server"},
           {{"--discovery-server", "1.2.3.4:x"}, 1, "expected an IPv4 address, or one with a port"},
           {{"--lease-s", "1"}, 1, "lease_s: expected at least twice announcement_s"}}) {
    std::vector<std::string> words{"status", "--seconds", "0.1"};
    words.insert(words.end(), wrong.words.begin(), wrong.words.end());
    std::string err;
    EXPECT_EQ(test::run(folder, "nearmesh-subscriber", words, nullptr, &err), wrong.code)
        << wrong.expected;
    EXPECT_NE(err.find(wrong.expected), std::string::npos) << err;
  }
  const Variable domain("NEARMESH_DOMAIN", "many");
  std::string err;
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber", {"status"}, nullptr, &err), 2);
  EXPECT_NE(err.find("NEARMESH_DOMAIN: expected a whole number"), std::string::npos) << err;
}

/// The tables of docs/operate.md, rows as "| `key` | built-in | values | help |", are those of the
/// programs.
TEST_F(Operate, PageHoldsEverySetting) {
  const std::vector<std::string> page = test::lines_of(test::read_text(NEARMESH_OPERATE_PAGE));
  for (const auto& [program, command] :
       {std::pair{"nearmesh-publisher", "serve"}, std::pair{"nearmesh-subscriber", "run"}}) {
    std::string out, err;
    ASSERT_EQ(test::run(folder, program, {command, "--print-config", "--json"}, &out, &err), 0)
        << err;
    for (const json& entry : json::parse(out)) {
      const std::string built_in = entry.at("built_in").dump();
      const std::string row = "| `" + entry.at("key").get<std::string>() + "` | `" + built_in +
                              "` | " + entry.at("values").get<std::string>() + " | " +
                              entry.at("help").get<std::string>() + " |";
      EXPECT_NE(std::find(page.begin(), page.end(), row), page.end())
          << "docs/operate.md lacks this row: " << row;
    }
  }
}

TEST_F(Operate, LevelsOfTheLogCountByRoom) {
  write_scene(5);
  const auto publisher = serve(with({terrain(), aircraft()}));
  std::string err;
  ASSERT_EQ(test::run(folder, "nearmesh-subscriber", with({"run", folder.file("flight.yaml")}),
                      nullptr, &err),
            0);
  EXPECT_EQ(err.find("session debug"), std::string::npos) << err;
  ASSERT_EQ(
      test::run(folder, "nearmesh-subscriber",
                with({"run", folder.file("flight.yaml"), "--log", "session=debug"}), nullptr, &err),
      0);
  EXPECT_NE(err.find("session debug: 1 answers"), std::string::npos) << err;
}

// --- Watch

// What strangers get, and what a browser shows: look_at_live.py.
TEST_F(Operate, WatchShowsTheBusInABrowser) {
  write_scene(2);
  ASSERT_EQ(test::run(folder, "nearmesh-demo-flights",
                      {folder.path(), "--size", "48", "--frames", "100", "--rate", "20", "--rounds",
                       "200"}),
            0);  // there and back
  const auto publisher = serve(with({terrain(), aircraft()}));
  const std::string port = free_port();
  Process watch(folder, "nearmesh-subscriber", with({"watch", "--http", port}));
  ASSERT_TRUE(test::await([&] { return !watch.out().empty() || watch.is_over(); })) << watch.err();
  if (watch.err().find("three.js") != std::string::npos) GTEST_SKIP() << watch.err();
  EXPECT_EQ(watch.out(), "http://127.0.0.1:" + port + "/\n") << watch.err();
  const Process peer(
      folder, "nearmesh-subscriber",
      with({"run", folder.file("flight.yaml"), "--wait-recorder", "--name", "peer-1"}));
  const std::string out = folder.file("looked.txt");
  const int status = std::system(("python3 '" NEARMESH_LOOK_AT_LIVE "' " + port + " " +
                                  std::to_string(watch.id()) + " >'" + out + "' 2>&1")
                                     .c_str());
  if (WEXITSTATUS(status) == 77)
    watch.signal(SIGINT);
  else
    EXPECT_EQ(status, 0) << test::read_text(out);
  EXPECT_EQ(watch.wait(), 0) << watch.err();
  if (WEXITSTATUS(status) == 77) GTEST_SKIP() << "no Chromium here (Debian package chromium)";
}

// Else it would fill a disk in days, and the memory of all that look.
TEST_F(Operate, WatchBeginsAnewAtItsSize) {
  write_scene(400, kRounds);
  const auto publisher = serve(with({terrain(), aircraft()}));
  const Variable scratch("TMPDIR", folder.path());
  const std::string port = free_port();
  Process watch(folder, "nearmesh-subscriber",
                with({"watch", "--http", port, "--max-size", "256KiB"}));
  ASSERT_TRUE(test::await([&] { return !watch.out().empty() || watch.is_over(); })) << watch.err();
  if (watch.err().find("three.js") != std::string::npos) GTEST_SKIP() << watch.err();
  const Process peer(folder, "nearmesh-subscriber", with({"run", folder.file("flight.yaml")}));
  const auto recordings = [&] {
    std::set<std::string> names;
    std::error_code gone;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder.path(), gone))
      if (entry.path().filename().string().starts_with("live_") &&
          entry.path().extension() == ".db3")
        names.insert(entry.path().filename().string());
    return names;
  };
  // One at a time, each with the next number.
  EXPECT_TRUE(test::await([&] {
    const std::set<std::string> now = recordings();
    return now.size() == 1 && std::stoi(now.begin()->substr(5)) >= 2;
  })) << recordings().size()
      << watch.err();
  EXPECT_FALSE(watch.is_over()) << watch.err();
  watch.signal(SIGINT);
  EXPECT_EQ(watch.wait(), 0) << watch.err();
  EXPECT_TRUE(recordings().empty());
}

TEST_F(Operate, WatchSaysWhatIsWrong) {
  std::string err;
  EXPECT_EQ(
      test::run(folder, "nearmesh-subscriber", with({"watch", "--http", "nowhere"}), nullptr, &err),
      1);
  EXPECT_NE(err.find("--http nowhere: expected PORT or ADDRESS:PORT"), std::string::npos) << err;
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber", with({"watch", "--http", "203.0.113.1:8080"}),
                      nullptr, &err),
            1);
  if (err.find("three.js") != std::string::npos) GTEST_SKIP() << err;
  EXPECT_NE(err.find("cannot listen at 203.0.113.1:8080"), std::string::npos) << err;
}

// --- Status and metrics

TEST_F(Operate, StatusTellsOfPublisherAndPeer) {
  write_scene(400, kRounds);
  const auto publisher = serve(with({terrain(), aircraft()}));
  const std::string port = free_port();
  const Process peer(folder, "nearmesh-subscriber",
                     with({"run", folder.file("flight.yaml"), "--metrics", port}));
  json status;
  // Each tells it once a second, so one may not have told yet of what the other has.
  ASSERT_TRUE(status_tells(
      [&] {
        status = json::parse(told);
        return status.at("peers").size() == 1 && status["peers"][0].at("certified_pairs") == 1 &&
               status.at("publishers").size() == 1 &&
               status["publishers"][0].value("peers", 0) == 1 &&
               status["publishers"][0].value("batches", 0) > 0;
      },
      {"--json"}))
      << told;
  EXPECT_EQ(status["peers"][0].at("readiness"), "ready");
  EXPECT_EQ(status["publishers"][0].at("models").size(), 2U);
  const json& served = status["publishers"][0]["models"];
  for (const json& model : status["peers"][0].at("models")) {
    EXPECT_GT(model.at("splits"), 0);
    EXPECT_TRUE(std::any_of(served.begin(), served.end(), [&](const json& other) {
      return other.at("name") == model.at("name") &&
             other.at("content_hash") == model.at("content_hash") &&
             other.at("faces") == model.at("faces");
    })) << status.dump(1);
  }
  EXPECT_GT(status["peers"][0].at("requests"), 0);
  EXPECT_EQ(status["peers"][0].at("process_id"), peer.id());
  EXPECT_EQ(status["publishers"][0].at("process_id"), publisher->id());
  for (const char* role : {"peers", "publishers"}) {
    const json& process = status[role][0];
    EXPECT_GT(process.at("uptime_s"), 0);
    EXPECT_GT(process.at("resident_bytes"), 1'000'000);
    EXPECT_GT(process.at("batches"), 0) << role;
    // A batch is a datagram.
    EXPECT_GT(process.at("bytes"), process.at("batches")) << role;
    EXPECT_LE(process.at("bytes").get<double>(), 1200 * process.at("batches").get<double>())
        << role;
    EXPECT_EQ(process.at("refused"), 0);
    EXPECT_EQ(process.at("has_door"), true);
    EXPECT_EQ(process.at("door_refused").at("submessages"), 0);
  }
  EXPECT_TRUE(status.at("refusals").empty()) << status.dump(1);

  std::string metrics;
  for (const char* text :
       {"200 OK", "nearmesh_certified_pairs{role=\"peer\"} 1", "nearmesh_door{role=\"peer\"} 1",
        "nearmesh_door_refused_total{role=\"peer\",reason=\"source\"} 0",
        "# TYPE nearmesh_batch_bytes_total counter",
        "nearmesh_model_held_splits{role=\"peer\",model=\"terrain\""})
    EXPECT_TRUE(test::await([&] {
      metrics = get_metrics(port);
      return metrics.find(text) != std::string::npos;
    })) << text
        << " in " << metrics;
}

TEST_F(Operate, NamesStandBesideNumbersEverywhere) {
  write_scene(400, kRounds);
  const auto publisher = serve(with({terrain(), aircraft(), "--name", "terrain server"}));
  EXPECT_NE(publisher->err().find(" (terrain server)"), std::string::npos) << publisher->err();
  Process recorder(folder, "nearmesh-subscriber", with({"record", "-o", folder.file("named.db3")}));
  ASSERT_TRUE(recorder.says("recording domain")) << recorder.err();
  Process named(folder, "nearmesh-subscriber",
                with({"run", folder.file("flight.yaml"), "--wait-recorder", "--name", "cockpit 1",
                      "--answers", folder.file("answers.jsonl")}));
  std::string out, err;
  json status;
  ASSERT_TRUE(status_tells(
      [&] {
        status = json::parse(told);
        return status.at("peers").size() == 1 && status["peers"][0].at("moved_bodies") != 0 &&
               status.at("publishers").size() == 1 && status["publishers"][0].contains("host");
      },
      {"--json"}))
      << told;
  EXPECT_EQ(status["publishers"][0].at("name"), "terrain server");
  const json& peer = status["peers"][0];
  EXPECT_EQ(peer.at("name"), "cockpit 1");
  EXPECT_EQ(peer.at("moves"), json{"one"});
  EXPECT_EQ(peer.at("moved_bodies"), 1);
  EXPECT_EQ(peer.at("heard_bodies"), 0);
  EXPECT_EQ(peer.at("stale_bodies"), 0);
  EXPECT_TRUE(peer.at("oldest_pose").is_null());
  const std::string number = peer.at("session");
  // On the page is what was recorded of a flight.
  ASSERT_TRUE(test::answers_come(folder.file("answers.jsonl"), 0, 50, is_certified)) << named.err();
  named.signal(SIGINT);
  EXPECT_EQ(named.wait(), 0) << named.err();
  EXPECT_NE(named.err().find("as peer " + number + " (cockpit 1)"), std::string::npos)
      << named.err();
  recorder.signal(SIGINT);
  EXPECT_EQ(recorder.wait(), 0) << recorder.err();
  // The recording knows it too, and the page made from it.
  ASSERT_EQ(test::run(folder, "nearmesh-subscriber", {"info", folder.file("named.db3"), "--json"},
                      &out, &err),
            0)
      << err;
  const json info = json::parse(out);
  EXPECT_EQ(info.at("names").at(number), "cockpit 1") << info.dump(1);
  ASSERT_EQ(info.at("publishers").size(), 1U);
  EXPECT_EQ(info.at("names").at(info["publishers"][0].get<std::string>()), "terrain server");
  for (const json& topic : info.at("topics"))
    if (topic.at("name").get<std::string>().ends_with("process_status")) {
      EXPECT_EQ(topic.at("samples"), 2) << "one of each process";
      EXPECT_EQ(topic.at("missing"), 0);
    }
  EXPECT_EQ(test::run(folder, "nearmesh-subscriber",
                      {"report", folder.file("named.db3"), "-o", folder.file("page")}, &out, &err),
            0)
      << err;
  EXPECT_NE(test::read_text(folder.file("page/index.html")).find("cockpit 1"), std::string::npos);
}

TEST_F(Operate, StatusTellsOfPosesThatAreOldOrGone) {
  write_scene(400, kRounds);
  folder.write("look.yaml",
               "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
               "  - {name: one, model: aircraft}\n  - {name: two, model: aircraft}\n"
               "moves:\n  - {body: two, trajectory: flight2.csv}\n"
               "pairs: [[one, two]]\nframe_rate_hz: 50\nbudget_ms: 5\n");
  const auto publisher = serve(with({terrain(), aircraft()}));
  Process mover(folder, "nearmesh-subscriber", with({"run", folder.file("flight.yaml")}));
  Process looker(folder, "nearmesh-subscriber",
                 with({"run", folder.file("look.yaml"), "--name", "looker"}));
  json looked;
  const auto looker_has = [&](const char* count) {
    return status_tells(
        [&] {
          looked = json::object();
          const json status = json::parse(told);
          for (const json& peer : status.at("peers"))
            if (peer.at("name") == "looker") looked = peer;
          return looked.value(count, 0) == 1;
        },
        {"--json"});
  };
  ASSERT_TRUE(looker_has("certified_pairs")) << told << looker.err();
  EXPECT_EQ(looked.at("heard_bodies"), 1);
  EXPECT_EQ(looked.at("stale_bodies"), 0);
  ASSERT_TRUE(looked.at("oldest_pose").is_object()) << looked.dump(1);
  EXPECT_EQ(looked["oldest_pose"].at("body"), "one");
  EXPECT_LT(std::abs(looked["oldest_pose"].at("age_s").get<double>()), 2);
  mover.signal(SIGKILL);
  ASSERT_TRUE(looker_has("stale_bodies")) << told;
}

/// Its text names what was expected; it is refused before anything is joined.
TEST_F(Operate, BadNamesAreRefusedWhereTheyAreGiven) {
  folder.write("name.yaml", "name: \"rig\\e[2J\"\n");
  struct Case {
    std::vector<std::string> words;
    std::string expected;
  };
  for (const Case& wrong : std::vector<Case>{
           {{"--name", ""}, "--name: expected 1 to 63 bytes of printable ASCII, found none"},
           {{"--name", std::string(64, 'x')}, "found 64 bytes"},
           {{"--name", "two\nlines"}, "found byte 0x0a at place 4"},
           {{"--name", "\xff\xfe"}, "found byte 0xff at place 1"},
           {{"--config", folder.file("name.yaml")}, "name.yaml:1: name: expected 1 to 63 bytes"}}) {
    for (const auto& [program, command] :
         {std::pair{"nearmesh-publisher", "serve"}, std::pair{"nearmesh-subscriber", "status"}}) {
      std::vector<std::string> words{command};
      words.insert(words.end(), wrong.words.begin(), wrong.words.end());
      std::string err;
      EXPECT_EQ(test::run(folder, program, words, nullptr, &err), 2) << wrong.expected;
      EXPECT_NE(err.find(wrong.expected), std::string::npos) << err;
    }
  }
}

TEST_F(Operate, VersionsOfEveryProgramAndVerb) {
  for (const auto& [program, verbs] : std::vector<std::pair<std::string, std::vector<std::string>>>{
           {"nearmesh-model", {"", "build", "info"}},
           {"nearmesh-publisher", {"", "serve", "replay"}},
           {"nearmesh-subscriber", {"", "run", "record", "status", "doctor", "verify"}},
           {"nearmesh-demo-flights", {""}}})
    for (const std::string& verb : verbs) {
      std::vector<std::string> words{"--version"};
      if (!verb.empty()) words.insert(words.begin(), verb);
      std::string out, err;
      EXPECT_EQ(test::run(folder, program, words, &out, &err), 0) << program << verb << err;
      const std::vector<std::string> lines = test::lines_of(out);
      ASSERT_FALSE(lines.empty()) << program << verb;
      EXPECT_EQ(lines[0].find(program + " "), 0U) << out;
      const bool speaks_dds = program == "nearmesh-publisher" || program == "nearmesh-subscriber";
      ASSERT_EQ(lines.size(), speaks_dds ? 3U : 1U) << out;
      if (!speaks_dds) continue;
      EXPECT_EQ(lines[1].find("wire version "), 0U) << out;
      EXPECT_EQ(lines[2].find("Fast DDS "), 0U) << out;
      EXPECT_NE(lines[2].find("assertions"), std::string::npos) << out;
    }
}

/// A program of another release, as far as this one can be it: an endpoint of each topic, named and
/// filled in for that wire version. It serves the same name with another content, asks, and moves
/// the body that others move.
class OtherRelease {
 public:
  OtherRelease(const wire::TransportOptions& transport, std::uint16_t version) : version_(version) {
    auto opened =
        wire::Bus::open({.transport = transport,
                         .header_bytes_per_s = 10'000'000,  // it paces headers, too
                         .names = wire::TopicNames(transport.prefix, std::to_string(version))},
                        mailbox_);
    EXPECT_TRUE(opened.is_ok()) << opened.status().message();
    bus_ = std::move(opened).value();
    wire::for_each_topic([this](const auto& topic) {
      using Message = typename std::decay_t<decltype(topic)>::Message;
      auto reader = std::make_shared<wire::Reader<Message>>(mailbox_);
      auto writer = std::make_shared<wire::Writer<Message>>(mailbox_);
      EXPECT_TRUE(reader->open(*bus_).is_ok() && writer->open(*bus_).is_ok()) << topic.name;
      endpoints_.push_back(reader);
      endpoints_.push_back(writer);
      if constexpr (requires {
                      { says(Message{}) } -> std::same_as<Message>;
                    })
        says_.push_back([this, writer, message = says(Message{})]() mutable {
          if constexpr (requires { message.frame; }) ++message.frame;
          EXPECT_NE(writer->write(message), wire::WriteResult::kFailed);
        });
    });
    thread_ = std::jthread([this](const std::stop_token& stop) {
      for (; !stop.stop_requested(); test::pause(0.02))
        for (const auto& say : says_) say();
    });
  }
  ~OtherRelease() {
    thread_ = {};
    says_.clear();
    bus_.reset();
  }
  OtherRelease(const OtherRelease&) = delete;
  OtherRelease& operator=(const OtherRelease&) = delete;

 private:
  template <class Message>
  Message of_it(Message message) const {
    message.wire_version = version_;
    return message;
  }
  wire::Hello says(wire::Hello hello) const {
    hello.publisher = own_;
    hello.models.push_back({"terrain", {1, 2}, 1000});
    hello.models.push_back({"aircraft", {3, 4}, 1000});
    return of_it(hello);
  }
  wire::RegionSubscription says(wire::RegionSubscription asked) const {
    asked.peer = asked.publisher = own_;
    asked.request = 1;
    return of_it(asked);
  }
  wire::BodyDirectory says(wire::BodyDirectory directory) const {
    directory.peer = own_;
    directory.bodies.push_back({.number = 0, .name = "one", .model = "aircraft"});
    return of_it(directory);
  }
  wire::BodyPoses says(wire::BodyPoses poses) const {
    poses.peer = own_;
    poses.bodies.push_back({.number = 0});
    return of_it(poses);
  }
  wire::ProcessStatus says(wire::ProcessStatus status) const {
    status.session = own_;
    status.name = "not to be shown";
    return of_it(status);
  }

  const std::uint16_t version_;
  const wire::SessionId own_ = wire::make_session_id();
  wire::Mailbox mailbox_;
  std::vector<std::shared_ptr<void>> endpoints_;  // outlive the bus
  std::vector<std::function<void()>> says_;
  std::unique_ptr<wire::Bus> bus_;
  std::jthread thread_;
};

// Each names the other; nobody is harmed.
TEST_F(Operate, ReleasesOfOtherWireVersionsShareTheBus) {
  write_scene(400, kRounds);
  wire::TransportOptions transport;
  transport.domain = static_cast<std::uint32_t>(std::stoul(bus()[1]));
  transport.prefix = bus()[3];
  transport.interface = "127.0.0.1";
  transport.name = "old rig";
  const OtherRelease older(transport, wire::kWireVersion - 1);
  transport.name = "";
  const OtherRelease newer(transport, wire::kWireVersion + 1);
  const auto publisher = serve(with({terrain(), aircraft()}));
  Process peer(
      folder, "nearmesh-subscriber",
      with({"run", folder.file("flight.yaml"), "--answers", folder.file("answers.jsonl")}));
  const auto line = [&](const std::string& who, int version) {
    return who + " uses prefix " + transport.prefix + " with wire version " +
           std::to_string(version) + ", this build speaks " + std::to_string(wire::kWireVersion);
  };
  const std::vector<std::string> expected{
      line("old rig on " + wire::default_process_name(), wire::kWireVersion - 1),
      line(wire::default_process_name(), wire::kWireVersion + 1)};
  json status;
  ASSERT_TRUE(status_tells(
      [&] {
        status = json::parse(told);
        return status.at("publishers").size() == 1 && status.at("peers").size() == 1 &&
               status["peers"][0].at("certified_pairs") == 1 &&
               std::all_of(expected.begin(), expected.end(), [&](const std::string& text) {
                 return told.find(text) != std::string::npos;
               });
      },
      {"--json"}))
      << told;
  EXPECT_EQ(told.find("not to be shown"), std::string::npos) << told;
  EXPECT_TRUE(status.at("errors").empty()) << told;
  for (const char* role : {"peers", "publishers"})
    for (const json& process : status.at(role)) EXPECT_EQ(process.at("refused"), 0) << told;
  for (const std::string& text : expected) {
    EXPECT_TRUE(peer.says(text)) << peer.err();
    EXPECT_TRUE(publisher->says(text)) << publisher->err();
  }
  constexpr std::size_t kCertified = 300;
  const std::string answers = folder.file("answers.jsonl");
  EXPECT_TRUE(test::answers_come(answers, 0, kCertified, is_certified)) << peer.err();
  peer.signal(SIGINT);
  EXPECT_EQ(peer.wait(), 0) << peer.err();
  const test::CheckedAnswers checked =
      test::check_answers(folder, {terrain(), aircraft()}, answers);
  EXPECT_EQ(checked.wrong, 0U);
  EXPECT_GE(checked.certified, kCertified);
  publisher->signal(SIGINT);
  EXPECT_EQ(publisher->wait(), 0) << publisher->err();
}

TEST_F(Operate, StatusTellsWhoseContentDiffers) {
  write_scene(5);
  const std::string other = "0123456789abcdef0123456789abcdef";
  folder.write(
      "pinned.yaml",
      "bodies:\n  - {name: ground, model: terrain, content: " + other +
          ", pose: {translation: [0, 0, 0]}}\n  - {name: one, model: aircraft}\n"
          "moves:\n  - {body: one, trajectory: flight1.csv}\n"
          "pairs: [[ground, one]]\nframe_rate_hz: 50\nbudget_ms: 5\nstart_timeout_s: 600\n");
  const auto publisher = serve(with({terrain(), aircraft()}));
  const Process peer(folder, "nearmesh-subscriber",
                     with({"run", folder.file("pinned.yaml"), "--name", "odd one"}));
  EXPECT_TRUE(status_tells(" (odd one) stands by content " + other + ", but what is served"))
      << told;
}

TEST_F(Operate, StatusTellsWhatAPeerWaitsFor) {
  write_scene(5);
  const auto publisher = serve(with({terrain()}));  // and nobody serves the aircraft
  const Process peer(folder, "nearmesh-subscriber", with({"run", folder.file("flight.yaml")}));
  EXPECT_TRUE(status_tells("waits: nobody serves model aircraft: 0 of 1 pair certified")) << told;
}

TEST_F(Operate, StatusTellsOfEachRegionOnDemand) {
  write_scene(5);
  // High above the ground, then through it and along, so that it lacks more at each moment.
  std::string rows = "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n";
  for (int i = 0; i < 6000; ++i)
    rows += "1,0,0,0,1,0,0,0,1," + std::to_string(-600 + 0.2 * i) + ",0," +
            std::to_string(i < 250 ? 500 : 100 * std::sin(0.05 * i)) + "\n";
  folder.write("flight1.csv", rows);
  const auto publisher = serve(with({terrain(), aircraft()}));
  const Process peer(folder, "nearmesh-subscriber", with({"run", folder.file("flight.yaml")}));
  json region;
  ASSERT_TRUE(status_tells(
      [&] {
        const json status = json::parse(told);
        if (status.at("peers").empty() || status["peers"][0].at("regions").empty()) return false;
        region = status["peers"][0]["regions"][0];
        return region.at("status") == "free";
      },
      {"--regions", "--json"}))
      << told;
  EXPECT_EQ(region.at("a"), "ground");
  EXPECT_EQ(region.at("b"), "one");
  EXPECT_EQ(region.at("uncertain_s"), 0);
  EXPECT_GT(region.at("clearance_m"), 0);
  // While nobody serves, answers turn uncertain: how far off they may be, and since when.
  publisher->signal(SIGKILL);
  ASSERT_TRUE(status_tells(
      [&] {
        return (told.find("region ground and one: uncertain") != std::string::npos ||
                told.find("region ground and one: partial") != std::string::npos) &&
               told.find(" m, for ") != std::string::npos;
      },
      {"--regions"}))
      << told;
  // Without the flag nothing is heard of it.
  EXPECT_TRUE(status_tells("of 1 pair certified")) << told;
  EXPECT_EQ(told.find("region ground"), std::string::npos) << told;
}

TEST_F(Operate, StatusTellsOfOneNameWithTwoContents) {
  const std::string other = folder.file("terrain.spm");
  std::filesystem::copy_file(aircraft(), other);
  const auto one = serve(with({terrain()})), two = serve(with({other}));
  EXPECT_TRUE(status_tells("errors\n  model terrain: publisher")) << told;
  EXPECT_NE(told.find("stop or rename one"), std::string::npos) << told;
}

TEST_F(Operate, StatusOfAnEmptyBusFails) {
  std::string err;
  EXPECT_EQ(
      test::run(folder, "nearmesh-subscriber", with({"status", "--seconds", "0.3"}), nullptr, &err),
      1);
  EXPECT_NE(err.find("nobody was heard on domain"), std::string::npos) << err;
}

TEST_F(Operate, WatchedStatusGoesOnUntilInterrupted) {
  const auto publisher = serve(with({terrain()}));
  Process watch(folder, "nearmesh-subscriber",
                with({"status", "--watch", "--seconds", "0.2", "--json"}));
  EXPECT_TRUE(test::await([&] { return test::lines_of(watch.out()).size() >= 3; }));
  watch.signal(SIGINT);
  EXPECT_EQ(watch.wait(), 0) << watch.err();
  for (const std::string& line : test::lines_of(watch.out())) EXPECT_TRUE(json::accept(line));
}

TEST_F(Operate, MetricsAddressThatIsTakenIsNamed) {
  const std::string port = free_port();
  const auto publisher = serve(with({terrain(), "--metrics", port}));
  EXPECT_TRUE(test::await([&] {
    return get_metrics(port).find("nearmesh_model_faces{role=\"publisher\",model=\"terrain\"") !=
           std::string::npos;
  }));
  std::string err;
  EXPECT_EQ(test::run(folder, "nearmesh-publisher", with({"serve", aircraft(), "--metrics", port}),
                      nullptr, &err),
            1);
  EXPECT_NE(err.find("metrics: cannot listen at 127.0.0.1:" + port), std::string::npos) << err;
}

// --- Doctor

// A machine that is held up while they measure is not healthy: they look again.
TEST_F(Operate, TwoDoctorsFindEachOtherHealthy) {
  std::unique_ptr<Process> one, two;
  const auto are_healthy = [&] {
    for (auto* doctor : {&one, &two})
      *doctor =
          std::make_unique<Process>(folder, "nearmesh-subscriber", with({"doctor", "--json"}));
    const int first = one->wait(), second = two->wait();
    return first == 0 && second == 0;
  };
  EXPECT_TRUE(test::await(are_healthy)) << one->out() << two->out() << one->err() << two->err();
  for (Process* doctor : {one.get(), two.get()}) {
    const json report = json::parse(doctor->out());
    EXPECT_TRUE(report.at("healthy")) << report.dump(1);
    EXPECT_EQ(finding(report, "1 kB").at("value").at("bytes"), 1000);
    EXPECT_EQ(finding(report, "1 MB").at("value").at("bytes"), 1000000);
    EXPECT_LT(finding(report, "round trip").at("value").at("median_s"), 0.5);
    EXPECT_LE(finding(report, "loss").at("value"), 0.05);
    EXPECT_FALSE(finding(report, "locators").at("value").empty());
    EXPECT_FALSE(finding(report, "interfaces").at("value").empty());
  }
}

TEST_F(Operate, ADoctorThatIsInterruptedBeforeItFoundAnybodySuspectsNothing) {
  Process doctor(folder, "nearmesh-subscriber", with({"doctor", "--json", "--seconds", "600"}));
  ASSERT_TRUE(doctor.catches(SIGINT)) << doctor.err();
  test::pause(2);  // in the midst of it; any other moment would do
  doctor.signal(SIGINT);
  EXPECT_EQ(doctor.wait(test::kEnd_s), 1) << doctor.err();
  const json report = json::parse(doctor.out());
  EXPECT_FALSE(report.at("healthy"));
  const std::string text = finding(report, "interrupted").at("text");
  EXPECT_NE(text.find("of 600.0 s: nobody was found until then"), std::string::npos) << text;
  for (const json& one : report.at("findings"))
    EXPECT_TRUE(one.at("name") != "discovery" && one.at("name") != "data") << one;
}

TEST_F(Operate, DoctorAgainstAPublisherSeesItsModels) {
  const auto publisher = serve(with({terrain(), aircraft()}));
  std::string out;
  EXPECT_TRUE(test::run_until(folder, "nearmesh-subscriber", with({"doctor", "--seconds", "3"}),
                              out, [&] { return out.find("2 models") != std::string::npos; }))
      << out;
  EXPECT_NE(out.find("model terrain, "), std::string::npos) << out;
}

TEST_F(Operate, LonelyDoctorFails) {
  std::string out, err;
  EXPECT_EQ(
      test::run(folder, "nearmesh-subscriber", with({"doctor", "--seconds", "2"}), &out, &err), 1);
  EXPECT_NE(out.find("nobody was found"), std::string::npos) << out;
  EXPECT_NE(err.find("something is wrong"), std::string::npos) << err;
}

// --- Transports

/// A port that somebody else has makes Fast DDS complain.
TEST_F(Operate, FastDdsComplainsOnStandardErrorAlone) {
  const int taken = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  ASSERT_EQ(::bind(taken, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(::listen(taken, 1), 0);
  socklen_t size = sizeof address;
  ::getsockname(taken, reinterpret_cast<sockaddr*>(&address), &size);
  std::string out, err;
  static_cast<void>(test::run(folder, "nearmesh-subscriber",
                              {"doctor", "--json", "--seconds", "2", "--transport", "tcp",
                               "--listen-port", std::to_string(ntohs(address.sin_port))},
                              &out, &err));
  ::close(taken);
  EXPECT_FALSE(json::parse(out, nullptr, false).is_discarded()) << out;
  EXPECT_NE(err.find("fastdds error: "), std::string::npos) << err;
}

TEST_F(Operate, EveryTransportFliesOnOneMachine) {
  write_scene(5);
  using Words = std::vector<std::string>;
  const auto fly = [&](const Words& publisher_words, const Words& peer_words) {
    const auto publisher = serve(with({terrain(), aircraft()}, publisher_words));
    std::string err;
    EXPECT_EQ(test::run(folder, "nearmesh-subscriber",
                        with({"run", folder.file("flight.yaml")}, peer_words), nullptr, &err),
              0)
        << publisher_words[1] << ": " << err;
    publisher->signal(SIGTERM);
    EXPECT_EQ(publisher->wait(), 0) << publisher->err();
  };
  for (const Words& words : std::vector<Words>{{"--transport", "thin", "--interface", "127.0.0.1"},
                                               {"--transport", "udp-only", "--peer", "127.0.0.1"},
                                               {"--transport", "same-host"}})
    fly(words, words);
  const std::string port = free_port();
  fly({"--transport", "tcp", "--listen-port", port, "--interface", "127.0.0.1"},
      {"--transport", "tcp", "--peer", "127.0.0.1:" + port, "--interface", "127.0.0.1"});
}

/// As by a connection of Fast DDS 2.9 that is deaf: who connects is taken and never answered.
class Deaf {
 public:
  Deaf() {
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const int yes = 1;
    ::setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in place{};
    place.sin_family = AF_INET;
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::bind(listener_, reinterpret_cast<sockaddr*>(&place), sizeof place), 0);
    EXPECT_EQ(::listen(listener_, 8), 0);
    socklen_t size = sizeof place;
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&place), &size);
    port_ = ntohs(place.sin_port);
  }
  ~Deaf() {
    for (const int socket : {listener_, taken_})
      if (socket >= 0) ::close(socket);
  }
  Deaf(const Deaf&) = delete;
  Deaf& operator=(const Deaf&) = delete;
  [[nodiscard]] std::string port() const { return std::to_string(port_); }
  /// Waits for one, and leaves the port to others. Its connection stays.
  [[nodiscard]] bool take_one() {
    pollfd ready{.fd = listener_, .events = POLLIN, .revents = 0};
    if (::poll(&ready, 1, static_cast<int>(1000 * test::kDeadline_s)) != 1) return false;
    taken_ = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    ::close(std::exchange(listener_, -1));
    return taken_ >= 0;
  }

 private:
  std::uint16_t port_ = 0;
  int listener_ = -1, taken_ = -1;
};

TEST_F(Operate, APeerWhoseConnectionIsDeafMakesAnother) {
  write_scene(5);
  Deaf deaf;
  const std::vector<std::string> tcp{"--transport", "tcp", "--interface", "127.0.0.1"};
  std::vector<std::string> words = with({"run", folder.file("flight.yaml")}, tcp);
  words.insert(words.end(), {"--peer", "127.0.0.1:" + deaf.port()});
  Process peer(folder, "nearmesh-subscriber", words);
  ASSERT_TRUE(deaf.take_one()) << peer.err();
  words = with({terrain(), aircraft()}, tcp);
  words.insert(words.end(), {"--listen-port", deaf.port()});
  const auto publisher = serve(words);
  EXPECT_TRUE(peer.says("127.0.0.1:" + deaf.port() +
                        " took the connection, and nobody answers through it: joining again"))
      << peer.err();
  if (peer.err().find("Fast DDS 3.") != std::string::npos)
    GTEST_SKIP() << "Fast DDS 3.1 makes no other connection: docs/platforms.md";
  EXPECT_EQ(peer.wait(), 0) << peer.err();
}

/// Fast DDS 3.1 takes no second connection of one name, be the first long closed.
TEST_F(Operate, WhoComesBackByTcpIsFoundAgain) {
  write_scene(5);
  const std::string port = free_port(), of_peer = free_port();
  const std::vector<std::string> tcp{"--transport", "tcp", "--interface", "127.0.0.1"};
  std::vector<std::string> words = with({terrain(), aircraft()}, tcp);
  words.insert(words.end(), {"--listen-port", port});
  const auto publisher = serve(words);
  words = with({"run", folder.file("flight.yaml")}, tcp);
  words.insert(words.end(), {"--listen-port", of_peer, "--peer", "127.0.0.1:" + port});
  for (const char* time : {"first", "second", "third"}) {
    std::string err;
    EXPECT_EQ(test::run(folder, "nearmesh-subscriber", words, nullptr, &err), 0)
        << time << ": " << err;
  }
}

// --- systemd

TEST(SystemdUnit, IsAcceptedByItsChecker) {
  if (std::system("command -v systemd-analyze >/dev/null") != 0)
    GTEST_SKIP() << "systemd-analyze is not there";
  const Folder folder;
  // As installed, but with the program where it was built.
  std::string text = test::read_text(NEARMESH_UNIT_FILE);
  ASSERT_FALSE(text.empty());
  const std::size_t begin = text.find("ExecStart=") + 10,
                    end = text.find("/nearmesh-publisher ", begin);
  ASSERT_NE(end, std::string::npos);
  text.replace(begin, end - begin, NEARMESH_BIN_DIR);
  folder.write("nearmesh-publisher.service", text);
  const std::string said = folder.file("said.txt");
  EXPECT_EQ(std::system(("systemd-analyze verify " + folder.file("nearmesh-publisher.service") +
                         " >" + said + " 2>&1")
                            .c_str()),
            0)
      << test::read_text(said);
  // What it does not understand it says, and ends with 0. Of other units it may say what it likes.
  EXPECT_EQ(test::read_text(said).find("nearmesh-publisher.service:"), std::string::npos)
      << test::read_text(said);
}

}  // namespace
}  // namespace nearmesh
