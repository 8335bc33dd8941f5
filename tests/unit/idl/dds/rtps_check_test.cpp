// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/rtps_check.hpp"

#include <gtest/gtest.h>

#include <functional>

#include "tests/support/rtps_message.hpp"

namespace nearmesh::wire {
namespace {

using nearmesh::test::Rtps;
using nearmesh::test::RtpsBytes;

Rtps message() { return Rtps(nearmesh::test::key_of(1)); }

/// Why a message is refused; "" where it is not.
std::string reason(const RtpsBytes& bytes) {
  const RtpsVerdict verdict = check_rtps(bytes);
  return verdict.refusal ? to_string(*verdict.refusal) : "";
}

struct Case {
  const char* name;
  const char* expected;
  std::function<void(Rtps&)> write;
};

/// Parameters of an announcement, in its midst.
std::function<void(Rtps&)> announced(std::function<void(Rtps&)> parameters) {
  return [parameters = std::move(parameters)](Rtps& m) {
    m.begin_announcement().lease(20);
    parameters(m);
    m.finish_announcement();
  };
}

std::function<void(Rtps&)> parameter(std::uint16_t id, std::function<void(Rtps&)> body) {
  return announced([id, body = std::move(body)](Rtps& m) {
    m.begin_parameter(id);
    body(m);
    m.end_parameter();
  });
}

std::function<void(Rtps&)> sample(std::uint8_t flags, std::function<void(Rtps&)> rest) {
  return [flags, rest = std::move(rest)](Rtps& m) {
    m.begin_data(0, 0x00000103, 1, flags);
    rest(m);
    m.end();
  };
}

void write_fragment(Rtps& m, std::uint32_t first, std::uint16_t count, std::uint16_t size,
                    std::uint32_t total, std::size_t bytes, std::uint32_t writer = 0x00000103) {
  m.begin(0x16).u16(0).u16(28).entity(0).entity(writer).sequence(1);
  m.u32(first).u16(count).u16(size).u32(total).zeros(bytes).end();
}

/// As far as a list of so many tokens' class.
void write_handshake(Rtps& m, std::uint32_t tokens) {
  m.begin_data(0x000201c4, nearmesh::test::kHandshakeWriter, 1, 4)
      .encapsulation(1)
      .zeros(2 * 24 + 3 * 16);
  m.text("dds.sec.auth").u32(tokens);
}

const std::vector<Case> kCases{
    {"Nothing", "", [](Rtps&) {}},
    {"OneOfEach", "",
     [](Rtps& m) {
       m.to(nearmesh::test::key_of(2)).timestamp().heartbeat(1, 9).ack_nack(4, 33).gap(3, 5, 8);
       sample(4, [](Rtps& s) { s.encapsulation(1).zeros(9).align(); })(m);
       write_fragment(m, 1, 1, 100, 250, 100);
       m.statistics();
     }},
    {"EmptyStream", "", [](Rtps& m) { m.heartbeat(1, 0); }},
    {"FirstAckNack", "", [](Rtps& m) { m.ack_nack(0, 0); }},
    {"Padding", "", [](Rtps& m) { m.begin(1).end().timestamp(); }},
    {"InvalidTimestamp", "", [](Rtps& m) { m.begin(9, 3).end().heartbeat(1, 1); }},
    {"UnknownSubmessage", "", [](Rtps& m) { m.begin(0x42).zeros(8).end().heartbeat(1, 1); }},
    {"LastOfOddLength", "", [](Rtps& m) { m.begin(0x42).zeros(3).end(); }},
    {"DataToTheEnd", "",
     [](Rtps& m) {
       m.begin_data(0, 0x103, 1, 4).encapsulation(1).zeros(70'000);
       m.bytes[22] = m.bytes[23] = 0;
     }},
    {"Announcement", "", [](Rtps& m) { m.announcement(); }},
    {"Farewell", "", [](Rtps& m) { m.farewell(); }},
    {"SourceThatIsItself", "",
     [](Rtps& m) { m.begin(0x0c).zeros(8).add(nearmesh::test::key_of(1)).end(); }},

    {"TailOfThreeBytes", "submessages", [](Rtps& m) { m.timestamp().zeros(3); }},
    {"LengthBeyondTheEnd", "submessages",
     [](Rtps& m) {
       m.heartbeat(1, 1);
       m.bytes[22] = 40;
     }},
    {"OddLengthInTheMidst", "submessages",
     [](Rtps& m) { m.begin(0x42).zeros(3).end().timestamp(); }},
    {"LengthNoneInTheMidst", "submessages", [](Rtps& m) { m.begin(0x42).end().timestamp(); }},
    {"TimestampWithoutTime", "submessages", [](Rtps& m) { m.begin(9).end(); }},
    {"ShortHeartbeat", "submessages", [](Rtps& m) { m.begin(7).zeros(20).end(); }},
    {"ShortDestination", "submessages", [](Rtps& m) { m.begin(0x0e).zeros(8).end(); }},
    {"ShortData", "submessages", [](Rtps& m) { m.begin(0x15).zeros(16).end(); }},
    {"DataWithKeyToo", "submessages", sample(12, [](Rtps& m) { m.encapsulation(1).u32(1); })},
    {"DataWithoutEncapsulation", "submessages", sample(4, [](Rtps& m) { m.u8(0).u8(1); })},
    {"ShortCryptoHeader", "submessages", [](Rtps& m) { m.begin(0x31).zeros(16).end(); }},

    {"DeadlyStatistics", "statistics", [](Rtps& m) { m.u8(0x80).u8(1).u16(56).zeros(60); }},
    {"StatisticsOfOtherLength", "statistics", [](Rtps& m) { m.begin(0x80).zeros(60).end(); }},
    {"StatisticsInTheMidst", "statistics", [](Rtps& m) { m.statistics().timestamp(); }},

    {"HeartbeatFromNothing", "sequence", [](Rtps& m) { m.heartbeat(0, 1); }},
    {"HeartbeatBackward", "sequence", [](Rtps& m) { m.heartbeat(5, 3); }},
    {"HeartbeatToTheEndOfTime", "sequence", [](Rtps& m) { m.heartbeat(1, kMaxSequence + 1); }},
    {"HeartbeatBelowZero", "sequence", [](Rtps& m) { m.heartbeat(-5, -4); }},
    {"AckNackBeyond", "sequence", [](Rtps& m) { m.ack_nack(kMaxSequence + 1, 1); }},
    {"AckNackOfTooManyBits", "sequence", [](Rtps& m) { m.ack_nack(1, 257); }},
    {"GapFromNothing", "sequence", [](Rtps& m) { m.gap(0, 5, 0); }},
    {"GapBackward", "sequence", [](Rtps& m) { m.gap(5, 4, 0); }},
    {"GapWithoutEnd", "sequence", [](Rtps& m) { m.gap(1, kMaxGap + 2, 0); }},
    {"DataOfNumberNone", "sequence",
     [](Rtps& m) { m.begin_data(0, 0x103, 0, 4).encapsulation(1).end(); }},

    {"FragmentNone", "fragments", [](Rtps& m) { write_fragment(m, 0, 1, 100, 250, 100); }},
    {"FragmentsOfNothing", "fragments", [](Rtps& m) { write_fragment(m, 1, 1, 0, 250, 100); }},
    {"FragmentBeyondTheSample", "fragments",
     [](Rtps& m) { write_fragment(m, 4, 1, 100, 250, 100); }},
    {"FragmentThatIsNotThere", "fragments",
     [](Rtps& m) { write_fragment(m, 1, 2, 100, 250, 100); }},
    {"SampleOfFourGigabytes", "fragments",
     [](Rtps& m) { write_fragment(m, 1, 1, 100, 0xffffffff, 100); }},
    {"AnnouncementInFragments", "fragments",
     [](Rtps& m) { write_fragment(m, 1, 1, 100, 250, 100, nearmesh::test::kParticipantWriter); }},

    {"QosWithoutEnd", "parameters",
     sample(6, [](Rtps& m) { m.begin_parameter(0x70).zeros(16).end_parameter(); })},
    // Fast DDS takes what is left for the payload's length: less than nothing is four gigabytes.
    {"QosLongerThanTheData", "parameters",
     [](Rtps& m) {
       m.begin_data(0, 0x103, 1, 6).u16(0x42).u16(200).end();
       m.begin(0x42).zeros(300).sentinel().end();
     }},
    {"ShortKeyHash", "parameters",
     sample(2, [](Rtps& m) { m.begin_parameter(0x70).zeros(8).end_parameter().sentinel(); })},
    {"OtherEncapsulation", "parameters",
     [](Rtps& m) {
       m.begin_data(0, nearmesh::test::kParticipantWriter, 1, 4).encapsulation(1).sentinel().end();
     }},
    {"LeaseUntold", "parameters", [](Rtps& m) { m.begin_announcement().finish_announcement(); }},
    {"LeaseOfNothing", "parameters", announced([](Rtps& m) { m.lease(0, 1000); })},
    {"LeaseBelowZero", "parameters", announced([](Rtps& m) { m.lease(-1); })},
    {"ShortLease", "parameters", parameter(0x0002, [](Rtps& m) { m.u32(1); })},
    {"ShortLocator", "parameters", parameter(0x0031, [](Rtps& m) { m.zeros(20); })},
    {"NameWithoutEndMark", "parameters", parameter(0x0062, [](Rtps& m) { m.u32(4).u32(~0U); })},
    {"NameBeyondItsParameter", "parameters", parameter(0x0062, [](Rtps& m) { m.u32(40).u32(0); })},
    {"UserDataOfFourGigabytes", "parameters", parameter(0x002c, [](Rtps& m) { m.u32(~0U); })},
    {"PropertiesWithoutNumber", "parameters",
     parameter(0x0059, [](Rtps& m) { m.u32(~0U).zeros(40); })},
    {"TokenOfFourGigabytes", "parameters",
     parameter(0x1001, [](Rtps& m) { m.text("DDS:Auth").u32(0).u32(1).text("c.id").u32(~0U); })},
    {"TokenOfCountlessProperties", "parameters",
     parameter(0x1001, [](Rtps& m) { m.text("DDS:Auth").u32(~0U); })},
    {"HandshakeOfCountlessTokens", "parameters",
     [](Rtps& m) {
       write_handshake(m, ~0U);
       m.zeros(64).end();
     }},

    {"AnnouncedTwice", "parameters", [](Rtps& m) { m.announcement().announcement(2); }},
    {"SpeakingForAnother", "source",
     [](Rtps& m) { m.begin(0x0c).zeros(8).add(nearmesh::test::key_of(2)).end(); }},
};

class RtpsCheckCase : public testing::TestWithParam<Case> {};

TEST_P(RtpsCheckCase, IsRefusedForItsReason) {
  Rtps m = message();
  GetParam().write(m);
  EXPECT_EQ(reason(m.bytes), GetParam().expected);
}

INSTANTIATE_TEST_SUITE_P(Cases, RtpsCheckCase, testing::ValuesIn(kCases),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST(RtpsCheck, RefusesWhatIsNoRtps) {
  EXPECT_EQ(reason({}), "header");
  EXPECT_EQ(reason(RtpsBytes(64)), "header");
  Rtps m = message();
  m.bytes.pop_back();
  EXPECT_EQ(reason(m.bytes), "header");
  m = message();
  m.bytes[4] = 3;
  EXPECT_EQ(reason(m.bytes), "header");
}

TEST(RtpsCheck, RefusesThePacketThatEndsFastDds) {
  EXPECT_EQ(nearmesh::test::deadly_packet().size(), 84U);
  // Its vendor is eProsima's, so Fast DDS reads the statistics.
  EXPECT_EQ(reason(nearmesh::test::deadly_packet()), "statistics");
}

TEST(RtpsCheck, CutsStatisticsOffTheEnd) {
  Rtps m = message();
  m.timestamp();
  const std::size_t size = m.bytes.size();
  m.statistics();
  EXPECT_EQ(reason(m.bytes), "");
  EXPECT_EQ(check_rtps(m.bytes).size, size);
}

TEST(RtpsCheck, LeavesOtherVendorsSubmessagesAlone) {
  Rtps m(nearmesh::test::key_of(1), 0x0110);
  m.begin(0x80).zeros(8).end().timestamp();
  EXPECT_EQ(reason(m.bytes), "");
  EXPECT_EQ(check_rtps(m.bytes).size, m.bytes.size());
}

TEST(RtpsCheck, TellsWhoAnnouncesItself) {
  Rtps m = message();
  m.timestamp().begin_announcement(7).lease(20, 0x80000000).finish_announcement();
  const RtpsVerdict verdict = check_rtps(m.bytes);
  EXPECT_EQ(verdict.source, nearmesh::test::key_of(1));
  ASSERT_TRUE(verdict.announcement);
  EXPECT_EQ(verdict.announcement->sequence, 7);
  EXPECT_EQ(verdict.announcement->lease_s, 20.5);
  EXPECT_FALSE(verdict.announcement->leaves);
  EXPECT_EQ(m.bytes[verdict.announcement->lease_at], 20);
  EXPECT_EQ(m.bytes[verdict.announcement->lease_at + 7], 0x80);
  EXPECT_TRUE(verdict.only_announces);
  m.heartbeat(1, 1);
  EXPECT_FALSE(check_rtps(m.bytes).only_announces);
}

// What two releases of Fast DDS on one secured bus are told by.
TEST(RtpsCheck, TellsOfWhichReleaseAnIdentityIs) {
  Rtps m = message();
  m.begin_announcement().lease(20).secured("rig/peer");
  const auto told = [](Rtps written) {
    written.finish_announcement();
    const RtpsVerdict verdict = check_rtps(written.bytes);
    EXPECT_TRUE(verdict.announcement);
    EXPECT_EQ(std::string(verdict.announcement->name.begin(), verdict.announcement->name.end() - 1),
              "rig/peer");
    return std::pair(verdict.announcement->is_secured, int{verdict.announcement->release});
  };
  // As Fast DDS 2.9.1 and 3.1.2 announce themselves.
  m.begin_parameter(0x0058).u32(0x0fcf003f).end_parameter();
  EXPECT_EQ(told(m), std::pair(true, 0));
  m.product(0x00020103);
  EXPECT_EQ(told(m), std::pair(true, 3));
}

/// Of participant 1, in the name of `speaker`, with these certificates.
Rtps handshake(std::uint8_t speaker, const std::vector<std::string>& certificates,
               std::uint32_t reader = 0x000201c4,
               std::uint32_t writer = nearmesh::test::kHandshakeWriter) {
  Rtps m = message();
  m.begin_data(reader, writer, 1, 4).encapsulation(1);
  m.add(nearmesh::test::key_of(speaker)).zeros(12 + 24 + 3 * 16);
  m.text("dds.sec.auth").u32(1).text("DDS:Auth:PKI-DH:1.0+Req").u32(0);
  m.u32(static_cast<std::uint32_t>(certificates.size()));
  for (const std::string& certificate : certificates) {
    m.text("c.id").u32(static_cast<std::uint32_t>(certificate.size())).add(certificate);
    m.align();
  }
  return m.end();
}

TEST(RtpsCheck, TellsWhomAHandshakeShows) {
  const auto shown = [](const Rtps& m) {
    const RtpsVerdict verdict = check_rtps(m.bytes);
    EXPECT_FALSE(verdict.refusal);
    return std::string(verdict.certificate.begin(), verdict.certificate.end());
  };
  EXPECT_EQ(shown(handshake(1, {"alice"})), "alice");
  EXPECT_EQ(shown(handshake(1, {})), "");
  EXPECT_EQ(shown(handshake(1, {"alice", "alice"})), "alice");
  // As it also comes to the reader of handshakes.
  EXPECT_EQ(shown(handshake(1, {"alice"}, 0)), "alice");
  EXPECT_EQ(shown(handshake(1, {"alice"}, 0, 0)), "alice");
  EXPECT_EQ(shown(handshake(1, {"alice"}, 0x000201c4, 0x00000103)), "alice");
}

TEST(RtpsCheck, TellsWhatIntroduces) {
  EXPECT_TRUE(check_rtps(message().announcement().bytes).introduces);
  EXPECT_TRUE(check_rtps(message().farewell().bytes).introduces);
  EXPECT_TRUE(check_rtps(handshake(1, {}).bytes).introduces);
  Rtps m = message();
  sample(4, [](Rtps& s) { s.encapsulation(1).zeros(9).align(); })(m);
  EXPECT_FALSE(check_rtps(m.heartbeat(1, 9).bytes).introduces);
}

TEST(RtpsCheck, RefusesHandshakesOfTwo) {
  EXPECT_EQ(reason(handshake(1, {"alice", "bob"}).bytes), "parameters");
  EXPECT_EQ(reason(handshake(1, {"", "bob"}).bytes), "parameters");
  EXPECT_EQ(reason(handshake(2, {"alice"}).bytes), "source");
}

TEST(RtpsCheck, TellsWhoLeaves) {
  Rtps m = message();
  m.farewell(9);
  const RtpsVerdict verdict = check_rtps(m.bytes);
  ASSERT_TRUE(verdict.announcement);
  EXPECT_TRUE(verdict.announcement->leaves);
  EXPECT_EQ(verdict.announcement->sequence, 9);
}

TEST(RtpsCheck, WordOfAnotherIsNoAnnouncement) {
  Rtps m = message();
  Rtps other(nearmesh::test::key_of(2));
  other.announcement();
  m.bytes.insert(m.bytes.end(), other.bytes.begin() + 20, other.bytes.end());
  EXPECT_EQ(reason(m.bytes), "");
  EXPECT_FALSE(check_rtps(m.bytes).announcement);
  EXPECT_TRUE(check_rtps(m.bytes).tells_of_others);
}

TEST(RtpsCheck, EndpointOfAnotherIsToldOf) {
  const auto endpoint = [](std::uint8_t whose) {
    Rtps m = message();
    m.begin_data(0x000003c7, nearmesh::test::kPublicationsWriter, 1, 4).encapsulation(3);
    m.begin_parameter(0x5a).add(nearmesh::test::key_of(whose)).entity(0x103).end_parameter();
    m.sentinel().end();
    return check_rtps(m.bytes);
  };
  EXPECT_FALSE(endpoint(1).tells_of_others);
  EXPECT_TRUE(endpoint(2).tells_of_others);
  EXPECT_FALSE(endpoint(2).refusal);
}

TEST(RtpsCheck, BigEndianIsReadToo) {
  Rtps m = message();
  const auto big32 = [&](std::uint32_t value) { m.entity(value); };
  m.u8(7).u8(0).big16(28).entity(0).entity(0);
  for (const std::uint32_t word : {0, 1, 0, 9, 1}) big32(word);
  EXPECT_EQ(reason(m.bytes), "");
  m.bytes[39] = 0;  // first: 0
  EXPECT_EQ(reason(m.bytes), "sequence");
}

/// Each prefix is a message by itself or is refused; none reads beyond its end (address sanitizer), and none passes that ends
/// inside a submessage.
TEST(RtpsCheck, RefusesEveryMessageThatWasCut) {
  Rtps m = message();
  m.to(nearmesh::test::key_of(2)).announcement().heartbeat(1, 9).gap(3, 5, 8).ack_nack(1, 200);
  std::size_t passed = 0;
  for (std::size_t size = 0; size < m.bytes.size(); ++size)
    passed +=
        reason(RtpsBytes(m.bytes.begin(), m.bytes.begin() + static_cast<std::ptrdiff_t>(size)))
            .empty();
  EXPECT_EQ(passed, 5U);  // before each of the five
}

}  // namespace
}  // namespace nearmesh::wire
