// SPDX-License-Identifier: Apache-2.0
#pragma once
// Exact integer vectors, and the corner of a triangle that stands alone on its side of a plane:
// what the overlap test and the construction of the intersection share.

#include <array>
#include <cstddef>
#include <cstdint>

namespace nearmesh {

__extension__ typedef __int128 Int128;
using Whole3 = std::array<std::int64_t, 3>;
using Double3 = std::array<double, 3>;
using Wide3 = std::array<Int128, 3>;
using Signs = std::array<int, 3>;

template <class To, class From>
std::array<To, 3> subtract(const std::array<From, 3>& p, const std::array<From, 3>& q) {
  return {static_cast<To>(p[0] - q[0]), static_cast<To>(p[1] - q[1]), static_cast<To>(p[2] - q[2])};
}

template <class T>
std::array<T, 3> cross(const std::array<T, 3>& u, const std::array<T, 3>& v) {
  return {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
}

template <class T>
T dot(const std::array<T, 3>& u, const std::array<T, 3>& v) {
  return u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
}

template <class T>
int sign(T x) {
  return (x > 0) - (x < 0);
}

inline bool all_zero(const Signs& s) { return (s[0] | s[1] | s[2]) == 0; }

inline bool is_zero(const Wide3& n) { return n[0] == 0 && n[1] == 0 && n[2] == 0; }

inline std::size_t nonzero_axis(const Wide3& n) { return n[0] != 0 ? 0U : n[1] != 0 ? 1U : 2U; }

/// The corner that stands alone on its side of a plane, the other two on the other closed side, and
/// whether its side is the negative one. Both edges from it cross the plane, never lie in it.
struct Lone {
  std::uint8_t corner;
  bool negative;
};

/// Of signs that are neither all zero nor all on one strict side.
constexpr Lone find_lone(const Signs& s) {
  const int positives = (s[0] > 0) + (s[1] > 0) + (s[2] > 0);
  const int negatives = (s[0] < 0) + (s[1] < 0) + (s[2] < 0);
  const auto first = [&s](auto is_it) {
    return static_cast<std::uint8_t>(is_it(s[0]) ? 0 : is_it(s[1]) ? 1 : 2);
  };
  //  + 0 0, + 0 -, + - -: the positive     + + 0, + + -: the other, as a negative
  //  - 0 0: the negative                   - - 0: the zero, as a positive
  if (positives == 1) return {first([](int x) { return x > 0; }), false};
  if (positives == 2) return {first([](int x) { return x <= 0; }), true};
  if (negatives == 1) return {first([](int x) { return x < 0; }), true};
  return {first([](int x) { return x == 0; }), false};
}

inline constexpr std::array<std::size_t, 4> kNext{1, 2, 0, 1};

}  // namespace nearmesh
