// SPDX-License-Identifier: Apache-2.0
#pragma once
// The simulator's physics: rigid aircraft on autopilot from way point to way point, low over the terrain. Fixed step,
// metres, seconds, z up. No DDS, no nearmesh but its terrain generator.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/base/random.hpp"
#include "nearmesh/core/mesh/detail/indexed_mesh.hpp"

namespace flight_sim {

using Vector = std::array<double, 3>;

inline constexpr double kStep_s = 0.01;  ///< 100 Hz

struct Aircraft {
  std::string name;
  Vector position_m{}, velocity_mps{}, rates_radps{};  ///< world frame
  std::array<double, 9> rotation{1, 0, 0, 0, 1,
                                 0, 0, 0, 1};  ///< row-major; columns: nose, left, up
  Vector way_point_m{};
  nearmesh::Random random{0};
};

/// What the autopilot knows of the ground: heights on a lattice, for choosing way points. It knows nothing of contact.
class Ground {
 public:
  Ground();
  [[nodiscard]] double height_m(double x_m, double y_m) const;

 private:
  nearmesh::IndexedMesh mesh_;
};

/// Aircraft `callsign`1, `callsign`2, ... The same seed, callsign and count give the same flights.
[[nodiscard]] std::vector<Aircraft> make_fleet(const Ground& ground, const std::string& callsign,
                                               std::uint32_t count, std::uint64_t seed);
/// One step of thrust, lift, drag, weight and autopilot.
void fly(Aircraft& aircraft, const Ground& ground);
/// Pushes out along a unit normal that points away from the obstacle: what drives inward is turned back.
void push_out(Aircraft& aircraft, const Vector& normal);

}  // namespace flight_sim
