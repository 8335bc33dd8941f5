// SPDX-License-Identifier: Apache-2.0
#pragma once
// Sine and cosine of a fraction of a turn, for the generators: the library's differ in the last bit
// between platforms, and generated models must be the same bits everywhere.

#include <cmath>
#include <cstdint>

namespace nearmesh {

struct SinCos {
  double sin = 0, cos = 1;
};

/// Sine and cosine of step/steps of a turn. In: step < steps <= 2^28. Out: error below 1e-15, exact
/// at multiples of a quarter turn, symmetric bit for bit under the reflections of the octants.
inline SinCos sin_cos_turn(std::uint64_t step, std::uint64_t steps) {
  const std::uint64_t octant = 8 * step / steps;
  const std::uint64_t rest = 8 * step % steps;
  const bool mirrored = (octant & 1) != 0;
  const double part = static_cast<double>(mirrored ? steps - rest : rest);
  const double a = 0.78539816339744830962 * part / static_cast<double>(steps);  // [0, pi/4]
  const double q = a * a;
  // Taylor polynomials; the first term left out is below 1e-17 at pi/4.
  double s = 1, c = 1;
  for (int k = 8; k >= 1; --k) {
    s = 1 - s * q / static_cast<double>((2 * k) * (2 * k + 1));
    c = 1 - c * q / static_cast<double>((2 * k - 1) * (2 * k));
  }
  s *= a;
  const bool swapped = ((octant + 1) & 2) != 0;  // octants 1, 2, 5, 6
  const double sine = swapped ? c : s;
  const double cosine = swapped ? s : c;
  return {octant >= 4 ? -sine : sine, octant >= 2 && octant < 6 ? -cosine : cosine};
}

/// The nearest multiple of 2^-bits (halves go up).
inline double round_to_bits(double x, int bits) {
  return std::ldexp(std::floor(std::ldexp(x, bits) + 0.5), -bits);
}

}  // namespace nearmesh
