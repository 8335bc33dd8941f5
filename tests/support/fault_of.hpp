// SPDX-License-Identifier: Apache-2.0
#pragma once
// The judge of answers: holds what was answered from partial data against the answer of the full
// meshes for the same poses. Everything that the project promises of an answer stands here, and
// nowhere else in the tests.

#include <algorithm>
#include <string>
#include <vector>

#include "nearmesh/core/query/query.hpp"

namespace nearmesh::test {

/// Whether what is said of a pose contradicts the full meshes: empty when it does not, else how. Of
/// an answer that is not certified only the pairs say something.
inline std::string contradiction(AnswerStatus status, const std::vector<FacePair>& pairs,
                                 const Answer& full) {
  if (!is_certified(status))
    return std::includes(full.pairs.begin(), full.pairs.end(), pairs.begin(), pairs.end())
               ? ""
               : "a pair touches that does not in the full meshes";
  if (status != full.status)
    return std::string("certified ") + to_string(status) + ", but the full meshes say " +
           to_string(full.status);
  if (pairs != full.pairs)
    return "certified contact of " + std::to_string(pairs.size()) +
           " pairs, but the full meshes have " + std::to_string(full.pairs.size()) + " or others";
  return {};
}

/// What is wrong with an answer; empty when nothing is. Preconditions: no body has more parts than
/// answers about insides look at (such answers stay open whatever has come), or a part that is a
/// single point (what is not known of it is in its place).
inline std::string fault_of(const Answer& answer, const Answer& full) {
  if (std::string wrong = contradiction(answer.status, answer.pairs, full); !wrong.empty())
    return wrong;
  const bool lacks = !answer.missing_a.empty() || !answer.missing_b.empty();
  if (is_certified(answer.status)) {
    if (answer.contained != full.contained)
      return std::string("certified ") + to_string(answer.contained) +
             ", but the full meshes say " + to_string(full.contained);
    return lacks ? "certified although detail is missing" : "";
  }
  if (!lacks) return std::string(to_string(answer.status)) + " although nothing is missing";
  if (!(answer.uncertainty_m > 0))
    return std::string(to_string(answer.status)) + " within no distance at all";
  if ((answer.status == AnswerStatus::kPartial) == answer.pairs.empty())
    return std::string(to_string(answer.status)) + " with " + std::to_string(answer.pairs.size()) +
           " pairs";
  return {};
}

}  // namespace nearmesh::test
