// SPDX-License-Identifier: Apache-2.0
#pragma once
// Deterministic models for the demo, the tests and the benchmarks. Coordinates are multiples of a power of two that a
// single-precision reader keeps exactly; no library sin or cos decides a bit (own polynomials).

#include <cstdint>

#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh {

/// Fractal height field of size x size cells (2 * size^2 triangles) of 32 m, z up, heights within +-2000 m,
/// centred on the origin. size in [2, 4096].
[[nodiscard]] IndexedMesh generate_terrain(std::uint32_t size, std::uint64_t seed);

/// An aircraft of about `size` triangles (fuselage, wings, tail, engines; closed surfaces), about 60 m long,
/// x forward, z up, centred on the origin. size in [200, 200000].
[[nodiscard]] IndexedMesh generate_aircraft(std::uint32_t size, std::uint64_t seed);

/// UV sphere of radius 1 m with `size` slices and size/2 stacks, poles on z. size in [4, 4096], even. size 64 gives
/// 64 * 31 * 2 = 3,968 triangles.
[[nodiscard]] IndexedMesh generate_sphere(std::uint32_t size, std::uint64_t seed);

}  // namespace nearmesh
