// SPDX-License-Identifier: Apache-2.0
#include "query_methods.hpp"

#include <algorithm>
#include <set>

#include "core/base/stopwatch.hpp"
#include "grid_cells.hpp"

namespace nearmesh::program {
namespace {

Result<std::uint64_t> wire_bytes(const SpmHeader& header, const ActiveMesh& mesh) {
  std::uint64_t bytes = 0;
  for (const auto& batch :
       encode_batches(header, mesh.store(), active_treelet(mesh), BoxPolicy::kCutNodes))
    bytes += batch.size() + kBatchFramingBytes;
  return bytes;
}

Status split_all(ActiveMesh& mesh, const std::vector<VertexId>& splits, RefineDelta& delta) {
  for (const VertexId u : splits)
    if (!mesh.split(u, delta))
      return {StatusCode::kCorrupt, "split " + std::to_string(u.value) + " is missing"};
  return Status::ok();
}

// ---- one mesh for all poses: full, base, global -------------------------------------------------

class FixedMeshes : public QueryMethod {
 public:
  FixedMeshes(ModelFile& a, ModelFile& b, const QueryMethodOptions& options, std::uint32_t splits)
      : a_(a), b_(b), options_(options), splits_(splits) {}

  Result<MethodAnswer> answer(const PosedPair& posed) override {
    MethodAnswer result;
    if (!ready_) NEARMESH_RETURN_IF_ERROR(prepare(result));
    ready_ = true;
    result.splits = split_count_;
    result.bytes = bytes_;
    Stopwatch watch;
    result.answer = query(tree_a_.view(), posed.a, tree_b_.view(), posed.b, options_.query);
    result.query_s = watch.lap();
    if (options_.contacts) {
      result.contacts =
          splits_ == kAllSplits
              ? find_contacts(tree_a_.view(), posed.a, tree_b_.view(), posed.b, result.answer)
              : approximate_contacts(*mesh_a_, posed.a, *mesh_b_, posed.b,
                                     options_.query.max_pairs);
      result.contacts_s = watch.seconds();
    }
    return result;
  }

  static constexpr std::uint32_t kAllSplits = 0xffffffffU;

 private:
  Status prepare(MethodAnswer& result) {
    NEARMESH_RETURN_IF_ERROR(prepare(a_, mesh_a_, tree_a_, result));
    return prepare(b_, mesh_b_, tree_b_, result);
  }
  Status prepare(ModelFile& file, std::optional<ActiveMesh>& kept, TriangleTree& tree,
                 MethodAnswer& result) {
    Stopwatch watch;
    if (splits_ > 0) NEARMESH_RETURN_IF_ERROR(file.require_all());
    result.load_s += watch.lap();
    ActiveMesh& mesh = kept.emplace(file.store());
    RefineDelta delta;
    NEARMESH_RETURN_IF_ERROR(split_all(mesh, global_order(file.store(), splits_), delta));
    result.refine_s += watch.lap();
    tree = build_triangle_tree(file.header().grid, current_triangles(mesh));
    tree.surface = file.header().surface;
    result.tree_s += watch.lap();
    const Result<std::uint64_t> bytes = wire_bytes(file.header(), mesh);
    bytes_ += bytes.value();
    split_count_ += mesh.split_count();
    return Status::ok();
  }

  ModelFile &a_, &b_;
  const QueryMethodOptions options_;
  const std::uint32_t splits_;
  bool ready_ = false;
  std::optional<ActiveMesh> mesh_a_, mesh_b_;
  TriangleTree tree_a_, tree_b_;
  std::uint64_t split_count_ = 0, bytes_ = 0;
};

// ---- certified ----------------------------------------------------------------------------------

class Certified : public QueryMethod {
 public:
  Certified(ModelFile& a, ModelFile& b, const QueryMethodOptions& options)
      : a_(a), b_(b), options_(options) {}

  Result<MethodAnswer> answer(const PosedPair& posed) override {
    MethodAnswer result;
    Stopwatch watch;
    LocalModel a(a_.store(), a_.header().grid), b(b_.store(), b_.header().grid);
    result.tree_s = watch.lap();
    const auto require = [&](ModelFile& file) {
      return [&file, &result](NodeSpan node) {
        Stopwatch load;
        const Status status = file.require(node);
        result.load_s += load.seconds();
        return status;
      };
    };
    CertifyTimes times;
    Result<Answer> answer =
        certify(a, posed.a, require(a_), b, posed.b, require(b_), options_.query, &times);
    NEARMESH_RETURN_IF_ERROR(answer);
    result.answer = std::move(answer).value();
    result.refine_s = std::max(0.0, times.refine_s - result.load_s);  // require runs inside refine
    result.tree_s += times.tree_s;
    result.query_s = times.query_s;
    result.splits = a.mesh.split_count() + b.mesh.split_count();
    result.slots = a.tree.stats().slots + b.tree.stats().slots;
    watch.lap();
    if (options_.contacts)
      result.contacts = find_contacts(a.view(), posed.a, b.view(), posed.b, result.answer);
    result.contacts_s = watch.lap();
    result.bytes =
        wire_bytes(a_.header(), a.mesh).value() + wire_bytes(b_.header(), b.mesh).value();
    result.load_s += watch.seconds();
    return result;
  }

 private:
  ModelFile &a_, &b_;
  const QueryMethodOptions options_;
};

// ---- the grid of Liu, Georganas, Roth 2006 ------------------------------------------------------

class PaperGrid : public QueryMethod {
 public:
  PaperGrid(ModelFile& a, ModelFile& b, const QueryMethodOptions& options)
      : a_(a), b_(b), options_(options), cells_a_(a.store()), cells_b_(b.store()) {}

  Result<MethodAnswer> answer(const PosedPair& posed) override {
    MethodAnswer result;
    ActiveMesh mesh_a(a_.store()), mesh_b(b_.store());
    std::set<int> done_a, done_b;
    Stopwatch watch;
    while (true) {
      // The whole tree is built anew; they refit theirs, so their T_B is the smaller.
      const TriangleTree tree_a = build_triangle_tree(a_.header().grid, current_triangles(mesh_a));
      const TriangleTree tree_b = build_triangle_tree(b_.header().grid, current_triangles(mesh_b));
      result.tree_s += watch.lap();
      result.answer = query(tree_a.view(), posed.a, tree_b.view(), posed.b,
                            {.any = false, .clearance = Clearance::kNone});
      result.query_s += watch.lap();
      std::set<int> touched_a, touched_b;
      for (const FacePair& pair : result.answer.pairs) {
        cells_a_.touched(current_box(mesh_a, pair.a), touched_a);
        cells_b_.touched(current_box(mesh_b, pair.b), touched_b);
      }
      bool more = false;
      NEARMESH_RETURN_IF_ERROR(refine(mesh_a, cells_a_, touched_a, done_a, more));
      NEARMESH_RETURN_IF_ERROR(refine(mesh_b, cells_b_, touched_b, done_b, more));
      result.refine_s += watch.lap();
      if (!more) break;
    }
    if (options_.query.any && result.answer.pairs.size() > 1) result.answer.pairs.resize(1);
    result.answer.truncated = result.answer.pairs.size() > options_.query.max_pairs;
    if (result.answer.truncated) result.answer.pairs.resize(options_.query.max_pairs);
    if (options_.contacts)
      result.contacts =
          approximate_contacts(mesh_a, posed.a, mesh_b, posed.b, options_.query.max_pairs);
    result.contacts_s = watch.lap();
    result.splits = mesh_a.split_count() + mesh_b.split_count();
    result.bytes =
        wire_bytes(a_.header(), mesh_a).value() + wire_bytes(b_.header(), mesh_b).value();
    result.load_s = watch.seconds();
    return result;
  }

 private:
  static Status refine(ActiveMesh& mesh, const GridCells& cells, const std::set<int>& touched,
                       std::set<int>& done, bool& more) {
    RefineDelta delta;
    for (const int cell : touched) {
      if (!done.insert(cell).second) continue;
      more = true;
      // Active, and alone: the vertex itself, and whoever would still stand for it and its right
      // neighbour.
      for (const VertexId v : cells.vertices(cell)) {
        NEARMESH_RETURN_IF_ERROR(split_all(mesh, {v}, delta));
        while (!mesh.is_resolved(v))
          NEARMESH_RETURN_IF_ERROR(
              split_all(mesh, {mesh.store().split_of(mesh.current_node(v))}, delta));
      }
    }
    return Status::ok();
  }

  ModelFile &a_, &b_;
  const QueryMethodOptions options_;
  const GridCells cells_a_, cells_b_;
};

}  // namespace

Result<std::unique_ptr<QueryMethod>> make_query_method(const std::string& name, ModelFile& a,
                                                       ModelFile& b,
                                                       const QueryMethodOptions& options) {
  std::unique_ptr<QueryMethod> method;
  if (options.query.solid_a || options.query.solid_b) {
    // Seeds are vertices of the full mesh, which a coarser one need not have.
    if (name != "full" && name != "certified")
      return Status{
          StatusCode::kInvalidArgument,
          "--solid-a, --solid-b: method " + name + " knows no inside; expected full or certified"};
    if (options.query.solid_a) NEARMESH_RETURN_IF_ERROR(check_solid(a.header().surface, "A"));
    if (options.query.solid_b) NEARMESH_RETURN_IF_ERROR(check_solid(b.header().surface, "B"));
  }
  if (name == "grid" && options.query.max_tests != kAllTests)
    return Status{StatusCode::kInvalidArgument,
                  "--max-tests: method grid has no bound of tests; expected another method"};
  if (name == "full") {
    method = std::make_unique<FixedMeshes>(a, b, options, FixedMeshes::kAllSplits);
  } else if (name == "base") {
    method = std::make_unique<FixedMeshes>(a, b, options, 0);
  } else if (name == "global") {
    method = std::make_unique<FixedMeshes>(a, b, options, options.global_splits);
  } else if (name == "grid") {
    NEARMESH_RETURN_IF_ERROR(a.require_all());
    NEARMESH_RETURN_IF_ERROR(b.require_all());
    method = std::make_unique<PaperGrid>(a, b, options);
  } else if (name == "certified") {
    method = std::make_unique<Certified>(a, b, options);
  } else {
    return Status{StatusCode::kInvalidArgument, "unknown method " + name};
  }
  return method;
}

}  // namespace nearmesh::program
