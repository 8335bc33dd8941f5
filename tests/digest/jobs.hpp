// SPDX-License-Identifier: Apache-2.0
#pragma once
// Fixed work whose results must be the same bits whatever compiler, optimisation and number of
// threads. A new room adds its jobs as a file of its own, with one function here and one line in
// all_jobs().

#include <bit>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/base/hash.hpp"

namespace nearmesh::digest_jobs {

/// A chain over everything that a job computes, in order.
class Digest {
 public:
  void add(std::uint64_t x) { value_ = mix(value_ ^ x); }
  void add_bits(double x) { add(std::bit_cast<std::uint64_t>(x)); }
  void add_bytes(std::span<const std::uint8_t> bytes) { add(hash_bytes(bytes)); }
  [[nodiscard]] std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 1;  // 0 stands for a job that failed
};

struct Job {
  std::string name;
  std::function<std::uint64_t()> run;  ///< 0: failed; may run in several threads at once
};

[[nodiscard]] std::vector<Job> geometry_jobs();
[[nodiscard]] std::vector<Job> model_jobs();
[[nodiscard]] std::vector<Job> answer_jobs();
[[nodiscard]] std::vector<Job> session_jobs();  ///< in builds with DDS alone

}  // namespace nearmesh::digest_jobs
