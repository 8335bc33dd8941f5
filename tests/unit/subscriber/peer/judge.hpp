// SPDX-License-Identifier: Apache-2.0
#pragma once
// Served models, random flights, and a judge that holds every answer against the full meshes.

#include <array>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "brute_force.hpp"
#include "fault_of.hpp"
#include "moving.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "test_models.hpp"

namespace nearmesh::test {

using subscriber::BodyId;
using subscriber::FrameReport;
using subscriber::PairAnswer;
using subscriber::Session;
using subscriber::SessionOptions;

/// The ground is the first body of every session here, aircraft follow.
constexpr BodyId kGround{0}, kOne{1}, kTwo{2};

/// A model on disk and its full mesh.
struct ServedModel {
  explicit ServedModel(BakedModel baked) : model(std::move(baked)) {}
  BakedModel model;
  std::unique_ptr<TempFile> file = write_model(model);
  FullModel full{model};
  [[nodiscard]] ModelFile open() const { return std::move(ModelFile::open(file->path())).value(); }
};

inline const ServedModel& terrain() {
  static const ServedModel served(bake_mesh(generate_terrain(40, 7), 16));
  return served;
}
/// Other content, to be served under the same name.
inline const ServedModel& other_terrain() {
  static const ServedModel served(bake_mesh(generate_terrain(40, 8), 16));
  return served;
}
inline const ServedModel& aircraft() {
  static const ServedModel served(bake_mesh(generate_aircraft(500, 7), 16));
  return served;
}

// ---- flights ------------------------------------------------------------------------------------

/// Two aircraft, frame by frame, at 20 Hz.
struct Flight {
  std::vector<Motion> one, two;
  [[nodiscard]] std::size_t frames() const { return one.size(); }
};

/// From way point to way point close above, or in, the ground, turning; the second near the first.
inline Flight make_flight(std::uint64_t seed, int segments = 5) {
  Random random(seed);
  Flight flight;
  const auto way_point = [&] {
    const BakedModel& ground = terrain().model;
    Vector3 at =
        position_m(ground.header, ground.store, {random.below(ground.header.vertex_count)});
    at[2] += random.between(-5, 40);
    return at;
  };
  const auto spin = [&] {
    return Vector3{random.between(-1, 1), random.between(-1, 1), random.between(-1, 1)};
  };
  constexpr int kFramesEach = 8;
  constexpr double kPeriod_s = 0.05;
  Vector3 from = way_point();
  Motion one, two;
  one.pose.rotation = random_rotation(random);
  two.pose.rotation = random_rotation(random);
  for (int segment = 0; segment < segments; ++segment) {
    const Vector3 to = way_point();
    one.pose.translation_m = from;
    one.angular_velocity_radps = spin();
    two.angular_velocity_radps = spin();
    for (std::size_t k = 0; k < 3; ++k) {
      one.linear_velocity_mps[k] = (to[k] - from[k]) / (kFramesEach * kPeriod_s);
      two.pose.translation_m[k] = from[k] + random.between(-60, 60);
      two.linear_velocity_mps[k] = one.linear_velocity_mps[k] + random.between(-150, 150);
    }
    for (int frame = 0; frame < kFramesEach; ++frame) {
      flight.one.push_back(one);
      flight.two.push_back(two);
      one.pose = moved(one, kPeriod_s);
      two.pose = moved(two, kPeriod_s);
    }
    from = to;
  }
  return flight;
}

// ---- judge --------------------------------------------------------------------------------------

/// Counts answers, and fails the test for every one that the full meshes contradict.
class Judge {
 public:
  const ServedModel* ground = &terrain();  ///< what "terrain" stands for
  bool solid_ground = false;               ///< the ground has an inside, always body a
  std::uint64_t free = 0, contact = 0, partial = 0, uncertain = 0, contained = 0, unknown = 0;

  [[nodiscard]] std::uint64_t certified() const { return free + contact + contained; }

  void check(const FrameReport& report) {
    for (const PairAnswer& answer : report.answers) check(answer);
  }
  void check(const PairAnswer& answer) {
    if (!answer.reason.empty()) {
      EXPECT_EQ(answer.answer.status, AnswerStatus::kUncertain) << answer.reason;
      EXPECT_TRUE(answer.answer.pairs.empty());
      ++unknown;
      return;
    }
    EXPECT_EQ(fault_of(answer.answer, full(answer)), "")
        << answer.a.value << " and " << answer.b.value;
    ++count_of(answer.answer.status);
  }
  /// What the full meshes say.
  std::vector<FacePair> touching(const PairAnswer& answer, const Pose& pose_a,
                                 const Pose& pose_b) const {
    return truth(answer, pose_a, pose_b).pairs;
  }

 private:
  std::uint64_t& count_of(AnswerStatus status) {
    switch (status) {
      case AnswerStatus::kFree:
        return free;
      case AnswerStatus::kContact:
        return contact;
      case AnswerStatus::kPartial:
        return partial;
      case AnswerStatus::kContained:
        return contained;
      case AnswerStatus::kUncertain:
        break;
    }
    return uncertain;
  }
  [[nodiscard]] Answer truth(const PairAnswer& answer, const Pose& pose_a,
                             const Pose& pose_b) const {
    const TriangleTree &a = mesh_of(answer.a).full.tree, &b = mesh_of(answer.b).full.tree;
    const Result<PosedPair> posed = pose_pair(a.grid, pose_a, "a", b.grid, pose_b, "b");
    EXPECT_TRUE(posed.is_ok());
    return query(a.view(), posed.value().a, b.view(), posed.value().b,
                 {.clearance = Clearance::kNone, .solid_a = solid_ground && answer.a == kGround});
  }
  [[nodiscard]] const ServedModel& mesh_of(BodyId body) const {
    return body == kGround ? *ground : aircraft();
  }
  // The same question comes many times while detail is on its way.
  const Answer& full(const PairAnswer& answer) {
    Known& known = known_[{answer.a, answer.b}];
    if (known.ground != ground || known.poses[0].rotation != answer.pose_a.rotation ||
        known.poses[0].translation_m != answer.pose_a.translation_m ||
        known.poses[1].rotation != answer.pose_b.rotation ||
        known.poses[1].translation_m != answer.pose_b.translation_m)
      known = {ground, {answer.pose_a, answer.pose_b}, truth(answer, answer.pose_a, answer.pose_b)};
    return known.answer;
  }
  struct Known {
    const ServedModel* ground = nullptr;
    std::array<Pose, 2> poses;
    Answer answer;
  };
  std::map<std::pair<BodyId, BodyId>, Known> known_;
};

}  // namespace nearmesh::test
