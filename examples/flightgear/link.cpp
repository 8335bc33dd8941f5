// SPDX-License-Identifier: Apache-2.0
#include "link.hpp"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <vector>

namespace flightgear {
namespace {

constexpr double kFoot_m = 0.3048;

sockaddr_in local(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

/// A field of nearmesh-pose.xml, and what it may be. That it is a number keeps "nan" out too.
struct Field {
  const char* name;
  double least, most;
};
constexpr std::array<Field, 11> kFields{{{"flies", 0, 1},
                                         {"elapsed-s", 0, 1e9},
                                         {"latitude-deg", -90, 90},
                                         {"longitude-deg", -180, 180},
                                         {"altitude-ft", -1e5, 1e7},
                                         {"roll-deg", -360, 360},
                                         {"pitch-deg", -90, 90},
                                         {"heading-deg", -360, 360},
                                         {"north-fps", -1e5, 1e5},
                                         {"east-fps", -1e5, 1e5},
                                         {"down-fps", -1e5, 1e5}}};

std::string text_of(const char* format, double a, double b, double c) {
  std::array<char, 128> text{};
  std::snprintf(text.data(), text.size(), format, a, b, c);
  return text.data();
}

}  // namespace

std::optional<AircraftState> parse_state(std::string_view line, std::string& why) {
  while (line.ends_with('\n') || line.ends_with('\r')) line.remove_suffix(1);
  std::array<double, kFields.size()> value{};
  for (std::size_t i = 0; i < kFields.size(); ++i) {
    const Field& field = kFields[i];
    const std::size_t tab = line.find('\t');
    const bool is_last = i + 1 == kFields.size();
    if ((tab == std::string_view::npos) != is_last) {
      why = "expected 11 fields with tabs between them, as nearmesh-pose.xml has them";
      return std::nullopt;
    }
    const std::string_view word = line.substr(0, tab);
    const auto read = std::from_chars(word.data(), word.data() + word.size(), value[i]);
    if (read.ec != std::errc() || read.ptr != word.data() + word.size() ||
        !(value[i] >= field.least && value[i] <= field.most)) {
      // While it starts, a heading is 9999.
      if (i > 0 && value[0] == 0) return AircraftState{};
      why = std::string(field.name) + " is \"" + std::string(word.substr(0, 32)) + "\"";
      return std::nullopt;
    }
    if (!is_last) line.remove_prefix(tab + 1);
  }
  return AircraftState{
      .flies = value[0] != 0,
      .elapsed_s = value[1],
      .place = {value[2], value[3], value[4] * kFoot_m},
      .roll_deg = value[5],
      .pitch_deg = value[6],
      .heading_deg = value[7],
      .north_east_down_mps = {value[8] * kFoot_m, value[9] * kFoot_m, value[10] * kFoot_m}};
}

std::unique_ptr<Link> Link::open(std::uint16_t first_port, std::string& why) {
  const int handle = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  std::unique_ptr<Link> link(new Link(handle, first_port));
  const sockaddr_in address = local(first_port);
  if (handle >= 0 &&
      ::bind(handle, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0)
    return link;
  why = "UDP port " + std::to_string(first_port) + ": " + std::strerror(errno);
  return nullptr;
}

Link::~Link() {
  if (socket_ >= 0) ::close(socket_);
}

std::optional<std::string> Link::take(double seconds) {
  pollfd waiting{.fd = socket_, .events = POLLIN, .revents = 0};
  if (::poll(&waiting, 1, static_cast<int>(seconds * 1000)) <= 0) return std::nullopt;
  std::string line(2048, '\0');
  const ssize_t size = ::recv(socket_, line.data(), line.size(), MSG_DONTWAIT);
  // What comes back from a port at which nobody listens, too.
  line.resize(size < 0 ? 0 : static_cast<std::size_t>(size));
  return size < 0 ? std::nullopt : std::optional(line);
}

void Link::show(const ShownAnswer& answer) {
  send(1, answer.status + '\t' + answer.with + '\t' + std::to_string(answer.face_pairs) +
              text_of("\t%.4f\t%.4f", answer.clearance_m, answer.depth_m, 0));
}

void Link::put(const Place& place) {
  send(2, text_of("%.10f\t%.10f\t%.5f", place.latitude_deg, place.longitude_deg,
                  place.height_m / kFoot_m));
}

void Link::say(const std::string& line) { send(3, line); }

void Link::send(int after_first, const std::string& line) {
  const sockaddr_in address = local(static_cast<std::uint16_t>(first_port_ + after_first));
  const std::string bytes = line + '\n';
  ::sendto(socket_, bytes.data(), bytes.size(), MSG_DONTWAIT,
           reinterpret_cast<const sockaddr*>(&address), sizeof address);
}

}  // namespace flightgear
