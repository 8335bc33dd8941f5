// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/bake/bake.hpp"

#include <algorithm>
#include <bit>
#include <numeric>

#include "nearmesh/core/base/random.hpp"
#include "nearmesh/core/demand/collect.hpp"
#include "nearmesh/core/mesh/surface.hpp"
#include "nearmesh/core/spm/blocks.hpp"
#include "nearmesh/core/spm/train.hpp"

namespace nearmesh {
namespace {

// The merge forest in VertexIds. Arrays by id unless they say otherwise.
struct Forest {
  std::vector<std::uint32_t> id_of;  // by mesh vertex
  std::vector<std::uint32_t> size;  // of the node that the vertex represents when its split is done
  std::vector<std::uint32_t> parent;  // the vertex it merges into; own id for a root
  std::vector<std::uint32_t> roots;   // ids, ascending
};

// Interleaves the top ten bits of each coordinate: roots that are near get ids that are near.
std::uint32_t morton(const GridPoint& p, int bits) {
  std::uint32_t code = 0;
  for (int bit = 0; bit < 10; ++bit)
    for (int k = 0; k < 3; ++k) {
      const int place = bits - 1 - bit;
      code = code << 1 | (place >= 0 ? static_cast<std::uint32_t>(p[k]) >> place & 1U : 0U);
    }
  return code;
}

Forest number_forest(const GridMesh& mesh, const std::vector<Collapse>& log) {
  constexpr std::uint32_t kNone = 0xffffffffU;
  const std::size_t n = mesh.positions.size();
  // Children of each vertex in the order in which they merged into it: earliest first.
  std::vector<std::uint32_t> parent(n, kNone), first_child(n, kNone), last_child(n, kNone),
      next_sibling(n, kNone), size(n, 1);
  for (const Collapse& c : log) {
    parent[c.removed] = c.kept;
    size[c.kept] += size[c.removed];
    if (last_child[c.kept] == kNone) {
      first_child[c.kept] = c.removed;
    } else {
      next_sibling[last_child[c.kept]] = c.removed;
    }
    last_child[c.kept] = c.removed;
  }
  std::vector<std::uint32_t> roots;
  for (std::uint32_t v = 0; v < n; ++v)
    if (parent[v] == kNone) roots.push_back(v);
  std::sort(roots.begin(), roots.end(), [&](std::uint32_t a, std::uint32_t b) {
    const std::uint32_t x = morton(mesh.positions[a], mesh.grid.bits);
    const std::uint32_t y = morton(mesh.positions[b], mesh.grid.bits);
    return x != y ? x < y : a < b;
  });

  Forest forest;
  forest.id_of.resize(n);
  forest.size.resize(n);
  forest.parent.resize(n);
  std::uint32_t next = 0;
  for (const std::uint32_t root : roots) {
    forest.roots.push_back(next);
    // Depth first without a stack: down to the first child, else to the next sibling of the nearest ancestor with one.
    for (std::uint32_t v = root;;) {
      const std::uint32_t id = next++;
      forest.id_of[v] = id;
      forest.size[id] = size[v];
      forest.parent[id] = v == root ? id : forest.id_of[parent[v]];
      if (first_child[v] != kNone) {
        v = first_child[v];
        continue;
      }
      while (v != root && next_sibling[v] == kNone) v = parent[v];
      if (v == root) break;
      v = next_sibling[v];
    }
  }
  return forest;
}

// The split that parts vertices x < y, or none: climb from y until the parent's subtree holds x.
VertexId parting_split(const Forest& forest, std::uint32_t x, std::uint32_t y) {
  std::uint32_t v = y;
  while (forest.parent[v] != v && forest.parent[v] > x) v = forest.parent[v];
  return forest.parent[v] == v ? VertexId{} : VertexId{v};
}

struct OwnedFace {
  VertexId split;  // none: a base face
  SplitFace face;
  FaceNumber number;
};

// Each face appears with the deepest of the splits that part its corners; the third corner is then outside the node.
OwnedFace own_face(const Forest& forest, const std::array<std::uint32_t, 3>& corners,
                   FaceId number) {
  OwnedFace owned;
  std::uint32_t best = 0xffffffffU;
  int odd = 2;  // the corner outside
  for (int k = 0; k < 3; ++k) {
    const std::uint32_t a = corners[(k + 1) % 3], b = corners[(k + 2) % 3];
    const VertexId split = parting_split(forest, std::min(a, b), std::max(a, b));
    if (!split.is_valid()) continue;
    const std::uint32_t node = split.value + forest.size[split.value] - forest.parent[split.value];
    if (node < best) {
      best = node;
      owned.split = split;
      odd = k;
    }
  }
  const std::uint32_t a = corners[(odd + 1) % 3], b = corners[(odd + 2) % 3];
  owned.face = {{std::min(a, b)}, {std::max(a, b)}, {corners[odd]}, a > b};
  const auto stored = owned.face.corners();
  std::uint8_t first = 0;
  while (stored[first].value != corners[0]) ++first;
  owned.number = {number, first};
  return owned;
}

std::vector<OwnedFace> own_faces(const GridMesh& mesh, const Forest& forest) {
  std::vector<OwnedFace> faces;
  faces.reserve(mesh.faces.size());
  for (std::size_t i = 0; i < mesh.faces.size(); ++i) {
    std::array<std::uint32_t, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) corners[k] = forest.id_of[mesh.faces[i][k]];
    faces.push_back(own_face(forest, corners, mesh.face_ids[i]));
  }
  // Base faces first (their split is "none", all ones, plus one wraps to zero), then by split; unflipped before
  // flipped, as the codec writes them.
  const auto key = [](const OwnedFace& f) {
    return std::tuple(f.split.value + 1U, f.face.flipped, f.face.left, f.face.right, f.face.outside,
                      f.number.face);
  };
  std::sort(faces.begin(), faces.end(),
            [&](const OwnedFace& a, const OwnedFace& b) { return key(a) < key(b); });
  return faces;
}

// Boxes of original faces: of each vertex first, then of every node, in the order in which nodes were merged.
struct NodeBoxes {
  std::vector<GridBox> left, right;  // of the children of each split, by split id
  std::vector<GridBox> root;         // of what each vertex represents in the end, by id
};

NodeBoxes bound_nodes(const GridMesh& mesh, const Forest& forest,
                      const std::vector<Collapse>& log) {
  const std::size_t n = mesh.positions.size();
  NodeBoxes boxes;
  boxes.left.resize(n);
  boxes.right.resize(n);
  boxes.root.resize(n);
  for (std::size_t v = 0; v < n; ++v) boxes.root[forest.id_of[v]].add(mesh.positions[v]);
  for (const auto& face : mesh.faces) {
    GridBox box;
    for (const std::uint32_t v : face) box.add(mesh.positions[v]);
    for (const std::uint32_t v : face) boxes.root[forest.id_of[v]].add(box);
  }
  for (const Collapse& c : log) {
    const std::uint32_t u = forest.id_of[c.removed], s = forest.id_of[c.kept];
    boxes.left[u] = boxes.root[s];
    boxes.right[u] = boxes.root[u];
    boxes.root[s].add(boxes.root[u]);
  }
  return boxes;
}

std::array<std::uint8_t, 3> lattice_shift(const GridMesh& mesh) {
  std::array<std::uint32_t, 3> any{};
  for (const GridPoint& p : mesh.positions)
    for (std::size_t k = 0; k < 3; ++k) any[k] |= static_cast<std::uint32_t>(p.v[k]);
  std::array<std::uint8_t, 3> shift{};
  for (std::size_t k = 0; k < 3; ++k)
    shift[k] = static_cast<std::uint8_t>(std::min(std::countr_zero(any[k]), mesh.grid.bits));
  return shift;
}

SurfaceFacts describe_surface(const GridMesh& mesh, const Forest& forest) {
  SurfaceFacts facts;
  const OpenEdges open = count_open_edges(mesh);
  facts.boundary_edges = static_cast<std::uint32_t>(open.boundary);
  facts.disagreeing_edges = static_cast<std::uint32_t>(open.disagreeing);
  const std::vector<std::uint32_t> component = find_components(mesh);
  const std::size_t n = mesh.positions.size();
  std::vector<std::uint32_t> vertex_of(n);  // by id
  for (std::uint32_t v = 0; v < n; ++v) vertex_of[forest.id_of[v]] = v;
  std::vector<bool> seen(n, false);  // by component
  facts.component_count = 0;
  for (const std::uint32_t v : vertex_of) {
    if (seen[component[v]]) continue;
    seen[component[v]] = true;
    if (++facts.component_count <= kMaxComponentSeeds)
      facts.component_seeds.push_back(mesh.positions[v]);
  }
  if (facts.component_count > kMaxComponentSeeds) facts.component_seeds.clear();
  return facts;
}

// Typical requests: cubes of many sizes around random vertices. Every eighth stored block of a large model is enough to
// learn what blocks look like, and keeps requests from being drowned.
CodingTables train(const SpmHeader& header, const SplitStore& store) {
  TrainingCounts counts(static_cast<std::size_t>(coding_context_count()));
  std::size_t splits = 0;
  std::size_t number = 0;
  for (const auto& level : cut_into_blocks(store))
    for (const StoredBlock& block : level)
      if (number++ % 8 == 0 || splits < 4096) {
        count_treelet(header, store, block.treelet, BoxPolicy::kAllNodes, counts);
        splits += block.treelet.size();
      }
  Random random(1);
  const std::int64_t extent = store.grid_max();
  for (int i = 0; i < 256; ++i) {
    RegionRequest request{.max_splits = 2048};
    for (const BaseRoot& root : header.roots)
      if (root.node.size > 1) request.attach.push_back(root.node);
    const GridPoint& at = store.position({random.below(header.vertex_count)});
    const std::int64_t radius = std::max<std::int64_t>(1, extent >> (4 + random.below(8)));
    GridBox box;
    for (int k = 0; k < 3; ++k) {
      box.lo[k] = static_cast<std::int32_t>(std::max<std::int64_t>(0, at[k] - radius));
      box.hi[k] = static_cast<std::int32_t>(std::min<std::int64_t>(extent, at[k] + radius));
    }
    request.region.push_back(box);
    if (request.attach.empty()) break;
    const Result<Demand> demand = collect(store, request, nullptr);
    count_treelet(header, store, demand.value().treelet, BoxPolicy::kCutNodes, counts);
  }
  return make_tables(counts);
}

// A split travels in one datagram; only hundreds of faces on one edge make one that does not fit.
Status check_split_sizes(const SpmHeader& header, const SplitStore& store) {
  constexpr std::size_t kSuspicious = 64;
  for (VertexId u{0}; u.value < header.vertex_count; ++u.value) {
    if (store.is_root(u) || store.faces(u).size() < kSuspicious) continue;
    const Treelet single{{store.node_of(u), u}};
    if (encode_batches(header, store, single, BoxPolicy::kCutNodes).front().size() > kMaxBatchBytes)
      return {StatusCode::kUnsupported,
              std::to_string(store.faces(u).size()) +
                  " faces meet along one edge, more than one datagram holds"};
  }
  return Status::ok();
}

}  // namespace

Result<BakedModel> bake(const GridMesh& mesh, double rounding_error_m,
                        const SimplifyOptions& options) {
  NEARMESH_ASSERT(!mesh.faces.empty());
  if (mesh.faces.size() >= (std::size_t{1} << 30))
    return Status{StatusCode::kUnsupported,
                  "a model has fewer than 2^30 faces, found " + std::to_string(mesh.faces.size())};
  CollapseLog log = simplify(mesh, options);
  const Forest forest = number_forest(mesh, log.collapses);
  const std::vector<OwnedFace> faces = own_faces(mesh, forest);
  const NodeBoxes boxes = bound_nodes(mesh, forest, log.collapses);
  std::vector<GridPoint> position(mesh.positions.size());
  for (std::size_t v = 0; v < mesh.positions.size(); ++v)
    position[forest.id_of[v]] = mesh.positions[v];

  SpmHeader header;
  header.grid = mesh.grid;
  header.rounding_error_m = rounding_error_m;
  header.lattice_shift = lattice_shift(mesh);
  header.vertex_count = static_cast<std::uint32_t>(mesh.positions.size());
  header.face_count = static_cast<std::uint32_t>(faces.size());
  header.surface = describe_surface(mesh, forest);
  for (const std::uint32_t root : forest.roots)
    header.roots.push_back({{{root}, forest.size[root]},
                            position[root],
                            encode_box(position[root], boxes.root[root])});
  std::vector<std::uint32_t> face_begin(mesh.positions.size() + 1, 0);  // by split
  for (const OwnedFace& owned : faces) {
    if (owned.split.is_valid()) {
      ++face_begin[owned.split.value + 1];
    } else {
      header.base_faces.push_back(owned.face);
    }
  }
  face_begin[0] = static_cast<std::uint32_t>(header.base_faces.size());
  std::partial_sum(face_begin.begin(), face_begin.end(), face_begin.begin());

  SplitStore store(header);
  std::vector<SplitFace> own;
  for (auto c = log.collapses.rbegin(); c != log.collapses.rend(); ++c) {
    const std::uint32_t u = forest.id_of[c->removed], p = forest.parent[u];
    SplitRecord record{.node = {{p}, u + forest.size[u] - p}, .split = {u}};
    for (int k = 0; k < 3; ++k) record.offset[k] = position[u][k] - position[p][k];
    if (record.left().size > 1) record.left_box = encode_box(position[p], boxes.left[u]);
    if (record.right().size > 1) record.right_box = encode_box(position[u], boxes.right[u]);
    own.clear();
    for (std::uint32_t i = face_begin[u]; i < face_begin[u + 1]; ++i) own.push_back(faces[i].face);
    const auto inserted = store.insert(record, own);
    if (!inserted.is_ok()) return Status{StatusCode::kUnsupported, inserted.status().message()};
    NEARMESH_ASSERT(inserted.value() == SplitStore::Insertion::kAdded);
  }
  header.tables = train(header, store);
  NEARMESH_RETURN_IF_ERROR(check_split_sizes(header, store));

  BakedModel baked{std::move(header), std::move(store), {}, std::move(log)};
  baked.numbers.reserve(faces.size());
  for (const OwnedFace& owned : faces) baked.numbers.push_back(owned.number);
  return baked;
}

}  // namespace nearmesh
