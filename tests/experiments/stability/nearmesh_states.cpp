// SPDX-License-Identifier: Apache-2.0
// nearmesh's promises about states: stored bounds, and answers that do not depend on how a state
// was reached.
#include "bound_checker.hpp"
#include "core/base/hash.hpp"
#include "core/base/random.hpp"
#include "nearmesh_questions.hpp"

namespace nearmesh::stability {
namespace {

constexpr std::size_t kLevels = 24;
constexpr int kSteps = 40;

/// A few splits, or a node collapsed.
void change(LocalModel& model, Random& random) {
  const SplitStore& store = model.mesh.store();
  RefineDelta delta;
  const bool refines = random.below(3) != 0;
  for (std::uint32_t n = 1 + random.below(refines ? 60 : 3); n > 0; --n) {
    const VertexId u{random.below(store.vertex_count())};
    if (store.is_root(u)) continue;
    if (refines) {
      [[maybe_unused]] const bool done = model.mesh.split(u, delta);
      NEARMESH_ASSERT(done);
    } else {
      // A delta says what collapsed before what was split: one operation each.
      RefineDelta collapsed;
      model.mesh.collapse(store.node_of(u), collapsed);
      model.tree.update(collapsed);
    }
  }
  if (!delta.is_empty()) model.tree.update(delta);
}

/// The same state reached from the base in one go, in an order of its own.
void rebuild(LocalModel& model, const ActiveMesh& wanted, Random& random) {
  std::vector<VertexId> splits;
  for (const TreeletSplit& split : active_treelet(wanted)) splits.push_back(split.split);
  for (std::size_t i = splits.size(); i > 1; --i)
    std::swap(splits[i - 1], splits[random.below(static_cast<std::uint32_t>(i))]);
  refine(model, splits);
}

}  // namespace

NearmeshAnswer ask_bounds(const Model& model) {
  return {.verdict = {.kind = Verdict::Kind::kFree},
          .trouble = test::check_bounds(model.baked.store, kLevels)};
}

NearmeshAnswer ask_incremental(const Case& asked, const Model& model_a, const Model& model_b,
                               const PosedPair& posed) {
  const SplitStore &store_a = model_a.baked.store, &store_b = model_b.baked.store;
  LocalModel a(store_a, model_a.baked.header.grid), b(store_b, model_b.baked.header.grid);
  NearmeshAnswer out{.verdict = {.kind = Verdict::Kind::kFree}};
  Random random(
      hash_bytes({reinterpret_cast<const std::uint8_t*>(asked.name.data()), asked.name.size()}));
  for (int step = 0; step < kSteps && out.trouble.empty(); ++step) {
    change(random.below(2) == 0 ? a : b, random);
    LocalModel fresh_a(store_a, a.grid), fresh_b(store_b, b.grid);
    rebuild(fresh_a, a.mesh, random);
    rebuild(fresh_b, b.mesh, random);
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
    const Answer fresh = query(fresh_a.view(), posed.a, fresh_b.view(), posed.b);
    if (digest(answer) != digest(fresh))
      out.trouble = "step " + std::to_string(step) + ": not the answer from scratch";
    if (digest(query(a.view(), posed.a, b.view(), posed.b)) != digest(answer))
      out.trouble = "step " + std::to_string(step) + ": another answer to the same query";
  }
  return out;
}

}  // namespace nearmesh::stability
