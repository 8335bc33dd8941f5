// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Deterministic models for the demo, the tests and the benchmarks. Coordinates are multiples of a
// power of two that a single-precision reader keeps exactly; no library sin or cos decides a bit
// (own polynomials). The same arguments give the same bits on every machine.

#include <cstdint>

#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh {

/// Fractal height field of size x size cells (2 * size^2 triangles) of 32 m, z up, heights within
/// +-2000 m in multiples of 2^-4 m, centred on the origin (an odd size lies half a cell towards +x
/// and +y). size in [2, 4096]. Height depends on place and seed only: a greater size continues a
/// smaller.
[[nodiscard]] IndexedMesh generate_terrain(std::uint32_t size, std::uint64_t seed);

/// Closes the sheet that generate_terrain(size, any seed) made by walls down to a flat floor, so
/// that what is below the ground is inside: 12 size - 2 more triangles, oriented outward. floor_m
/// is rounded down to a multiple of 2^-4 m.
/// Errors: kInvalidArgument where the floor is not below the lowest height, or below -100 km;
/// nothing was changed then.
[[nodiscard]] Status close_terrain(IndexedMesh& terrain, std::uint32_t size, double floor_m);

/// An aircraft of about `size` triangles (within a tenth), about 60 m long, x forward, z up,
/// centred on the origin lengthwise, in multiples of 2^-12 m. Eight closed surfaces, oriented
/// outward, that run into each other: fuselage, wings, tailplanes, fin, two engines. The seed
/// varies the proportions. size in [200, 200000].
[[nodiscard]] IndexedMesh generate_aircraft(std::uint32_t size, std::uint64_t seed);

/// UV sphere of radius 1 m with `size` slices and size/2 stacks, poles on z, in multiples of 2^-22
/// m, oriented outward. size in [4, 4096], even. size 64 gives 64 * 31 * 2 = 3,968 triangles. The
/// seed is not used; it is there so that the generators can be called alike.
[[nodiscard]] IndexedMesh generate_sphere(std::uint32_t size, std::uint64_t seed);

}  // namespace nearmesh
