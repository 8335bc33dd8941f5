// SPDX-License-Identifier: Apache-2.0
#include "lan.hpp"

#include <fcntl.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <stdexcept>

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

}  // namespace

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
      const std::string port = "port" + std::to_string(i);
      must("ip link add " + port + " type veth peer name e0 netns " + name_for_ip(hosts_[i]));
      must("ip link set " + port + " master br0 up");
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
