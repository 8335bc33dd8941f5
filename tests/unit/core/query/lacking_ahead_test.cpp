// SPDX-License-Identifier: Apache-2.0
#include "core/query/lacking_ahead.hpp"

#include "model_pairs.hpp"

namespace nearmesh {
namespace {

constexpr double kAhead_s = 0.5;

/// Two cuts of two models whose stores know every split.
struct Cuts {
  Cuts(const BakedModel& baked_a, const BakedModel& baked_b)
      : a(baked_a.store, baked_a.header.grid), b(baked_b.store, baked_b.header.grid) {}

  /// Splits what is lacking, again and again. Out: how many looks that took.
  int refine(const Motion& motion_a, const Motion& motion_b, const Require& require) {
    for (int looks = 1;; ++looks) {
      const Result<Lacking> lacking = lacking_ahead(a.view(), motion_a, "a", b.view(), motion_b,
                                                    "b", kAhead_s, 0, require, require);
      EXPECT_TRUE(lacking.is_ok()) << lacking.status().message();
      if (!lacking.is_ok() || lacking.value().is_nothing()) return looks;
      split(a, lacking.value().a);
      split(b, lacking.value().b);
    }
  }
  [[nodiscard]] std::size_t split_count() const {
    return a.mesh.split_count() + b.mesh.split_count();
  }
  static void split(LocalModel& model, const std::vector<NodeSpan>& nodes) {
    RefineDelta delta;
    for (const NodeSpan& node : nodes)
      EXPECT_TRUE(model.mesh.split(model.mesh.store().split_of(node), delta)) << to_string(node);
    model.tree.update(delta);
  }

  LocalModel a, b;
};

class LackingAhead : public test::ModelPair {};
INSTANTIATE_TEST_SUITE_P(Models, LackingAhead, test::model_pairs(), test::name_of_pair);

TEST_P(LackingAhead, LooksIntoNodesFindWhatALookALevelDoes) {
  Random random(3);
  int looks_by_levels = 0, looks_into = 0;
  std::size_t splits_by_levels = 0, splits_into = 0;
  for (int i = 0; i < 40; ++i) {
    const auto [motion_a, motion_b] = near_motions(random);
    Cuts by_levels(a_, b_), into(a_, b_);
    looks_by_levels += by_levels.refine(motion_a, motion_b, {});
    looks_into += into.refine(motion_a, motion_b, [](NodeSpan /*node*/) { return Status::ok(); });
    splits_by_levels += by_levels.split_count();
    splits_into += into.split_count();
  }
  // Not quite the same: which of two nodes is split depends on which is looked at first.
  EXPECT_LE(100 * splits_into, 101 * splits_by_levels);
  EXPECT_LT(2 * looks_into, looks_by_levels);
}

TEST_P(LackingAhead, TellsWhyASplitCannotBeLoaded) {
  Random random(4);
  const auto [motion_a, motion_b] = near_motions(random);
  const Cuts cuts(a_, b_);
  const Require refuse = [](NodeSpan /*node*/) {
    return Status{StatusCode::kIo, "the disk is gone"};
  };
  const Result<Lacking> lacking = lacking_ahead(cuts.a.view(), motion_a, "a", cuts.b.view(),
                                                motion_b, "b", kAhead_s, 0, refuse, refuse);
  ASSERT_FALSE(lacking.is_ok());
  EXPECT_EQ(lacking.status().message(), "the disk is gone");
}

}  // namespace
}  // namespace nearmesh
