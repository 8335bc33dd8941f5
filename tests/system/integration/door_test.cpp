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

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <memory>
#include <string>
#include <thread>

#include "idl/dds/fastdds.hpp"
#include "idl/dds/fastdds_api.hpp"
#include "nearmesh/idl/dds/door.hpp"
#include "poll.hpp"
#include "tests/support/rtps_message.hpp"

namespace nearmesh::test {
namespace {

namespace fdds = wire::fdds;
namespace rtps = wire::rtps;

constexpr double kDeadline_s = 20;
constexpr double kLease_s = 2;
/// Of a test each: the packet ends everybody on the bus who has no door. Their ports lie below those that systems give out.
// Of nobody else: who is found there is counted.
enum Domain : std::uint32_t { kDeadly = 64, kLeases = 65, kSharedMemory = 66, kTransports = 67 };

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
  [[nodiscard]] fdds::DomainParticipant& participant() { return *participant_; }

  std::atomic<int> found = 0, gone = 0;

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

TEST(Door, LeasesEndAtTheDoor) {
  Watcher watcher(kLeases, qos_of("door"));
  Child child("door", kLeases);
  ASSERT_TRUE(poll([&] { return watcher.found == 1; }, kDeadline_s, 0.01));
  child.signal(SIGSTOP);
  EXPECT_FALSE(poll([&] { return watcher.gone > 0; }, kLease_s / 2, 0.01));
  EXPECT_TRUE(poll([&] { return watcher.gone == 1; }, kDeadline_s, 0.01));
  // Whoever was forgotten may come again.
  child.signal(SIGCONT);
  EXPECT_TRUE(poll([&] { return watcher.found == 2; }, kDeadline_s, 0.01));
  child.end(SIGKILL);
  EXPECT_TRUE(poll([&] { return watcher.gone == 2; }, kDeadline_s, 0.01));
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
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
