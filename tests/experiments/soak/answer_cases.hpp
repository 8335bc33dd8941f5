// SPDX-License-Identifier: Apache-2.0
#pragma once
// One case of the soak of answers: a pair of models, a way of refining, a few poses. All of it
// follows from the case's number and the run's seed, so that any case can be run again alone.

#include <array>
#include <string>
#include <vector>

#include "random_policies.hpp"

namespace nearmesh::soak {

inline constexpr std::uint32_t kPosesPerCase = 8;

enum class Policy : std::uint8_t { kBase, kSubset, kPrefix, kDemand, kLoss, kSession, kServed };
inline constexpr std::array<const char*, 7> kPolicyNames{"base", "subset",  "prefix", "demand",
                                                         "loss", "session", "served"};

/// A model, complete, with what the cases need of it.
struct Model {
  explicit Model(BakedModel baked_model);
  Model(const Model&) = delete;
  Model& operator=(const Model&) = delete;
  BakedModel baked;
  test::FullModel full;
  std::vector<test::KeyedFace> faces;
  std::vector<VertexId> order;  ///< all splits in global order
  test::TrueHalfSpaces half_spaces;
  double radius_m;
};

struct ModelPair {
  std::string name;
  const Model *a, *b;
};

struct Tally {
  std::uint64_t poses = 0, brute_force = 0;
  std::array<std::uint64_t, 4> answers{};  ///< by AnswerStatus
  std::uint64_t false_answers = 0;
  void add(const Tally& other);
};

struct CaseResult {
  Tally tally;
  std::uint64_t digest = 0;  ///< of all answers, in order
  std::string fault;         ///< the first, or empty
};

/// `check_by_force`: compare the first pose's reference with brute force, and clearances with the
/// true distance.
[[nodiscard]] CaseResult run_case(const ModelPair& pair, Policy policy, std::uint64_t seed,
                                  bool check_by_force);

}  // namespace nearmesh::soak
