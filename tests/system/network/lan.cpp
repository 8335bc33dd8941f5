// SPDX-License-Identifier: Apache-2.0
#include "lan.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <deque>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace nearmesh::test {
namespace {

constexpr char kOwnNamespace[] = "/proc/thread-self/ns/net";

/// Runs a shell command; empty when it succeeds, else what it said.
std::string complaint_of(const std::string& command) {
  std::string said;
  std::FILE* pipe = ::popen(("{ " + command + "\n} 2>&1 </dev/null").c_str(), "r");
  if (pipe == nullptr) return "cannot run a shell";
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) said += static_cast<char>(c);
  if (::pclose(pipe) == 0) return {};
  return said.empty() ? "failed" : said;
}

void must(const std::string& command) {
  if (const std::string said = complaint_of(command); !said.empty())
    throw std::runtime_error(command + ": " + said);
}

int open_own() {
  const int own = ::open(kOwnNamespace, O_RDONLY | O_CLOEXEC);
  if (own < 0) throw std::runtime_error("cannot open " + std::string(kOwnNamespace));
  return own;
}

/// A new namespace with its loopback up; the calling thread stays where it is.
int make_namespace() {
  const int home = open_own();
  if (::unshare(CLONE_NEWNET) != 0) {
    ::close(home);
    throw std::runtime_error("a new network namespace is not permitted");
  }
  const int made = open_own();
  const std::string said = complaint_of(
      "ip link set lo up; echo 1 >/proc/sys/net/ipv6/conf/all/disable_ipv6; echo 1 "
      ">/proc/sys/net/ipv6/conf/default/disable_ipv6; true");
  ::setns(home, CLONE_NEWNET);
  ::close(home);
  return made;
}

std::string name_for_ip(int descriptor) {
  return "/proc/" + std::to_string(::getpid()) + "/fd/" + std::to_string(descriptor);
}

std::string shaping(const std::string& device, const Link& link) {
  if (link.mbit_per_s <= 0)
    return "tc qdisc del dev " + device + " root >/dev/null 2>/dev/null; true";
  const double bytes_per_s = link.mbit_per_s * 125e3;
  // As few tokens as the shaper can do with: they pass a pause's first datagrams at once.
  const auto burst = static_cast<unsigned long>(std::max(1600.0, bytes_per_s / 4000));
  const auto queue = static_cast<unsigned long>(
      link.queue_bytes > 0 ? link.queue_bytes : std::max(32e3, bytes_per_s / 10));
  return "tc qdisc replace dev " + device + " root tbf rate " +
         std::to_string(static_cast<unsigned long>(link.mbit_per_s * 1e6)) + "bit burst " +
         std::to_string(burst) + " limit " + std::to_string(queue);
}

/// All frames that come in through an interface of this namespace. The first bytes of each say what
/// is left to do of its checksum, and must go with it.
int open_frames(const std::string& interface) {
  const int made = ::socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, htons(ETH_P_ALL));
  const int on = 1, buffer_bytes = 1 << 22;
  sockaddr_ll address{};
  address.sll_family = AF_PACKET;
  address.sll_protocol = htons(ETH_P_ALL);
  address.sll_ifindex = static_cast<int>(::if_nametoindex(interface.c_str()));
  if (made < 0 || ::setsockopt(made, SOL_PACKET, PACKET_VNET_HDR, &on, sizeof on) != 0 ||
      ::setsockopt(made, SOL_PACKET, PACKET_IGNORE_OUTGOING, &on, sizeof on) != 0 ||
      ::setsockopt(made, SOL_SOCKET, SO_RCVBUFFORCE, &buffer_bytes, sizeof buffer_bytes) != 0 ||
      ::bind(made, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    throw std::runtime_error("frames of " + interface + " cannot be heard");
  return made;
}

}  // namespace

/// Two interfaces: what comes in through one goes out through the other, later.
class Lan::Relay {
 public:
  /// In the namespace of both.
  Relay(const std::string& a, const std::string& b, double delay_s)
      : sockets_{open_frames(a), open_frames(b)},
        delay_(std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(delay_s))),
        thread_([this] { run(); }) {}
  ~Relay() {
    ending_ = true;
    thread_.join();
    for (const int socket : sockets_) ::close(socket);
  }
  Relay(const Relay&) = delete;
  Relay& operator=(const Relay&) = delete;

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::size_t kMaxFrameBytes = 1 << 17;  // unsegmented ones too
  struct Frame {
    Clock::time_point due;
    std::size_t to;
    std::vector<char> bytes;
  };

  void run() {
    while (!ending_) {
      std::array<pollfd, 2> waiting{{{sockets_[0], POLLIN, 0}, {sockets_[1], POLLIN, 0}}};
      constexpr std::chrono::nanoseconds kIdle = std::chrono::milliseconds(50);
      const std::chrono::nanoseconds wait =
          frames_.empty()
              ? kIdle
              : std::clamp<std::chrono::nanoseconds>(frames_.front().due - Clock::now(), {}, kIdle);
      const timespec timeout{0, static_cast<long>(wait.count())};
      ::ppoll(waiting.data(), waiting.size(), &timeout, nullptr);
      take();
      for (; !frames_.empty() && frames_.front().due <= Clock::now(); frames_.pop_front())
        static_cast<void>(::send(sockets_[frames_.front().to], frames_.front().bytes.data(),
                                 frames_.front().bytes.size(), 0));
    }
  }
  void take() {
    for (std::size_t from = 0; from < 2; ++from)
      for (ssize_t size = 0;
           (size = ::recv(sockets_[from], buffer_.data(), buffer_.size(), 0)) > 0;)
        frames_.push_back(
            {Clock::now() + delay_, 1 - from, {buffer_.begin(), buffer_.begin() + size}});
  }

  const std::array<int, 2> sockets_;
  const Clock::duration delay_;
  std::vector<char> buffer_ = std::vector<char>(kMaxFrameBytes);
  std::deque<Frame> frames_;
  std::atomic<bool> ending_ = false;
  std::thread thread_;
};

Lan::Visit::Visit(int there) : home_(open_own()) {
  if (::setns(there, CLONE_NEWNET) != 0) throw std::runtime_error("cannot enter a namespace");
}
Lan::Visit::~Visit() {
  ::setns(home_, CLONE_NEWNET);
  ::close(home_);
}

std::string Lan::why_not_permitted() {
  if (::geteuid() != 0) return "network namespaces need root";
  for (const char* tool : {"ip", "tc", "nft"})
    if (!complaint_of("command -v " + std::string(tool) + " >/dev/null").empty())
      return std::string(tool) + " is not installed (Debian: iproute2, nftables)";
  try {
    const Lan trial({{.mbit_per_s = 1, .loss = 0.5}});
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return {};
}

Lan::Lan(const std::vector<Link>& hosts) : hub_(make_namespace()) {
  try {
    const Visit hub(hub_);
    must("ip link add br0 type bridge mcast_snooping 0 && ip link set br0 up");
    must("nft add table bridge loss");
    for (std::size_t i = 0; i < hosts.size(); ++i) {
      hosts_.push_back(make_namespace());
      const std::string port = "port" + std::to_string(i), far = "far" + std::to_string(i),
                        near = "near" + std::to_string(i);
      const bool is_delayed = hosts[i].delay_s > 0;
      must("ip link add " + (is_delayed ? far : port) + " type veth peer name e0 netns " +
           name_for_ip(hosts_[i]));
      if (is_delayed)
        must("ip link add " + port + " type veth peer name " + near + " && ip link set " + far +
             " up && ip link set " + near + " up");
      must("ip link set " + port + " master br0 up");
      if (is_delayed) relays_.push_back(std::make_unique<Relay>(near, far, hosts[i].delay_s));
      const Visit host(hosts_[i]);
      must("ip link set e0 up");
      give_address(i, i + 1);
    }
    for (std::size_t i = 0; i < hosts.size(); ++i) shape(i, hosts[i]);
  } catch (...) {
    for (const int host : hosts_) ::close(host);
    ::close(hub_);
    throw;
  }
}

Lan::~Lan() {
  relays_.clear();
  for (const int host : hosts_) ::close(host);
  ::close(hub_);
}

void Lan::shape(std::size_t host, const Link& link) {
  const std::string port = "port" + std::to_string(host);
  {
    const Visit there(hosts_.at(host));
    must(shaping("e0", link));
  }
  const Visit there(hub_);
  must(shaping(port, link));
  // One chain for each link, so that a change replaces what was there.
  std::ostringstream rules;
  rules << "nft 'add chain bridge loss " << port << " { type filter hook forward priority "
        << host + 1 << "; }; flush chain bridge loss " << port;
  if (link.loss > 0)
    for (const char* direction : {"iifname", "oifname"})
      rules << "; add rule bridge loss " << port << ' ' << direction << ' ' << port
            << " ether type ip numgen random mod 10000 < "
            << static_cast<unsigned>(link.loss * 10000) << " drop";
  rules << "'";
  must(rules.str());
}

void Lan::set_up(std::size_t host, bool up) const {
  const Visit there(hosts_.at(host));
  must(up ? "ip link set e0 up && ip route add 224.0.0.0/4 dev e0" : "ip link set e0 down");
}

void Lan::give_address(std::size_t host, std::size_t last) const {
  const Visit there(hosts_.at(host));
  must("ip address add 10.77.0." + std::to_string(last) +
       "/24 dev e0 && ip route add 224.0.0.0/4 dev e0");
}

void Lan::take_address(std::size_t host) const {
  const Visit there(hosts_.at(host));
  must("ip address flush dev e0");
}

void Lan::set_mtu(int bytes) const {
  const std::string mtu = " mtu " + std::to_string(bytes);
  for (std::size_t i = 0; i < hosts_.size(); ++i) {
    {
      const Visit hub(hub_);
      must("ip link set port" + std::to_string(i) + mtu);
    }
    const Visit there(hosts_[i]);
    must("ip link set e0" + mtu);
  }
}

void Lan::connect(std::size_t a, std::size_t b) const {
  {
    const Visit there(hosts_.at(a));
    must("ip link add e1 type veth peer name e1 netns " + name_for_ip(hosts_.at(b)));
  }
  for (const std::size_t host : {a, b}) {
    const Visit there(hosts_[host]);
    must("ip link set e1 up && ip address add 10.78.0." + std::to_string(host + 1) + "/24 dev e1");
  }
}

Lan::Counters Lan::counters(std::size_t host) const {
  const Visit there(hosts_.at(host));
  std::ifstream devices("/proc/thread-self/net/dev");
  for (std::string line; std::getline(devices, line);) {
    const std::size_t colon = line.find("e0:");
    if (colon == std::string::npos) continue;
    std::istringstream numbers(line.substr(colon + 3));
    Counters found;
    std::uint64_t skipped = 0;
    numbers >> found.received_bytes >> found.received_packets;
    for (int i = 0; i < 6; ++i) numbers >> skipped;
    numbers >> found.sent_bytes >> found.sent_packets;
    return found;
  }
  throw std::runtime_error("no interface e0 in a namespace");
}

}  // namespace nearmesh::test
