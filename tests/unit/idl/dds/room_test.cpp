// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/room.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include "idl/dds/mailbox.hpp"

namespace nearmesh::wire {
namespace {

/// A limit of this process's, for one scope.
class Limit {
 public:
  Limit(__rlimit_resource_t which, rlim_t value) : which_(which) {
    EXPECT_EQ(::getrlimit(which, &before_), 0);
    rlimit now = before_;
    now.rlim_cur = value;
    EXPECT_EQ(::setrlimit(which, &now), 0);
  }
  ~Limit() { ::setrlimit(which_, &before_); }
  Limit(const Limit&) = delete;
  Limit& operator=(const Limit&) = delete;

 private:
  __rlimit_resource_t which_;
  rlimit before_{};
};

TEST(Room, IsThereOnAHealthyMachine) {
  EXPECT_TRUE(check_room({}).is_ok()) << check_room({}).message();
}

TEST(Room, TooFewDescriptorsAreCountedAndTheLimitNamed) {
  const Limit limit(RLIMIT_NOFILE, 12);
  const Status status = check_room({});
  EXPECT_EQ(status.code(), StatusCode::kIo);
  EXPECT_NE(status.message().find("it takes 32 more open files, only "), std::string::npos);
  EXPECT_NE(status.message().find("ulimit -n"), std::string::npos) << status.message();
}

TEST(Room, TooLittleMemoryIsALineAndNoSignal) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "the sanitizer's own memory is beyond any limit";
#endif
  const Limit limit(RLIMIT_AS, 1);  // nothing more
  const Status status = check_room({});
  EXPECT_EQ(status.code(), StatusCode::kIo);
  EXPECT_NE(status.message().find("ulimit -v"), std::string::npos) << status.message();
}

TEST(Room, WithoutMulticastAStrangerIsToldWhatToDo) {
  const std::vector<Interface> plain{{"lo", "127.0.0.1", true, true, true, false},
                                     {"eth0", "10.0.0.7", true, true, false, false},
                                     {"eth1", "10.0.1.7", true, false, false, true}};
  EXPECT_NE(why_alone({}, plain).find("marked for multicast (eth0 10.0.0.7): where"),
            std::string::npos)
      << why_alone({}, plain);
  std::vector<Interface> good = plain;
  good[1].has_multicast = true;
  EXPECT_EQ(why_alone({}, good), "");
  EXPECT_EQ(why_alone({.interface = "127.0.0.1"}, plain), "");
  EXPECT_NE(why_alone({.interface = "eth0"}, plain), "");
  EXPECT_EQ(why_alone({.initial_peers = {"10.0.0.8"}}, plain), "");
  EXPECT_EQ(why_alone({.discovery_server = "10.0.0.8"}, plain), "");
  EXPECT_EQ(why_alone({.transport = Transport::kTcp}, plain), "");
  EXPECT_EQ(why_alone({}, {plain[0]}), "");  // told by doctor; it may come up later
}

TEST(Room, LackOfMemoryIsSaidWithoutAskingForMore) {
  Mailbox mailbox;
  EXPECT_FALSE(mailbox.has_complaints());
  mailbox.complain_of_memory();
  EXPECT_TRUE(mailbox.has_complaints());
  ASSERT_EQ(mailbox.take_complaints().size(), 1U);
  EXPECT_FALSE(mailbox.has_complaints());
}

}  // namespace
}  // namespace nearmesh::wire
