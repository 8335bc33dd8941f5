// SPDX-License-Identifier: Apache-2.0
#pragma once
// What nearmesh-subscriber counts while it flies, and how it prints that at the end.

#include <array>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::subscriber::program {

// Milliseconds of one phase, frame by frame. Who flies for weeks has more frames than fit: then
// each second one is left out, of those before and of those to come, and so on, so that those that
// are kept stand for the whole flight.
class Timings {
 public:
  void add(double seconds);
  [[nodiscard]] double quantile(double q) const;
  [[nodiscard]] std::size_t kept() const { return ms_.size(); }
  static constexpr std::size_t kMost = 1U << 20;  // some five hours of 60 a second

 private:
  std::vector<double> ms_;    // in the order of frames
  std::uint64_t added_ = 0;   // frames
  std::uint64_t one_of_ = 1;  // that many is kept
};

struct Summary {
  std::array<std::uint64_t, 5> by_status{};
  std::uint64_t frames = 0, contact_pairs = 0;
  std::uint64_t put_off = 0;                      // of the uncertain ones: for want of budget
  std::uint64_t free_by_bounds = 0, unknown = 0;  // of pairs that were not listed
  Timings load, refine, tree, query;
  std::optional<double> first_certified_s;  ///< since the start; none: there was none
  double seconds = 0;
  SessionStats stats;
};
/// One object, "summary" (docs/answers.md).
[[nodiscard]] nlohmann::ordered_json to_json(Summary& s);
/// A few lines on standard output.
void print_text(Summary& s);

}  // namespace nearmesh::subscriber::program
