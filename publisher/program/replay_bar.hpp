// SPDX-License-Identifier: Apache-2.0
#pragma once
// How far a replay is, as a bar for people.

#include <algorithm>
#include <string>

namespace nearmesh::publisher::program {

/// The share of [start_s, end_s] that lies before time_s: none before it, where one may go back to,
/// and all behind. In [0, 1].
[[nodiscard]] inline double played_share(double time_s, double start_s, double end_s) {
  return std::clamp((time_s - start_s) / std::max(1e-9, end_s - start_s), 0.0, 1.0);
}
/// "[=====     ]", always of the same width.
[[nodiscard]] inline std::string bar_of(double share) {
  constexpr std::size_t kWidth = 24;
  std::string bar(static_cast<std::size_t>(kWidth * share), '=');
  bar.resize(kWidth, ' ');
  return "[" + bar + "]";
}

}  // namespace nearmesh::publisher::program
