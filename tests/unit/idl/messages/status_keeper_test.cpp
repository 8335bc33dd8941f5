// SPDX-License-Identifier: Apache-2.0
#include "idl/messages/status_keeper.hpp"

#include <gtest/gtest.h>

namespace nearmesh::wire {
namespace {

ProcessStatus at(StatusKeeper& keeper, double now_s, std::uint64_t bytes = 0) {
  ProcessStatus status;
  status.session = 1;
  status.bytes = bytes;
  keeper.complete(status, now_s);
  return status;
}

TEST(StatusKeeper, IsDueOnceASecond) {
  StatusKeeper keeper;
  EXPECT_TRUE(keeper.is_due(0));
  EXPECT_TRUE(check(at(keeper, 0)).is_ok());
  EXPECT_FALSE(keeper.is_due(0.9));
  EXPECT_TRUE(keeper.is_due(1));
}

TEST(StatusKeeper, RateIsOfTheTimeSinceTheLast) {
  StatusKeeper keeper;
  EXPECT_EQ(at(keeper, 0, 0).bytes_per_s, 0);
  EXPECT_EQ(at(keeper, 2, 1000).bytes_per_s, 500);
  EXPECT_EQ(at(keeper, 3, 1100).bytes_per_s, 100);
}

TEST(StatusKeeper, LinesAreDistinctBoundedAndForgotten) {
  StatusKeeper keeper;
  for (std::size_t i = 0; i < 2 * kMaxStatusLines; ++i) keeper.note("line " + std::to_string(i), 0);
  keeper.note("line 20", 30);
  const ProcessStatus full = at(keeper, 31);
  ASSERT_EQ(full.complaints.size(), kMaxStatusLines);
  EXPECT_EQ(full.complaints.back(), "line 20");
  EXPECT_EQ(full.complaints.front(), "line 16");
  EXPECT_TRUE(check(full).is_ok());
  EXPECT_EQ(at(keeper, 61).complaints, std::vector<std::string>{"line 20"});
  EXPECT_TRUE(at(keeper, 91).complaints.empty());
}

}  // namespace
}  // namespace nearmesh::wire
