// SPDX-License-Identifier: Apache-2.0
// FlightGear itself as a peer, where it is installed (Debian: flightgear, xvfb, xauth,
// dbus-daemon): its own aircraft and flight model, without a screen. The first start takes a
// minute, in which it makes its caches.

#include <array>
#include <cstdio>
#include <set>

#include "flights.hpp"

namespace nearmesh {
namespace {

/// Empty where it is not installed.
std::string find_program(const std::string& name) {
  std::string folders = "/usr/games:/usr/local/games";
  if (const char* path = std::getenv("PATH")) folders = std::string(path) + ":" + folders;
  std::istringstream in(folders);
  for (std::string folder; std::getline(in, folder, ':');)
    if (::access((folder + "/" + name).c_str(), X_OK) == 0) return folder + "/" + name;
  return {};
}

/// A program and all that it starts.
class ProcessGroup {
 public:
  ProcessGroup(const std::string& log, std::vector<std::string> words) {
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    pid_ = ::fork();
    if (pid_ != 0) return;
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGTERM);
    const int out = ::open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ::dup2(out, STDOUT_FILENO);
    ::dup2(out, STDERR_FILENO);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  ProcessGroup(const ProcessGroup&) = delete;
  ProcessGroup& operator=(const ProcessGroup&) = delete;
  ~ProcessGroup() {
    // The X server takes its files away when it is asked to end.
    for (const int number : {SIGTERM, SIGKILL}) {
      ::kill(-pid_, number);
      if (test::await(
              [&] {
                while (::waitpid(-pid_, nullptr, WNOHANG) > 0) {
                }
                return ::kill(-pid_, 0) != 0;
              },
              10))
        return;
    }
  }

 private:
  pid_t pid_ = 0;
};

TEST_F(FlightGearFlight, OfFlightGearItself) {
  const std::string fgfs = find_program("fgfs"), xvfb = find_program("xvfb-run"),
                    dbus = find_program("dbus-run-session");
  if (fgfs.empty() || xvfb.empty() || dbus.empty())
    GTEST_SKIP()
        << "FlightGear without a screen is not here: apt install flightgear xvfb xauth dbus-daemon";
  begin_flight({"--on-contact", "push", "--on-uncertain", "hold"});
  const int port = flightgear_port();
  const Ear seen(port + 4);
  const std::string home = NEARMESH_FLIGHTGEAR_HOME;
  std::filesystem::create_directories(home);
  ::setenv("HOME", home.c_str(), 1);
  ::setenv("FG_HOME", home.c_str(), 1);
  ::setenv("XDG_RUNTIME_DIR", folder.path().c_str(), 1);
  const auto udp = [&](const char* direction, int after, const char* protocol) {
    return std::string("--generic=socket,") + direction + ",20,127.0.0.1," +
           std::to_string(port + after) + ",udp," + protocol;
  };
  // 26 m above the ground, level towards the hill at 40 m/s: 0.02 of what its ufo does at most.
  constexpr double kFoot_m = 0.3048;
  const flightgear::Place from = scene.to_place({-760, 0, 140});
  const auto number = [](double x) {
    std::array<char, 64> text{};
    std::snprintf(text.data(), text.size(), "%.9f", x);
    return std::string(text.data());
  };
  const std::string log = folder.file("fgfs.log");
  const ProcessGroup flight(log, {dbus,
                                  "--",
                                  xvfb,
                                  "-a",
                                  "-s",
                                  "-screen 0 320x240x24",
                                  fgfs,
                                  "--data=" NEARMESH_FLIGHTGEAR_DIR,
                                  "--data=" NEARMESH_FLIGHTGEAR_TEST_DIR,
                                  udp("out", 0, "nearmesh-pose"),
                                  udp("in", 1, "nearmesh-answer"),
                                  udp("in", 2, "nearmesh-pose"),
                                  udp("in", 3, "nearmesh-say"),
                                  udp("out", 4, "nearmesh-seen"),
                                  "--aircraft=ufo",
                                  "--fdm=ufo",
                                  "--lat=" + number(from.latitude_deg),
                                  "--lon=" + number(from.longitude_deg),
                                  "--altitude=" + number(from.height_m / kFoot_m),
                                  "--heading=90",
                                  "--prop:/controls/engines/engine[0]/throttle=0.02",
                                  "--prop:/sim/frame-rate-throttle-hz=30",
                                  "--timeofday=noon",
                                  "--geometry=160x120",
                                  "--disable-sound",
                                  "--disable-random-objects",
                                  "--disable-ai-traffic",
                                  "--disable-ai-models",
                                  "--disable-clouds",
                                  "--disable-real-weather-fetch",
                                  "--disable-terrasync",
                                  "--log-level=warn"});
  // What FlightGear itself has of it.
  std::set<std::string> statuses, lines;
  const auto saw = [&] {
    while (const auto line = seen.take()) {
      const auto fields = fields_of(*line);
      if (fields.size() != 3) continue;
      statuses.insert(fields[0] + " " + fields[1]);
      lines.insert(fields[2]);
    }
    return statuses.contains("free ") && statuses.contains("contact terrain") &&
           lines.contains("nearmesh: contact with terrain");
  };
  ASSERT_TRUE(test::await(saw, 200)) << test::read_text(log) << bridge->out() << bridge->err();
  // It is put on its way over the hill, 172 m high: pushed out and out again, and free beyond the
  // top.
  ASSERT_TRUE(test::await(
      [&] {
        saw();
        const std::string out = bridge->out();
        const std::size_t contact = out.find("nearmesh: contact with terrain");
        return contact != std::string::npos &&
               out.find("nearmesh: free", contact) != std::string::npos;
      },
      test::kDeadline_s))
      << bridge->out();
  end_flight();
  EXPECT_EQ(bridge->out().find(" 0 pushed out"), std::string::npos) << bridge->out();
  EXPECT_NE(bridge->out().find(", 0 refused;"), std::string::npos) << bridge->out();
  std::printf("%s%s", bridge->out().c_str(), verdict.c_str());
}

}  // namespace
}  // namespace nearmesh
