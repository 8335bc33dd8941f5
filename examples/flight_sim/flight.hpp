// SPDX-License-Identifier: Apache-2.0
#pragma once
// The simulator's physics: rigid aircraft on autopilot from way point to way point, low over the
// terrain. Fixed step, metres, seconds, z up. No DDS, no nearmesh but its terrain generator.

#include <Eigen/Geometry>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace flight_sim {

using Vector = Eigen::Vector3d;

inline constexpr double kStep_s = 0.01;  ///< 100 Hz

struct Aircraft {
  std::string name;
  /// x_world = pose x; axes: nose, left, up.
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  Vector velocity_mps = Vector::Zero(), rates_radps = Vector::Zero();  ///< world frame
  Vector way_point_m = Vector::Zero();
  std::mt19937_64 random{0};
};

/// What the autopilot knows of the ground: heights on a lattice, for choosing way points. It knows
/// nothing of contact.
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
/// Pushes out along a unit normal that points away from the obstacle: what drives inward is turned
/// back.
void push_out(Aircraft& aircraft, const Vector& normal);

}  // namespace flight_sim
