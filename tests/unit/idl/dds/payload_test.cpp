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
  test::for_each_valid([](const auto& message) { expect_round_trip(message); });
}

TEST(Payload, ReportKeepsWhatWasAsked) {
  const ContactReport sent = test::valid_report();
  const ContactReport came = decode_payload<ContactReport>(encode_payload(sent)).value();
  EXPECT_TRUE(came.asked);
  EXPECT_TRUE(came.cut);
  EXPECT_FALSE(came.put_off);
  EXPECT_EQ(came.world, sent.world);
  EXPECT_EQ(came.answer_digest, sent.answer_digest);
  for (const auto side : {&ContactReport::a, &ContactReport::b}) {
    EXPECT_EQ((came.*side).content_hash, (sent.*side).content_hash);
    EXPECT_EQ((came.*side).state_digest, (sent.*side).state_digest);
    EXPECT_EQ((came.*side).applied_batches, (sent.*side).applied_batches);
    EXPECT_EQ((came.*side).era, (sent.*side).era);
    EXPECT_EQ((came.*side).solid, (sent.*side).solid);
    EXPECT_EQ((came.*side).pose.rotation, (sent.*side).pose.rotation);
    EXPECT_EQ((came.*side).pose.translation_m, (sent.*side).pose.translation_m);
    EXPECT_EQ((came.*side).stamp.mover, (sent.*side).stamp.mover);
    EXPECT_EQ((came.*side).stamp.time_s, (sent.*side).stamp.time_s);
    EXPECT_EQ((came.*side).stamp.max_age_s, (sent.*side).stamp.max_age_s);
  }
  ContactReport late = sent;
  late.asked = false;
  EXPECT_FALSE(decode_payload<ContactReport>(encode_payload(late)).is_ok()) << "of a world";
  late.world.reset();
  late.put_off = true;
  EXPECT_TRUE(decode_payload<ContactReport>(encode_payload(late)).value().put_off);
  late.asked = true;
  EXPECT_FALSE(decode_payload<ContactReport>(encode_payload(late)).is_ok());
  ContactReport tilted = sent;
  tilted.b.pose.rotation[0] = 2;
  EXPECT_FALSE(decode_payload<ContactReport>(encode_payload(tilted)).is_ok());
  tilted.asked = false;  // then it says nothing
  tilted.world.reset();
  EXPECT_TRUE(decode_payload<ContactReport>(encode_payload(tilted)).is_ok());
}

TEST(Payload, WhatAReportSaysOfAWorldIsReadAsItWasWrittenOrNotAtAll) {
  ContactReport sent = test::valid_report();
  sent.world = {.reach_cells = 5, .tiles = {{true, 1, 2, 3}, {}}, .missing_pages = {{5, 6}}};
  // With 12 octets of tiles and 16 of a page at the end, before them three numbers and the
  // sequence's own count.
  const std::vector<std::uint8_t> whole = encode_payload(sent);
  const std::size_t begin = whole.size() - 31;
  ASSERT_EQ(whole[begin + 1], 5);
  ASSERT_EQ(whole[begin - 4], 31);
  std::size_t read = 0;
  for (std::size_t at = begin; at < whole.size(); ++at)
    for (const unsigned octet : {0x00U, 0x01U, 0x02U, 0x7fU, 0x80U, 0xffU}) {
      std::vector<std::uint8_t> changed = whole;
      changed[at] = static_cast<std::uint8_t>(octet);
      const auto came = decode_payload<ContactReport>(changed);
      if (!came.is_ok()) continue;
      ++read;
      EXPECT_EQ(encode_payload(came.value()), changed);
    }
  EXPECT_GT(read, 100U);
  sent.world->tiles.resize(kMaxReportTiles + 1);
  EXPECT_FALSE(decode_payload<ContactReport>(encode_payload(sent)).is_ok());
  sent.world->tiles.resize(kMaxReportTiles);
  for (auto& tile : sent.world->tiles) tile = {true, ~0ULL, ~0U, ~0U};
  sent.world->missing_pages.resize(kMaxReportPages);
  EXPECT_TRUE(decode_payload<ContactReport>(encode_payload(sent)).is_ok());
  sent.world->missing_pages.resize(kMaxReportPages + 1);
  EXPECT_FALSE(decode_payload<ContactReport>(encode_payload(sent)).is_ok());
}

TEST(Payload, OfAnotherVersionIsRefused) {
  for (const int other : {kWireVersion - 1, kWireVersion + 1}) {
    std::vector<std::uint8_t> cdr = encode_payload(test::valid_poses());
    cdr[4] = static_cast<std::uint8_t>(other);
    const Result<BodyPoses> read = decode_payload<BodyPoses>(cdr);
    ASSERT_FALSE(read.is_ok()) << other;
    EXPECT_EQ(read.status().message(), "wire version " + std::to_string(other) +
                                           ", this build speaks " + std::to_string(kWireVersion));
  }
}

TEST(Payload, RecordingsOfAnotherVersionAreRefusedWithBothVersionsAndWhatToDo) {
  EXPECT_TRUE(check_recorded_version(kWireVersion).is_ok());
  const Status older = check_recorded_version(4), newer = check_recorded_version(kWireVersion + 1);
  EXPECT_EQ(older.code(), StatusCode::kUnsupported);
  EXPECT_EQ(older.message(),
            "recorded with wire version 4, this build reads 15: use the build that recorded it, or "
            "record anew");
  EXPECT_EQ(newer.code(), StatusCode::kUnsupported);
  EXPECT_NE(newer.message().find("wire version 16, this build reads 15"), std::string::npos);
}

TEST(Payload, IdlIsTheText) {
  EXPECT_NE(std::string_view(idl_text()).find("struct ContactReportSample {"),
            std::string_view::npos);
}

}  // namespace
}  // namespace nearmesh::wire
