// SPDX-License-Identifier: Apache-2.0
#pragma once
// FlightGear's generic protocol over UDP on this machine, with the files in Protocol/: lines of
// fields with tabs between them.

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "geodesy.hpp"

namespace flightgear {

/// A line of nearmesh-pose.xml, out.
struct AircraftState {
  bool flies = false;    ///< false while FlightGear starts: nothing else counts
  double elapsed_s = 0;  ///< of its own time, which stands while it is paused
  Place place;
  double roll_deg = 0, pitch_deg = 0, heading_deg = 0;
  Vector north_east_down_mps{};
};
/// None, and `why`, where a line is not such a one.
[[nodiscard]] std::optional<AircraftState> parse_state(std::string_view line, std::string& why);

struct ShownAnswer {
  std::string status, with;
  std::uint64_t face_pairs = 0;
  double clearance_m = 0, depth_m = 0;
};

/// Ports: states come to `first_port`; answers go to the next one, places to the one after, lines
/// for the pilot to the fourth.
class Link {
 public:
  /// Null where the port cannot be had; `why` says so.
  [[nodiscard]] static std::unique_ptr<Link> open(std::uint16_t first_port, std::string& why);
  ~Link();
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  /// The next line that has come, waiting for it so long at most.
  [[nodiscard]] std::optional<std::string> take(double seconds);
  // FlightGear need not be there.
  void show(const ShownAnswer& answer);
  void put(const Place& place);
  void say(const std::string& line);

 private:
  Link(int socket, std::uint16_t first_port) : socket_(socket), first_port_(first_port) {}
  void send(int after_first, const std::string& line);

  int socket_;
  std::uint16_t first_port_;
};

}  // namespace flightgear
