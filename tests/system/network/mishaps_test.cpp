// SPDX-License-Identifier: Apache-2.0
// What befalls machines and networks while programs fly: none ends by a signal, no answer is wrong,
// what is printed as JSON is JSON.

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "idl/dds/room.hpp"
#include "network_fixture.hpp"

namespace nearmesh::test {
namespace {

using nlohmann::json;

constexpr double kRate_hz = 10;

class Mishaps : public ServedFixture {
 protected:
  /// Flies until it is told to stop, from the host 1.
  void take_off() {
    write_flights(folder, models, 3000, kRate_hz);
    flight = start_flight(*lan, 1, folder, models, kRate_hz);
    ASSERT_TRUE(certifies()) << flight->err();
  }
  [[nodiscard]] std::vector<std::string> answers() const {
    std::vector<std::string> lines = lines_of(read_text(folder.file("answers.jsonl")));
    if (!lines.empty()) lines.pop_back();  // it may be half of one
    return lines;
  }
  /// So many answers from now on are certified, within the deadline.
  [[nodiscard]] bool certifies(std::size_t count = 5) const {
    const std::size_t from = answers().size();
    return await([&] {
             const std::vector<std::string> lines = answers();
             std::size_t certified = 0;
             for (std::size_t i = from; i < lines.size(); ++i) {
               const std::string status = json::parse(lines[i]).value("status", "");
               certified += status == "free" || status == "contact" ? 1 : 0;
             }
             return certified >= count || flight->is_over();
           }) &&
           !flight->is_over();
  }
  void land() {
    flight->signal(SIGINT);
    ASSERT_EQ(flight->wait(), 0) << flight->err();
    const std::size_t lines = lines_of(read_text(folder.file("answers.jsonl"))).size();
    EXPECT_EQ(count_wrong_answers(folder, models, lines - 1), 0U);  // the last is the summary
  }
  /// Sets a limit of a program that runs. Out: what it was.
  static rlimit limit(const Process& process, decltype(RLIMIT_AS) what, rlim_t value) {
    rlimit before{};
    EXPECT_EQ(::prlimit(process.id(), what, nullptr, &before), 0);
    rlimit now = before;
    now.rlim_cur = value;
    EXPECT_EQ(::prlimit(process.id(), what, &now, nullptr), 0);
    return before;
  }

  std::unique_ptr<Process> flight;
};

TEST_F(Mishaps, SmallAndLargePacketsCarryAFlight) {
  for (const int mtu_bytes : {576, 9000}) {
    models = exercise();
    lan = std::make_unique<Lan>(std::vector<Link>{{}, {}});
    lan->set_mtu(mtu_bytes);
    publisher = serve(*lan, folder, models);
    FlightResult flown;
    constexpr std::uint64_t kEnough = 50;
    for (int i = 0; i < 5 && flown.certified <= kEnough; ++i) {  // the machine may be held up
      flown = fly(*lan, 1, folder, models, {.frames = 60});
      ASSERT_TRUE(flown.ended) << mtu_bytes << flown.complaint;
      EXPECT_EQ(flown.answers, 60U) << mtu_bytes;
      EXPECT_EQ(flown.wrong, 0U) << mtu_bytes;
    }
    EXPECT_GT(flown.certified, kEnough) << mtu_bytes;
    EXPECT_GT(flown.batch_bytes, 1000U) << mtu_bytes;
  }
}

TEST_F(Mishaps, OneOfTwoInterfacesGoesDownAndComesBack) {
  models = exercise();
  lan = std::make_unique<Lan>(std::vector<Link>{{}, {}});
  lan->connect(0, 1);
  publisher = serve(*lan, folder, models);
  take_off();
  lan->set_up(1, false);
  EXPECT_TRUE(certifies(40)) << flight->err();  // four seconds of flight over what it has not seen
  lan->set_up(1, true);
  EXPECT_TRUE(certifies(20)) << flight->err();
  land();
}

/// A program that stood still for longer than others wait joins anew, which takes them. It says so,
/// again and again, until there are some.
TEST_F(Mishaps, DescriptorsThatAreLackedToJoinAgainAreWaitedFor) {
  serve_over({{}, {}});
  take_off();
  flight->signal(SIGSTOP);
  // All that it may open from now on are these, of which it has some: its output, say.
  const rlimit before = limit(*flight, RLIMIT_NOFILE, wire::kRoomDescriptors);
  pause(17);
  flight->signal(SIGCONT);
  EXPECT_TRUE(flight->says("could not join again: cannot join: it takes 32 more open files"))
      << flight->err();
  pause(2);
  ASSERT_FALSE(flight->is_over()) << flight->err();
  limit(*flight, RLIMIT_NOFILE, before.rlim_cur);
  EXPECT_TRUE(certifies()) << flight->err();
  land();
}

/// As much as is there, and no more. What a frame lacks may end the program, with a line.
TEST_F(Mishaps, MemoryThatIsRefusedInFlightIsALine) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "the sanitizer's own memory is beyond any limit";
#endif
  serve_over({{}, {}});
  take_off();
  const rlimit before = limit(*flight, RLIMIT_AS, 1);
  pause(3);
  limit(*flight, RLIMIT_AS, before.rlim_cur);
  if (flight->is_over()) {
    EXPECT_EQ(flight->wait(), 1) << flight->err();
    EXPECT_NE(flight->err().find("no memory"), std::string::npos) << flight->err();
    return;
  }
  EXPECT_TRUE(certifies()) << flight->err();
  land();
}

TEST_F(Mishaps, WhatIsPrintedIsJsonWhileThePublisherIsKilledAndTheLinkIsCut) {
  serve_over({{}, {}});
  write_flights(folder, models, 3000, kRate_hz);
  folder.write("printed.yaml",
               "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
               "  - {name: aircraft1, model: aircraft}\nmoves:\n  - {body: aircraft1, trajectory: "
               "flight1.csv}\npairs: [[ground, aircraft1]]\nbudget_ms: 10\nframe_rate_hz: 10\n");
  {
    const Lan::Visit there = lan->visit(1);
    flight = std::make_unique<Process>(
        folder, "nearmesh-subscriber",
        std::vector<std::string>{"run", folder.file("printed.yaml"), "--json", "--domain",
                                 std::to_string(models.domain)});
  }
  const auto printed = [&] { return lines_of(flight->out()).size(); };
  const auto prints = [&](std::size_t more) {
    const std::size_t from = printed();
    return await([&] { return printed() >= from + more || flight->is_over(); }) &&
           !flight->is_over();
  };
  ASSERT_TRUE(prints(20)) << flight->err();
  publisher->signal(SIGKILL);
  static_cast<void>(publisher->wait());
  EXPECT_TRUE(prints(10)) << flight->err();
  publisher = serve(*lan, folder, models);
  EXPECT_TRUE(prints(10)) << flight->err();
  lan->set_up(1, false);
  EXPECT_TRUE(prints(40)) << flight->err();
  lan->set_up(1, true);
  EXPECT_TRUE(prints(10)) << flight->err();
  flight->signal(SIGINT);
  EXPECT_EQ(flight->wait(), 0) << flight->err();
  const std::vector<std::string> lines = lines_of(flight->out());
  std::size_t certified = 0;
  for (const std::string& line : lines) {
    ASSERT_TRUE(json::accept(line)) << line;
    const std::string status = json::parse(line).value("status", "");
    certified += status == "free" || status == "contact" ? 1 : 0;
  }
  EXPECT_GT(certified, 0U);
  EXPECT_TRUE(json::parse(lines.back()).contains("summary")) << lines.back();
}

}  // namespace
}  // namespace nearmesh::test
