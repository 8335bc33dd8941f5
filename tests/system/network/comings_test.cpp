// SPDX-License-Identifier: Apache-2.0
// Late joins, links that go down, and a short soak, with the real programs. At length:
// nearmesh-network joins, outages, soak.

#include <gtest/gtest.h>

#include <algorithm>

#include "comings.hpp"
#include "network_fixture.hpp"
#include "watch.hpp"

namespace nearmesh::test {
namespace {

class Comings : public NetworkFixture {};

std::string all_of(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line + "\n";
  return text;
}

TEST_F(Comings, LateJoinTenTimesInARowIsRight) {
  const Joins joins = join_in_a_row(exercise(), 10, 0.02, 1);
  EXPECT_EQ(joins.joined, 10U) << all_of(joins.faults);
  EXPECT_EQ(joins.wrong, 0U) << all_of(joins.faults);
  EXPECT_GE(joins.answers, 40U);  // two rows of two pairs each
  EXPECT_GT(joins.certified, 20U);
}

TEST_F(Comings, LinksThatWereDownServeAgain) {
  // Shorter and longer than the silence of three seconds that counts as a loss.
  const Outages outages = take_links_down(exercise(), {1, 5});
  for (const Outage& outage : outages.all)
    EXPECT_GE(outage.back_s, 0) << (outage.of_publisher ? "publisher" : "peer") << " after "
                                << outage.down_s << " s";
  EXPECT_EQ(outages.all.size(), 4U);
  EXPECT_EQ(outages.certified_while_down, 0U);
  EXPECT_EQ(outages.wrong, 0U);
}

class Named : public ServedFixture {};

TEST_F(Named, AnInterfaceWithoutALinkIsSaidToHaveNone) {
  serve_over({{}, {}});
  const auto look = [&](std::string& err) {
    const auto there = lan->visit(1);
    test::run(folder, "nearmesh-subscriber", {"status", "--interface", "e0", "--seconds", "1"},
              nullptr, &err);
    return err.find("nobody was heard on domain 0") != std::string::npos;  // there is nobody
  };
  std::string err;
  lan->set_up(1, false);
  EXPECT_FALSE(look(err));
  EXPECT_NE(err.find("interface \"e0\" has no link: it is down"), std::string::npos) << err;
  lan->set_up(1, true);
  EXPECT_TRUE(await([&] { return look(err); })) << err;
}

class Rivals : public ServedFixture {};

TEST_F(Rivals, APublisherIsWarnedAgainOfOneThatWasLostAndFound) {
  serve_over({{}, {}});
  Exercise others = models;
  others.models = {model_file("terrain", 32)};  // of the same name
  const auto rival = serve(*lan, folder, others, 1);
  const auto warnings = [&] {
    const std::vector<std::string> lines = lines_of(publisher->err());
    return std::count_if(lines.begin(), lines.end(), [](const std::string& line) {
      return line.find("model terrain: publisher") != std::string::npos;
    });
  };
  ASSERT_TRUE(await([&] { return warnings() == 1; })) << publisher->err();
  lan->set_up(1, false);
  pause(11);  // beyond the lease, and a line is not said again for ten seconds
  lan->set_up(1, true);
  // While it lasts it is said each half minute, but of who was lost no more.
  EXPECT_TRUE(await([&] { return warnings() == 2; })) << publisher->err();
}

class Stopped : public ServedFixture {};

TEST_F(Stopped, PeerThatIsBackAfterTenSecondsGoesOnWithoutJoiningAnew) {
  serve_over({{}, {}});
  constexpr double kFrames_per_s = 20, kLongest_s = 14;  // beyond, it is right to join anew
  write_flights(folder, models, 400, kFrames_per_s);
  const auto answers = [&] { return lines_of(read_text(folder.file("answers.jsonl"))); };
  std::unique_ptr<Process> flight;
  double stood_s = 2 * kLongest_s;
  for (int i = 0; i < 5 && stood_s > kLongest_s; ++i) {  // the test may be held up as it waits
    flight = start_flight(*lan, 1, folder, models, kFrames_per_s);
    ASSERT_TRUE(await([&] { return answers().size() > 40; })) << flight->err();
    const Stopwatch clock;
    flight->signal(SIGSTOP);
    pause(10);
    flight->signal(SIGCONT);
    stood_s = clock.seconds();
  }
  ASSERT_LT(stood_s, kLongest_s);
  ASSERT_EQ(flight->wait(), 0) << flight->err();
  for (const std::string& said : {flight->err(), publisher->err()})
    EXPECT_EQ(said.find("joining again"), std::string::npos) << said;
  const std::vector<std::string> lines = answers();
  // It makes up for the frames that it missed, faster than detail comes; then all is as it was.
  constexpr std::ptrdiff_t kLast = 100;
  ASSERT_GT(lines.size(), 2U * kLast);
  EXPECT_GT(std::count_if(lines.end() - kLast, lines.end(),
                          [](const std::string& line) {
                            return line.find("\"status\":\"free\"") != std::string::npos ||
                                   line.find("\"status\":\"contact\"") != std::string::npos;
                          }),
            0.9 * kLast);
}

TEST(Watch, SlopeIsThatOfALine) {
  std::vector<double> seconds, values;
  for (int i = 0; i < 10; ++i) {
    seconds.push_back(7 * i);
    values.push_back(100 + 0.5 * 7 * i);
  }
  EXPECT_NEAR(slope_of(seconds, values).per_minute, 30, 1e-9);
  EXPECT_NEAR(slope_of(seconds, values).error, 0, 1e-6);
  values[5] += 60;
  EXPECT_GT(slope_of(seconds, values).error, 1);
}

TEST(Watch, SeesWhatAProcessHolds) {
  const Holding before = holding_of(::getpid());
  EXPECT_GE(before.threads, 1);
  EXPECT_GE(before.descriptors, 3);
  const std::vector<char> more(64 << 20, 'x');
  const Holding after = holding_of(::getpid());
  EXPECT_GT(after.heap_kb, before.heap_kb + 50'000) << more[1000];
  EXPECT_GT(after.rss_kb, before.rss_kb + 50'000);
}

}  // namespace
}  // namespace nearmesh::test
