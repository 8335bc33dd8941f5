// SPDX-License-Identifier: Apache-2.0
#pragma once
// What doctor says (takes what it measured, gives lines): also of tests that were interrupted,
// which tell what they had measured until then and accuse nobody.

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace nearmesh::subscriber::program {

/// One line of the diagnosis.
struct Finding {
  enum class Kind { kFact, kGood, kAdvice, kWrong };
  Kind kind = Kind::kFact;
  std::string name, text;
  nlohmann::ordered_json value;
};
[[nodiscard]] const char* to_string(Finding::Kind kind);
[[nodiscard]] std::string milliseconds(double seconds);

inline constexpr std::size_t kKilobyte = 1000, kMegabyte = 1'000'000;

/// Of so many bytes that went there and back, in the times of those that came. In: one that did not
/// within `patience_s` ends the test, unless the user did.
struct RoundTrips {
  std::string name;
  std::size_t bytes = 0;
  std::vector<double> times_s;
  double patience_s = 0;
  bool is_overdue = false, is_interrupted = false;
};
[[nodiscard]] Finding finding_of(RoundTrips trips);

/// Of kilobytes that nobody repairs: how many were sent, and came back.
struct Probes {
  std::size_t sent = 0, back = 0;
  bool is_interrupted = false;
};
[[nodiscard]] Finding finding_of(const Probes& probes);

}  // namespace nearmesh::subscriber::program
