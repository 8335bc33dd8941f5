// SPDX-License-Identifier: Apache-2.0
#include "core/base/float_guard.hpp"
#include "nearmesh/core/base/detail/assert.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "turn.hpp"

namespace nearmesh {

IndexedMesh generate_sphere(std::uint32_t size, std::uint64_t /*seed*/) {
  const FloatGuard guard;
  NEARMESH_ASSERT(size >= 4 && size <= 4096 && size % 2 == 0);
  constexpr int kBits = 22;
  const std::uint32_t slices = size, stacks = size / 2, rings = stacks - 1;

  IndexedMesh mesh;
  mesh.positions_m.push_back({0, 0, 1});
  for (std::uint32_t ring = 1; ring <= rings; ++ring) {
    const SinCos polar = sin_cos_turn(ring, 2 * std::uint64_t{stacks});
    for (std::uint32_t slice = 0; slice < slices; ++slice) {
      const SinCos azimuth = sin_cos_turn(slice, slices);
      mesh.positions_m.push_back({round_to_bits(polar.sin * azimuth.cos, kBits),
                                  round_to_bits(polar.sin * azimuth.sin, kBits),
                                  round_to_bits(polar.cos, kBits)});
    }
  }
  mesh.positions_m.push_back({0, 0, -1});

  const auto vertex = [&](std::uint32_t ring, std::uint32_t slice) {
    return 1 + (ring - 1) * slices + slice % slices;
  };
  const auto south = static_cast<std::uint32_t>(mesh.positions_m.size() - 1);
  for (std::uint32_t s = 0; s < slices; ++s)
    mesh.faces.push_back({0, vertex(1, s), vertex(1, s + 1)});
  for (std::uint32_t ring = 1; ring < rings; ++ring) {
    for (std::uint32_t s = 0; s < slices; ++s) {
      const std::uint32_t a = vertex(ring, s), b = vertex(ring, s + 1);
      const std::uint32_t c = vertex(ring + 1, s), d = vertex(ring + 1, s + 1);
      mesh.faces.push_back({a, c, d});
      mesh.faces.push_back({a, d, b});
    }
  }
  for (std::uint32_t s = 0; s < slices; ++s)
    mesh.faces.push_back({vertex(rings, s), south, vertex(rings, s + 1)});
  return mesh;
}

}  // namespace nearmesh
