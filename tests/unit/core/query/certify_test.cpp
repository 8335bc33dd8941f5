// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/query/certify.hpp"

#include "brute_force.hpp"
#include "fault_of.hpp"

namespace nearmesh {
namespace {

TEST(Certify, SplitsOnlyWhatAnAnswerNamed) {
  const BakedModel model = test::bake_named("terrain");
  const BakedModel other = test::bake_named("sphere");
  Random random(1);
  const PosedPair posed = test::near_pose(random, model, other);
  LocalModel a(model.store, model.header.grid), b(other.store, other.header.grid);
  std::set<std::uint32_t> named;
  const Require remember = [&](NodeSpan node) {
    named.insert(model.store.split_of(node).value);
    return Status::ok();
  };
  ASSERT_TRUE(certify(a, posed.a, remember, b, posed.b, test::no_require, {}).is_ok());
  for (const std::uint32_t v : test::active_ids(a.mesh)) {
    if (!model.store.is_root({v})) {
      EXPECT_TRUE(named.contains(v));
    }
  }
}

TEST(Certify, PassesOnWhatRequireReports) {
  const BakedModel model = test::bake_named("terrain");
  LocalModel a(model.store, model.header.grid), b(model.store, model.header.grid);
  const PosedPair posed = pose_pair(model.header.grid, {}, "a", model.header.grid, {}, "b").value();
  const Require gone = [](NodeSpan) { return Status{StatusCode::kIo, "gone"}; };
  const Result<Answer> answer = certify(a, posed.a, gone, b, posed.b, gone, {});
  ASSERT_FALSE(answer.is_ok());
  EXPECT_EQ(answer.status().code(), StatusCode::kIo);
}

TEST(Certify, SaysWhichSplitIsNotToBeHad) {
  const BakedModel model = test::bake_named("terrain");
  const SplitStore empty(model.header);
  LocalModel a(empty, model.header.grid), b(empty, model.header.grid);
  const PosedPair posed = pose_pair(model.header.grid, {}, "a", model.header.grid, {}, "b").value();
  const Result<Answer> answer =
      certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {});
  ASSERT_FALSE(answer.is_ok());
  EXPECT_EQ(answer.status().code(), StatusCode::kNotFound);
}

TEST(Certify, RepeatedTakesOneRound) {
  const BakedModel model = test::bake_named("terrain");
  LocalModel a(model.store, model.header.grid), b(model.store, model.header.grid);
  Random random(2);
  const PosedPair posed = test::near_pose(random, model, model);
  CertifyTimes first, second;
  ASSERT_TRUE(
      certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {}, &first).is_ok());
  ASSERT_TRUE(
      certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {}, &second).is_ok());
  EXPECT_EQ(second.rounds, 1U);
}

TEST(Certify, FromAFileNothingDecodedGivesTheSameAnswer) {
  const BakedModel model = test::bake_named("terrain"), other = test::bake_named("aircraft");
  const auto path_a = test::write_model(model), path_b = test::write_model(other);
  const test::FullModel full_a(model), full_b(other);
  Random random(3);
  for (int i = 0; i < 20; ++i) {
    Result<ModelFile> file_a = ModelFile::open(path_a->path()),
                      file_b = ModelFile::open(path_b->path());
    ASSERT_TRUE(file_a.is_ok() && file_b.is_ok());
    LocalModel a(file_a.value().store(), model.header.grid),
        b(file_b.value().store(), other.header.grid);
    const PosedPair posed = test::near_pose(random, model, other);
    const Result<Answer> answer = certify(
        a, posed.a, [&](NodeSpan node) { return file_a.value().require(node); }, b, posed.b,
        [&](NodeSpan node) { return file_b.value().require(node); }, {});
    ASSERT_TRUE(answer.is_ok()) << answer.status().message();
    EXPECT_TRUE(is_certified(answer.value().status));
    EXPECT_EQ(test::fault_of(answer.value(),
                             query(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b)),
              "");
  }
}

}  // namespace
}  // namespace nearmesh
