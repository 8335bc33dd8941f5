// SPDX-License-Identifier: Apache-2.0
#pragma once
// A small network inside this process: hosts in network namespaces, joined by a bridge in one more,
// each over a link with a rate, a queue and losses of its own. The namespaces have no names: they
// are held by file descriptors and by the processes in them, so the kernel removes them, links and
// all, however this process ends. Needs root, iproute2 (ip, tc) and nft. A delay is made by a
// thread that forwards frames: netem is not in every kernel.

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace nearmesh::test {

/// Both directions alike.
struct Link {
  double mbit_per_s = 0;  ///< 0: as fast as the machine
  double loss = 0;        ///< share of packets lost, in [0, 1]
  /// What waits in front of the link; the rest is dropped. 0: 100 ms of the rate, at least 32 kB.
  std::uint32_t queue_bytes = 0;
  double delay_s = 0;  ///< on top of what the rate takes
};

class Lan {
 public:
  /// Why networks cannot be made here; empty when they can.
  [[nodiscard]] static std::string why_not_permitted();

  /// Host i has the address 10.77.0.(i + 1) on its interface e0. Throws std::runtime_error with the
  /// command that failed.
  explicit Lan(const std::vector<Link>& hosts);
  ~Lan();
  Lan(const Lan&) = delete;
  Lan& operator=(const Lan&) = delete;

  /// While it lives, what the calling thread starts (processes, threads, sockets) is on that host.
  class Visit {
   public:
    ~Visit();
    Visit(const Visit&) = delete;
    Visit& operator=(const Visit&) = delete;

   private:
    friend class Lan;
    explicit Visit(int there);
    int home_;
  };
  [[nodiscard]] Visit visit(std::size_t host) const { return Visit(hosts_.at(host)); }

  /// Takes a host's e0 down, or up again, as a pulled cable or an operator does: routes go with it,
  /// the address stays.
  void set_up(std::size_t host, bool up) const;
  /// Gives a host's e0 the address 10.77.0.`last`, or takes what it has, as on a machine that was
  /// suspended and has resumed.
  void give_address(std::size_t host, std::size_t last) const;
  void take_address(std::size_t host) const;
  /// Of the interfaces of all hosts: larger packets are sent in fragments.
  void set_mtu(int bytes) const;
  /// A second link, between two hosts alone: e1 on both, with the address 10.78.0.(i + 1).
  void connect(std::size_t a, std::size_t b) const;

  /// Of a host's e0 since it was made: everything that is on the wire, Ethernet headers included.
  struct Counters {
    std::uint64_t received_bytes = 0, received_packets = 0, sent_bytes = 0, sent_packets = 0;
  };
  [[nodiscard]] Counters counters(std::size_t host) const;

 private:
  class Relay;

  void shape(std::size_t host, const Link& link);

  std::vector<int> hosts_;  ///< file descriptors of namespaces
  int hub_ = -1;
  std::vector<std::unique_ptr<Relay>> relays_;  ///< of links with a delay
};

}  // namespace nearmesh::test
