// SPDX-License-Identifier: Apache-2.0
#include "subscriber/program/flight_summary.hpp"

#include <gtest/gtest.h>

namespace nearmesh::subscriber::program {
namespace {

TEST(Timings, OfFewFramesTheQuantilesAreExact) {
  Timings timings;
  EXPECT_EQ(timings.quantile(0.5), 0);
  for (const double ms : {5, 1, 4, 2, 3}) timings.add(ms * 1e-3);
  EXPECT_DOUBLE_EQ(timings.quantile(0), 1);
  EXPECT_DOUBLE_EQ(timings.quantile(0.5), 3);
  timings.add(6e-3);
  EXPECT_DOUBLE_EQ(timings.quantile(1), 6);
}

// Two days at 60 a second: what is kept is bounded, and stands for the first frame as for the last.
TEST(Timings, OfAFlightOfDaysTheQuantilesStandForAllOfIt) {
  Timings timings;
  constexpr std::uint64_t kFrames = 10 * Timings::kMost;
  for (std::uint64_t frame = 0; frame < kFrames; ++frame)
    timings.add(static_cast<double>(frame) / kFrames);
  EXPECT_NEAR(timings.quantile(0.5), 500, 1);
  EXPECT_NEAR(timings.quantile(0.99), 990, 1);
  EXPECT_LE(timings.kept(), Timings::kMost);
}

TEST(Summary, OfAFlightWithoutACertifiedAnswerTellsNoTimeOfOne) {
  Summary summary;
  EXPECT_TRUE(to_json(summary).at("summary").at("first_certified_s").is_null());
  summary.first_certified_s = 0.5;
  EXPECT_EQ(to_json(summary).at("summary").at("first_certified_s"), 0.5);
}

}  // namespace
}  // namespace nearmesh::subscriber::program
