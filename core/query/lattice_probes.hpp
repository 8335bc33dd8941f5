// SPDX-License-Identifier: Apache-2.0
#pragma once
// Probes on the lattice against one posed face: where a ray first meets it, whether a ball does.
// Decided exactly, compared exactly.

#include <compare>
#include <optional>

#include "core/geometry/exact.hpp"
#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh {

/// All points from + t (to - from), t in [0, 1]. Coordinates of rays and faces differ by less than
/// 2^36: models of 31 bits on a lattice of a quarter of their cell, and worlds, turned anyhow.
struct LatticeRay {
  LatticePoint from, to;
  bool operator==(const LatticeRay&) const = default;
};

/// t = over / under, under > 0.
struct ExactTime {
  Int128 over = 0, under = 1;
};
[[nodiscard]] std::strong_ordering operator<=>(const ExactTime& a, const ExactTime& b);

/// The true t lies within `error` of `t`.
struct RayHit {
  double t = 0, error = 0;
};

/// The first common point of the ray and the closed triangle, which may be a segment or a point, as
/// may the ray; nothing where they have none.
[[nodiscard]] std::optional<RayHit> first_hit(const LatticeRay& ray, const LatticeTriangle& face);
/// Precondition: first_hit() found one.
[[nodiscard]] ExactTime exact_hit(const LatticeRay& ray, const LatticeTriangle& face);

/// A closed ball. Coordinates of its centre and of faces differ by less than 2^42, and the radius
/// is at most kMaxBallRadius.
struct LatticeBall {
  LatticePoint center;
  std::int64_t radius = 0;
};
inline constexpr std::int64_t kMaxBallRadius = std::int64_t{1} << 40;
/// Whether the ball and the closed triangle have a common point. Exact.
[[nodiscard]] bool ball_meets(const LatticeBall& ball, const LatticeTriangle& face);

}  // namespace nearmesh
