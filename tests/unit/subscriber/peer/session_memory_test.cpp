// SPDX-License-Identifier: Apache-2.0
// Want of memory in any call of a session: it has changed nothing, or nothing is asked of the
// session any more.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <functional>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

#if !defined(__SANITIZE_ADDRESS__)  // which has an allocator of its own

namespace {

/// Allocations of this thread that are left before one is refused; below 0: any number.
thread_local int allowed_here = -1;

}  // namespace

// Not inlined, or compilers see memory of malloc() given to delete.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
  const bool is_refused = allowed_here >= 0 && allowed_here-- == 0;
  void* const made = is_refused ? nullptr : std::malloc(std::max<std::size_t>(bytes, 1));
  if (made == nullptr) throw std::bad_alloc();
  return made;
}
[[gnu::noinline]] void operator delete(void* made) noexcept { std::free(made); }
[[gnu::noinline]] void operator delete(void* made, std::size_t) noexcept { std::free(made); }

namespace nearmesh::test {
namespace {

using subscriber::BodyId;
using subscriber::Session;

/// Two links of a robot to be, a ground in place, another peer's body.
struct Host {
  Host() : session(std::make_unique<subscriber::LocalChannel>()) {
    for (const char* name : {"arm", "hand"})
      own.push_back(session.add_body({.name = name, .model = "steel", .own = true}).value());
    ground = session.add_body({.name = "ground", .model = "terrain"}).value();
    other = session.add_body({.name = "other", .model = "aircraft"}).value();
    EXPECT_TRUE(session.place_body(ground, {}).is_ok());
    EXPECT_TRUE(session.watch(ground, other).is_ok());
  }
  Session session;
  std::vector<BodyId> own;
  BodyId ground, other;
};

struct Call {
  const char* name;
  std::function<Status(Host&)> make;
};

const std::vector<Call>& calls() {
  static const std::vector<Call> kCalls{
      {"add_body",
       [](Host& host) {
         return host.session
             .add_body({.name = "a body whose name is long enough to be stored apart",
                        .model = "a model whose name is long enough to be stored apart",
                        .own = true})
             .status();
       }},
      {"place_body",
       [](Host& host) {
         Pose pose;
         pose.translation_m = {1, 2, 3};
         return host.session.place_body(host.other, pose);
       }},
      {"link_bodies", [](Host& host) { return host.session.link_bodies(host.own); }},
      {"remove_body", [](Host& host) { return host.session.remove_body(host.ground); }},
      {"replace_model",
       [](Host& host) { return host.session.replace_model(host.other, "another aircraft"); }},
      {"watch", [](Host& host) { return host.session.watch(host.own[0], host.ground); }},
      {"unwatch", [](Host& host) { return host.session.unwatch(host.ground, host.other); }},
      {"watch_all",
       [](Host& host) {
         host.session.watch_all();
         return Status::ok();
       }},
      {"hear", [](Host& host) {
         const std::array<Session::HeardPose, 2> heard{
             {{.body = host.other, .time_s = 1}, {.body = host.other, .time_s = 2}}};
         return host.session.hear(heard);
       }}};
  return kCalls;
}

/// As after the same calls in a session of its own.
void expect_same(Host& found, Host& expected, const std::string& where) {
  const auto a = found.session.update(1, 0.5, {}, 1), b = expected.session.update(1, 0.5, {}, 1);
  ASSERT_TRUE(a.is_ok() && b.is_ok()) << where << a.status().message();
  ASSERT_EQ(a.value().answers.size(), b.value().answers.size()) << where;
  for (std::size_t i = 0; i < a.value().answers.size(); ++i) {
    EXPECT_EQ(a.value().answers[i].a, b.value().answers[i].a) << where;
    EXPECT_EQ(a.value().answers[i].b, b.value().answers[i].b) << where;
  }
  EXPECT_EQ(a.value().unknown.size(), b.value().unknown.size()) << where;
  EXPECT_EQ(a.value().answers_digest, b.value().answers_digest) << where;
}

TEST(SessionMemory, ACallThatFindsNoneHasChangedNothingOrIsTheLast) {
  int half_way = 0;
  for (const Call& call : calls()) {
    int tries = 0;
    for (bool is_refused = true; is_refused; ++tries) {
      const std::string where = std::string(call.name) + ", allocation " + std::to_string(tries);
      Host host, expected;
      allowed_here = tries;
      is_refused = false;
      try {
        const Status done = call.make(host);
        is_refused = allowed_here < 0;
        allowed_here = -1;
        ASSERT_TRUE(done.is_ok()) << where << done.message();
      } catch (const std::bad_alloc&) {
        is_refused = true;
        allowed_here = -1;
        if (const auto next = host.session.update(0, 0, {}, 1); !next.is_ok()) {
          EXPECT_EQ(next.status().code(), StatusCode::kConflict) << where;
          ++half_way;
          for (const Call& later : calls()) {
            if (later.name == std::string("watch_all")) continue;  // which gives no status
            EXPECT_EQ(later.make(host).code(), StatusCode::kConflict)
                << later.name << " after " << where;
          }
          EXPECT_EQ(host.session.readiness(host.other).status().code(), StatusCode::kConflict);
          EXPECT_EQ(host.session.held_mesh(host.ground).status().code(), StatusCode::kConflict);
          EXPECT_EQ(host.session.options_of(host.ground).status().code(), StatusCode::kConflict);
          EXPECT_EQ(host.session.held_state(host.ground), 0U);
          EXPECT_EQ(host.session.write_cache().code(), StatusCode::kConflict);
          continue;
        }
        const Status again = call.make(host);
        ASSERT_TRUE(again.is_ok()) << "made again, " << where << ": " << again.message();
        static_cast<void>(expected.session.update(0, 0, {}, 1));
      }
      if (!is_refused) break;
      ASSERT_TRUE(call.make(expected).is_ok());
      expect_same(host, expected, where);
    }
    const bool is_frugal =
        call.name == std::string("unwatch") || call.name == std::string("watch_all");
    EXPECT_TRUE(is_frugal || tries > 0) << call.name << " allocates nothing: nothing was tested";
  }
  EXPECT_GT(half_way, 0);
}

}  // namespace
}  // namespace nearmesh::test

#endif
