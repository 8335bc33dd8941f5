// SPDX-License-Identifier: Apache-2.0
#include "flight.hpp"

#include <algorithm>
#include <cmath>

#include "nearmesh/core/mesh/generate.hpp"

namespace flight_sim {
namespace {

constexpr std::uint32_t kGroundCells = 128;  // the same heights as any larger terrain of that seed
constexpr std::uint64_t kGroundSeed = 1;
constexpr double kArea_m = 1500;  // way points lie within so much of the middle
constexpr double kMass_kg = 60'000, kWing_m2 = 240, kAir_kgpm3 = 1.2, kGravity_mps2 = 9.81;
constexpr double kCruise_mps = 140;

Vector unit(const Vector& a) { return a / std::max(a.norm(), 1e-9); }

void set_axes(Aircraft& aircraft, const Vector& nose, const Vector& up_hint) {
  const Vector x = unit(nose), y = unit(up_hint.cross(x));
  aircraft.pose.linear() << x, y, x.cross(y);
}

Vector next_way_point(Aircraft& aircraft, const Ground& ground) {
  std::uniform_real_distribution<double> across_m(-kArea_m, kArea_m), above_m(-30, 120);
  const double x = across_m(aircraft.random);
  const double y = across_m(aircraft.random);
  return {x, y, ground.height_m(x, y) + above_m(aircraft.random)};
}

Vector acceleration(const Aircraft& aircraft) {
  const Vector nose = aircraft.pose.linear().col(0), left = aircraft.pose.linear().col(1),
               up = aircraft.pose.linear().col(2);
  const Vector& v = aircraft.velocity_mps;
  const double speed = v.norm(), pressure_n = 0.5 * kAir_kgpm3 * speed * speed * kWing_m2;
  const Vector along = unit(v);
  const double lift = std::clamp(0.25 + 5 * -along.dot(up), -1.2, 1.6);
  const double drag = 0.02 + 0.05 * lift * lift;
  const double thrust_n = std::clamp((kCruise_mps - speed) * 2e4 + drag * pressure_n, 0.0,
                                     0.5 * kMass_kg * kGravity_mps2);
  const Vector force = thrust_n * nose + lift * pressure_n * unit(along.cross(left)) -
                       drag * pressure_n * along - 0.8 * pressure_n * along.dot(left) * left;
  return force / kMass_kg - kGravity_mps2 * Vector::UnitZ();
}

/// Turns the nose to the way point, and the wings so that their lift pulls there.
Vector wanted_rates(const Aircraft& aircraft) {
  const Vector nose = aircraft.pose.linear().col(0), up = aircraft.pose.linear().col(2);
  const Vector to = unit(aircraft.way_point_m - aircraft.pose.translation());
  const Vector pull =
      0.25 * kCruise_mps * (to - to.dot(nose) * nose) + kGravity_mps2 * Vector::UnitZ();
  const double roll = up.cross(unit(pull)).dot(nose);
  return 0.5 * nose.cross(to) + 1.5 * roll * nose;
}

}  // namespace

Ground::Ground() : mesh_(nearmesh::generate_terrain(kGroundCells, kGroundSeed)) {}

double Ground::height_m(double x_m, double y_m) const {
  const double origin = mesh_.positions_m[0][0], cell = mesh_.positions_m[1][0] - origin;
  const auto index = [&](double at_m) {
    return static_cast<std::size_t>(
        std::clamp((at_m - origin) / cell, 0.0, static_cast<double>(kGroundCells)));
  };
  return mesh_.positions_m[index(y_m) * (kGroundCells + 1) + index(x_m)][2];
}

std::vector<Aircraft> make_fleet(const Ground& ground, const std::string& callsign,
                                 std::uint32_t count, std::uint64_t seed) {
  for (const char letter : callsign) seed = seed * 257 + static_cast<unsigned char>(letter);
  std::vector<Aircraft> fleet(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    Aircraft& aircraft = fleet[i];
    aircraft.name = callsign + std::to_string(i + 1);
    aircraft.random = std::mt19937_64(seed + i);
    aircraft.pose.translation() = next_way_point(aircraft, ground) + 200 * Vector::UnitZ();
    aircraft.way_point_m = next_way_point(aircraft, ground);
    set_axes(aircraft, aircraft.way_point_m - aircraft.pose.translation(), Vector::UnitZ());
    aircraft.velocity_mps = kCruise_mps * aircraft.pose.linear().col(0);
  }
  return fleet;
}

void fly(Aircraft& aircraft, const Ground& ground) {
  if ((aircraft.way_point_m - aircraft.pose.translation()).norm() < 150)
    aircraft.way_point_m = next_way_point(aircraft, ground);
  aircraft.velocity_mps += kStep_s * acceleration(aircraft);
  aircraft.pose.translation() += kStep_s * aircraft.velocity_mps;
  aircraft.rates_radps += kStep_s / 0.3 * (wanted_rates(aircraft) - aircraft.rates_radps);
  const Vector nose = aircraft.pose.linear().col(0), up = aircraft.pose.linear().col(2);
  set_axes(aircraft, nose + kStep_s * aircraft.rates_radps.cross(nose),
           up + kStep_s * aircraft.rates_radps.cross(up));
}

void push_out(Aircraft& aircraft, const Vector& normal) {
  constexpr double kBounce = 0.3, kSkin_m = 0.05;
  const double inward_mps = std::max(0.0, -aircraft.velocity_mps.dot(normal));
  aircraft.pose.translation() += (kStep_s * inward_mps + kSkin_m) * normal;
  aircraft.velocity_mps += (1 + kBounce) * inward_mps * normal;
}

}  // namespace flight_sim
