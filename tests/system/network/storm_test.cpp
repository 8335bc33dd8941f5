// SPDX-License-Identifier: Apache-2.0
// Hostile packets against the real programs, for some seconds. At length: nearmesh-storm.

#include "storm.hpp"
#include "network_fixture.hpp"

namespace nearmesh::test {
namespace {

class StormTest : public NetworkFixture {
 protected:
  void expect_weathered(StormOptions options) {
    options.deaf_s = kDeadline_s;  // the machine is at work
    const StormResult result = weather_storm(exercise(), options);
    EXPECT_EQ(result.ended, std::vector<std::string>{}) << result.complaint;
    EXPECT_EQ(result.spins, std::vector<std::string>{});
    EXPECT_EQ(result.deaf, std::vector<std::string>{});
    EXPECT_EQ(result.wrong, 0U);
    EXPECT_GT(result.certified, 0U);
    // 2 s are promised, and nearmesh-storm holds that.
    EXPECT_LT(result.slowest_end_s, kEnd_s);
  }
};

/// The first packets of each storm are those that once ended every program on the bus.
TEST_F(StormTest, ProgramsGoOnUnderHostilePackets) {
  expect_weathered({.packets = 4000, .packets_per_s = 1000, .first = {deadly_packet()}});
}

TEST_F(StormTest, SecuredProgramsGoOnUnderHostilePackets) {
  expect_weathered(
      {.packets = 4000, .packets_per_s = 1000, .secured = true, .first = {deadly_packet()}});
}

}  // namespace
}  // namespace nearmesh::test
