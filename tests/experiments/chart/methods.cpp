// SPDX-License-Identifier: Apache-2.0
#include "methods.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <map>

#include "core/base/stopwatch.hpp"
#include "core/certificate/certificate.hpp"
#include "core/program/grid_cells.hpp"
#include "core/refine/refined_mesh.hpp"
#include "core/spm/packed_certificate.hpp"
#include "hoppe.hpp"
#include "nearmesh/core/abtree/detail/ab_tree.hpp"
#include "tests/experiments/perf/served.hpp"

namespace nearmesh::chart {
namespace {

using Batches = std::vector<std::vector<std::uint8_t>>;

/// Two headers come in one datagram, where the second needs no IP, UDP and RTPS headers of its own.
/// Measured on a capture.
constexpr std::uint64_t kSharedHeaderBytes = 64;

// The splits in the reverse order of the collapses: the progressive mesh as it was made. Where
// vertices share a place, so that the log cannot be followed by positions, the largest nodes first.
std::vector<VertexId> collapse_order(const perf::Model& model) {
  const SplitStore& store = model.baked.store;
  const Grid& grid = model.baked.header.grid;
  std::map<GridPoint, VertexId> ids;
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v) ids[store.position({v})] = {v};
  if (ids.size() < store.vertex_count()) return global_order(store, 0xffffffffU);
  std::vector<VertexId> order;
  const auto& collapses = model.baked.log.collapses;
  for (auto at = collapses.rbegin(); at != collapses.rend(); ++at) {
    GridPoint p;
    for (std::size_t k = 0; k < 3; ++k)
      p.v[k] = static_cast<std::int32_t>(
          std::ldexp(model.mesh.positions_m[at->removed][k] - grid.origin_m[k], -grid.exponent));
    order.push_back(ids.at(p));
  }
  return order;
}

// Splits in an order with parents first, as batches: whoever has the first ones has a mesh. In
// preorder within each of a few levels: a batch names the nodes that it hangs on, so that an order
// split by split would cost twice the bytes.
Batches encode_in_order(const perf::Model& model, std::span<const VertexId> order) {
  const SplitStore& store = model.baked.store;
  Batches batches;
  for (std::size_t done = 0; done < order.size();) {
    const std::size_t count = std::min(order.size() - done, std::max<std::size_t>(256, 3 * done));
    std::vector<NodeSpan> nodes;
    for (const VertexId u : order.subspan(done, count)) nodes.push_back(store.node_of(u));
    std::sort(nodes.begin(), nodes.end());
    const auto included = [&](NodeSpan node) {
      return std::binary_search(nodes.begin(), nodes.end(), node);
    };
    Treelet treelet;
    for (const NodeSpan& node : nodes) {
      const VertexId u = store.split_of(node);
      treelet.push_back({node, u, included(node.left_of(u)), included(node.right_of(u))});
    }
    for (auto& batch : encode_batches(model.baked.header, store, treelet, BoxPolicy::kCutNodes))
      batches.push_back(std::move(batch));
    done += count;
  }
  return batches;
}

// One body on the peer's side.
class Body {
 public:
  Body(const perf::Model& model, bool streamed)
      : model_(&model),
        streamed_(streamed),
        header_bytes_(streamed ? framed(encode_header(model.baked.header).size()) : 0) {}

  void start() {
    replica_.reset();
    if (streamed_) replica_.emplace(model_->baked.header);
    coarse_.reset();
  }
  [[nodiscard]] bool streamed() const { return streamed_; }
  [[nodiscard]] std::uint64_t header_bytes() const { return header_bytes_; }
  [[nodiscard]] const perf::Model& model() const { return *model_; }
  [[nodiscard]] const RefinedMesh& replica() const { return *replica_; }

  RefineDelta apply(const std::vector<std::uint8_t>& bytes, State& state) {
    Stopwatch watch;
    const SplitBatch batch = decode_batch(model_->baked.header, bytes).value();
    state.load_s += watch.lap();
    RefinedMesh::Applied applied = replica_->apply_batch(batch);
    state.refine_s += watch.lap();
    state.splits += applied.delta.split.size();
    coarse_.reset();
    return std::move(applied.delta);
  }
  // All faces of the current mesh, exact or not. Built anew where something came: the paper refits,
  // so its T_B is less.
  const TriangleTree& tree(State& state) {
    if (!streamed_) return model_->tree;
    if (!coarse_) {
      const Stopwatch watch;
      const std::vector<TreeFace> faces = current_triangles(replica_->mesh());
      coarse_faces_ = faces.size();
      coarse_.emplace(build_triangle_tree(model_->baked.header.grid, faces));
      state.tree_s += watch.seconds();
    }
    return *coarse_;
  }
  void weigh(State& state) const {
    if (!streamed_ || !coarse_) return;
    state.faces_held += coarse_faces_;
    state.tree_bytes +=
        coarse_->nodes.size() * sizeof(TreeNode) + coarse_->blocks.size() * sizeof(FaceBlock);
  }

 private:
  const perf::Model* model_;
  bool streamed_;
  std::uint64_t header_bytes_, coarse_faces_ = 0;
  std::optional<RefinedMesh> replica_;
  std::optional<TriangleTree> coarse_;
};

// Bodies, and batches on their way to them.
class Stream : public Method {
 public:
  explicit Stream(const Scene& scene)
      : bodies_{Body(scene.a, true), Body(scene.b, scene.b_streamed)} {}

  void start() override {
    for (Body& body : bodies_) body.start();
    state_ = State{.bytes = bodies_[0].header_bytes() + bodies_[1].header_bytes()};
    if (bodies_[0].streamed() && bodies_[1].streamed()) state_.bytes -= kSharedHeaderBytes;
    queue_.clear();
  }
  State receive(const Bodies& bodies, const PosedPair& posed, std::uint64_t max_bytes) override {
    if (state_.bytes > max_bytes) return state_;  // still without base meshes
    state_.finished = false;
    ++version_;
    while (true) {
      take(max_bytes);
      if (!queue_.empty()) break;
      room_ = {};
      if (!ask(bodies, posed)) break;
    }
    answer(posed);
    state_.finished = queue_.empty() && state_.finished;
    return state_;
  }

 protected:
  // Queues what the peer asks for next; false, with state_.finished, where there is nothing.
  virtual bool ask(const Bodies& bodies, const PosedPair& posed) = 0;
  virtual void answer(const PosedPair& posed) { guess(posed); }
  virtual void applied(std::size_t /*body*/, const RefineDelta& /*delta*/) {}

  void queue(std::size_t body, Batches batches) {
    for (std::vector<std::uint8_t>& batch : batches) {
      const std::size_t wire_bytes = room_.add(batch.size() + kSealBytes);
      queue_.push_back({body, std::move(batch), wire_bytes});
    }
  }
  [[nodiscard]] bool has_all() const { return queue_.empty(); }
  // By the faces that there are, coarse or not.
  void guess(const PosedPair& posed) {
    if (guessed_ == version_) return;
    guessed_ = version_;
    const TriangleTree &a = bodies_[0].tree(state_), &b = bodies_[1].tree(state_);
    const Stopwatch watch;
    Answer answer = query(a.view(), posed.a, b.view(), posed.b, {.clearance = Clearance::kNone});
    state_.query_s += watch.seconds();
    state_.answers = true;
    state_.contacts = find_contacts(a.view(), posed.a, b.view(), posed.b, answer);
    state_.pairs = std::move(answer.pairs);
    state_.faces_held = state_.tree_bytes = 0;
    for (const Body& body : bodies_) body.weigh(state_);
  }

  std::array<Body, 2> bodies_;
  State state_;
  std::uint64_t version_ = 0;  // of poses and what has come

 private:
  void take(std::uint64_t max_bytes) {
    while (!queue_.empty()) {
      const Queued& next = queue_.front();
      if (state_.bytes + next.wire_bytes > max_bytes) return;
      state_.bytes += next.wire_bytes;
      applied(next.body, bodies_[next.body].apply(next.batch, state_));
      queue_.pop_front();
      ++version_;
    }
  }
  struct Queued {
    std::size_t body;
    std::vector<std::uint8_t> batch;
    std::size_t wire_bytes;
  };
  std::deque<Queued> queue_;
  SampleRoom room_;            // of the answer that is queued
  std::uint64_t guessed_ = 0;  // version of the last guess
};

// ---- global refinement and static levels --------------------------------------------------------

// Largest nodes first, everywhere; both bodies in turn.
class Global : public Stream {
 public:
  explicit Global(const Scene& scene) : Stream(scene) {
    for (std::size_t i = 0; i < 2; ++i)
      if (bodies_[i].streamed())
        batches_[i] = encode_in_order(bodies_[i].model(),
                                      global_order(bodies_[i].model().baked.store, 0xffffffffU));
  }
  void start() override {
    Stream::start();
    asked_ = false;
  }

 protected:
  bool ask(const Bodies& /*bodies*/, const PosedPair& /*posed*/) override {
    if (asked_) {
      state_.finished = true;
      return false;
    }
    asked_ = true;  // who joins is sent all of it
    for (std::size_t at = 0; at < std::max(batches_[0].size(), batches_[1].size()); ++at)
      for (std::size_t i = 0; i < 2; ++i)
        if (at < batches_[i].size()) queue(i, {batches_[i][at]});
    return true;
  }

  std::array<Batches, 2> batches_;

 private:
  bool asked_ = false;
};

// A level of detail as a mesh of its own: of no use before all of it has come.
class StaticLevel : public Global {
 public:
  StaticLevel(const Scene& scene, double share) : Global(scene) {
    for (std::size_t i = 0; i < 2; ++i) {
      if (!bodies_[i].streamed()) continue;
      const BakedModel& model = bodies_[i].model().baked;
      ActiveMesh mesh(model.store);
      RefineDelta delta;
      for (const VertexId u : global_order(
               model.store, static_cast<std::uint32_t>(share * model.header.split_count())))
        static_cast<void>(mesh.split(u, delta));
      batches_[i] =
          encode_batches(model.header, model.store, active_treelet(mesh), BoxPolicy::kCutNodes);
    }
  }

 protected:
  void answer(const PosedPair& posed) override {
    if (has_all()) guess(posed);
  }
};

// ---- the paper's grid ---------------------------------------------------------------------------

enum class Closure : std::uint8_t { kHoppe, kAncestors };

class Grid3 : public Stream {
 public:
  Grid3(const Scene& scene, int cells, Closure closure) : Stream(scene) {
    for (std::size_t i = 0; i < 2; ++i) {
      if (!bodies_[i].streamed()) continue;
      const SplitStore& store = bodies_[i].model().baked.store;
      cells_[i].emplace(store, cells);
      if (closure == Closure::kHoppe) rules_[i].emplace(store, collapse_order(bodies_[i].model()));
    }
  }
  void start() override {
    Stream::start();
    for (std::size_t i = 0; i < 2; ++i) {
      done_[i].clear();
      if (bodies_[i].streamed()) sent_[i].emplace(bodies_[i].model().baked.store);
    }
  }

 protected:
  bool ask(const Bodies& /*bodies*/, const PosedPair& posed) override {
    guess(posed);
    bool more = false;
    for (std::size_t i = 0; i < 2; ++i) {
      if (!bodies_[i].streamed()) continue;
      std::set<int> touched;
      for (const FacePair& pair : state_.pairs)
        cells_[i]->touched(
            program::current_box(bodies_[i].replica().mesh(), i == 0 ? pair.a : pair.b), touched);
      const RefineDelta delta = refine(i, touched);
      if (delta.split.empty()) continue;
      more = true;
      state_.request_bytes += 4 * touched.size();
      std::vector<VertexId> order = delta.split;  // coarse first, as a progressive mesh is sent
      const SplitStore& store = bodies_[i].model().baked.store;
      std::stable_sort(order.begin(), order.end(), [&](VertexId x, VertexId y) {
        return store.node_of(x).size > store.node_of(y).size;
      });
      queue(i, encode_in_order(bodies_[i].model(), order));
    }
    if (more) ++state_.requests;
    state_.finished = !more;
    return more;
  }

 private:
  // The server's walk: what makes every vertex of the new cells active and alone.
  RefineDelta refine(std::size_t i, const std::set<int>& touched) {
    RefineDelta delta;
    ActiveMesh& mesh = *sent_[i];
    const auto split = [&](VertexId u) {
      if (rules_[i]) {
        rules_[i]->split(mesh, u, delta);
      } else {
        static_cast<void>(mesh.split(u, delta));
      }
    };
    for (const int cell : touched) {
      if (!done_[i].insert(cell).second) continue;
      for (const VertexId v : cells_[i]->vertices(cell)) {
        if (!mesh.store().is_root(v)) split(v);
        while (!mesh.is_resolved(v)) split(mesh.store().split_of(mesh.current_node(v)));
      }
    }
    return delta;
  }

  std::array<std::optional<program::GridCells>, 2> cells_;
  std::array<std::optional<HoppeRule>, 2> rules_;
  std::array<std::optional<ActiveMesh>, 2> sent_;
  std::array<std::set<int>, 2> done_;
};

// ---- certified ----------------------------------------------------------------------------------

// As a peer's Session asks: it says where the bodies are, and the publisher chooses. `kLeast`:
// nothing but the splits that the answer names, round after round.
class Certified : public Stream {
 public:
  enum class Choice : std::uint8_t { kPublisher, kLeast };

  Certified(const Scene& scene, Choice choice, double lookahead_s = 0)
      : Stream(scene),
        choice_(choice),
        lookahead_s_(lookahead_s),
        served_{perf::Served(scene.a.baked), perf::Served(scene.b.baked)} {}

  void start() override {
    for (auto& tree : trees_) tree.reset();
    Stream::start();
    answer_ = {};
    for (std::size_t i = 0; i < 2; ++i) {
      mirrors_[i] = bodies_[i].streamed() ? served_[i].fresh() : served_[i].whole();
      if (bodies_[i].streamed()) trees_[i].emplace(bodies_[i].replica().mesh());
    }
  }

 protected:
  void applied(std::size_t body, const RefineDelta& delta) override {
    const Stopwatch watch;
    trees_[body]->update(delta);
    state_.tree_s += watch.seconds();
  }
  bool ask(const Bodies& bodies, const PosedPair& posed) override {
    exact(posed);
    if (is_certified(answer_.status)) {
      state_.finished = true;
      return false;
    }
    const bool asked = choice_ == Choice::kLeast ? ask_least() : ask_certificate(bodies);
    if (asked) ++state_.requests;
    return asked;
  }
  void answer(const PosedPair& posed) override {
    exact(posed);
    state_.claim = answer_.status;
    if (!is_certified(answer_.status)) return guess(posed);
    state_.answers = true;
    state_.contacts = find_contacts(view(0), posed.a, view(1), posed.b, answer_);
    state_.pairs = answer_.pairs;
    state_.faces_held = state_.tree_bytes = 0;
    for (std::size_t i = 0; i < 2; ++i) {
      if (!trees_[i]) continue;
      const AbTreeStats stats = trees_[i]->stats();
      state_.faces_held += stats.exact_faces;
      state_.tree_bytes += stats.bytes;
    }
  }

 private:
  bool ask_certificate(const Bodies& bodies) {
    CertificateRequest request{
        .horizon_s = static_cast<float>(lookahead_s_), .models = {}, .pairs = {}};
    for (const auto& mirror : mirrors_)
      request.models.push_back({mirror->file().content_hash(), mirror->state(), {}});
    request.pairs = {relative(bodies.a, bodies.b)};
    request.pairs[0].b = 1;
    state_.request_bytes += pack_certificate(request).size();
    CertificateMaker maker(std::move(request), {mirrors_[0], mirrors_[1]});
    while (!maker.is_done()) {
      CertificateMaker::Part part = maker.next().value();
      queue(part.model, std::move(part.batches));
    }
    return !has_all();
  }
  bool ask_least() {
    for (std::size_t i = 0; i < 2; ++i) {
      if (!bodies_[i].streamed()) continue;
      const std::vector<NodeSpan>& missing = i == 0 ? answer_.missing_a : answer_.missing_b;
      const BakedModel& model = bodies_[i].model().baked;
      Treelet treelet;
      for (const NodeSpan& node : missing)
        treelet.push_back({node, model.store.split_of(node), false, false});
      state_.request_bytes += 8 * missing.size();
      queue(i, encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes));
    }
    return !has_all();
  }
  [[nodiscard]] TreeView view(std::size_t i) const {
    return trees_[i] ? trees_[i]->view(bodies_[i].model().baked.header.grid)
                     : bodies_[i].model().tree.view();
  }
  void exact(const PosedPair& posed) {
    if (exact_ == version_) return;
    exact_ = version_;
    const Stopwatch watch;
    answer_ = query(view(0), posed.a, view(1), posed.b, {.clearance = Clearance::kNone});
    state_.query_s += watch.seconds();
  }

  Choice choice_;
  double lookahead_s_;
  std::array<perf::Served, 2> served_;
  std::array<std::shared_ptr<Mirror>, 2> mirrors_;
  std::array<std::optional<AbTree>, 2> trees_;
  Answer answer_;
  std::uint64_t exact_ = 0;  // version of answer_
};

}  // namespace

std::uint64_t framed(std::uint64_t payload) {
  return payload + (payload + kMaxBatchBytes - 1) / kMaxBatchBytes * kBatchFramingBytes;
}

const std::vector<MethodInfo>& methods() {
  using Made = std::unique_ptr<Method>;
  static const std::vector<MethodInfo> all{
      {"static-1/256", "none",
       [](const Scene& s) -> Made { return std::make_unique<StaticLevel>(s, 1.0 / 256); }},
      {"static-1/64", "none",
       [](const Scene& s) -> Made { return std::make_unique<StaticLevel>(s, 1.0 / 64); }},
      {"static-1/16", "none",
       [](const Scene& s) -> Made { return std::make_unique<StaticLevel>(s, 1.0 / 16); }},
      {"static-1/4", "none",
       [](const Scene& s) -> Made { return std::make_unique<StaticLevel>(s, 1.0 / 4); }},
      {"static-full", "none",
       [](const Scene& s) -> Made { return std::make_unique<StaticLevel>(s, 1); }},
      {"global", "none", [](const Scene& s) -> Made { return std::make_unique<Global>(s); }},
      {"grid8-hoppe", "none",
       [](const Scene& s) -> Made { return std::make_unique<Grid3>(s, 8, Closure::kHoppe); }},
      {"grid8", "none",
       [](const Scene& s) -> Made { return std::make_unique<Grid3>(s, 8, Closure::kAncestors); }},
      {"grid16", "none",
       [](const Scene& s) -> Made { return std::make_unique<Grid3>(s, 16, Closure::kAncestors); }},
      {"grid32", "none",
       [](const Scene& s) -> Made { return std::make_unique<Grid3>(s, 32, Closure::kAncestors); }},
      {"certified", "client",
       [](const Scene& s) -> Made {
         return std::make_unique<Certified>(s, Certified::Choice::kPublisher);
       }},
      {"certified-ahead", "client",
       [](const Scene& s) -> Made {
         return std::make_unique<Certified>(s, Certified::Choice::kPublisher, kLookahead_s);
       },
       true},
      {"certified-least", "client",
       [](const Scene& s) -> Made {
         return std::make_unique<Certified>(s, Certified::Choice::kLeast);
       }},
      {"clusters-checked", "client", make_checked_rival},
      {"clusters-chosen", "client", make_chosen_rival},
      {"clusters-chosen-ahead", "client", make_rival_ahead, true},
      {"triangles-trusted", "server", make_trusted_rival},
  };
  return all;
}

}  // namespace nearmesh::chart
