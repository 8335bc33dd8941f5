// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the doors of one participant share: who is known, what was refused, and the thread that lets leases end.

#include <array>
#include <atomic>
#include <condition_variable>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "discovery_pace.hpp"
#include "participant_book.hpp"

namespace nearmesh::wire {

/// Where the watch tells Fast DDS that a participant has left.
class LeaseEnd {
 public:
  virtual void end(std::span<const std::uint8_t> farewell) = 0;

 protected:
  ~LeaseEnd() = default;
};

/// Threads: all functions, any thread.
class DoorWatch {
 public:
  /// `is_plain`: discovery without a server, where each participant speaks for itself alone. Then leases end here, and its
  /// announcements, each `announcement_s`, are paced.
  DoorWatch(bool is_plain, double announcement_s, double lease_s);
  ~DoorWatch();
  DoorWatch(const DoorWatch&) = delete;
  DoorWatch& operator=(const DoorWatch&) = delete;

  [[nodiscard]] bool ends_leases() const { return is_plain_; }
  /// Checks a message, and counts it where it is refused.
  [[nodiscard]] RtpsVerdict check(std::span<const std::uint8_t> message, const MessageSource& from,
                                  Standing& standing);
  [[nodiscard]] bool paces_announcements() const { return is_plain_; }
  /// As DiscoveryPace::may_go, now.
  [[nodiscard]] bool may_go(const RtpsPlace& place, const DiscoveryWord& word);
  void count(DoorRefusal refusal);
  [[nodiscard]] std::array<std::uint64_t, kDoorRefusals> refused() const;
  /// As ParticipantBook::is_silent.
  [[nodiscard]] std::optional<bool> is_silent(const ParticipantKey& participant,
                                              double silence_s) const;

  void add(LeaseEnd* end);
  void remove(LeaseEnd* end);
  /// Told what was refused, one line a second at most; empty: nobody is.
  void set_complaint(std::function<void(std::string)> complain);

 private:
  void run();
  void say_what_was_refused();

  const bool is_plain_;
  mutable std::mutex mutex_;  ///< of the book and the thread
  ParticipantBook book_;
  std::mutex pace_mutex_;
  DiscoveryPace pace_;
  std::array<std::atomic<std::uint64_t>, kDoorRefusals> refused_{};
  std::mutex ends_mutex_;
  std::vector<LeaseEnd*> ends_;
  std::mutex complain_mutex_;
  std::function<void(std::string)> complain_;
  std::array<std::uint64_t, kDoorRefusals> said_{};
  std::condition_variable condition_;
  bool ending_ = false;
  std::thread thread_;
};

/// The watch of a participant's doors; nullptr where a transport of it has none.
[[nodiscard]] std::shared_ptr<DoorWatch> door_watch_of(
    const eprosima::fastdds::dds::DomainParticipant& participant);

}  // namespace nearmesh::wire
