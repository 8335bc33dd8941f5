// SPDX-License-Identifier: Apache-2.0
// The pool of docs/embed.md, as the page has it: made a header by CMake.
#include <array>
#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <new>
#include <stdexcept>
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

/// Schedulers that do not keep their word.
const std::vector<std::pair<const char*, subscriber::RunJobs>> kWrong{
    {"none", [](std::size_t, const auto&) {}},
    {"the last alone", [](std::size_t count, const auto& job) { job(count - 1); }},
    {"twice, and beyond",
     [](std::size_t count, const auto& job) {
       for (std::size_t i = 0; i < 3 * count; ++i) job(i / 2);
     }},
    {"throws each second time",
     [calls = 0](std::size_t count, const auto& job) mutable {
       std::thread other([&job] { job(0); });
       for (std::size_t i = 0; i < count / 2; ++i) job(i);
       other.join();
       if (calls++ % 2 == 0) throw std::runtime_error("of the host");
     }},
};

TEST(HostPool, ThatBreaksItsWordHarmsNoAnswer) {
  for (const auto& [name, run_jobs] : kWrong) {
    SCOPED_TRACE(name);
    const bool throws = std::string(name).rfind("throws", 0) == 0;
    LocalHost alone, host(SessionOptions{.run_jobs = run_jobs});
    std::vector<Session::OwnMotion> motions;
    for (std::uint32_t i = 0; i < 4; ++i) {
      motions.push_back({host.spawn("a" + std::to_string(i)), above_ground(100 * i + 50, 5)});
      alone.spawn("a" + std::to_string(i));
    }
    FrameReport expected, found;
    std::size_t thrown = 0;
    for (int frame = 0; frame < 12; ++frame) {
      for (auto& [body, motion] : motions) motion.pose.translation_m[2] -= 1;
      expected = alone.update(motions);
      try {
        found = host.update(motions);
        EXPECT_EQ(found.answers_digest, expected.answers_digest);
        EXPECT_EQ(found.state_digest, expected.state_digest);
      } catch (const std::runtime_error& fault) {
        EXPECT_STREQ(fault.what(), "of the host");
        ++thrown;
      }
    }
    EXPECT_EQ(thrown > 0, throws);
    EXPECT_EQ(host.session->stats().held_splits, alone.session->stats().held_splits);
  }
}

/// A channel of the host's for which there is no memory.
class PoorChannel : public subscriber::Channel {
 public:
  [[nodiscard]] wire::SessionId own_id() const override { return 1; }
  void send(const wire::RegionSubscription&) override {}
  void send(const wire::BodyPoses&) override {}
  void send(const wire::BodyDirectory&) override {}
  void send(const wire::ContactReport&) override {}
  [[nodiscard]] Inbox take() override {
    if (is_poor) throw std::bad_alloc();
    return {};
  }
  bool is_poor = false;
};

TEST(HostPool, NothingIsCertifiedAfterAnUpdateThatEndedHalfWay) {
  auto made = std::make_unique<PoorChannel>();
  PoorChannel& channel = *made;
  Session session(std::move(made));
  const BodyId body = session.add_body({.name = "one", .model = "aircraft", .own = true}).value();
  ASSERT_TRUE(session.update(0, 0, {{body, {}}}, 1).is_ok());
  channel.is_poor = true;
  EXPECT_THROW(static_cast<void>(session.update(1, 0, {}, 1)), std::bad_alloc);
  channel.is_poor = false;
  EXPECT_EQ(session.update(2, 0, {}, 1).status().code(), StatusCode::kConflict);
  const std::array<RayProbe, 1> ray{{{.origin_m = {0, 0, 100}}}};
  std::array<RayAnswer, 1> answer;
  EXPECT_EQ(session.probe(body, ray, answer).status().code(), StatusCode::kConflict);
}

}  // namespace
}  // namespace nearmesh::test
