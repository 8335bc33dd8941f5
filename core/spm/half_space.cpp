// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/half_space.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace nearmesh {
namespace {

constexpr int kSide = 64, kRadius = kSide - 1;
constexpr std::uint32_t kDirections = 1U << kDirectionBits;
static_assert(kSide * kSide == kDirections);

using Normal = std::array<std::int8_t, 3>;

/// The greatest number whose square is no more than x.
int floor_root(int x) {
  int root = 0;
  for (int bit = 1 << 14; bit > 0; bit /= 2)
    if ((root + bit) * (root + bit) <= x) root += bit;
  return root;
}

/// A point of the octahedron |x| + |y| + |z| = kRadius; below the equator its sides are folded
/// outwards.
std::array<int, 3> point_of(int column, int row) {
  const int u = 2 * column - kRadius, v = 2 * row - kRadius;
  const int w = kRadius - std::abs(u) - std::abs(v);
  if (w >= 0) return {u, v, w};
  return {u < 0 ? std::abs(v) - kRadius : kRadius - std::abs(v),
          v < 0 ? std::abs(u) - kRadius : kRadius - std::abs(u), w};
}

/// The point at a distance of 127, rounded, by integers alone: round(127 x / |p|) = (floor(254 x /
/// |p|) + 1) / 2.
Normal normal_of(const std::array<int, 3>& p) {
  const int square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
  Normal normal{};
  for (std::size_t k = 0; k < 3; ++k) {
    const int length = (floor_root(254 * 254 * p[k] * p[k] / square) + 1) / 2;
    normal[k] = static_cast<std::int8_t>(p[k] < 0 ? -length : length);
  }
  return normal;
}

const std::array<Normal, kDirections> kNormals = [] {
  std::array<Normal, kDirections> normals{};
  for (std::uint32_t code = 0; code < kDirections; ++code)
    normals[code] =
        normal_of(point_of(static_cast<int>(code) / kSide, static_cast<int>(code) % kSide));
  return normals;
}();

constexpr std::size_t kReaches = std::size_t{1} << kReachBits;
const std::array<std::int64_t, kReaches> kReachOf = [] {
  constexpr std::int64_t kEighths[8] = {65536, 71468,  77936,  84990,
                                        92682, 101070, 110218, 120194};  // 2^(16 + i / 8)
  std::array<std::int64_t, kReaches> reaches{};
  for (std::size_t code = 1; code < kReaches; ++code)
    reaches[code] = (kEighths[(code - 1) % 8] << (code - 1) / 8) >> 10;
  return reaches;
}();

}  // namespace

const std::array<std::int8_t, 3>& half_space_normal(std::uint16_t direction) {
  return kNormals[direction];
}

std::int64_t half_space_reach(std::uint8_t code) { return kReachOf[code]; }

std::optional<std::uint8_t> half_space_reach_code(std::int64_t reach) {
  const auto at = std::lower_bound(kReachOf.begin(), kReachOf.end(), reach);
  if (at == kReachOf.end()) return std::nullopt;
  return static_cast<std::uint8_t>(at - kReachOf.begin());
}

std::uint16_t nearest_direction(const std::array<double, 3>& v) {
  const double sum = std::abs(v[0]) + std::abs(v[1]) + std::abs(v[2]);
  double x = v[0] / sum, y = v[1] / sum;
  if (v[2] < 0) {
    const double folded = std::copysign(1 - std::abs(y), v[0]);
    y = std::copysign(1 - std::abs(x), v[1]);
    x = folded;
  }
  // The map bends, so the nearest is one of the nine around.
  const auto place = [](double at) {
    return static_cast<int>(std::floor((at + 1) * 0.5 * kRadius + 0.5));
  };
  const int column = place(x), row = place(y);
  double best = -2;
  std::uint16_t found = 0;
  for (int i = std::max(0, column - 1); i <= std::min(kRadius, column + 1); ++i)
    for (int j = std::max(0, row - 1); j <= std::min(kRadius, row + 1); ++j) {
      const auto code = static_cast<std::uint16_t>(i * kSide + j);
      const Normal& n = kNormals[code];
      const double square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
      const double cosine = (n[0] * v[0] + n[1] * v[1] + n[2] * v[2]) / std::sqrt(square);
      if (best == -2 || cosine > best) {
        best = cosine;
        found = code;
      }
    }
  return found;
}

bool add_half_space(const HalfSpace& half_space, std::vector<HalfSpace>& to) {
  const auto at = std::lower_bound(
      to.begin(), to.end(), half_space.direction,
      [](const HalfSpace& x, std::uint16_t direction) { return x.direction < direction; });
  if (at != to.end() && at->direction == half_space.direction) {
    if (at->reach <= half_space.reach) return false;
    at->reach = half_space.reach;
    return true;
  }
  if (at == to.end() && to.size() == kMaxHalfSpaces) return false;
  to.insert(at, half_space);
  if (to.size() > kMaxHalfSpaces) to.pop_back();
  return true;
}

}  // namespace nearmesh
