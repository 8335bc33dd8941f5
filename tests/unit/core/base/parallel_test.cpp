// SPDX-License-Identifier: Apache-2.0
#include "core/base/parallel.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

namespace nearmesh {
namespace {

TEST(ForEachIndex, CallsEachIndexOnce) {
  for (const unsigned threads : {0U, 1U, 2U, 7U})
    for (const std::size_t count : {0U, 1U, 2U, 1000U}) {
      std::vector<std::atomic<int>> calls(count);
      for_each_index(count, threads, [&](std::size_t i) { ++calls[i]; });
      EXPECT_TRUE(std::all_of(calls.begin(), calls.end(), [](const auto& c) { return c == 1; }))
          << threads << " threads, " << count;
    }
}

TEST(ForEachIndex, OneThreadIsTheCallersAndGoesInOrder) {
  const std::thread::id caller = std::this_thread::get_id();
  std::vector<std::size_t> order;
  for_each_index(100, 1, [&](std::size_t i) {
    EXPECT_EQ(std::this_thread::get_id(), caller);
    order.push_back(i);
  });
  EXPECT_TRUE(std::is_sorted(order.begin(), order.end()));
  EXPECT_EQ(order.size(), 100U);
}

TEST(ForEachIndex, UsesAsManyThreadsAsAsked) {
  std::mutex mutex;
  std::set<std::thread::id> seen;
  std::atomic<int> waiting = 0;
  for_each_index(3, 3, [&](std::size_t) {
    ++waiting;
    while (waiting < 3) std::this_thread::yield();  // each holds one thread until all three run
    const std::lock_guard lock(mutex);
    seen.insert(std::this_thread::get_id());
  });
  EXPECT_EQ(seen.size(), 3U);
  EXPECT_TRUE(seen.contains(std::this_thread::get_id()));
}

TEST(ForEachIndex, ThrowsWhatAPieceThrew) {
  for (const unsigned threads : {1U, 4U})
    EXPECT_THROW(for_each_index(100, threads,
                                [](std::size_t i) {
                                  if (i == 37) throw std::runtime_error("37");
                                }),
                 std::runtime_error);
}

}  // namespace
}  // namespace nearmesh
