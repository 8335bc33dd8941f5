// SPDX-License-Identifier: Apache-2.0
#include "rejoin_watch.hpp"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <limits>
#include <new>

#include "core/base/float_guard.hpp"
#include "dds_transport.hpp"

namespace nearmesh::wire {
namespace {

constexpr double kAgain_s = 1;

/// By the one clock that also counts while the machine is suspended.
double now_s() {
  timespec time{};
  clock_gettime(CLOCK_BOOTTIME, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace

bool NetworkMemory::is_used(const Interface& interface) const {
  return interface.is_running &&
         (wanted_.empty() || wanted_ == interface.name || wanted_ == interface.address);
}

void NetworkMemory::joined(const std::vector<Interface>& now) {
  // All memory first: where there is none, what was news still is.
  decltype(joined_) joined;
  bool has_loopback_alone = true;
  for (const Interface& interface : now) {
    if (!is_used(interface)) continue;
    joined.emplace(interface.name, interface.address);
    names_.insert(interface.name);
    has_loopback_alone = has_loopback_alone && interface.is_loopback;
  }
  joined_.swap(joined);
  has_loopback_alone_ = has_loopback_alone;
}

const Interface* NetworkMemory::news(const std::vector<Interface>& now) const {
  for (const Interface& interface : now)
    if (is_used(interface) && !joined_.contains({interface.name, interface.address}) &&
        (has_loopback_alone_ || names_.contains(interface.name)))
      return &interface;
  return nullptr;
}

bool DeafWatch::is_due(bool alone, double now_s) {
  if (!alone) {
    since_s_.reset();
    return false;
  }
  if (!since_s_) since_s_ = now_s;
  if (now_s - *since_s_ < wait_s_) return false;
  since_s_.reset();
  wait_s_ = std::min(2 * wait_s_, kLongest_s);
  return true;
}

RejoinWatch::RejoinWatch(Mailbox& mailbox, const TransportOptions& options)
    : mailbox_(mailbox), options_(options), network_(options.interface) {
  // A peer that is no address is refused where the participant is made.
  if (options.transport == Transport::kTcp)
    if (Result<std::vector<sockaddr_in>> peers = tcp_peers(options); peers.is_ok())
      tcp_peers_ = std::move(peers).value();
  network_.joined(ipv4_interfaces());
  thread_ = std::thread([this, lease_s = options.lease_s] { watch(lease_s); });
}

RejoinWatch::~RejoinWatch() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  condition_.notify_all();
  thread_.join();
}

void RejoinWatch::watch(double lease_s) {
  const FloatGuard guard;
  const std::chrono::duration<double> period(std::min(lease_s / 8, 0.5));
  double again_s = std::numeric_limits<double>::infinity();
  bool was_stopped = false;
  std::unique_lock lock(mutex_);
  for (double last = now_s(); !ending_;) {
    condition_.wait_for(lock, period, [this] { return ending_; });
    const double now = now_s();
    if (again_.exchange(false)) again_s = now + kAgain_s;
    was_stopped = was_stopped || now - last > 0.75 * lease_s;
    last = now;
    try {
      if (!look(was_stopped, now >= again_s, now)) continue;
    } catch (const std::bad_alloc&) {
      mailbox_.complain_of_memory();
      continue;  // each cause is still there
    }
    again_s = std::numeric_limits<double>::infinity();
    was_stopped = false;
    due_ = true;
    mailbox_.wake();
  }
}

const std::string* RejoinWatch::deaf_peer(double now_s) {
  const bool alone = is_alone_;
  const auto taken = alone ? std::find_if(tcp_peers_.begin(), tcp_peers_.end(), is_connected_to)
                           : tcp_peers_.end();
  if (!deaf_.is_due(taken != tcp_peers_.end(), now_s)) return nullptr;
  return &options_.initial_peers[static_cast<std::size_t>(taken - tcp_peers_.begin())];
}

bool RejoinWatch::look(bool was_stopped, bool is_to_try_again, double now_s) {
  const std::vector<Interface> interfaces = ipv4_interfaces();
  const Interface* news = network_.news(interfaces);
  const std::string* deaf = deaf_peer(now_s);
  if (!was_stopped && news == nullptr && deaf == nullptr && !is_to_try_again) return false;
  if (was_stopped)
    mailbox_.complain("this process stood still for longer than others wait: joining again");
  else if (news != nullptr)
    mailbox_.complain(news->name + " has the address " + news->address + " now: joining again");
  else if (deaf != nullptr)
    mailbox_.complain(*deaf + " took the connection, and nobody answers through it: joining again");
  network_.joined(interfaces);
  return true;
}

}  // namespace nearmesh::wire
