// SPDX-License-Identifier: Apache-2.0
#pragma once
// Notices when a participant is of no use any more, and this process must join anew. For the rooms
// named dds alone.

#include <netinet/in.h>

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "fastdds_api.hpp"
#include "interfaces.hpp"
#include "mailbox.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"
#include "room.hpp"

namespace nearmesh::wire {

/// Fast DDS 2.9 uses the addresses that were there when a participant was made; one that is made
/// before the network of a machine that has resumed, or has just started, is never found. Threads:
/// one.
class NetworkMemory {
 public:
  /// `wanted`: name or address of the only interface that is used; empty: all.
  explicit NetworkMemory(std::string wanted) : wanted_(std::move(wanted)) {}
  /// A participant is about to be made, or was just made, with these. May throw std::bad_alloc:
  /// then it does not know of it.
  void joined(const std::vector<Interface>& now);
  /// An address that the participant does not know: of an interface that was used before, or of any
  /// where it has loopback alone. Others do not count, say a bridge for containers: joining anew
  /// costs a pause. nullptr: there is none.
  [[nodiscard]] const Interface* news(const std::vector<Interface>& now) const;

 private:
  [[nodiscard]] bool is_used(const Interface& interface) const;

  const std::string wanted_;
  std::set<std::pair<std::string, std::string>> joined_;  ///< names and addresses
  std::set<std::string> names_;                           ///< of all that were ever used
  bool has_loopback_alone_ = true;
};

/// Fast DDS 2.9 opens a connection of TCP and only then notes what it wants to reach by it. Where
/// the other side is faster, it throws that one's first answer away, and never speaks through this
/// connection (of peers that wait for a processor one in a hundred). A new participant makes a new
/// connection. Threads: one.
class DeafWatch {
 public:
  /// What is waited for the first time; then twice as long each time, up to kLongest_s, for whom
  /// nobody answers at all.
  static constexpr double kFirst_s = 6, kLongest_s = 60;

  /// `alone`: connected, and nobody was found since the participant was made. Out: true once after
  /// each wait.
  [[nodiscard]] bool is_due(bool alone, double now_s);

 private:
  std::optional<double> since_s_;
  double wait_s_ = kFirst_s;
};

/// Three things make joining anew necessary. The whole process was stopped (debugger, suspended
/// machine) for so long that others dropped it: with Fast DDS 2.9 it never missed the others, so it
/// believes that they still have what it told them, and its endpoints are not found again (seen in
/// 3 of 10 trials). An address came that the participant was made without (NetworkMemory). And a
/// connection of TCP is deaf (DeafWatch). What it was is left in the mailbox. Want of memory is
/// said there too, and delays: what is due stays due.
class RejoinWatch {
 public:
  /// Make it before the participant, so that no address comes unseen between the two.
  RejoinWatch(Mailbox& mailbox, const TransportOptions& options);
  ~RejoinWatch();
  RejoinWatch(const RejoinWatch&) = delete;
  RejoinWatch& operator=(const RejoinWatch&) = delete;
  /// True once after each cause; the mailbox is woken then.
  [[nodiscard]] bool take_due() { return due_.exchange(false); }
  /// Joining anew failed, say because the network of a resumed machine is not up yet: take_due() is
  /// true again in a second.
  void try_again() { again_ = true; }
  /// To be called at each turn. When it is due: gives up the bus and joins anew. `join` makes the
  /// bus and says whether that worked; where it did not, there is none, the mailbox has a line, and
  /// it will be due again. Out: true when all endpoints are new.
  template <class Bus, class Join>
  [[nodiscard]] bool rejoin_if_due(std::unique_ptr<Bus>& bus, Join join) {
    is_alone_ = bus != nullptr && !bus->has_found_others();
    if (!take_due()) return false;
    is_alone_ = false;
    bus.reset();
    try {
      list_addresses_again();
      Status status = check_room(options_);  // Fast DDS does not end well without
      if (status.is_ok()) status = join();
      if (status.is_ok()) return true;
      mailbox_.complain("could not join again: " + status.message());
    } catch (const std::bad_alloc&) {
      mailbox_.complain_of_memory();
    }
    bus.reset();
    try_again();
    return false;
  }

 private:
  void watch(double lease_s);
  /// Out: it is due. Where there is no memory for it, it may be called again.
  [[nodiscard]] bool look(bool was_stopped, bool is_to_try_again, double now_s);
  /// The initial peer that took a connection through which nobody answers; nullptr: there is none.
  [[nodiscard]] const std::string* deaf_peer(double now_s);

  Mailbox& mailbox_;
  const TransportOptions options_;
  std::vector<sockaddr_in> tcp_peers_;  ///< as in options_.initial_peers; empty: not by TCP
  NetworkMemory network_;               ///< of the thread, once that runs
  DeafWatch deaf_;                      ///< of the thread
  std::atomic<bool> is_alone_ = false;
  std::atomic<bool> due_ = false;
  std::atomic<bool> again_ = false;
  std::mutex mutex_;
  std::condition_variable condition_;
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace nearmesh::wire
