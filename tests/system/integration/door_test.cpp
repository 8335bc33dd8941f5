// SPDX-License-Identifier: Apache-2.0
// The door on participants as a host makes them, in processes of their own: some are to die.

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "idl/dds/bus.hpp"
#include "idl/dds/door_watch.hpp"
#include "idl/dds/endpoints.hpp"
#include "idl/dds/fastdds.hpp"
#include "idl/dds/fastdds_api.hpp"
#include "idl/dds/rtps_check.hpp"
#include "nearmesh/idl/dds/door.hpp"
#include "poll.hpp"
#include "tests/support/rtps_message.hpp"

namespace nearmesh::test {
namespace {

namespace fdds = wire::fdds;
namespace rtps = wire::rtps;

/// Of what ought to happen soon: a machine may be held up for many seconds.
constexpr double kDeadline_s = 100;
constexpr double kLease_s = 5;
/// Of a test each: the packet ends everybody on the bus who has no door. Their ports lie below
/// those that systems give out.
// Of nobody else: who is found there is counted.
enum Domain : std::uint32_t {
  kDeadly = 64,
  kLeases = 65,
  kSharedMemory = 66,
  kTransports = 67,
  kTypes = 68,
  kHostile = 69,
  kSpeakers = 70,
  kSockets = 71,
  kOutgoing = 72,
};

/// On loopback alone, found by multicast there.
fdds::DomainParticipantQos loopback_qos() {
  fdds::DomainParticipantQos qos;
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().user_transports.push_back(udp);
  auto& discovery = qos.wire_protocol().builtin.discovery_config;
  discovery.leaseDuration = wire::Duration(kLease_s);
  discovery.leaseDuration_announcementperiod = wire::Duration(0.3);
  return qos;
}

fdds::DomainParticipantQos shared_memory_qos() {
  fdds::DomainParticipantQos qos = loopback_qos();
  qos.transport().user_transports = {std::make_shared<rtps::SharedMemTransportDescriptor>()};
  return qos;
}

/// Who is there, as Fast DDS tells.
class Watcher : public wire::FindingListener {
 public:
  explicit Watcher(std::uint32_t domain, const fdds::DomainParticipantQos& qos)
      : participant_(fdds::DomainParticipantFactory::get_instance()->create_participant(
            domain, qos, this, fdds::StatusMask::none())) {}
  ~Watcher() override {
    fdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  void participant_found(const wire::FoundParticipant& told) override {
    if (told.is_new) ++found;
    if (told.is_gone) ++gone;
  }
  void writer_found(const wire::FoundEndpoint& told) override {
    if (told.is_new) ++writers;
  }
  [[nodiscard]] fdds::DomainParticipant& participant() { return *participant_; }

  std::atomic<int> found = 0, gone = 0, writers = 0;

 private:
  fdds::DomainParticipant* participant_;
};

/// This program again: a participant until it is killed.
class Child {
 public:
  Child(const char* role, std::uint32_t domain) {
    pid_ = fork();
    if (pid_ != 0) return;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    execl("/proc/self/exe", "door_test", "--child", role, std::to_string(domain).c_str(), nullptr);
    _exit(127);
  }
  ~Child() {
    if (!is_over()) end(SIGKILL);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  bool is_over() { return over_ || (over_ = waitpid(pid_, &status_, WNOHANG) == pid_); }
  void signal(int number) const { kill(pid_, number); }
  void end(int number) {
    kill(pid_, number);
    waitpid(pid_, &status_, 0);
    over_ = true;
  }
  [[nodiscard]] int signal_of_death() const { return WIFSIGNALED(status_) ? WTERMSIG(status_) : 0; }

 private:
  pid_t pid_ = 0;
  int status_ = 0;
  bool over_ = false;
};

fdds::DomainParticipantQos qos_of(const std::string& role) {
  fdds::DomainParticipantQos qos = role == "shared-memory" ? shared_memory_qos() : loopback_qos();
  if (role != "no-door") wire::add_door(qos);
  return qos;
}

void send_to(std::uint32_t domain, const RtpsBytes& packet) {
  const int sender = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const in_addr lo{htonl(INADDR_LOOPBACK)};
  ::setsockopt(sender, IPPROTO_IP, IP_MULTICAST_IF, &lo, sizeof lo);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(7400 + 250 * domain));
  to.sin_addr.s_addr = inet_addr("239.255.0.1");
  EXPECT_EQ(::sendto(sender, packet.data(), packet.size(), 0,
                     reinterpret_cast<const sockaddr*>(&to), sizeof to),
            static_cast<ssize_t>(packet.size()));
  ::close(sender);
}

/// Hears what participants announce of themselves on loopback.
class Ear {
 public:
  explicit Ear(std::uint32_t domain) : socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    const int on = 1;
    ::setsockopt(socket_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_port = htons(static_cast<std::uint16_t>(7400 + 250 * domain));
    at.sin_addr.s_addr = htonl(INADDR_ANY);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&at), sizeof at), 0);
    const ip_mreq group{{inet_addr("239.255.0.1")}, {htonl(INADDR_LOOPBACK)}};
    EXPECT_EQ(::setsockopt(socket_, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group), 0);
  }
  ~Ear() { ::close(socket_); }
  Ear(const Ear&) = delete;
  Ear& operator=(const Ear&) = delete;

  /// Nothing: there is none now.
  [[nodiscard]] RtpsBytes next() const {
    RtpsBytes packet(65536);
    const ssize_t got = ::recv(socket_, packet.data(), packet.size(), MSG_DONTWAIT);
    packet.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
    return packet;
  }

 private:
  const int socket_;
};

/// Speaks from one socket to all participants of a domain, in the name of some that are none: once
/// to each, where it hears of endpoints.
class Hostile {
 public:
  explicit Hostile(std::uint32_t domain)
      : domain_(domain), socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}
  ~Hostile() { ::close(socket_); }
  Hostile(const Hostile&) = delete;
  Hostile& operator=(const Hostile&) = delete;

  void say(const RtpsBytes& packet) const {
    constexpr std::uint32_t kMostParticipants = 8;  // of a test
    for (std::uint32_t i = 0; i < kMostParticipants; ++i) {
      sockaddr_in to{};
      to.sin_family = AF_INET;
      to.sin_port = htons(static_cast<std::uint16_t>(7410 + 250 * domain_ + 2 * i));
      to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
      EXPECT_EQ(::sendto(socket_, packet.data(), packet.size(), 0,
                         reinterpret_cast<const sockaddr*>(&to), sizeof to),
                static_cast<ssize_t>(packet.size()));
    }
  }
  /// Again and again, since a datagram may be lost on a busy machine.
  [[nodiscard]] bool say_until(const RtpsBytes& packet, const std::function<bool()>& done) const {
    return poll(
        [&] {
          say(packet);
          return done();
        },
        kDeadline_s, 0.1);
  }

 private:
  const std::uint32_t domain_;
  const int socket_;
};

Rtps announced_with_a_malformed_type(std::int64_t number = 1) {
  Rtps m(key_of(9));
  m.announcement(number).begin_endpoint(true, "hostile", "none").malformed_type();
  return m.finish_announcement();
}

TEST(Door, OnePacketEndsAParticipantWithoutOneAndNoneWithIt) {
  Watcher watcher(kDeadly, qos_of("door"));
  Child without("no-door", kDeadly), with("door", kDeadly);
  ASSERT_TRUE(poll([&] { return watcher.found >= 2; }, kDeadline_s, 0.01));
  send_to(kDeadly, deadly_packet());
  if (wire::fastdds_asserts()) {
    // A datagram may be lost on a busy machine.
    const auto is_over = [&] {
      send_to(kDeadly, deadly_packet());
      return without.is_over();
    };
    ASSERT_TRUE(poll(is_over, kDeadline_s, 0.1));
    EXPECT_EQ(without.signal_of_death(), SIGABRT);
  }
  // It had the packet when the other died of it; its life signs go on.
  std::this_thread::sleep_for(std::chrono::duration<double>(1));
  EXPECT_FALSE(with.is_over());
}

TEST(Door, MalformedTypeEndsAParticipantWithoutOneAndNoneWithIt) {
  Watcher watcher(kTypes, qos_of("door"));
  Child without("no-door", kTypes);
  ASSERT_TRUE(poll([&] { return watcher.found >= 1; }, kDeadline_s, 0.01));
  const Hostile hostile(kTypes);
  // Else this process ends. The endpoint is found by its names.
  EXPECT_TRUE(hostile.say_until(announced_with_a_malformed_type().bytes,
                                [&] { return watcher.writers > 0; }));
  if (NEARMESH_FASTDDS != 2) return;
  ASSERT_TRUE(hostile.say_until(announced_with_a_malformed_type().bytes,
                                [&] { return without.is_over(); }));
  EXPECT_EQ(without.signal_of_death(), SIGSEGV);
}

wire::TransportOptions loopback(std::uint32_t domain) {
  wire::TransportOptions options;
  options.domain = domain;
  options.interface = "127.0.0.1";
  options.announcement_s = 0.3;
  return options;
}

TEST(Door, BusGoesOnUnderFragmentsGapsAndHeartbeatsThatAreNone) {
  wire::Mailbox heard, said;
  wire::Reader<wire::Hello> reader(heard);
  wire::Writer<wire::Hello> writer(said);
  std::atomic<bool> is_known = false;
  const wire::BusOptions hearing{
      .transport = loopback(kHostile),
      .on_writer = [&](const auto& found) { is_known = is_known || found.topic == "hostile"; }};
  const auto hearer = std::move(wire::Bus::open(hearing, heard)).value();
  ASSERT_TRUE(reader.open(*hearer).is_ok());

  const Hostile hostile(kHostile);
  const auto say = [] { return Rtps(key_of(9)); };
  ASSERT_TRUE(
      hostile.say_until(announced_with_a_malformed_type().bytes, [&] { return is_known.load(); }));
  const auto refused = [&] {
    return hearer->door()->refused()[static_cast<std::size_t>(wire::DoorRefusal::kFragments)];
  };
  // Of a key; so short that the list of the missing ones has no room; of an endpoint, which comes
  // in parts.
  for (const Rtps& fragments :
       {say().fragments(1, 1, 100, 250, 100, 0x103, 4), say().fragments(1, 1, 1, 9, 1),
        say().fragments(1, 2, 2, 9, 4), say().fragments(3, 1, 3, 9, 3),
        say().fragments(1, 1, 100, 250, 100, kPublicationsWriter, 0, 0x000003c7, 2)}) {
    const auto before = refused();
    EXPECT_TRUE(hostile.say_until(fragments.bytes, [&] { return refused() > before; }));
  }
  // Sizes that differ pass, and are read as the first one says; nobody awaits this sample.
  hostile.say(say().fragments(1, 1, 8000, 60'000, 8000).fragments(7, 1, 9999, 60'000, 6).bytes);
  // Who counts all these numbers hears of no endpoint for months, so that what is said next does
  // not come, nor does this test end.
  hostile.say(say().gap(2, wire::kMaxSequence, 0).bytes);
  hostile.say(say().heartbeat(wire::kMaxSequence, wire::kMaxSequence).bytes);

  const auto speaker = std::move(wire::Bus::open({.transport = loopback(kHostile)}, said)).value();
  ASSERT_TRUE(writer.open(*speaker).is_ok());
  wire::Hello hello;
  hello.publisher = 7;
  hello.models.push_back({"bunny", {1, 2}, 3});
  ASSERT_EQ(writer.write(hello), wire::WriteResult::kTaken);
  bool has_come = false;
  EXPECT_TRUE(poll(
      [&] {
        static_cast<void>(reader.drain(100, [&](wire::Hello&& one, const auto&, auto) {
          has_come = has_come || one.publisher == 7;
        }));
        return has_come;
      },
      kDeadline_s, 0.01));
}

// As Cyclone DDS puts together what two participants of one process say. Judged as the first one's
// word the second's is refused.
TEST(Door, BothSpeakersOfADatagramAreFound) {
  Watcher watcher(kSpeakers, qos_of("door"));
  Rtps m(key_of(8));
  m.announcement().speaker(key_of(9)).announcement();
  EXPECT_TRUE(Hostile(kSpeakers).say_until(m.bytes, [&] { return watcher.found == 2; }));
}

TEST(Door, WhoSpeaksFromAnotherSocketIsHeardOnceItHasBeenSilent) {
  Watcher watcher(kSockets, qos_of("door"));
  const auto door = wire::door_watch_of(watcher.participant().get_qos());
  const auto refused = [&] {
    return door->refused()[static_cast<std::size_t>(wire::DoorRefusal::kSource)];
  };
  const Hostile here(kSockets), elsewhere(kSockets), once(kSockets);
  ASSERT_TRUE(once.say_until(Rtps(key_of(8)).announcement(1, 1000).bytes,
                             [&] { return watcher.found == 1; }));
  std::int64_t number = 0;
  const auto word = [&] { return announced_with_a_malformed_type(++number).bytes; };
  const auto announce = [&] { here.say(Rtps(key_of(9)).announcement(++number).bytes); };
  ASSERT_TRUE(poll(
      [&] {
        announce();
        return watcher.found == 2;
      },
      kDeadline_s, 0.1));
  // As the door counts, whose time stands still where it is held up: some seconds more than the
  // time of learning takes.
  ASSERT_TRUE(poll(
      [&] {
        announce();
        return door->is_silent(key_of(8), 13) == true;
      },
      kDeadline_s, 0.5));
  EXPECT_TRUE(poll(
      [&] {
        announce();
        elsewhere.say(word());
        return refused() > 0;
      },
      kDeadline_s, 0.1));
  EXPECT_EQ(watcher.writers, 0);
  // And then than a silence.
  ASSERT_TRUE(poll([&] { return door->is_silent(key_of(9), 7) == true; }, kDeadline_s, 0.1));
  EXPECT_TRUE(elsewhere.say_until(word(), [&] { return watcher.writers > 0; }));
}

TEST(Door, IsOnEachTransport) {
  fdds::DomainParticipantQos qos;  // with built-in transports
  wire::add_door(qos);
  EXPECT_FALSE(qos.transport().use_builtin_transports);
  EXPECT_EQ(qos.transport().user_transports.size(), 2U);
  wire::add_door(qos);  // again: the same
  EXPECT_EQ(qos.transport().user_transports.size(), 2U);
  Watcher with(kTransports, qos), without(kTransports, loopback_qos());
  EXPECT_TRUE(wire::has_door(with.participant()));
  EXPECT_FALSE(wire::has_door(without.participant()));
}

TEST(Door, WhatGoesOutByUdpHasNoStatistics) {
  const Ear ear(kOutgoing);
  Watcher with(kOutgoing, qos_of("door")), without(kOutgoing, qos_of("no-door"));
  // Messages of each without statistics and with them.
  std::array<int, 2> of_door{}, of_other{};
  const auto hear = [&] {
    for (RtpsBytes packet = ear.next(); !packet.empty(); packet = ear.next()) {
      const wire::RtpsVerdict verdict = wire::check_rtps(packet);
      EXPECT_FALSE(verdict.refusal);
      const auto is_of = [&](Watcher& one) {
        return std::equal(verdict.source.begin(), verdict.source.end(),
                          one.participant().guid().guidPrefix.value);
      };
      const std::size_t ends = verdict.size < packet.size() ? 1 : 0;
      if (is_of(with)) ++of_door[ends];
      if (is_of(without)) ++of_other[ends];
    }
    return of_door[0] >= 3 && of_other[0] + of_other[1] >= 3;
  };
  EXPECT_TRUE(poll(hear, kDeadline_s, 0.01));
  EXPECT_EQ(of_door[1], 0);
  // A Fast DDS that writes none needs none taken away.
  std::printf("without a door: %d messages with statistics, %d without\n", of_other[1],
              of_other[0]);
  EXPECT_TRUE(poll([&] { return with.found == 1 && without.found == 1; }, kDeadline_s, 0.01));
}

TEST(Door, LeasesEndAtTheDoor) {
  Watcher watcher(kLeases, qos_of("door"));
  Child child("door", kLeases);
  // A child that is held up for a lease is lost, and found again: counted is who is there.
  const auto becomes = [&](int there) {
    return poll([&] { return watcher.found - watcher.gone == there; }, kDeadline_s, 0.01);
  };
  ASSERT_TRUE(becomes(1));
  const auto stopped = std::chrono::steady_clock::now();
  child.signal(SIGSTOP);
  EXPECT_TRUE(becomes(0));
  const std::chrono::duration<double> stood = std::chrono::steady_clock::now() - stopped;
  EXPECT_GT(stood.count(), kLease_s / 2);
  // Whoever was forgotten may come again.
  child.signal(SIGCONT);
  EXPECT_TRUE(becomes(1));
  child.end(SIGKILL);
  EXPECT_TRUE(becomes(0));
}

TEST(Door, ParticipantsMeetInSharedMemory) {
  Watcher watcher(kSharedMemory, qos_of("shared-memory"));
  Child child("shared-memory", kSharedMemory);
  EXPECT_TRUE(poll([&] { return watcher.found == 1; }, kDeadline_s, 0.01));
}

}  // namespace
}  // namespace nearmesh::test

int main(int argc, char** argv) {
  using namespace nearmesh::test;
  if (argc == 4 && std::string(argv[1]) == "--child") {
    auto* made =
        eprosima::fastdds::dds::DomainParticipantFactory::get_instance()->create_participant(
            static_cast<std::uint32_t>(std::atoi(argv[3])), qos_of(argv[2]));
    if (made == nullptr) return 1;
    for (;;) std::this_thread::sleep_for(std::chrono::seconds(1));
  }
  nearmesh::wire::speak_through_transports();
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
