// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/messages/topics.hpp"

#include <gtest/gtest.h>

namespace nearmesh::wire {
namespace {

TEST(Topics, CarryPrefixAndVersionButHelloHasNone) {
  const TopicNames names("site/nearmesh");
  EXPECT_EQ(names.of<Hello>(), "site/nearmesh/hello");
  EXPECT_EQ(names.of<SplitBatchMessage>(), "site/nearmesh/v15/split_batch");
}

TEST(Topics, PartitionIsSixteenDigits) {
  EXPECT_EQ(partition_of(0xab), "00000000000000ab");
  EXPECT_EQ(partition_of(~SessionId{0}), "ffffffffffffffff");
  EXPECT_EQ(peer_of(partition_of(0xab)), 0xabU);
  for (const char* nobodys : {"", "*", "ab", "00000000000000AB", "00000000000000abc"})
    EXPECT_EQ(peer_of(nobodys), 0U) << nobodys;
}

TEST(Topics, PrefixIsChecked) {
  EXPECT_TRUE(check_prefix("nearmesh").is_ok());
  EXPECT_TRUE(check_prefix("a/b_c-9").is_ok());
  for (const auto* bad : {"", "/a", "a/", "a b", "a*", "\xc3\xa9"})
    EXPECT_FALSE(check_prefix(bad).is_ok()) << bad;
  EXPECT_FALSE(check_prefix(std::string(101, 'a')).is_ok());
}

TEST(Topics, RemoteEndpointsThatCannotTalkToUsAreNamed) {
  const auto judge = [](const char* topic, std::string_view type) {
    return judge_remote_endpoint("p", topic, type, "rig-2").value_or("");
  };
  EXPECT_EQ(judge("p/v15/body_poses", topic_of<BodyPoses>().type), "");
  EXPECT_EQ(judge("p/hello", topic_of<Hello>().type), "");
  EXPECT_EQ(judge("p/v15/process_status", topic_of<ProcessStatus>().type), "");
  EXPECT_EQ(judge("p/v15/probe", topic_of<Echo>().type), "");
  EXPECT_EQ(judge("q/v1/body_poses", topic_of<BodyPoses>().type), "");
  EXPECT_EQ(judge("pp/v1/body_poses", topic_of<BodyPoses>().type), "");
  EXPECT_EQ(judge("p/v/body_poses", "x"), "");
  EXPECT_EQ(judge("p/v1", "x"), "");
  EXPECT_EQ(judge("p/video", "x"), "");
  EXPECT_NE(judge("p/v15/body_poses", "Other").find("Other"), std::string::npos);
  EXPECT_EQ(judge("p/v23/body_poses", topic_of<BodyPoses>().type),
            "rig-2 uses prefix p with wire version 23, this build speaks " +
                std::to_string(kWireVersion) + ": the two will not exchange data");
  EXPECT_EQ(judge_remote_endpoint("p", "p/v23/hello", "x", "").value_or("").find("a program uses"),
            0U);
}

TEST(Topics, SessionIdsDiffer) { EXPECT_NE(make_session_id(), make_session_id()); }

}  // namespace
}  // namespace nearmesh::wire
