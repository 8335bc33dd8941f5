// SPDX-License-Identifier: Apache-2.0
// The bytes are a program of what a peer does with two bodies: single splits and collapses on a
// complete store for one, stored blocks, small batches, collapse and forget on a replica for the
// other, and queries in between. Holds: no answer contradicts the full meshes; trees that followed
// answer as trees made afresh; the state's hash is a function of the set of active vertices.

#include <map>

#include "core/refine/refined_mesh.hpp"
#include "core/spm/blocks.hpp"
#include "fuzz_models.hpp"

using namespace nearmesh;

namespace {

constexpr int kMaxOperations = 40;

struct Operation {
  std::uint8_t kind;
  std::uint32_t number;
};

/// The stored blocks of a model, as batches of the wire.
std::vector<SplitBatch> make_batches(const fuzz::FullModel& model) {
  std::vector<SplitBatch> batches;
  for (const NodeSpan& root : block_roots(model.store()))
    for (const BoxPolicy policy : {BoxPolicy::kAllNodes, BoxPolicy::kCutNodes})
      for (const std::size_t max_bytes : {std::size_t{80}, std::size_t{1000}})
        for (const auto& bytes :
             encode_batches(model.header(), model.store(), block_treelet(model.store(), root),
                            policy, max_bytes)) {
          Result<SplitBatch> batch = decode_batch(model.header(), bytes);
          FUZZ_CHECK(batch.is_ok());
          batches.push_back(std::move(batch).value());
        }
  return batches;
}

/// Answers of the full meshes, each asked once.
const Answer& full_answer(std::size_t a, std::size_t b, std::uint32_t pose) {
  static std::map<std::array<std::size_t, 3>, Answer> known;
  const auto [at, is_new] = known.try_emplace({a, b, pose});
  if (is_new) {
    const auto &model_a = fuzz::models()[a], &model_b = fuzz::models()[b];
    const PosedPair posed = fuzz::make_pair(model_a, model_b, pose);
    at->second = query(model_a.tree.view(), posed.a, model_b.tree.view(), posed.b);
  }
  return at->second;
}

class Program {
 public:
  Program(std::size_t a, std::size_t b)
      : a_(a),
        b_(b),
        mesh_(model_a().store()),
        tree_(mesh_),
        replica_(model_b().header()),
        replica_tree_(replica_.mesh()) {}

  void run(const Operation& operation) {
    const std::uint32_t vertex_a = operation.number % model_a().vertex_count();
    const std::uint32_t vertex_b = operation.number % model_b().vertex_count();
    switch (operation.kind % 8) {
      case 0:
      case 1: {
        RefineDelta delta;
        FUZZ_CHECK(mesh_.split({vertex_a}, delta));
        tree_.update(delta);
        break;
      }
      case 2: {
        RefineDelta delta;
        mesh_.collapse(node_around(mesh_, vertex_a, operation.number / 256 % 8), delta);
        tree_.update(delta);
        break;
      }
      case 3:
      case 4: {
        static const std::vector<std::vector<SplitBatch>> batches = [] {
          std::vector<std::vector<SplitBatch>> made;
          for (const fuzz::FullModel& model : fuzz::models()) made.push_back(make_batches(model));
          return made;
        }();
        const SplitBatch& batch = batches[b_][operation.number % batches[b_].size()];
        const RefinedMesh::Applied applied = replica_.apply_batch(batch);
        FUZZ_CHECK(applied.status.is_ok());
        replica_tree_.update(applied.delta);
        break;
      }
      case 5: {
        const NodeSpan node = node_around(replica_.mesh(), vertex_b, operation.number / 256 % 8);
        replica_tree_.update(replica_.collapse(node));
        if (replica_.mesh().is_current(node) && operation.kind >= 128) replica_.forget(node);
        break;
      }
      case 6: {  // all that the answer lacks of one body
        const Answer answer = ask(operation.number % 16, tree_, replica_tree_);
        RefineDelta delta;
        for (const NodeSpan& node : answer.missing_a)
          FUZZ_CHECK(mesh_.split(mesh_.store().split_of(node), delta));
        tree_.update(delta);
        break;
      }
      default:
        check(operation.number % 16);
    }
  }

  void check(std::uint32_t pose) const {
    const Answer answer = ask(pose, tree_, replica_tree_);
    fuzz::check_never_wrong(answer, full_answer(a_, b_, pose));
    const Answer afresh = ask(pose, AbTree(mesh_), AbTree(replica_.mesh()));
    FUZZ_CHECK(digest(answer) == digest(afresh));
    fuzz::check_mesh(mesh_);
    fuzz::check_mesh(replica_.mesh());
  }

 private:
  [[nodiscard]] const fuzz::FullModel& model_a() const { return fuzz::models()[a_]; }
  [[nodiscard]] const fuzz::FullModel& model_b() const { return fuzz::models()[b_]; }
  [[nodiscard]] Answer ask(std::uint32_t pose, const AbTree& tree_a, const AbTree& tree_b) const {
    const PosedPair posed = fuzz::make_pair(model_a(), model_b(), pose);
    return query(tree_a.view(model_a().header().grid), posed.a,
                 tree_b.view(model_b().header().grid), posed.b);
  }
  /// The node that stands for the vertex now, or one `steps` above it.
  static NodeSpan node_around(const ActiveMesh& mesh, std::uint32_t vertex, std::uint32_t steps) {
    NodeSpan node = mesh.current_node(mesh.active_predecessor({vertex}));
    for (; steps > 0; --steps) {
      const NodeSpan parent = mesh.store().parent_of(node);
      if (parent.size == 0) break;
      node = parent;
    }
    return node;
  }

  std::size_t a_, b_;
  ActiveMesh mesh_;
  AbTree tree_;
  RefinedMesh replica_;
  AbTree replica_tree_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::FuzzInput in(data, size);
  const std::uint8_t choice = in.byte();
  const std::size_t count = fuzz::models().size();
  Program program(choice % count, choice / count % count);
  for (int i = 0; i < kMaxOperations && !in.is_empty(); ++i)
    program.run({in.byte(), in.number<std::uint16_t>()});
  program.check(choice % 16);
  return 0;
}
