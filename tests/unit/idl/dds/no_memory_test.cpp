// SPDX-License-Identifier: Apache-2.0
// Want of memory in threads of ours: what was to be done is done once there is memory again, and it
// is said.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <new>
#include <thread>
#include <utility>

#include "idl/dds/door_watch.hpp"
#include "idl/dds/rejoin_watch.hpp"
#include "nearmesh/idl/dds/door.hpp"
#include "tests/support/rtps_message.hpp"

#if !defined(__SANITIZE_ADDRESS__)  // which has an allocator of its own

namespace {

/// Allocations of this thread that are left before one is refused; below 0: any number.
thread_local int allowed_here = -1;
thread_local bool is_tester = false;
std::atomic<bool> refused_to_others = false;
std::atomic<int> refusals_to_others = 0;

bool is_refused() {
  if (refused_to_others && !is_tester) {
    ++refusals_to_others;
    return true;
  }
  return allowed_here >= 0 && allowed_here-- == 0;
}

}  // namespace

// Not inlined, or compilers see memory of malloc() given to delete.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
  void* const made = is_refused() ? nullptr : std::malloc(std::max<std::size_t>(bytes, 1));
  if (made == nullptr) throw std::bad_alloc();
  return made;
}
[[gnu::noinline]] void operator delete(void* made) noexcept { std::free(made); }
[[gnu::noinline]] void operator delete(void* made, std::size_t) noexcept { std::free(made); }

namespace nearmesh::wire {
namespace {

/// Calls `step` in a world of its own each time, with its first allocation refused, then its
/// second, until it needs no more. `check` is called in those where one was refused. Out: how many.
template <class World, class Step, class Check>
int refuse_each(Step step, Check check) {
  for (int refused = 0;; ++refused) {
    World world;
    allowed_here = refused;
    bool was_refused = false;
    try {
      step(world);
    } catch (const std::bad_alloc&) {
      was_refused = true;
    }
    // Also where it was caught on the way.
    was_refused = std::exchange(allowed_here, -1) < 0 || was_refused;
    if (!was_refused) return refused;
    check(world);
  }
}

template <class Condition>
bool comes(Condition condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(100);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return true;
}

/// No thread but this one gets memory, for so long, and until one has asked for some. `look` is
/// called at the end of it.
template <class Look>
void starve_others(std::chrono::milliseconds time, Look look) {
  is_tester = true;
  refusals_to_others = 0;
  refused_to_others = true;
  std::this_thread::sleep_for(time);
  EXPECT_TRUE(comes([] { return refusals_to_others > 0; }));
  look();
  refused_to_others = false;
}

bool says_no_memory(Mailbox& mailbox) {
  const auto lines = mailbox.take_complaints();
  return std::any_of(lines.begin(), lines.end(),
                     [](const std::string& line) { return line.starts_with("no memory"); });
}

constexpr MessageSource kSender{true, 40'000};

nearmesh::test::RtpsBytes announcement_bytes(std::uint8_t number, std::int32_t lease_s) {
  return nearmesh::test::Rtps(nearmesh::test::key_of(number)).announcement(1, lease_s).bytes;
}

TEST(NoMemory, WhoLeftByItsLeaseIsNotForgottenUnheard) {
  struct Three {
    Three() {
      for (std::uint8_t number = 1; number <= 3; ++number) {
        RtpsVerdict word;
        word.source = nearmesh::test::key_of(number);
        word.announcement = RtpsAnnouncement{.sequence = 1, .leaves = false, .lease_s = 1};
        EXPECT_FALSE(book.hear(word, kSender));
      }
    }
    ParticipantBook book;
  };
  EXPECT_GT(refuse_each<Three>([](Three& three) { three.book.tick(1.5); },
                               [](Three& three) {
                                 EXPECT_EQ(three.book.size(), 3U);
                                 EXPECT_TRUE(three.book.take_gone().empty());
                                 three.book.tick(0);
                                 EXPECT_EQ(three.book.take_gone().size(), 3U);
                               }),
            0);
  const nearmesh::test::Rtps::Key barred = nearmesh::test::key_of(2);
  EXPECT_GT(refuse_each<Three>([&](Three& three) { three.book.bar(barred); },
                               [&](Three& three) {
                                 three.book.bar(barred);
                                 EXPECT_EQ(three.book.take_gone().size(), 1U);
                                 EXPECT_TRUE(three.book.is_barred(barred));
                               }),
            0);
}

TEST(NoMemory, WhoIsHeldBackComesInAllTheSame) {
  struct Crowd {
    Crowd() {
      for (std::uint32_t number = 0; number < 256; ++number) say(number);
    }
    bool say(std::uint32_t number) {
      RtpsVerdict word;
      word.source[4] = static_cast<std::uint8_t>(number >> 8);
      word.source[5] = static_cast<std::uint8_t>(number);
      word.announcement = RtpsAnnouncement{.sequence = 1, .leaves = false, .lease_s = 20};
      return !book.hear(word, kSender);
    }
    ParticipantBook book;
  };
  EXPECT_GT(refuse_each<Crowd>([](Crowd& crowd) { crowd.say(1000); },
                               [](Crowd& crowd) {
                                 crowd.say(1000);
                                 crowd.book.tick(0.25);
                                 EXPECT_TRUE(crowd.say(1000));
                               }),
            0);
}

TEST(NoMemory, AMessageThatTheDoorHasNoMemoryForMayComeAgain) {
  struct Watched {
    DoorWatch watch{{.is_plain = true, .identity_period_s = 5}, nullptr};
  };
  const nearmesh::test::RtpsBytes bytes = announcement_bytes(1, 20);
  EXPECT_GT(refuse_each<Watched>(
                [&](Watched& one) { static_cast<void>(one.watch.check(bytes, kSender)); },
                [&](Watched& one) { EXPECT_FALSE(one.watch.check(bytes, kSender).refusal); }),
            0);
}

TEST(NoMemory, TheDoorLosesAMessageAndGoesOn) {
  struct Inside final : rtps::TransportReceiverInterface {
    void OnDataReceived(const rtps::octet*, const std::uint32_t, const rtps::Locator_t&,
                        const rtps::Locator_t&) override {
      ++heard;
    }
    int heard = 0;
  };
  struct House {
    House() {
      fdds::DomainParticipantQos qos;
      qos.transport().use_builtin_transports = false;
      qos.transport().user_transports.push_back(std::make_shared<rtps::UDPv4TransportDescriptor>());
      add_door(qos);
      descriptor = qos.transport().user_transports.front();
      transport.reset(descriptor->create_transport());
      door = dynamic_cast<rtps::ChainingTransport*>(transport.get());
    }
    void receive(const nearmesh::test::RtpsBytes& bytes) {
      const rtps::Locator_t from(LOCATOR_KIND_UDPv4, 40'000);
      door->receive(&inside, bytes.data(), static_cast<std::uint32_t>(bytes.size()), from, from);
    }
    std::shared_ptr<rtps::TransportDescriptorInterface> descriptor;
    std::unique_ptr<rtps::TransportInterface> transport;
    rtps::ChainingTransport* door = nullptr;
    Inside inside;
  };
  const nearmesh::test::RtpsBytes bytes = announcement_bytes(1, 20);
  EXPECT_GT(
      refuse_each<House>(
          [&](House& house) { EXPECT_NO_THROW(house.receive(bytes)); },
          [&](House& house) {
            const int before = house.inside.heard;
            // A newer one: an announcement is handed on once in a while.
            house.receive(nearmesh::test::Rtps(nearmesh::test::key_of(1)).announcement(2).bytes);
            EXPECT_EQ(house.inside.heard, before + 1);
          }),
      0);
}

TEST(NoMemory, LeasesThatEndedMeanwhileAreToldAfterwards) {
  struct Ends final : LeaseEnd {
    void end(std::span<const std::uint8_t> farewell) override {
      const std::lock_guard lock(mutex);
      farewells.emplace_back(farewell.begin(), farewell.end());
      if (farewells.size() == 1) throw std::bad_alloc();  // Fast DDS has none either
    }
    std::size_t size() {
      const std::lock_guard lock(mutex);
      return farewells.size();
    }
    std::mutex mutex;
    std::vector<nearmesh::test::RtpsBytes> farewells;
  } ends;
  Mailbox mailbox;
  DoorWatch watch({.is_plain = true, .identity_period_s = 5}, nullptr);
  watch.set_mailbox(&mailbox);
  watch.add(&ends);
  ASSERT_FALSE(watch.check(announcement_bytes(1, 1), kSender).refusal);
  starve_others(std::chrono::milliseconds(2500), [&] { EXPECT_EQ(ends.size(), 0U); });
  ASSERT_TRUE(comes([&] { return ends.size() == 2; }));
  EXPECT_TRUE(says_no_memory(mailbox));
  std::this_thread::sleep_for(std::chrono::milliseconds(600));
  ASSERT_EQ(ends.size(), 2U);
  // Told again it is another message, or it would pass for the first.
  EXPECT_NE(ends.farewells[0], ends.farewells[1]);
  watch.remove(&ends);
}

TEST(NoMemory, JoiningAnewStaysDue) {
  Mailbox mailbox;
  TransportOptions options;
  options.lease_s = 20;
  options.interface = "127.0.0.1";
  RejoinWatch watch(mailbox, options);
  watch.try_again();
  starve_others(std::chrono::milliseconds(2500), [&] { EXPECT_FALSE(watch.take_due()); });
  EXPECT_TRUE(says_no_memory(mailbox));
  struct AnyBus {
    static bool has_found_others() { return true; }
  };
  std::unique_ptr<AnyBus> bus;
  int tries = 0;
  const auto rejoins = [&] {
    return watch.rejoin_if_due(bus, [&] {
      if (++tries == 1) throw std::bad_alloc();
      bus = std::make_unique<AnyBus>();
      return Status::ok();
    });
  };
  EXPECT_TRUE(comes(rejoins));
  EXPECT_EQ(tries, 2);
  EXPECT_NE(bus, nullptr);
}

TEST(NoMemory, AnAddressIsNewsUntilItIsJoinedWith) {
  const Interface wlan{"a wireless interface", "10.0.0.5", true, true, false, true};
  struct Alone {
    NetworkMemory memory{""};
  };
  EXPECT_GT(refuse_each<Alone>([&](Alone& alone) { alone.memory.joined({wlan}); },
                               [&](Alone& alone) {
                                 const std::vector<Interface> now{wlan};
                                 ASSERT_NE(alone.memory.news(now), nullptr);
                                 alone.memory.joined(now);
                                 EXPECT_EQ(alone.memory.news(now), nullptr);
                               }),
            0);
}

TEST(NoMemory, AComplaintIsKeptOrMayBeMadeAgain) {
  struct Letters {
    Mailbox mailbox;
  };
  const std::string line = "a line that is longer than what a string holds in itself";
  EXPECT_GT(refuse_each<Letters>([&](Letters& letters) { letters.mailbox.complain(line); },
                                 [&](Letters& letters) {
                                   letters.mailbox.complain(line);
                                   const auto said = letters.mailbox.take_complaints();
                                   EXPECT_NE(std::find(said.begin(), said.end(), line), said.end());
                                 }),
            0);
}

}  // namespace
}  // namespace nearmesh::wire

#endif
