// SPDX-License-Identifier: Apache-2.0
// The project's claim: a certified answer is the full mesh's answer. Thousands of poses by default;
// NEARMESH_POSES=N asks for N in each of the six settings.
#include <cstdlib>

#include "random_policies.hpp"

namespace nearmesh {
namespace {

std::uint32_t pose_count() {
  const char* given = std::getenv("NEARMESH_POSES");
  return given == nullptr ? 600 : static_cast<std::uint32_t>(std::strtoul(given, nullptr, 10));
}

IndexedMesh large(const std::string& name, std::uint64_t seed) {
  if (name == "terrain") return generate_terrain(48, seed);
  return name == "aircraft" ? generate_aircraft(1000, seed) : generate_sphere(40, seed);
}

void split_missing(LocalModel& model, const std::vector<NodeSpan>& missing) {
  RefineDelta delta;
  for (const NodeSpan& node : missing) {
    ASSERT_TRUE(model.mesh.is_current(node));
    ASSERT_TRUE(model.mesh.split(model.mesh.store().split_of(node), delta));
  }
  model.tree.update(delta);
}

struct Setting {
  const char *a, *b;
  bool static_a;
};
class CertifiedAnswer : public ::testing::TestWithParam<Setting> {};
INSTANTIATE_TEST_SUITE_P(
    Models, CertifiedAnswer,
    ::testing::Values(Setting{"terrain", "aircraft", false}, Setting{"sphere", "sphere", false},
                      Setting{"aircraft", "aircraft", false}, Setting{"terrain", "aircraft", true},
                      Setting{"sphere", "sphere", true}, Setting{"aircraft", "aircraft", true}),
    [](const auto& setting) {
      return std::string(setting.param.static_a ? "static_" : "") + setting.param.a + "_" +
             setting.param.b;
    });

TEST_P(CertifiedAnswer, EqualsTheFullMeshesInEveryPose) {
  const BakedModel model_a = test::bake_mesh(large(GetParam().a, 3));
  const BakedModel model_b = test::bake_mesh(large(GetParam().b, 4));
  const test::FullModel full_a(model_a), full_b(model_b);
  std::size_t contacts = 0, uncertain = 0;
  // A mesh that does not progress need not be made again for each pose.
  LocalModel static_a(model_a.store, model_a.header.grid);
  if (GetParam().static_a) test::split_all(static_a);
  for (std::uint64_t seed = 0; seed < pose_count() && !HasFailure(); ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(seed);
    const PosedPair posed = test::near_pose(random, model_a, model_b);
    const Answer full = query(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b);
    LocalModel progressive_a(model_a.store, model_a.header.grid);
    LocalModel b(model_b.store, model_b.header.grid);
    LocalModel& a = GetParam().static_a ? static_a : progressive_a;
    while (true) {
      const Answer answer =
          query(a.view(), posed.a, b.view(), posed.b, {.clearance = Clearance::kNone});
      EXPECT_EQ(test::fault_of(answer, full), "");
      if (is_certified(answer.status)) break;
      ++uncertain;
      split_missing(a, answer.missing_a);
      split_missing(b, answer.missing_b);
    }
    contacts += full.pairs.empty() ? 0 : 1;
  }
  RecordProperty("poses", static_cast<int>(pose_count()));
  RecordProperty("contacts", static_cast<int>(contacts));
  std::printf("%u poses, %zu in contact, %zu uncertain answers on the way\n", pose_count(),
              contacts, uncertain);
  EXPECT_GT(contacts * 10, pose_count());  // both kinds of pose are there in number
  EXPECT_LT(contacts * 10, pose_count() * 9U);
}

// A peer that moves on keeps what it has: the state is whatever earlier poses left, collapsed in
// places.
TEST_P(CertifiedAnswer, EqualsTheFullMeshesFromAnyEarlierState) {
  const BakedModel model_a = test::bake_mesh(large(GetParam().a, 5));
  const BakedModel model_b = test::bake_mesh(large(GetParam().b, 6));
  const test::FullModel full_a(model_a), full_b(model_b);
  LocalModel a(model_a.store, model_a.header.grid), b(model_b.store, model_b.header.grid);
  for (std::uint64_t seed = 0; seed < pose_count() / 4 && !HasFailure(); ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(seed);
    const PosedPair posed = test::near_pose(random, model_a, model_b);
    const Answer full = query(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b);
    EXPECT_EQ(test::fault_of(query(a.view(), posed.a, b.view(), posed.b), full), "");
    const Result<Answer> answer =
        certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {});
    ASSERT_TRUE(answer.is_ok()) << answer.status().message();
    EXPECT_EQ(test::fault_of(answer.value(), full), "");
    // History must not show: trees made of the state at once give the same answer, bit by bit.
    const AbTree new_a(a.mesh), new_b(b.mesh);
    EXPECT_EQ(digest(query(new_a.view(a.grid), posed.a, new_b.view(b.grid), posed.b)),
              digest(answer.value()));
    if (!GetParam().static_a) test::collapse_some(a, random);
    test::collapse_some(b, random);
  }
}

}  // namespace
}  // namespace nearmesh
