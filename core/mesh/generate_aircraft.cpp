// SPDX-License-Identifier: Apache-2.0
// A twin-engined transport from eight closed surfaces that run into each other, as modelling
// programs make them: bodies of revolution (fuselage, nacelles) and tapered aerofoils (wings,
// tailplanes, fin).
#include <algorithm>
#include <cmath>

#include "core/base/float_guard.hpp"
#include "core/base/random.hpp"
#include "nearmesh/core/base/detail/assert.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "turn.hpp"

namespace nearmesh {
namespace {

constexpr int kBits = 12;  // coordinates are multiples of 2^-12 m

using Vector = std::array<double, 3>;

std::uint32_t push(IndexedMesh& mesh, double x, double y, double z) {
  mesh.positions_m.push_back(
      {round_to_bits(x, kBits), round_to_bits(y, kBits), round_to_bits(z, kBits)});
  return static_cast<std::uint32_t>(mesh.positions_m.size() - 1);
}

/// Side of the finest lattice of `cells` cells whose one side is `ratio` times the other.
std::uint32_t lattice_side(std::uint32_t cells, double ratio, std::uint32_t least) {
  return std::max(least, static_cast<std::uint32_t>(std::sqrt(cells / ratio)));
}

// --- bodies of revolution ---

struct Body {
  Vector nose_m{};       ///< foremost point; the axis runs along -x
  double length_m = 1;   //
  double radius_m = 1;   //
  double nose = 0.15;    ///< share of the length taken by the elliptic nose
  double tail = 0.35;    ///< share of the length taken by the tapering tail
  double upsweep_m = 0;  ///< rise of the axis over the tail
};

double body_radius_m(const Body& body, double along) {
  if (along < body.nose) {
    const double w = 1 - along / body.nose;
    return body.radius_m * std::sqrt(1 - w * w);
  }
  if (along > 1 - body.tail) {
    const double w = (along - (1 - body.tail)) / body.tail;
    return body.radius_m * (1 - w * w);
  }
  return body.radius_m;
}

double body_rise_m(const Body& body, double along) {
  const double w = std::max(0.0, (along - (1 - body.tail)) / body.tail);
  return body.upsweep_m * w * w;
}

void add_body(IndexedMesh& mesh, const Body& body, std::uint32_t triangles) {
  const double ratio = std::max(1.0, body.length_m / (6.2831853 * body.radius_m));
  const std::uint32_t slices = lattice_side(triangles / 2, ratio, 4);
  const std::uint32_t rings = std::max(2U, (triangles / 2 + slices / 2) / slices);

  const std::uint32_t nose = push(mesh, body.nose_m[0], body.nose_m[1], body.nose_m[2]);
  for (std::uint32_t ring = 1; ring <= rings; ++ring) {
    const double along = static_cast<double>(ring) / (rings + 1);
    const double radius = body_radius_m(body, along), rise = body_rise_m(body, along);
    for (std::uint32_t slice = 0; slice < slices; ++slice) {
      const SinCos around = sin_cos_turn(slice, slices);
      push(mesh, body.nose_m[0] - body.length_m * along, body.nose_m[1] + radius * around.cos,
           body.nose_m[2] + rise + radius * around.sin);
    }
  }
  const std::uint32_t end =
      push(mesh, body.nose_m[0] - body.length_m, body.nose_m[1], body.nose_m[2] + body.upsweep_m);

  const auto vertex = [&](std::uint32_t ring, std::uint32_t slice) {
    return nose + 1 + (ring - 1) * slices + slice % slices;
  };
  for (std::uint32_t s = 0; s < slices; ++s)
    mesh.faces.push_back({nose, vertex(1, s), vertex(1, s + 1)});
  for (std::uint32_t ring = 1; ring < rings; ++ring) {
    for (std::uint32_t s = 0; s < slices; ++s) {
      const std::uint32_t a = vertex(ring, s), b = vertex(ring, s + 1);
      const std::uint32_t c = vertex(ring + 1, s), d = vertex(ring + 1, s + 1);
      mesh.faces.push_back({a, c, d});
      mesh.faces.push_back({a, d, b});
    }
  }
  for (std::uint32_t s = 0; s < slices; ++s)
    mesh.faces.push_back({vertex(rings, s), end, vertex(rings, s + 1)});
}

// --- aerofoils ---

struct Aerofoil {
  Vector root_m{}, tip_m{};  ///< leading edge at either end
  double root_chord_m = 1, tip_chord_m = 1;
  double thickness = 0.12;  ///< of the chord
  bool upright = false;     ///< thickness along y (fin) instead of z
};

void add_aerofoil(IndexedMesh& mesh, const Aerofoil& foil, std::uint32_t triangles) {
  const double span_m =
      std::fabs(foil.upright ? foil.tip_m[2] - foil.root_m[2] : foil.tip_m[1] - foil.root_m[1]);
  const double ratio = std::max(1.0, span_m / (foil.root_chord_m + foil.tip_chord_m));
  // Points on one side.
  const std::uint32_t half = std::max(2U, lattice_side(triangles / 2, ratio, 4) / 2);
  const std::uint32_t around = 2 * half, caps = 2 * (around - 2);
  const std::uint32_t body = triangles > caps ? triangles - caps : 0;
  const std::uint32_t stations = std::max(2U, (body + around) / (2 * around) + 1);

  const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
  for (std::uint32_t station = 0; station < stations; ++station) {
    const double out = static_cast<double>(station) / (stations - 1);
    Vector edge{};
    for (std::size_t k = 0; k < 3; ++k)
      edge[k] = foil.root_m[k] + out * (foil.tip_m[k] - foil.root_m[k]);
    const double chord = foil.root_chord_m + out * (foil.tip_chord_m - foil.root_chord_m);
    for (std::uint32_t i = 0; i < around; ++i) {
      // Once round the section: leading edge, upper side, trailing edge, lower side.
      const SinCos angle = sin_cos_turn(i, around);
      const double back = 0.5 * (1 - angle.cos);
      const double offset = 0.5 * foil.thickness * angle.sin * (1.3 - 1.1 * back) * chord;
      const double x = edge[0] - chord * back;
      if (foil.upright)
        push(mesh, x, edge[1] + offset, edge[2]);
      else
        push(mesh, x, edge[1], edge[2] + offset);
    }
  }

  const auto vertex = [&](std::uint32_t station, std::uint32_t i) {
    return first + station * around + i % around;
  };
  // Seen from the tip, the section runs one way for a left wing and the other for a right wing or a
  // fin.
  const bool turned = foil.upright || foil.tip_m[1] < foil.root_m[1];
  const auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (turned) std::swap(b, c);
    mesh.faces.push_back({a, b, c});
  };
  for (std::uint32_t station = 0; station + 1 < stations; ++station) {
    for (std::uint32_t i = 0; i < around; ++i) {
      const std::uint32_t a = vertex(station, i), b = vertex(station, i + 1);
      const std::uint32_t c = vertex(station + 1, i), d = vertex(station + 1, i + 1);
      add(a, c, d);
      add(a, d, b);
    }
  }
  for (const std::uint32_t station : {0U, stations - 1}) {
    const auto cap = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      if (station == 0)
        add(a, b, c);
      else
        add(a, c, b);
    };
    // A strip between upper and lower side: no long fans.
    for (std::uint32_t i = 0; i < half; ++i) {
      const std::uint32_t upper = vertex(station, i), next_upper = vertex(station, i + 1);
      const std::uint32_t lower = vertex(station, around - i),
                          next_lower = vertex(station, around - i - 1);
      if (i + 1 < half) cap(upper, next_upper, next_lower);
      if (i > 0) cap(upper, i + 1 < half ? next_lower : next_upper, lower);
    }
  }
}

}  // namespace

IndexedMesh generate_aircraft(std::uint32_t size, std::uint64_t seed) {
  const FloatGuard guard;
  NEARMESH_ASSERT(size >= 200 && size <= 200000);
  Random random(seed);
  const double radius = random.between(2.7, 3.1);
  const double half_span = random.between(27, 31);
  const double sweep = random.between(8, 12);
  const double dihedral = random.between(1.5, 3);
  const double fin_height = random.between(7.5, 9);
  const double engine_radius = random.between(1.2, 1.5);

  IndexedMesh mesh;
  const auto share = [size](std::uint32_t percent) { return size * percent / 100; };
  add_body(mesh,
           {.nose_m = {30, 0, 0}, .length_m = 60, .radius_m = radius, .upsweep_m = 0.6 * radius},
           share(40));
  for (const double side : {1.0, -1.0}) {
    add_aerofoil(mesh,
                 {.root_m = {8, 0.5 * radius * side, -0.4 * radius},
                  .tip_m = {8 - sweep, half_span * side, -0.4 * radius + dihedral},
                  .root_chord_m = 10,
                  .tip_chord_m = 2.5},
                 share(15));
    add_aerofoil(mesh,
                 {.root_m = {-21, 0.2 * radius * side, 0.35 * radius},
                  .tip_m = {-26, 10 * side, 0.35 * radius + 1},
                  .root_chord_m = 5.5,
                  .tip_chord_m = 2.2,
                  .thickness = 0.1},
                 share(6));
    add_body(mesh,
             {.nose_m = {9.5, 0.36 * half_span * side, -0.4 * radius - 1.3},
              .length_m = 6,
              .radius_m = engine_radius,
              .nose = 0.4,
              .tail = 0.5},
             share(6));
  }
  add_aerofoil(mesh,
               {.root_m = {-19, 0, 0.5 * radius},
                .tip_m = {-26, 0, 0.5 * radius + fin_height},
                .root_chord_m = 8,
                .tip_chord_m = 3,
                .thickness = 0.1,
                .upright = true},
               share(6));
  return mesh;
}

}  // namespace nearmesh
