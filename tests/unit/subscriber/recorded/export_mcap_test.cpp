// SPDX-License-Identifier: Apache-2.0
#include "subscriber/recorded/export_mcap.hpp"

#include "core/recording/mcap.hpp"
#include "session_file.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

TEST(ExportMcap, EachPairHasATopicOfItsOwn) {
  const test::TempFile file(".db3"), out(".mcap");
  test::SessionFile session(file.path());
  constexpr std::uint8_t kUncertain = 3;
  for (const std::string body : {"arm-1", "arm.1", "arm_1"})
    session.add(1, wire::ContactReport{
                       .peer = 0xb1, .body_a = body, .body_b = "quay", .status = kUncertain});
  session.close();
  const auto recording = RecordingReader::open(file.path()).value();
  const auto done = subscriber::export_mcap(*recording, out.path(), {}, "");
  ASSERT_TRUE(done.is_ok()) << done.status().message();
  std::map<std::string, int> messages;
  std::map<std::uint16_t, std::string> topics;
  const auto all = [](const auto&...) { return Status::ok(); };
  ASSERT_TRUE(mcap::read(out.path(), {.channel =
                                          [&](std::uint16_t id, const mcap::Channel& channel,
                                              const mcap::Schema&) {
                                            topics[id] = channel.topic;
                                            return Status::ok();
                                          },
                                      .message =
                                          [&](const mcap::Message& message) {
                                            ++messages[topics[message.channel]];
                                            return Status::ok();
                                          },
                                      .metadata = all,
                                      .attachment = all})
                  .is_ok());
  for (const std::string name : {"arm_1/quay", "arm_1/quay_2", "arm_1/quay_3"})
    EXPECT_EQ(messages["/nearmesh/_00000000000000b1/" + name + "/clearance_m"], 1) << name;
}

}  // namespace
}  // namespace nearmesh
