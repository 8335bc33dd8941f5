// SPDX-License-Identifier: Apache-2.0
#include "core/demand/answer.hpp"

#include <algorithm>

#include "brute_force.hpp"

namespace nearmesh {
namespace {

using Batches = std::vector<std::vector<std::uint8_t>>;

// For everything, from the roots.
RegionRequest request_for_all(const BakedModel& model, std::uint32_t max_splits) {
  RegionRequest request{.max_splits = max_splits};
  const std::int32_t most = model.store.grid_max();
  request.region = {GridBox{{{0, 0, 0}}, {{most, most, most}}}};
  for (const BaseRoot& root : model.header.roots)
    if (root.node.size > 1) request.attach.push_back(root.node);
  return request;
}

struct Made {
  Batches batches;
  int parts = 0;
};
Made make(const BakedModel& model, const RegionRequest& request) {
  AnswerMaker maker(model.header, model.store, request, test::no_require);
  Made made;
  while (!maker.is_done()) {
    Batches part = maker.next().value();
    EXPECT_FALSE(made.parts > 1000) << "no end";
    ++made.parts;
    for (auto& batch : part) made.batches.push_back(std::move(batch));
  }
  return made;
}

TEST(AnswerMaker, SmallAnswersAreTheSameAndWholeAtOnce) {
  const BakedModel model = test::bake_mesh(generate_terrain(64, 7), 16);
  for (const std::uint32_t splits : {1U, 50U, 240U}) {
    const RegionRequest request = request_for_all(model, splits);
    const Made made = make(model, request);
    EXPECT_EQ(made.batches,
              answer_request(model.header, model.store, request, test::no_require).value());
    EXPECT_EQ(made.parts, 1);
  }
}

TEST(AnswerMaker, LargeAnswersComeInPartsOfTheSameBatches) {
  const BakedModel model = test::bake_mesh(generate_terrain(64, 7), 16);
  ASSERT_GT(model.header.split_count(), 2 * AnswerMaker::kPartSplits);
  for (const std::uint32_t splits : {1000U, 2500U, kMaxRequestSplits}) {
    const RegionRequest request = request_for_all(model, splits);
    const Made made = make(model, request);
    EXPECT_EQ(made.batches,
              answer_request(model.header, model.store, request, test::no_require).value());
    EXPECT_GE(made.parts, 5);
  }
}

TEST(AnswerMaker, EndsWithTheErrorOfTheFile) {
  const BakedModel model = test::bake_mesh(generate_terrain(64, 7), 16);
  int left = 1000;
  AnswerMaker maker(model.header, model.store, request_for_all(model, kMaxRequestSplits),
                    [&](NodeSpan) {
                      return --left > 0 ? Status::ok() : Status{StatusCode::kCorrupt, "damaged"};
                    });
  Status last;
  for (int part = 0; part < 100 && last.is_ok(); ++part) last = maker.next().status();
  EXPECT_EQ(last.message(), "damaged");
  EXPECT_TRUE(maker.is_done());
}

TEST(Collector, StepByStepFindsWhatOneWalkFinds) {
  const BakedModel model = test::bake_mesh(generate_terrain(64, 7), 16);
  for (const std::uint32_t splits : {1U, 300U, kMaxRequestSplits}) {
    const RegionRequest request = request_for_all(model, splits);
    const Demand whole = collect(model.store, request, nullptr).value();
    Collector collector(model.store, request, nullptr, AttachRule::kInRegion);
    int steps = 1;
    while (!collector.advance(3).value()) ++steps;
    Demand found = collector.take();
    EXPECT_EQ(found.truncated, whole.truncated);
    EXPECT_EQ(found.missing, whole.missing);
    ASSERT_EQ(found.treelet.size(), whole.treelet.size());
    std::sort(found.treelet.begin(), found.treelet.end(),
              [](const TreeletSplit& a, const TreeletSplit& b) { return a.node < b.node; });
    for (std::size_t i = 0; i < whole.treelet.size(); ++i) {
      EXPECT_EQ(found.treelet[i].node, whole.treelet[i].node);
      EXPECT_EQ(found.treelet[i].left_included, whole.treelet[i].left_included);
      EXPECT_EQ(found.treelet[i].right_included, whole.treelet[i].right_included);
    }
    EXPECT_GE(static_cast<std::size_t>(steps), whole.treelet.size() / 3);
  }
}

}  // namespace
}  // namespace nearmesh
