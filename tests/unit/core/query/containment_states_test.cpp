// SPDX-License-Identifier: Apache-2.0
// Containment in every state of refinement: never wrong by the winding numbers of the full meshes,
// certified in the end.
#include "fault_of.hpp"
#include "half_spaces.hpp"
#include "solids.hpp"

namespace nearmesh {
namespace {

using test::append;
using test::make_cube;
using test::pose_at;
using test::quarter_turns;
using test::Solid;

struct Scene {
  const char *name, *a, *b;
};

IndexedMesh scene_mesh(const std::string& name) {
  if (name == "box") return make_cube(1, 4);
  if (name == "large_box") return make_cube(4, 4);
  if (name == "nested") return test::make_nested();
  if (name == "torus") return test::make_torus(3, 1, 32, 16);
  if (name == "land") return test::make_closed_terrain(16, 7, -2500);
  if (name == "aircraft") return generate_aircraft(500, 7);
  if (name == "beads") return test::make_components(30, 3);
  if (name == "grain") return make_cube(0.25, 4);
  IndexedMesh mesh;
  Random random(5);
  const IndexedMesh voxels = test::Voxels(3, random).mesh();
  if (name == "sheet") {
    append(mesh, generate_terrain(8, 3), {}, 0.001);
  } else {
    append(mesh, voxels, {}, name == "small_voxels" ? 0.125 : name == "rocks" ? 0x1p20 : 1);
  }
  return mesh;
}

class SolidPair : public ::testing::TestWithParam<Scene> {
 protected:
  const Solid a_{scene_mesh(GetParam().a)}, b_{scene_mesh(GetParam().b)};
  const QueryOptions options_{.clearance = Clearance::kNone,
                              .solid_a = check_solid(a_.model.header.surface, "a").is_ok(),
                              .solid_b = check_solid(b_.model.header.surface, "b").is_ok()};

  /// b's middle anywhere in a's box, both turned by chance, by quarters half the time.
  PosedPair inside_pose(Random& random) const {
    const auto turn = [&random]() {
      return random.below(2) == 0 ? quarter_turns()[random.below(24)]
                                  : test::random_rotation(random);
    };
    Pose pose_a{.rotation = turn()}, pose_b{.rotation = turn()};
    const auto span = [&](const BakedModel& model, double lo, double hi) {
      GridBox box;
      for (std::uint32_t v = 0; v < model.header.vertex_count; ++v)
        box.add(model.store.position({v}));
      test::Point p = model.header.grid.origin_m;
      for (int k = 0; k < 3; ++k) {
        const double t = random.between(lo, hi);
        p[static_cast<std::size_t>(k)] +=
            std::ldexp(box.lo[k] + t * (double(box.hi[k]) - box.lo[k]), model.header.grid.exponent);
      }
      return p;
    };
    const auto at = test::place(pose_a, span(a_.model, 0, 1)),
               middle = test::place(pose_b, span(b_.model, 0.4, 0.6));
    for (std::size_t k = 0; k < 3; ++k) pose_b.translation_m[k] = at[k] - middle[k];
    return pose_at(a_, pose_a, b_, pose_b);
  }
  static void expect_true(const Answer& truth, const Answer& answer) {
    EXPECT_EQ(test::fault_of(answer, truth), "");
  }
};
INSTANTIATE_TEST_SUITE_P(Scenes, SolidPair,
                         ::testing::Values(Scene{"box_in_box", "large_box", "box"},
                                           Scene{"grain_in_shells", "nested", "grain"},
                                           Scene{"grain_in_torus", "torus", "grain"},
                                           Scene{"aircraft_in_land", "land", "aircraft"},
                                           Scene{"beads_in_box", "large_box", "beads"},
                                           Scene{"beads_in_shells", "nested", "beads"},
                                           Scene{"voxels_in_voxels", "voxels", "small_voxels"},
                                           // The pair's lattice is coarser than the box's grid.
                                           Scene{"box_in_rocks", "rocks", "box"},
                                           Scene{"sheet_in_shells", "nested", "sheet"}),
                         [](const auto& scene) { return scene.param.name; });

TEST_P(SolidPair, NeverWrongAndAlwaysCertifiedInTheEnd) {
  std::array<std::size_t, 5> seen{};
  const test::TrueHalfSpaces half_spaces_a(a_.model.store), half_spaces_b(b_.model.store);
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const PosedPair posed = inside_pose(random);
    const Answer truth = test::true_answer(a_.model, a_.full.tree.view(), b_.model,
                                           b_.full.tree.view(), posed, options_);
    ++seen[static_cast<std::size_t>(truth.status)];
    expect_true(truth, query(a_.full.tree.view(), posed.a, b_.full.tree.view(), posed.b, options_));
    for (int state = 0; state < 3; ++state) {
      LocalModel a(a_.model.store, a_.model.header.grid), b(b_.model.store, b_.model.header.grid);
      if (state > 0) test::refine_at_random(a, random);
      if (state > 0) test::refine_at_random(b, random);
      if (state > 1) {
        test::tell_half_spaces(a, half_spaces_a, random);
        test::tell_half_spaces(b, half_spaces_b, random);
      }
      const Answer early = query(a.view(), posed.a, b.view(), posed.b, options_);
      expect_true(truth, early);
      const Result<Answer> end =
          certify(a, posed.a, test::no_require, b, posed.b, test::no_require, options_);
      ASSERT_TRUE(end.is_ok()) << end.status().message();
      ASSERT_TRUE(is_certified(end.value().status));
      expect_true(truth, end.value());
      // Loss: parts given up at random.
      for (int i = 0; i < 6; ++i) {
        LocalModel& loser = random.below(2) == 0 ? a : b;
        const VertexId v{random.below(loser.mesh.store().vertex_count())};
        RefineDelta delta;
        loser.mesh.collapse(loser.mesh.store().initial_node(v), delta);
        loser.tree.update(delta);
        expect_true(truth, query(a.view(), posed.a, b.view(), posed.b, options_));
      }
    }
  }
  EXPECT_GT(seen[static_cast<std::size_t>(AnswerStatus::kContained)], 3U);
  EXPECT_GT(seen[static_cast<std::size_t>(AnswerStatus::kFree)] +
                seen[static_cast<std::size_t>(AnswerStatus::kContact)],
            3U);
}

TEST_P(SolidPair, SwappedBodiesGiveTheMirroredAnswer) {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const PosedPair posed = inside_pose(random);
    LocalModel a(a_.model.store, a_.model.header.grid), b(b_.model.store, b_.model.header.grid);
    test::refine_at_random(a, random);
    test::refine_at_random(b, random);
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b, options_);
    const Answer mirrored = query(
        b.view(), posed.b, a.view(), posed.a,
        {.clearance = Clearance::kNone, .solid_a = options_.solid_b, .solid_b = options_.solid_a});
    EXPECT_EQ(answer.status, mirrored.status);
    const auto c = static_cast<int>(answer.contained), m = static_cast<int>(mirrored.contained);
    EXPECT_EQ(c, (m & 1) * 2 + m / 2);
    if (answer.pair_total == 0 && answer.status == AnswerStatus::kUncertain) {
      // Which of two unresolved nodes of one size is named goes by the order of the bodies.
      EXPECT_EQ(answer.missing_a.empty() && answer.missing_b.empty(),
                mirrored.missing_a.empty() && mirrored.missing_b.empty());
    }
  }
}

}  // namespace
}  // namespace nearmesh
