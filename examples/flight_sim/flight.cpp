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

Vector operator+(const Vector& a, const Vector& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
Vector operator*(double s, const Vector& a) { return {s * a[0], s * a[1], s * a[2]}; }
Vector operator-(const Vector& a, const Vector& b) { return a + -1.0 * b; }
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double length(const Vector& a) { return std::sqrt(dot(a, a)); }
Vector unit(const Vector& a) { return (1 / std::max(length(a), 1e-9)) * a; }

Vector axis_of(const Aircraft& aircraft, std::size_t column) {
  return {aircraft.rotation[column], aircraft.rotation[3 + column], aircraft.rotation[6 + column]};
}

void set_axes(Aircraft& aircraft, const Vector& nose, const Vector& up_hint) {
  const Vector x = unit(nose), y = unit(cross(up_hint, x)), z = cross(x, y);
  for (std::size_t k = 0; k < 3; ++k) {
    aircraft.rotation[3 * k] = x[k];
    aircraft.rotation[3 * k + 1] = y[k];
    aircraft.rotation[3 * k + 2] = z[k];
  }
}

Vector next_way_point(Aircraft& aircraft, const Ground& ground) {
  std::uniform_real_distribution<double> across_m(-kArea_m, kArea_m), above_m(-30, 120);
  const double x = across_m(aircraft.random);
  const double y = across_m(aircraft.random);
  return {x, y, ground.height_m(x, y) + above_m(aircraft.random)};
}

Vector acceleration(const Aircraft& aircraft) {
  const Vector nose = axis_of(aircraft, 0), left = axis_of(aircraft, 1), up = axis_of(aircraft, 2);
  const Vector& v = aircraft.velocity_mps;
  const double speed = length(v), pressure_n = 0.5 * kAir_kgpm3 * speed * speed * kWing_m2;
  const Vector along = unit(v);
  const double lift = std::clamp(0.25 + 5 * -dot(along, up), -1.2, 1.6);
  const double drag = 0.02 + 0.05 * lift * lift;
  const double thrust_n = std::clamp((kCruise_mps - speed) * 2e4 + drag * pressure_n, 0.0,
                                     0.5 * kMass_kg * kGravity_mps2);
  const Vector force = thrust_n * nose + (lift * pressure_n) * unit(cross(along, left)) -
                       (drag * pressure_n) * along - (0.8 * pressure_n * dot(along, left)) * left;
  return 1 / kMass_kg * force + Vector{0, 0, -kGravity_mps2};
}

/// Turns the nose to the way point, and the wings so that their lift pulls there.
Vector wanted_rates(const Aircraft& aircraft) {
  const Vector nose = axis_of(aircraft, 0), up = axis_of(aircraft, 2);
  const Vector to = unit(aircraft.way_point_m - aircraft.position_m);
  const Vector pull =
      0.25 * kCruise_mps * (to - dot(to, nose) * nose) + Vector{0, 0, kGravity_mps2};
  const double roll = dot(cross(up, unit(pull)), nose);
  return 0.5 * cross(nose, to) + 1.5 * roll * nose;
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
    aircraft.position_m = next_way_point(aircraft, ground);
    aircraft.position_m[2] += 200;
    aircraft.way_point_m = next_way_point(aircraft, ground);
    set_axes(aircraft, aircraft.way_point_m - aircraft.position_m, {0, 0, 1});
    aircraft.velocity_mps = kCruise_mps * axis_of(aircraft, 0);
  }
  return fleet;
}

void fly(Aircraft& aircraft, const Ground& ground) {
  if (length(aircraft.way_point_m - aircraft.position_m) < 150)
    aircraft.way_point_m = next_way_point(aircraft, ground);
  aircraft.velocity_mps = aircraft.velocity_mps + kStep_s * acceleration(aircraft);
  aircraft.position_m = aircraft.position_m + kStep_s * aircraft.velocity_mps;
  const Vector lag = wanted_rates(aircraft) - aircraft.rates_radps;
  aircraft.rates_radps = aircraft.rates_radps + (kStep_s / 0.3) * lag;
  const Vector nose = axis_of(aircraft, 0), up = axis_of(aircraft, 2);
  set_axes(aircraft, nose + kStep_s * cross(aircraft.rates_radps, nose),
           up + kStep_s * cross(aircraft.rates_radps, up));
}

void push_out(Aircraft& aircraft, const Vector& normal) {
  constexpr double kBounce = 0.3, kSkin_m = 0.05;
  const double inward_mps = std::max(0.0, -dot(aircraft.velocity_mps, normal));
  aircraft.position_m = aircraft.position_m + (kStep_s * inward_mps + kSkin_m) * normal;
  aircraft.velocity_mps = aircraft.velocity_mps + (1 + kBounce) * inward_mps * normal;
}

}  // namespace flight_sim
