// SPDX-License-Identifier: Apache-2.0
// A peer's run: refinement in both directions, demand, answers with their clearance, down to the
// last bit.
#include "jobs.hpp"
#include "random_policies.hpp"

namespace nearmesh::digest_jobs {
namespace {

struct Names {
  const char *a, *b;
};
constexpr Names kPairs[] = {{"terrain", "aircraft"},  {"sphere", "sphere"},
                            {"soup", "components"},   {"degenerate", "aircraft"},
                            {"aircraft", "aircraft"}, {"book", "sphere"},
                            {"terrain", "components"}};

// Splits and collapses without end; an answer after each.
std::uint64_t refined(const Names& names) {
  const BakedModel model_a = test::bake_named(names.a), model_b = test::bake_named(names.b);
  LocalModel a(model_a.store, model_a.header.grid), b(model_b.store, model_b.header.grid);
  Random random(31);
  Digest digest;
  for (int i = 0; i < 60; ++i) {
    for (LocalModel* local : {&a, &b}) {
      test::collapse_some(*local, random);
      if (i % 20 == 19) test::collapse_to_base(*local);
      test::split_random(*local, random);
      digest.add(local->mesh.state_hash());
    }
    const PosedPair posed = test::near_pose(random, model_a, model_b);
    digest.add(nearmesh::digest(query(a.view(), posed.a, b.view(), posed.b)));
  }
  return digest.value();
}

// From the base to a certified answer, statistics included: the walk itself must be the same.
std::uint64_t certified(const Names& names) {
  const BakedModel model_a = test::bake_named(names.a), model_b = test::bake_named(names.b);
  Random random(32);
  Digest digest;
  for (int i = 0; i < 30; ++i) {
    LocalModel a(model_a.store, model_a.header.grid), b(model_b.store, model_b.header.grid);
    const PosedPair posed = test::near_pose(random, model_a, model_b);
    const Result<Answer> answer =
        certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {});
    if (!answer.is_ok()) return 0;
    digest.add(nearmesh::digest(answer.value()));
    digest.add_bits(answer.value().clearance_m);
    digest.add(answer.value().stats.box_tests);
    digest.add(answer.value().stats.triangle_tests);
    digest.add(a.mesh.state_hash());
    digest.add(b.mesh.state_hash());
  }
  return digest.value();
}

// What regions need, and what a peer that has some of it still lacks.
std::uint64_t demanded(const std::string& name) {
  const BakedModel model = test::bake_named(name);
  Random random(33);
  Digest digest;
  for (int i = 0; i < 30; ++i) {
    const GridBox region = test::random_region(model.store, random);
    const std::uint32_t most = 1 + random.below(1000);
    const Result<Demand> demand =
        collect(model.store, test::request_region(model.store, region, most), nullptr);
    if (!demand.is_ok()) return 0;
    for (const TreeletSplit& split : demand.value().treelet)
      digest.add(std::uint64_t{split.split.value} << 2 | (split.left_included ? 2U : 0U) |
                 (split.right_included ? 1U : 0U));
    test::Body body(model.header);
    for (const auto& bytes : encode_batches(model.header, model.store, demand.value().treelet,
                                            BoxPolicy::kCutNodes, 300))
      if (random.below(4) > 0) body.apply(bytes);
    for (const NodeSpan& node : unresolved_in(body.replica.store(), {{region}}, 100))
      digest.add(std::uint64_t{node.begin()} << 32 | node.size);
  }
  return digest.value();
}

// A peer with a bad link that forgets, too.
std::uint64_t streamed(const Names& names) {
  const BakedModel model_a = test::bake_named(names.a), model_b = test::bake_named(names.b);
  test::Body a(model_a.header), b(model_b.header);
  Random random(34);
  Digest digest;
  for (int i = 0; i < 30; ++i) {
    const PosedPair posed = test::near_pose(random, model_a, model_b);
    for (int round = 0; round < 6; ++round) {
      const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
      digest.add(nearmesh::digest(answer));
      if (is_certified(answer.status)) break;
      const auto ask = [&random](const BakedModel& model, test::Body& body,
                                 const std::vector<NodeSpan>& missing) {
        const auto request =
            test::request_missing(body.replica.store(), missing, 1 + random.below(300));
        test::deliver(body, test::serve(model, request, 400), random);
      };
      ask(model_a, a, answer.missing_a);
      ask(model_b, b, answer.missing_b);
    }
    a.evict_some(random);
    b.evict_some(random);
    digest.add(a.replica.mesh().state_hash());
    digest.add(b.replica.mesh().state_hash());
  }
  return digest.value();
}

}  // namespace

std::vector<Job> answer_jobs() {
  std::vector<Job> jobs;
  for (const Names& names : kPairs) {
    const std::string name = std::string(names.a) + "_" + names.b;
    jobs.push_back({"refine." + name, [names] { return refined(names); }});
    jobs.push_back({"certify." + name, [names] { return certified(names); }});
    jobs.push_back({"stream." + name, [names] { return streamed(names); }});
  }
  for (const std::string& name : test::mesh_names())
    jobs.push_back({"demand." + name, [name] { return demanded(name); }});
  return jobs;
}

}  // namespace nearmesh::digest_jobs
