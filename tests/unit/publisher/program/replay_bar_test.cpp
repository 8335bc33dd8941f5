// SPDX-License-Identifier: Apache-2.0
#include "publisher/program/replay_bar.hpp"

#include <gtest/gtest.h>

namespace nearmesh::publisher::program {
namespace {

const std::string kEmpty = "[" + std::string(24, ' ') + "]",
                  kFull = "[" + std::string(24, '=') + "]";

TEST(ReplayBar, FillsFromTheStartToTheEnd) {
  EXPECT_EQ(bar_of(played_share(10, 10, 30)), kEmpty);
  EXPECT_EQ(bar_of(played_share(20, 10, 30)),
            "[" + std::string(12, '=') + std::string(12, ' ') + "]");
  EXPECT_EQ(bar_of(played_share(30, 10, 30)), kFull);
}

// A seek may go to before --start, and the last sample lies at the end.
TEST(ReplayBar, IsEmptyBeforeTheStartAndFullBehindTheEnd) {
  for (const double before_s : {9.99, 0.0, -60.0}) {
    EXPECT_EQ(played_share(before_s, 10, 30), 0);
    EXPECT_EQ(bar_of(played_share(before_s, 10, 30)), kEmpty);
  }
  EXPECT_EQ(bar_of(played_share(31, 10, 30)), kFull);
  EXPECT_EQ(bar_of(played_share(10, 10, 10)), kEmpty);
}

}  // namespace
}  // namespace nearmesh::publisher::program
