// SPDX-License-Identifier: Apache-2.0
// Bytes of a recording and messages.
#include "nearmesh/idl/dds/payload.hpp"

#include <gtest/gtest.h>

#include <string_view>

#include "samples.hpp"

namespace nearmesh::wire {
namespace {

template <class Message>
void expect_round_trip(const Message& message) {
  const std::vector<std::uint8_t> cdr = encode_payload(message);
  const Result<Message> decoded = decode_payload<Message>(cdr);
  ASSERT_TRUE(decoded.is_ok()) << decoded.status().message();
  EXPECT_EQ(encode_payload(decoded.value()), cdr);
  for (std::size_t size = 0; size + 4 <= cdr.size(); ++size)
    EXPECT_FALSE(decode_payload<Message>({cdr.data(), size}).is_ok()) << size;
}

TEST(Payload, RoundTripAndNoPrefix) {
  expect_round_trip(test::valid_hello());
  expect_round_trip(test::valid_header());
  expect_round_trip(test::valid_subscription());
  expect_round_trip(test::valid_batch());
  expect_round_trip(test::valid_pose());
  expect_round_trip(test::valid_report());
}

TEST(Payload, ReportKeepsWhatWasAsked) {
  const ContactReport sent = test::valid_report();
  const ContactReport came = decode_payload<ContactReport>(encode_payload(sent)).value();
  EXPECT_TRUE(came.asked);
  EXPECT_TRUE(came.gave_up_detail);
  EXPECT_EQ(came.answer_digest, sent.answer_digest);
  for (const auto side : {&ContactReport::a, &ContactReport::b}) {
    EXPECT_EQ((came.*side).content_hash, (sent.*side).content_hash);
    EXPECT_EQ((came.*side).state_digest, (sent.*side).state_digest);
    EXPECT_EQ((came.*side).applied_batches, (sent.*side).applied_batches);
    EXPECT_EQ((came.*side).solid, (sent.*side).solid);
    EXPECT_EQ((came.*side).pose.rotation, (sent.*side).pose.rotation);
    EXPECT_EQ((came.*side).pose.translation_m, (sent.*side).pose.translation_m);
  }
  ContactReport tilted = sent;
  tilted.b.pose.rotation[0] = 2;
  EXPECT_FALSE(decode_payload<ContactReport>(encode_payload(tilted)).is_ok());
  tilted.asked = false;  // then it says nothing
  EXPECT_TRUE(decode_payload<ContactReport>(encode_payload(tilted)).is_ok());
}

template <class Message>
Result<Message> recorded_with(const Message& message, std::uint8_t version) {
  std::vector<std::uint8_t> cdr = encode_payload(message);
  cdr[4] = version;
  return decode_payload<Message>(cdr);
}

TEST(Payload, OfTheOldestRecordedVersionIsReadButForRegions) {
  constexpr auto kOldest = static_cast<std::uint8_t>(kOldestRecordedWireVersion);
  const BodyPose pose = test::valid_pose();
  const Result<BodyPose> read = recorded_with(pose, kOldest);
  ASSERT_TRUE(read.is_ok()) << read.status().message();
  EXPECT_EQ(encode_payload(read.value()), encode_payload(pose));
  EXPECT_TRUE(recorded_with(test::valid_hello(), kOldest).is_ok());
  EXPECT_TRUE(recorded_with(test::valid_header(), kOldest).is_ok());
  EXPECT_TRUE(recorded_with(test::valid_batch(), kOldest).is_ok());
  EXPECT_TRUE(recorded_with(test::valid_report(), kOldest).is_ok());
  EXPECT_FALSE(recorded_with(test::valid_subscription(), kOldest).is_ok());
  EXPECT_FALSE(recorded_with(pose, kOldest - 1).is_ok());
  EXPECT_FALSE(recorded_with(pose, kWireVersion + 1).is_ok());
}

TEST(Payload, IdlIsTheText) {
  EXPECT_NE(std::string_view(idl_text()).find("struct ContactReportSample {"),
            std::string_view::npos);
}

}  // namespace
}  // namespace nearmesh::wire
