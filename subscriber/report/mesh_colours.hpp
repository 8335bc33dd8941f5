// SPDX-License-Identifier: Apache-2.0
#pragma once
// The colours of refined meshes, in files and pictures. What is exact has one colour a body; what
// is not runs from yellow to red with the logarithm of its eps, from 1/8192 of the model's size to
// 1/8 and more.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace nearmesh::subscriber::report {

using Colour = std::array<std::uint8_t, 3>;  ///< sRGB

inline constexpr Colour kExactColour{49, 130, 189};        ///< blue: of the body that is looked at
inline constexpr Colour kOtherExactColour{150, 150, 150};  ///< grey: of the other one
inline constexpr Colour kContactColour{255, 0, 255};       ///< magenta: segments of contact
/// Yellow to red, as told apart with any colour vision.
inline constexpr std::array<Colour, 5> kEpsColours{
    {{255, 255, 178}, {254, 204, 92}, {253, 141, 60}, {240, 59, 32}, {189, 0, 38}}};
inline constexpr int kLeastEpsExponent = -13, kGreatestEpsExponent = -3;  ///< of eps / size
/// The same for readers.
inline constexpr const char* kColourScale =
    "blue: exact (grey: of the other body); yellow to red: eps of 1/8192 to 1/8 of the model's "
    "size; "
    "magenta: contact";

/// The colour of a vertex with eps_m > 0 of a model of this size.
inline Colour eps_colour(double eps_m, double size_m) {
  // Of the logarithm, straight lines between powers of two: the same bits everywhere.
  int exponent = 0;
  const double mantissa = std::frexp(size_m > 0 ? eps_m / size_m : 1, &exponent);
  const double octave = exponent - 1 + (2 * mantissa - 1);
  const double place =
      std::clamp((octave - kLeastEpsExponent) / double{kGreatestEpsExponent - kLeastEpsExponent},
                 0.0, 1.0) *
      (kEpsColours.size() - 1);
  const std::size_t step = std::min(static_cast<std::size_t>(place), kEpsColours.size() - 2);
  const double part = place - static_cast<double>(step);
  Colour colour;
  for (std::size_t k = 0; k < 3; ++k)
    colour[k] = static_cast<std::uint8_t>(
        kEpsColours[step][k] + part * (kEpsColours[step + 1][k] - kEpsColours[step][k]) + 0.5);
  return colour;
}

inline Colour vertex_colour(double eps_m, double size_m, bool other) {
  if (eps_m == 0) return other ? kOtherExactColour : kExactColour;
  return eps_colour(eps_m, size_m);
}

}  // namespace nearmesh::subscriber::report
