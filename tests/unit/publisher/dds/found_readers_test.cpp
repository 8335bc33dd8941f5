// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "publisher/dds/dds_peers.hpp"

namespace nearmesh::publisher {
namespace {

// Of a reader that went unheard a writer would be kept for good, in the place of another's.
TEST(FoundReaders, WhereSomeWereNotKeptNoneIsTakenForPresent) {
  FoundReaders readers;
  const auto tell = [&](std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) readers.add({.partition = std::to_string(i)});
  };
  tell(FoundReaders::kMost);
  const auto all = readers.take();
  ASSERT_TRUE(all);
  ASSERT_EQ(all->size(), FoundReaders::kMost);
  EXPECT_EQ(all->back().partition, std::to_string(FoundReaders::kMost - 1));
  tell(FoundReaders::kMost);
  readers.add({.partition = "1", .gone = true});
  EXPECT_FALSE(readers.take());
  tell(1);
  EXPECT_EQ(readers.take()->size(), 1U) << "what came since";
}

}  // namespace
}  // namespace nearmesh::publisher
