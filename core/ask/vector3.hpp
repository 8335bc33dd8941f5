// SPDX-License-Identifier: Apache-2.0
#pragma once
// Three numbers and the matrices that turn them, in doubles, for where bodies will be: each
// operation as it is written.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace nearmesh {

struct Vector3d {
  std::array<double, 3> v{};

  double& operator[](int k) { return v[static_cast<std::size_t>(k)]; }
  double operator[](int k) const { return v[static_cast<std::size_t>(k)]; }
};

/// Number by number.
template <class Of>
Vector3d each(const Vector3d& a, const Vector3d& b, const Of& of) {
  return {{of(a.v[0], b.v[0]), of(a.v[1], b.v[1]), of(a.v[2], b.v[2])}};
}
inline Vector3d operator+(const Vector3d& a, const Vector3d& b) {
  return each(a, b, [](double x, double y) { return x + y; });
}
inline Vector3d operator-(const Vector3d& a, const Vector3d& b) {
  return each(a, b, [](double x, double y) { return x - y; });
}
inline Vector3d operator*(const Vector3d& a, double by) {
  return {{a.v[0] * by, a.v[1] * by, a.v[2] * by}};
}
inline Vector3d least_of(const Vector3d& a, const Vector3d& b) {
  return each(a, b, [](double x, double y) { return std::min(x, y); });
}
inline Vector3d greatest_of(const Vector3d& a, const Vector3d& b) {
  return each(a, b, [](double x, double y) { return std::max(x, y); });
}
inline Vector3d absolute(const Vector3d& a) {
  return {{std::abs(a.v[0]), std::abs(a.v[1]), std::abs(a.v[2])}};
}
inline double dot(const Vector3d& a, const Vector3d& b) {
  return a.v[0] * b.v[0] + a.v[1] * b.v[1] + a.v[2] * b.v[2];
}
inline double norm(const Vector3d& a) { return std::sqrt(dot(a, a)); }
inline Vector3d cross(const Vector3d& a, const Vector3d& b) {
  return {{a.v[1] * b.v[2] - a.v[2] * b.v[1], a.v[2] * b.v[0] - a.v[0] * b.v[2],
           a.v[0] * b.v[1] - a.v[1] * b.v[0]}};
}

struct Matrix3d {
  std::array<double, 9> m{};  ///< row-major

  [[nodiscard]] Vector3d row(std::size_t r) const {
    return {{m[3 * r], m[3 * r + 1], m[3 * r + 2]}};
  }
  [[nodiscard]] Matrix3d transposed() const {
    return {{m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]}};
  }
};
inline Vector3d operator*(const Matrix3d& a, const Vector3d& b) {
  return {{dot(a.row(0), b), dot(a.row(1), b), dot(a.row(2), b)}};
}
inline Matrix3d operator*(const Matrix3d& a, const Matrix3d& b) {
  const Matrix3d columns = b.transposed();
  Matrix3d out;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) out.m[3 * r + c] = dot(a.row(r), columns.row(c));
  return out;
}
inline Matrix3d absolute(Matrix3d a) {
  for (double& x : a.m) x = std::abs(x);
  return a;
}

}  // namespace nearmesh
