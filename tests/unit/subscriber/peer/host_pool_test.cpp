// SPDX-License-Identifier: Apache-2.0
// The pool of docs/embed.md, as the page has it: made a header by CMake.
#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "local_host.hpp"

namespace nearmesh::test {
namespace page {
#include "embed_pool.inc"
}  // namespace page

namespace {

TEST(HostPool, GivesTheAnswersOfOneThread) {
  std::vector<std::uint64_t> digests[2];
  page::Pool pool(3);
  for (const bool is_pooled : {false, true}) {
    SessionOptions options;
    if (is_pooled)
      options.run_jobs = [&](std::size_t count, const std::function<void(std::size_t)>& job) {
        pool.parallel_for(count, job);
      };
    LocalHost host(options);
    std::vector<Session::OwnMotion> motions;
    for (std::uint32_t i = 0; i < 6; ++i)
      motions.push_back({host.spawn("a" + std::to_string(i)), above_ground(100 * i + 50, 10)});
    for (int frame = 0; frame < 40; ++frame) {
      for (auto& [body, motion] : motions) motion.pose.translation_m[2] -= 1;
      digests[is_pooled].push_back(host.update(motions).answers_digest);
    }
  }
  EXPECT_EQ(digests[0], digests[1]);
}

TEST(HostPool, RunsEachJobOnce) {
  page::Pool pool(2);
  for (std::size_t count = 0; count < 300; ++count) {
    std::vector<std::atomic<int>> runs(count);
    pool.parallel_for(count, [&](std::size_t i) { ++runs[i]; });
    for (const std::atomic<int>& run : runs) EXPECT_EQ(run, 1);
  }
}

}  // namespace
}  // namespace nearmesh::test
