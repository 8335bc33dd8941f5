// SPDX-License-Identifier: Apache-2.0
#include "free_pairs.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <span>

#include "core/base/hash.hpp"

namespace nearmesh {

std::uint64_t place_digest(std::string_view name, const ContentHash& content,
                           const Company& company, const Motion& motion) {
  std::array<std::uint64_t, 22> words{};
  auto next = words.begin();
  const auto add = [&next](std::uint64_t bits) { *next++ = bits; };
  add(content.high);
  add(content.low);
  add(std::uint64_t{company.group} << 32 | company.mask);
  add(company.is_scenery ? 1 : 0);
  const auto add_all = [&](const auto& numbers) {
    for (const double number : numbers) add(std::bit_cast<std::uint64_t>(number));
  };
  add_all(motion.pose.rotation);
  add_all(motion.pose.translation_m);
  add_all(motion.linear_velocity_mps);
  add_all(motion.angular_velocity_radps);
  const auto bytes_of = [](const auto& values) {
    return std::span(reinterpret_cast<const std::uint8_t*>(values.data()),
                     values.size() * sizeof(values[0]));
  };
  return hash_bytes(bytes_of(words), hash_bytes(bytes_of(name)));
}

void FreePairs::add(double way_m, double age_s) {
  if (way_m < next_way_m_) next_way_m_ = std::max(way_m, least_way_m_);
  least_way_m_ = std::min(least_way_m_, way_m);
  if (way_m <= 0) return;
  oldest_s_ = std::max(oldest_s_, age_s);
  newest_s_ = std::max(newest_s_, -age_s);
}

// Boxes that do not meet are farther apart than both ways and margins.
double FreePairs::clearance_m(double margin_m) const {
  return (least_way_m_ + next_way_m_ + 2 * margin_m) * (1 - 0x1p-40);
}

// A box holds where the body is for the look-ahead before its pose's time and after it.
double FreePairs::horizon_s(double lookahead_s) const {
  if (newest_s_ > lookahead_s) return 0;
  return std::max(0.0, lookahead_s - oldest_s_);
}

float float_at_most(double number) {
  if (number >= double{std::numeric_limits<float>::max()}) return std::numeric_limits<float>::max();
  const auto nearest = static_cast<float>(number);
  return double{nearest} > number ? std::nextafter(nearest, 0.0F) : nearest;
}

}  // namespace nearmesh
