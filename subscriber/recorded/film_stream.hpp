// SPDX-License-Identifier: Apache-2.0
#pragma once
// The bytes of a film: numbers and poses, told as differences (takes values, gives bytes).
// player/film.js reads them.

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh::subscriber {

/// A stream that is written. Records begin with a letter and two numbers.
struct FilmStream {
  std::string bytes;

  void begin(char kind, std::uint64_t first, std::uint64_t second) {
    bytes += kind;
    number(first);
    number(second);
  }
  void number(std::uint64_t x) {
    for (; x >= 128; x >>= 7) bytes += static_cast<char>(x | 128);
    bytes += static_cast<char>(x);
  }
  void signed_number(std::int64_t x) {
    number((static_cast<std::uint64_t>(x) << 1) ^ static_cast<std::uint64_t>(x >> 63));
  }
  /// From `last`, which is then `now`.
  void difference(std::int64_t& last, std::int64_t now) {
    signed_number(now - last);
    last = now;
  }
  void real(double x) {
    char raw[sizeof x];
    std::memcpy(raw, &x, sizeof x);
    bytes.append(raw, sizeof x);
  }
  /// To a part in 8,192, for people; infinity stays so.
  void rough(double x) {
    const auto single = static_cast<float>(x);
    std::uint32_t raw = 0;
    std::memcpy(&raw, &single, sizeof raw);
    number(raw >> 10);
  }
  void text(std::string_view what) {
    number(what.size());
    bytes += what;
  }
};

/// A pose in whole numbers: the translation in 2^unit metres, the rotation as a quaternion of 2^14.
struct FilmPose {
  int unit = 0;
  std::array<std::int64_t, 7> at{};

  FilmPose() = default;
  FilmPose(const Pose& pose, int of_unit) : unit(of_unit) {
    for (std::size_t k = 0; k < 3; ++k) at[k] = cells(pose.translation_m[k], unit);
    const std::array<double, 4> q = quaternion_of_rotation(pose.rotation);
    for (std::size_t k = 0; k < 4; ++k) at[3 + k] = std::lround(q[k] * 16384);
  }
  /// Beyond 2^52 cells: that.
  static std::int64_t cells(double metres, int unit) {
    const double cells = std::ldexp(metres, -unit);
    return std::abs(cells) < 0x1p52 ? std::llround(cells) : 0;
  }
};

/// Where a body went: each pose as the difference to where its last step would have taken it.
class FilmWay {
 public:
  [[nodiscard]] bool is_at(const FilmPose& pose) const {
    return has_begun_ && pose.unit == last_.unit && pose.at == last_.at;
  }
  void tell(const FilmPose& pose, FilmStream& out) {
    const bool begins = !has_begun_ || pose.unit != last_.unit;
    if (begins) {
      last_ = FilmPose();
      step_ = {};
    }
    for (std::size_t k = 0; k < 7; ++k) {
      out.signed_number(pose.at[k] - last_.at[k] - step_[k]);
      step_[k] = k < 3 && !begins ? pose.at[k] - last_.at[k] : 0;
    }
    last_ = pose;
    has_begun_ = true;
  }

 private:
  bool has_begun_ = false;
  FilmPose last_;
  std::array<std::int64_t, 7> step_{};
};

}  // namespace nearmesh::subscriber
