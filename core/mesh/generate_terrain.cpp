// SPDX-License-Identifier: Apache-2.0
// Mountains from gradient noise: a broad noise decides where mountains stand, ridged octaves shape
// them. Source: F. K. Musgrave, "Procedural Fractal Terrains", in Ebert et al., Texturing and
// Modeling, 2003, ch. 16 (ridged multifractal). Ours: each octave is turned against the last, so
// that the lattice does not show, and valleys keep a quarter of the detail.
#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/float_guard.hpp"
#include "core/base/random.hpp"
#include "nearmesh/core/base/detail/assert.hpp"
#include "nearmesh/core/mesh/generate.hpp"

namespace nearmesh {
namespace {

constexpr double kCell_m = 32;
constexpr int kRidgeOctaves = 7;  // wavelengths of 256 cells (8 km) down to 4 cells (128 m)
constexpr double kRegionWavelength = 512;  // cells: ranges and plains
constexpr double kRidgeWavelength = 256;   // cells

/// Slope (dx, dy) at a lattice point, taken at an offset from it; each slope in [-1, 1).
double slope_at(std::uint64_t seed, std::int64_t ix, std::int64_t iy, double dx, double dy) {
  const std::uint64_t place = static_cast<std::uint32_t>(ix) |
                              (static_cast<std::uint64_t>(static_cast<std::uint32_t>(iy)) << 32);
  const std::uint64_t hash = Random(seed ^ (place * 0xd1342543de82ef95ULL)).next();
  const double slope_x = static_cast<double>(hash >> 32) * 0x1p-31 - 1;
  const double slope_y = static_cast<double>(hash & 0xffffffffU) * 0x1p-31 - 1;
  return slope_x * dx + slope_y * dy;
}

/// Smooth to the second derivative, so that the lattice leaves no creases in the shading.
double fade(double t) { return t * t * t * (t * (t * 6 - 15) + 10); }

/// Gradient noise in [-1, 1], mostly within a third of it.
double gradient_noise(std::uint64_t seed, double x, double y) {
  const double floor_x = std::floor(x), floor_y = std::floor(y);
  const auto ix = static_cast<std::int64_t>(floor_x), iy = static_cast<std::int64_t>(floor_y);
  const double dx = x - floor_x, dy = y - floor_y, u = fade(dx), v = fade(dy);
  const double v00 = slope_at(seed, ix, iy, dx, dy);
  const double v10 = slope_at(seed, ix + 1, iy, dx - 1, dy);
  const double v01 = slope_at(seed, ix, iy + 1, dx, dy - 1);
  const double v11 = slope_at(seed, ix + 1, iy + 1, dx - 1, dy - 1);
  const double low = v00 + u * (v10 - v00), high = v01 + u * (v11 - v01);
  return low + v * (high - low);
}

struct Octave {
  explicit Octave(Random& random)
      : seed(random.next()), shift_x(random.between(0, 64)), shift_y(random.between(0, 64)) {}
  [[nodiscard]] double noise(double x, double y) const {
    return gradient_noise(seed, x + shift_x, y + shift_y);
  }

  std::uint64_t seed;
  double shift_x, shift_y;  // else all octaves would be flat at the origin, where the turns meet
};

struct Landscape {
  explicit Landscape(Random& random) : region(random), ridges(kRidgeOctaves, Octave(random)) {
    for (Octave& octave : ridges) octave = Octave(random);
  }
  Octave region;
  std::vector<Octave> ridges;
};

/// Height in metres at a place given in cells; within +-1900.
double height_m(const Landscape& land, double x, double y) {
  constexpr double kContrast = 2;  // brings the noise to about [-1, 1]
  const double region = std::clamp(
      kContrast * land.region.noise(x * (1 / kRegionWavelength), y * (1 / kRegionWavelength)), -1.0,
      1.0);
  const double mountainous = fade((region + 1) * 0.5);

  double sum = 0, amplitude = 0.5, weight = 1;
  double px = x * (1 / kRidgeWavelength), py = y * (1 / kRidgeWavelength);
  for (const Octave& octave : land.ridges) {
    const double ridge = 1 - std::min(1.0, kContrast * std::fabs(octave.noise(px, py)));
    const double signal = ridge * ridge;
    sum += signal * amplitude * weight;
    // Detail grows on ridges, and valleys stay smoother.
    weight = 0.25 + 0.75 * std::min(1.0, signal * weight * 1.5);
    amplitude *= 0.5;
    const double turned_x = 0.8 * px - 0.6 * py, turned_y = 0.6 * px + 0.8 * py;
    px = 2 * turned_x;
    py = 2 * turned_y;
  }
  return 400 * region + (500 + 1500 * mountainous) * (sum - 0.25);  // sum is in [0, 1)
}

}  // namespace

IndexedMesh generate_terrain(std::uint32_t size, std::uint64_t seed) {
  const FloatGuard guard;
  NEARMESH_ASSERT(size >= 2 && size <= 4096);
  Random random(seed);
  const Landscape land(random);

  const std::uint32_t side = size + 1;
  const double half = static_cast<double>(size / 2);
  IndexedMesh mesh;
  mesh.positions_m.reserve(std::size_t{side} * side);
  for (std::uint32_t row = 0; row < side; ++row) {
    for (std::uint32_t column = 0; column < side; ++column) {
      const double x = column - half, y = row - half;
      const double z = std::floor(height_m(land, x, y) * 16 + 0.5) * 0.0625;
      mesh.positions_m.push_back({x * kCell_m, y * kCell_m, z});
    }
  }
  mesh.faces.reserve(std::size_t{size} * size * 2);
  for (std::uint32_t row = 0; row < size; ++row) {
    for (std::uint32_t column = 0; column < size; ++column) {
      const std::uint32_t a = row * side + column, b = a + 1, c = a + side, d = c + 1;
      mesh.faces.push_back({a, b, d});
      mesh.faces.push_back({a, d, c});
    }
  }
  return mesh;
}

Status close_terrain(IndexedMesh& terrain, std::uint32_t size, double floor_m) {
  const FloatGuard guard;
  const std::uint32_t side = size + 1;
  NEARMESH_ASSERT(terrain.positions_m.size() == std::size_t{side} * side);
  double lowest = terrain.positions_m.front()[2];
  for (const auto& p : terrain.positions_m) lowest = std::min(lowest, p[2]);
  const double floor = std::floor(floor_m * 16) * 0.0625;
  if (!(floor < lowest && floor >= -100'000))
    return {StatusCode::kInvalidArgument,
            "floor of the terrain: expected from -100000 m to below its lowest height of " +
                std::to_string(lowest) + " m, found " + std::to_string(floor_m)};

  // Once round the edge, counter-clockwise from above; below each vertex of it stands one of the
  // floor.
  std::vector<std::uint32_t> rim;
  for (std::uint32_t i = 0; i < size; ++i) rim.push_back(i);
  for (std::uint32_t i = 0; i < size; ++i) rim.push_back(i * side + size);
  for (std::uint32_t i = size; i > 0; --i) rim.push_back(size * side + i);
  for (std::uint32_t i = size; i > 0; --i) rim.push_back(i * side);
  const auto first = static_cast<std::uint32_t>(terrain.positions_m.size());
  const auto count = static_cast<std::uint32_t>(rim.size());
  for (const std::uint32_t v : rim) {
    const auto p = terrain.positions_m[v];
    terrain.positions_m.push_back({p[0], p[1], floor});
  }
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint32_t next = (i + 1) % count;
    terrain.faces.push_back({rim[i], first + i, first + next});
    terrain.faces.push_back({rim[i], first + next, rim[next]});
  }
  // The floor in strips of one cell from edge to edge: no triangle's box is wider than a cell, as
  // it would be in a fan.
  const auto south = [&](std::uint32_t i) { return first + i; };
  const auto east = [&](std::uint32_t i) { return first + size + i; };
  const auto north = [&](std::uint32_t i) { return first + 3 * size - i; };
  const auto west = [&](std::uint32_t i) { return first + (4 * size - i) % count; };
  const auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    terrain.faces.push_back({a, b, c});
  };
  for (std::uint32_t i = 0; i < size; ++i) add(south(1), west(i), west(i + 1));
  add(south(1), north(0), north(1));
  for (std::uint32_t i = 1; i + 1 < size; ++i) {
    add(south(i), north(i), north(i + 1));
    add(south(i), north(i + 1), south(i + 1));
  }
  for (std::uint32_t i = 0; i < size; ++i) add(south(size - 1), east(i + 1), east(i));
  add(south(size - 1), north(size - 1), north(size));
  return Status::ok();
}

}  // namespace nearmesh
