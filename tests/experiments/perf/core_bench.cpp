// SPDX-License-Identifier: Apache-2.0
// Rates of the core on one model, as CSV rows: metric,value,unit. The figures of ARCHITECTURE.md
// come from
//   nearmesh-bench-core terrain.spm
// Single thread, thread CPU time, so that a busy machine disturbs little.

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <queue>

#include "core/base/random.hpp"
#include "core/base/stopwatch.hpp"
#include "core/demand/collect.hpp"
#include "core/refine/refined_mesh.hpp"
#include "core/spm/record_codec.hpp"
#include "core/spm/train.hpp"
#include "nearmesh/core/abtree/detail/ab_tree.hpp"
#include "nearmesh/core/spm/model_file.hpp"

using namespace nearmesh;

namespace {

double cpu_s() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

void row(const char* metric, double value, const char* unit) {
  std::printf("%s,%.6g,%s\n", metric, value, unit);
}

// Cubes of half-width grid >> shift around random vertices, asked for from the base mesh.
std::vector<Treelet> demands(ModelFile& file, int shift, int count) {
  std::vector<Treelet> treelets;
  Random random(7);
  const SplitStore& store = file.store();
  const std::int32_t radius = store.grid_max() >> shift;
  for (int i = 0; i < count; ++i) {
    RegionRequest request{.max_splits = kMaxRequestSplits};
    for (const BaseRoot& root : store.roots())
      if (root.node.size > 1) request.attach.push_back(root.node);
    const GridPoint at = store.position({random.below(store.vertex_count())});
    GridBox box;
    for (int k = 0; k < 3; ++k) {
      box.lo[k] = std::max(0, at[k] - radius);
      box.hi[k] = std::min(store.grid_max(), at[k] + radius);
    }
    request.region = {box};
    treelets.push_back(collect(store, request, nullptr).value().treelet);
  }
  return treelets;
}

// How many attach nodes a batch would name if records stood largest first instead of in preorder.
double attach_if_largest_first(const std::vector<Treelet>& treelets,
                               std::size_t records_per_batch) {
  double attach = 0, batches = 0;
  for (const Treelet& treelet : treelets) {
    const auto smaller = [](const TreeletSplit* a, const TreeletSplit* b) {
      return a->node.size < b->node.size;
    };
    std::priority_queue<const TreeletSplit*, std::vector<const TreeletSplit*>, decltype(smaller)>
        queue(smaller);
    const auto find = [&](NodeSpan node) {
      return &*std::lower_bound(
          treelet.begin(), treelet.end(), TreeletSplit{node, {}},
          [](const TreeletSplit& a, const TreeletSplit& b) { return a.node < b.node; });
    };
    std::vector<bool> is_child(treelet.size());
    for (const TreeletSplit& split : treelet) {
      if (split.left_included)
        is_child[find(split.node.left_of(split.split)) - treelet.data()] = true;
      if (split.right_included)
        is_child[find(split.node.right_of(split.split)) - treelet.data()] = true;
    }
    for (std::size_t i = 0; i < treelet.size(); ++i)
      if (!is_child[i]) queue.push(&treelet[i]);
    for (std::size_t done = 0; !queue.empty(); ++done) {
      if (done % records_per_batch == 0) {
        ++batches;
        attach += static_cast<double>(std::min(queue.size(), records_per_batch));
      }
      const TreeletSplit* split = queue.top();
      queue.pop();
      if (split->left_included) queue.push(find(split->node.left_of(split->split)));
      if (split->right_included) queue.push(find(split->node.right_of(split->split)));
    }
  }
  return attach / batches;
}

// What box extents take of the treelet's encoding.
double box_bits(const ModelFile& file, const Treelet& treelet) {
  TrainingCounts counts;
  count_treelet(file.header(), file.store(), treelet, BoxPolicy::kCutNodes, counts);
  double bits = 0;
  for (std::size_t c = record::kBox; c < counts.size(); ++c) {
    const auto& lengths = file.header().tables.contexts()[c].lengths;
    for (std::size_t symbol = 0; symbol < counts[c].size(); ++symbol)
      bits += static_cast<double>(counts[c][symbol]) *
              (lengths[symbol] > 0 ? lengths[symbol] : lengths[kEscape] + record::kEscapedBits);
  }
  return bits;
}

// What stands before a batch's first record: policy, counts, attach nodes.
double head_bits(const std::vector<std::uint8_t>& batch) {
  BitReader in(batch);
  in.skip(8);
  in.get_gamma();
  for (std::uint64_t fields = 2 * in.get_gamma(); fields > 0; --fields) in.get_gamma();
  return static_cast<double>(batch.size() * 8 - in.bits_left());
}

void bench_codec(ModelFile& file, const char* name, int shift) {
  const std::vector<Treelet> treelets = demands(file, shift, 200);
  std::size_t splits = 0, bytes = 0, batches = 0;
  std::vector<std::vector<std::uint8_t>> encoded;
  double start = cpu_s();
  for (const Treelet& treelet : treelets) {
    splits += treelet.size();
    for (auto& batch : encode_batches(file.header(), file.store(), treelet, BoxPolicy::kCutNodes))
      encoded.push_back(std::move(batch));
  }
  const double encode_s = cpu_s() - start;
  double head = 0, boxes = 0;
  for (const auto& batch : encoded) {
    bytes += batch.size();
    head += head_bits(batch) / 8;
  }
  for (const Treelet& treelet : treelets) boxes += box_bits(file, treelet) / 8;
  batches = encoded.size();
  start = cpu_s();
  std::size_t decoded = 0;
  for (const auto& batch : encoded)
    decoded += decode_batch(file.header(), batch).value().splits.size();
  const double decode_s = cpu_s() - start;
  const std::string prefix = name;
  row((prefix + "_splits_per_request").c_str(), static_cast<double>(splits) / 200, "splits");
  row((prefix + "_bytes_per_split").c_str(),
      static_cast<double>(bytes) / static_cast<double>(splits), "B");
  row((prefix + "_bytes_per_split_records").c_str(),
      (static_cast<double>(bytes) - boxes - head) / static_cast<double>(splits), "B");
  row((prefix + "_bytes_per_split_boxes").c_str(), boxes / static_cast<double>(splits), "B");
  row((prefix + "_bytes_per_split_heads").c_str(), head / static_cast<double>(splits), "B");
  row((prefix + "_encode").c_str(), static_cast<double>(splits) / encode_s / 1e6, "Msplits/s");
  row((prefix + "_decode").c_str(), static_cast<double>(decoded) / decode_s / 1e6, "Msplits/s");
  row((prefix + "_batches_per_request").c_str(), static_cast<double>(batches) / 200, "batches");
  row((prefix + "_attach_per_batch_if_largest_first").c_str(),
      attach_if_largest_first(treelets, std::max<std::size_t>(1, splits / batches)), "nodes");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: nearmesh-bench-core MODEL.spm\n");
    return 2;
  }
  Stopwatch watch;
  Result<ModelFile> file = ModelFile::open(argv[1]);
  if (!file.is_ok()) {
    std::fprintf(stderr, "%s\n", file.status().message().c_str());
    return 1;
  }
  row("open", watch.seconds() * 1e3, "ms");
  double start = cpu_s();
  if (const Status status = file.value().require_all(); !status.is_ok()) {
    std::fprintf(stderr, "%s\n", status.message().c_str());
    return 1;
  }
  const SplitStore& store = file.value().store();
  row("load_all", store.known_splits() / (cpu_s() - start) / 1e6, "Msplits/s");

  bench_codec(file.value(), "small", 8);
  bench_codec(file.value(), "large", 5);

  // Local Vertex Split in id order and in random order, Local Edge Collapse of everything.
  std::vector<VertexId> splits;
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v)
    if (!store.is_root({v})) splits.push_back({v});
  for (const char* order : {"split_id_order", "split_random_order"}) {
    ActiveMesh mesh(store);
    RefineDelta delta;
    delta.split.reserve(splits.size());
    start = cpu_s();
    for (const VertexId u : splits) static_cast<void>(mesh.split(u, delta));
    row(order, static_cast<double>(splits.size()) / (cpu_s() - start) / 1e6, "Msplits/s");
    start = cpu_s();
    for (const BaseRoot& root : store.roots()) mesh.collapse(root.node, delta);
    row("collapse_all", static_cast<double>(splits.size()) / (cpu_s() - start) / 1e6, "Msplits/s");
    Random random(3);
    for (std::size_t i = splits.size(); i > 1; --i)
      std::swap(splits[i - 1], splits[random.below(static_cast<std::uint32_t>(i))]);
  }

  // The same in the order in which the answers to many small requests bring them, and one by one in
  // reverse.
  const std::vector<Treelet> treelets = demands(file.value(), 8, 1000);
  std::vector<TreeletSplit> arrivals;
  std::vector<bool> arrived(store.vertex_count());
  for (const Treelet& treelet : treelets)
    for (const TreeletSplit& split : treelet)
      if (!arrived[split.split.value]) {
        arrived[split.split.value] = true;
        arrivals.push_back(split);
      }
  {
    ActiveMesh mesh(store);
    RefineDelta delta;
    delta.split.reserve(arrivals.size());
    delta.collapsed.reserve(arrivals.size());
    start = cpu_s();
    for (const TreeletSplit& split : arrivals) static_cast<void>(mesh.split(split.split, delta));
    row("split_arrival_order", static_cast<double>(arrivals.size()) / (cpu_s() - start) / 1e6,
        "Msplits/s");
    start = cpu_s();
    for (std::size_t i = arrivals.size(); i-- > 0;) mesh.collapse(arrivals[i].node, delta);
    row("collapse_reverse_order", static_cast<double>(arrivals.size()) / (cpu_s() - start) / 1e6,
        "Msplits/s");
  }

  // A peer: batches of small requests, one after another, into a replica and its tree.
  RefinedMesh replica(file.value().header());
  AbTree tree(replica.mesh());
  double apply_s = 0, tree_s = 0, faces = 0;
  std::size_t applied = 0;
  for (const Treelet& treelet : treelets)
    for (const auto& bytes :
         encode_batches(file.value().header(), store, treelet, BoxPolicy::kCutNodes)) {
      const SplitBatch batch = decode_batch(file.value().header(), bytes).value();
      start = cpu_s();
      const RefinedMesh::Applied result = replica.apply_batch(batch);
      apply_s += cpu_s() - start;
      applied += result.delta.split.size();
      start = cpu_s();
      tree.update(result.delta);
      tree_s += cpu_s() - start;
      faces += static_cast<double>(tree.stats().rebuilt_faces);
    }
  row("replica_apply", static_cast<double>(applied) / apply_s / 1e6, "Msplits/s");
  row("tree_update", faces / tree_s / 1e6, "Mfaces/s");
  row("tree_update_per_split", tree_s / static_cast<double>(applied) * 1e9, "ns");
  row("tree_bytes_per_face",
      static_cast<double>(tree.stats().bytes) / static_cast<double>(tree.stats().exact_faces), "B");
  return 0;
}
