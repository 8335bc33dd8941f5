// SPDX-License-Identifier: Apache-2.0
#pragma once
// Numbers that follow from a seed, whatever the machine does.

#include <cstdint>

#include "core/base/hash.hpp"

namespace nearmesh::test {

class Dice {
 public:
  explicit Dice(std::uint64_t seed) : state_(mix(seed)) {}
  std::uint64_t below(std::uint64_t n) { return mix(++state_) % n; }
  double between(double low, double high) {
    return low + (high - low) * 0x1p-53 * static_cast<double>(mix(++state_) >> 11);
  }

 private:
  std::uint64_t state_;
};

}  // namespace nearmesh::test
