// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/rtps_check.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>
#include <set>

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
       m.fragments(1, 1, 100, 250, 100);
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
     [](Rtps& m) {
       m.begin(0x0c).u32(0).u8(2).u8(3).big16(0x010f).add(nearmesh::test::key_of(1)).end();
     }},

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
    {"DataOfNumberNone", "sequence",
     [](Rtps& m) { m.begin_data(0, 0x103, 0, 4).encapsulation(1).end(); }},

    {"FragmentNone", "fragments", [](Rtps& m) { m.fragments(0, 1, 100, 250, 100); }},
    {"FragmentsOfNothing", "fragments", [](Rtps& m) { m.fragments(1, 1, 0, 250, 100); }},
    {"FragmentBeyondTheSample", "fragments", [](Rtps& m) { m.fragments(4, 1, 100, 250, 100); }},
    {"FragmentThatIsNotThere", "fragments", [](Rtps& m) { m.fragments(1, 2, 100, 250, 100); }},
    {"SampleOfFourGigabytes", "fragments",
     [](Rtps& m) { m.fragments(1, 1, 100, 0xffffffff, 100); }},
    {"ShortFragments", "fragments", [](Rtps& m) { m.fragments(1, 1, 4, 250, 4); }},
    {"FragmentsOfAKey", "fragments",
     [](Rtps& m) { m.fragments(1, 1, 100, 250, 100, 0x00000103, 4); }},
    {"CountlessFragmentsAtOnce", "fragments",
     [](Rtps& m) { m.fragments(1, kMaxFragmentsAtOnce + 1, 8, 4000, 1000); }},
    {"SampleOfCountlessFragments", "fragments",
     [](Rtps& m) { m.fragments(1, 1, 8, 8 * kMaxFragments + 8, 8); }},
    {"EndpointInFragments", "fragments",
     [](Rtps& m) { m.fragments(1, 1, 100, 250, 100, nearmesh::test::kPublicationsWriter); }},
    {"LastPartOfAnEndpoint", "fragments",
     [](Rtps& m) { m.fragments(3, 1, 100, 250, 100, nearmesh::test::kSubscriptionsWriter); }},
    {"LivelinessInFragments", "fragments",
     [](Rtps& m) { m.fragments(1, 1, 16, 32, 16, nearmesh::test::kLivelinessWriter); }},
    // Whole, and what it says is wrong.
    {"EndpointThatIsNoneInOneFragment", "parameters",
     [](Rtps& m) { m.fragments(1, 1, 100, 100, 100, nearmesh::test::kPublicationsWriter); }},
    {"ShortLivelinessInOneFragment", "parameters",
     [](Rtps& m) { m.fragments(1, 1, 20, 20, 20, nearmesh::test::kLivelinessWriter); }},
    {"AnnouncementInFragments", "fragments",
     [](Rtps& m) { m.fragments(1, 1, 100, 250, 100, nearmesh::test::kParticipantWriter); }},

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
    {"ShortNameOfAnother", "submessages", [](Rtps& m) { m.begin(0x0c).zeros(16).end(); }},
    {"SpeakingForAnotherVersion", "header",
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

TEST(SizeWithoutStatistics, IsThatOfAllBeforeThem) {
  for (const std::size_t payload : {9, 200, 1200}) {
    Rtps m = message();
    m.timestamp();
    sample(4, [&](Rtps& s) { s.encapsulation(1).zeros(payload).align(); })(m);
    const std::size_t size = m.bytes.size();
    EXPECT_EQ(size_without_statistics(m.bytes), size) << "there are none";
    m.statistics();
    EXPECT_EQ(size_without_statistics(m.bytes), size);
  }
}

TEST(SizeWithoutStatistics, WhatLooksLikeThemInASampleStays) {
  Rtps m = message();
  sample(4, [&](Rtps& s) { s.encapsulation(1).zeros(100).u8(0x80).u8(1).u16(56).zeros(56); })(m);
  EXPECT_EQ(size_without_statistics(m.bytes), m.bytes.size());
}

TEST(SizeWithoutStatistics, NothingIsLeftOutWhereFastDdsWouldTakeAnotherByteForTheirBegin) {
  Rtps m = message();
  sample(4, [&](Rtps& s) { s.encapsulation(1).zeros(100).u8(0x80).zeros(59); })(m);
  const std::size_t size = m.bytes.size();
  ASSERT_EQ(m.bytes[size - 60], 0x80);
  m.statistics();
  EXPECT_EQ(size_without_statistics(m.bytes), m.bytes.size());
  m.bytes[size - 60] = 0x81;
  EXPECT_EQ(size_without_statistics(m.bytes), size);
}

TEST(SizeWithoutStatistics, OfWhatIsCutIsAllOfIt) {
  Rtps m = message();
  m.timestamp().heartbeat(1, 1).statistics();
  for (std::size_t size = 0; size < m.bytes.size(); ++size)
    EXPECT_EQ(size_without_statistics(std::span(m.bytes).first(size)), size);
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
}

/// As it would be handed on.
RtpsBytes handed_on(const RtpsBytes& bytes, const RtpsVerdict& verdict) {
  EXPECT_FALSE(verdict.refusal);
  RtpsCopy copy;
  const auto passed = copy.of(std::span(bytes).first(verdict.size), verdict);
  return {passed.begin(), passed.end()};
}
RtpsBytes handed_on(const RtpsBytes& bytes, std::uint32_t turn = 0) {
  return handed_on(bytes, check_rtps(bytes, turn));
}

TEST(RtpsCheck, PlacesOfTcpBecomeThoseOfTheConnection) {
  constexpr std::uint32_t kLogical = 7411U << 16;
  const RtpsPlace connection{4, 40'001, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 10, 0, 0, 7}};
  const auto told = [](std::uint16_t port, std::uint8_t last, std::int32_t kind = 4) {
    Rtps m = message();
    const auto place = [&](std::uint16_t id) {
      m.begin_parameter(id).u32(static_cast<std::uint32_t>(kind)).u32(kLogical | port).zeros(12);
      m.u8(10).u8(0).u8(0).u8(last).end_parameter();
    };
    m.begin_announcement().lease(20);
    for (const std::uint16_t id : std::array<std::uint16_t, 2>{0x0031, 0x0032}) place(id);
    m.finish_announcement().begin_endpoint(true, "topic", "type");
    place(0x002f);
    m.sentinel().end();
    return m.bytes;
  };
  RtpsVerdict verdict = check_rtps(told(5101, 9));
  ASSERT_FALSE(verdict.refusal);
  verdict.reach_by(connection);
  EXPECT_EQ(handed_on(told(5101, 9), verdict), told(40'001, 7));
  verdict = check_rtps(told(5101, 9, 1));
  verdict.reach_by(connection);
  EXPECT_TRUE(verdict.changes.empty()) << "of UDP";
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

// One who is asked for a passphrase sits at the terminal of whoever was only spoken to.
TEST(RtpsCheck, RefusesCertificatesThatAskForAPassphrase) {
  const std::string head = "-----BEGIN CERTIFICATE-----\n", rest = " 4,ENCRYPTED\n\nAAAA\n";
  EXPECT_EQ(reason(handshake(1, {head + "Proc-Type:" + rest}).bytes), "parameters");
  // OpenSSL leaves out what follows a zero in a line, and the line's end.
  EXPECT_EQ(reason(handshake(1, {head + "Proc-" + std::string(1, 0) + "\nType:" + rest}).bytes),
            "parameters");
  EXPECT_EQ(reason(handshake(1, {head + "AAAA\n-----END CERTIFICATE-----\n"}).bytes), "");
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
  EXPECT_TRUE(endpoint(1).tells_of_endpoints);
  EXPECT_FALSE(check_rtps(message().announcement().bytes).tells_of_endpoints);
}

/// An endpoint whose type is told, whole in data or in fragments.
Rtps endpoint_with_types(bool in_fragments, bool has_types) {
  Rtps m = message();
  const std::size_t at = m.bytes.size();
  m.begin_data(0x000003c7, nearmesh::test::kPublicationsWriter, 1, 4);
  const std::size_t payload_at = m.bytes.size();
  m.encapsulation(3);
  m.begin_parameter(0x5a).guid(0x103).end_parameter();
  m.begin_parameter(0x05).text("topic").end_parameter();
  constexpr std::array<std::uint16_t, 3> kTypes{0x69, 0x72, 0x75};
  for (const std::uint16_t id : kTypes)
    m.begin_parameter(has_types ? id : std::uint16_t{0}).u32(0x01020304).zeros(36).end_parameter();
  m.begin_parameter(0x07).text("type").end_parameter();
  m.sentinel().end();
  if (!in_fragments) return m;
  const RtpsBytes payload(m.bytes.begin() + static_cast<std::ptrdiff_t>(payload_at), m.bytes.end());
  m.bytes.resize(at);
  m.begin(0x16).u16(0).u16(28).entity(0x000003c7).entity(nearmesh::test::kPublicationsWriter);
  m.sequence(1).u32(1).u16(static_cast<std::uint16_t>((payload.size() + 63) / 64)).u16(64);
  return m.u32(static_cast<std::uint32_t>(payload.size())).add(payload).end();
}

// Fast DDS 2.9 ends with a null pointer where a type that it is told of is malformed.
TEST(RtpsCheck, TypesOfEndpointsBecomePadding) {
  for (const bool in_fragments : {false, true}) {
    const Rtps told = endpoint_with_types(in_fragments, true);
    EXPECT_EQ(handed_on(told.bytes), endpoint_with_types(in_fragments, false).bytes);
    EXPECT_TRUE(check_rtps(handed_on(told.bytes)).changes.empty());
  }
  // Also where numbers are written the other way round.
  Rtps m = message();
  m.begin_data(0x000003c7, nearmesh::test::kSubscriptionsWriter, 1, 4).encapsulation(2);
  const std::size_t at = m.bytes.size();
  m.big16(0x72).big16(4).u32(0).big16(1).big16(0).end();
  EXPECT_EQ(m.bytes[at + 1], 0x72);
  EXPECT_EQ(handed_on(m.bytes)[at + 1], 0);
  // What is no discovery stays as it is.
  EXPECT_FALSE(RtpsCopy::is_needed(check_rtps(message().announcement().heartbeat(1, 9).bytes)));
}

TEST(RtpsCheck, EndpointOfAnotherIsToldOfInFragmentsToo) {
  Rtps m = endpoint_with_types(true, false);
  EXPECT_FALSE(check_rtps(m.bytes).tells_of_others);
  const Rtps::Key own = nearmesh::test::key_of(1);
  const auto in_payload = std::search(m.bytes.begin() + 20, m.bytes.end(), own.begin(), own.end());
  ASSERT_NE(in_payload, m.bytes.end());
  in_payload[11] = 2;
  EXPECT_TRUE(check_rtps(m.bytes).tells_of_others);
}

// Fast DDS reads the last fragment of a sample by what the first that came said of sizes.
TEST(RtpsCheck, BehindFragmentsThereIsRoomToRead) {
  Rtps m = message();
  m.fragments(1, 3, 1344, 60'000, 3 * 1344);
  m.fragments(3, 1, 100, 250, 52);  // of another size; the last is shorter
  const RtpsVerdict verdict = check_rtps(m.bytes);
  ASSERT_FALSE(verdict.refusal);
  EXPECT_TRUE(verdict.has_fragments);
  ASSERT_TRUE(RtpsCopy::is_needed(verdict));
  RtpsCopy copy;
  const auto passed = copy.of(m.bytes, verdict);
  EXPECT_TRUE(std::equal(passed.begin(), passed.end(), m.bytes.begin(), m.bytes.end()));
  ASSERT_GE(copy.size(), m.bytes.size() + kMaxFragmentsAtOnce * 0xffff);
  EXPECT_EQ(passed.data()[copy.size() - 1], 0);  // may be read (address sanitizer)
}

// Fast DDS keeps four bytes at the beginning of a fragment that is missing.
TEST(RtpsCheck, LastFragmentHasRoomForItsPlaceInTheList) {
  const auto total = [](std::uint16_t size, std::uint32_t said) {
    Rtps m = message();
    m.fragments(1, 1, size, said, size);
    const RtpsBytes passed = handed_on(m.bytes);
    return passed[52] | passed[53] << 8 | passed[54] << 16;
  };
  EXPECT_EQ(total(100, 201), 204);
  EXPECT_EQ(total(100, 203), 204);
  EXPECT_EQ(total(100, 204), 204);
  EXPECT_EQ(total(100, 300), 300);
  EXPECT_EQ(total(101, 203), 208);  // that of the third begins at 204
}

// A latched history with one old sample has all since then in one gap, before each heartbeat.
TEST(RtpsCheck, LongGapIsToldInParts) {
  Rtps m = message();
  m.gap(5, 5 + 3 * kMaxGap - 1, 8).heartbeat(1, 4 * kMaxGap);
  const auto number = [](const RtpsBytes& bytes, std::size_t at) {
    return static_cast<std::int64_t>(bytes[at + 4] | bytes[at + 5] << 8 | bytes[at + 6] << 16);
  };
  std::set<std::int64_t> starts;
  for (std::uint32_t turn = 0; turn < 16; ++turn) {
    const RtpsBytes passed = handed_on(m.bytes, turn);
    ASSERT_EQ(passed.size(), m.bytes.size());
    const std::int64_t start = number(passed, 32), base = number(passed, 40);
    starts.insert(start);
    const bool is_last = start == 5 + 2 * kMaxGap;
    EXPECT_EQ(base - start, kMaxGap - (is_last ? 1 : 0));
    EXPECT_EQ(passed[48], is_last ? 8 : 0);  // bits
    const RtpsVerdict again = check_rtps(passed);
    EXPECT_FALSE(again.refusal);
    EXPECT_TRUE(again.changes.empty());
    EXPECT_TRUE(check_rtps(m.bytes, turn).is_cut_gap);
  }
  EXPECT_EQ(starts, (std::set<std::int64_t>{5, 5 + kMaxGap, 5 + 2 * kMaxGap}));
  EXPECT_TRUE(check_rtps(message().gap(1, 1 + kMaxGap, 0).bytes).changes.empty());
  EXPECT_EQ(reason(message().gap(1, kMaxSequence, 0).bytes), "");
}

// Fast DDS counts up to where a heartbeat begins.
TEST(RtpsCheck, TellsHeartbeatsThatBeginFar) {
  Rtps m = message();
  m.heartbeat(kFarBeginning, kMaxSequence).heartbeat(kFarBeginning + 1, kMaxSequence, 2, 0, 0x203);
  RtpsVerdict verdict = check_rtps(m.bytes);
  EXPECT_FALSE(verdict.refusal);
  EXPECT_FALSE(RtpsCopy::is_needed(verdict));
  ASSERT_EQ(verdict.far_beginnings.size(), 1U);
  const RtpsBeginning far = verdict.far_beginnings[0];
  EXPECT_EQ(far.writer, 0x203U);
  EXPECT_EQ(far.first, kFarBeginning + 1);
  verdict.change_sequence(far.first_at, kFarBeginning, far.little_endian);
  RtpsCopy copy;
  const auto passed = copy.of(m.bytes, verdict);
  Rtps expected = message();
  expected.heartbeat(kFarBeginning, kMaxSequence)
      .heartbeat(kFarBeginning, kMaxSequence, 2, 0, 0x203);
  EXPECT_EQ(RtpsBytes(passed.begin(), passed.end()), expected.bytes);
}

// As Cyclone DDS puts together what two participants of one process answer.
TEST(RtpsCheck, WhoSpeaksNextIsJudgedByItself) {
  Rtps m = message();
  m.to(nearmesh::test::key_of(7)).ack_nack(4, 33);
  const std::size_t size = m.bytes.size();
  m.begin(0x0c).u32(0).u8(2).u8(1).big16(0x0110).add(nearmesh::test::key_of(2)).end();
  m.ack_nack(9, 0);
  const RtpsVerdict verdict = check_rtps(m.bytes);
  EXPECT_FALSE(verdict.refusal);
  EXPECT_EQ(verdict.size, size);
  ASSERT_EQ(verdict.next_speaker_at, size + 4);
  ASSERT_TRUE(verdict.confirmations[0]);
  EXPECT_EQ(verdict.confirmations[0]->next, 4);

  Rtps expected(nearmesh::test::key_of(2), 0x0110);
  expected.bytes[5] = 1;
  expected.to(nearmesh::test::key_of(7)).ack_nack(9, 0);
  const RtpsBytes next = rtps_of_next_speaker(m.bytes, verdict);
  EXPECT_EQ(next, expected.bytes);
  const RtpsVerdict of_next = check_rtps(next);
  EXPECT_FALSE(of_next.refusal);
  EXPECT_EQ(of_next.source, nearmesh::test::key_of(2));
  EXPECT_EQ(of_next.next_speaker_at, 0U);
  // What is wrong there is its own.
  m.heartbeat(0, 1);
  EXPECT_EQ(reason(m.bytes), "");
  EXPECT_EQ(reason(rtps_of_next_speaker(m.bytes, check_rtps(m.bytes))), "sequence");
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

/// Each prefix is a message by itself or is refused; none reads beyond its end (address sanitizer),
/// and none passes that ends inside a submessage.
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
