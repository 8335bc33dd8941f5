// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/bake/bake.hpp"

#include <algorithm>
#include <bit>
#include <numeric>
#include <span>
#include <tuple>

#include "core/base/float_guard.hpp"
#include "core/base/parallel.hpp"
#include "core/geometry/surface.hpp"
#include "core/spm/train.hpp"
#include "count_typical.hpp"

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
    // Depth first without a stack: down to the first child, else to the next sibling of the nearest
    // ancestor with one.
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

using Corners = std::array<std::uint32_t, 3>;

Corners corners_of(const GridMesh& mesh, const Forest& forest, std::size_t face) {
  Corners corners{};
  for (std::size_t k = 0; k < 3; ++k) corners[k] = forest.id_of[mesh.faces[face][k]];
  return corners;
}

// Each face appears with the deepest of the splits that part its corners; the third corner is then
// outside the node.
struct Owner {
  VertexId split;        // none: a base face
  std::uint8_t odd = 2;  // the corner outside
};

Owner owner_of(const Forest& forest, const Corners& corners) {
  Owner owner;
  std::uint32_t best = 0xffffffffU;
  for (std::uint8_t k = 0; k < 3; ++k) {
    const std::uint32_t a = corners[(k + 1) % 3], b = corners[(k + 2) % 3];
    const VertexId split = parting_split(forest, std::min(a, b), std::max(a, b));
    if (!split.is_valid()) continue;
    const std::uint32_t node = split.value + forest.size[split.value] - forest.parent[split.value];
    if (node < best) {
      best = node;
      owner = {split, k};
    }
  }
  return owner;
}

struct OwnedFace {
  SplitFace face;
  FaceNumber number;
};

OwnedFace own_face(const Corners& corners, std::uint32_t odd, FaceId number) {
  OwnedFace owned;
  const std::uint32_t a = corners[(odd + 1) % 3], b = corners[(odd + 2) % 3];
  owned.face = {{std::min(a, b)}, {std::max(a, b)}, {corners[odd]}, a > b};
  const auto stored = owned.face.corners();
  std::uint8_t first = 0;
  while (stored[first].value != corners[0]) ++first;
  owned.number = {number, first};
  return owned;
}

// Faces in canonical order: base faces, then by split; unflipped before flipped, as the codec
// writes them.
struct OwnedFaces {
  std::vector<std::uint32_t> begin;  // of the base faces, then of those of each id, then the end
  std::vector<SplitFace> faces;
  std::vector<FaceNumber> numbers;

  [[nodiscard]] std::span<const SplitFace> base() const { return of_place(0); }
  [[nodiscard]] std::span<const SplitFace> of(std::uint32_t split) const {
    return of_place(split + std::size_t{1});
  }

 private:
  [[nodiscard]] std::span<const SplitFace> of_place(std::size_t i) const {
    return std::span(faces).subspan(begin[i], begin[i + 1] - begin[i]);
  }
};

OwnedFaces own_faces(const GridMesh& mesh, const Forest& forest, unsigned threads) {
  constexpr std::size_t kPiece = 1U << 15;
  const std::size_t count = mesh.faces.size(), places = mesh.positions.size() + 1;
  const auto pieces = [](std::size_t items) { return (items + kPiece - 1) / kPiece; };
  OwnedFaces owned;
  // By face: its place (base faces have 0, a split the next of its id), and which corner is odd.
  std::vector<std::uint32_t> owner(count);
  for_each_index(pieces(count), threads, [&](std::size_t piece) {
    for (std::size_t i = piece * kPiece; i < std::min(count, (piece + 1) * kPiece); ++i) {
      const Owner found = owner_of(forest, corners_of(mesh, forest, i));
      owner[i] = (found.split.value + 1U) << 2 | found.odd;
    }
  });
  owned.begin.assign(places + 1, 0);
  for (const std::uint32_t o : owner) ++owned.begin[(o >> 2) + 1];
  std::partial_sum(owned.begin.begin(), owned.begin.end(), owned.begin.begin());
  std::vector<std::uint32_t> order(count);
  {
    std::vector<std::uint32_t> next(owned.begin);
    for (std::uint32_t i = 0; i < count; ++i) order[next[owner[i] >> 2]++] = i;
  }
  owned.faces.resize(count);
  owned.numbers.resize(count);
  for_each_index(pieces(places), threads, [&](std::size_t piece) {
    std::vector<OwnedFace> own;
    for (std::size_t at = piece * kPiece; at < std::min(places, (piece + 1) * kPiece); ++at) {
      own.clear();
      for (std::uint32_t i = owned.begin[at]; i < owned.begin[at + 1]; ++i) {
        const std::uint32_t face = order[i];
        own.push_back(
            own_face(corners_of(mesh, forest, face), owner[face] & 3U, mesh.face_ids[face]));
      }
      const auto key = [](const OwnedFace& f) {
        return std::tuple(f.face.flipped, f.face.left, f.face.right, f.face.outside, f.number.face);
      };
      if (own.size() > 1)
        std::sort(own.begin(), own.end(),
                  [&](const OwnedFace& a, const OwnedFace& b) { return key(a) < key(b); });
      for (std::size_t i = 0; i < own.size(); ++i) {
        owned.faces[owned.begin[at] + i] = own[i].face;
        owned.numbers[owned.begin[at] + i] = own[i].number;
      }
    }
  });
  return owned;
}

// Boxes of the original faces that touch a vertex of each node, by id.
struct NodeBoxes {
  std::vector<BoxCode> left, right;  // of the children of each split
  std::vector<GridBox> whole;        // of what each vertex represents when its split is done
};

NodeBoxes bound_nodes(const GridMesh& mesh, const Forest& forest,
                      const std::vector<GridPoint>& position) {
  const std::size_t n = position.size();
  NodeBoxes boxes;
  boxes.whole.resize(n);
  for (std::size_t v = 0; v < n; ++v) boxes.whole[v].add(position[v]);
  for (std::size_t i = 0; i < mesh.faces.size(); ++i) {
    GridBox box;
    for (const std::uint32_t v : mesh.faces[i]) box.add(mesh.positions[v]);
    for (const std::uint32_t id : corners_of(mesh, forest, i)) boxes.whole[id].add(box);
  }
  boxes.left.resize(n, kNoBox);
  boxes.right.resize(n, kNoBox);
  // A vertex's children have higher ids, and the one that merged into it first the lowest: nodes
  // grow as they were merged, and what lies together in memory is done together.
  for (std::size_t v = n; v-- > 0;) {
    const std::size_t end = v + forest.size[v];
    for (std::size_t u = v + 1; u < end; u += forest.size[u]) {
      if (u - v > 1) boxes.left[u] = encode_box(position[v], boxes.whole[v]);
      if (forest.size[u] > 1) boxes.right[u] = encode_box(position[u], boxes.whole[u]);
      boxes.whole[v].add(boxes.whole[u]);
    }
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
  const UnclosedEdges open = count_unclosed_edges(mesh.positions, mesh.faces);
  facts.boundary_edges = static_cast<std::uint32_t>(open.boundary);
  facts.disagreeing_edges = static_cast<std::uint32_t>(open.disagreeing);
  const std::vector<std::uint32_t> component = find_components(mesh.positions.size(), mesh.faces);
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

// Every split, parents before children and what lies together one after the other: depth first,
// larger ids first.
Status fill_store(const Forest& forest, const std::vector<GridPoint>& position,
                  const NodeBoxes& boxes, const OwnedFaces& owned, SplitStore& store) {
  std::vector<std::uint32_t> children, stack;
  for (const std::uint32_t root : forest.roots) {
    stack.assign(1, root);
    while (!stack.empty()) {
      const std::uint32_t p = stack.back();
      stack.pop_back();
      children.clear();
      for (std::uint32_t u = p + 1; u < p + forest.size[p]; u += forest.size[u])
        children.push_back(u);
      // The last to merge is the first to split off.
      for (; !children.empty(); children.pop_back()) {
        const std::uint32_t u = children.back();
        SplitRecord record{.node = {{p}, u + forest.size[u] - p},
                           .split = {u},
                           .left_box = boxes.left[u],
                           .right_box = boxes.right[u]};
        for (int k = 0; k < 3; ++k) record.offset[k] = position[u][k] - position[p][k];
        const auto inserted = store.insert(record, owned.of(u));
        if (!inserted.is_ok()) return {StatusCode::kUnsupported, inserted.status().message()};
        NEARMESH_ASSERT(inserted.value() == SplitStore::Insertion::kAdded);
        if (forest.size[u] > 1) stack.push_back(u);
      }
    }
  }
  return Status::ok();
}

}  // namespace

Result<BakedModel> bake(const GridMesh& mesh, double rounding_error_m,
                        const SimplifyOptions& options, TableChoice tables) {
  const FloatGuard guard;
  NEARMESH_ASSERT(!mesh.faces.empty());
  if (mesh.positions.size() >= kMaxVertices || mesh.faces.size() >= (std::size_t{1} << 30))
    return Status{StatusCode::kUnsupported,
                  "a model has fewer than 2^30 vertices and faces, found " +
                      std::to_string(mesh.positions.size()) + " and " +
                      std::to_string(mesh.faces.size())};
  CollapseLog log = simplify(mesh, options);
  const Forest forest = number_forest(mesh, log.collapses);
  std::vector<GridPoint> position(mesh.positions.size());
  for (std::size_t v = 0; v < mesh.positions.size(); ++v)
    position[forest.id_of[v]] = mesh.positions[v];
  const NodeBoxes boxes = bound_nodes(mesh, forest, position);
  OwnedFaces owned = own_faces(mesh, forest, options.threads);

  SpmHeader header;
  header.grid = mesh.grid;
  header.rounding_error_m = rounding_error_m;
  header.lattice_shift = lattice_shift(mesh);
  header.vertex_count = static_cast<std::uint32_t>(mesh.positions.size());
  header.face_count = static_cast<std::uint32_t>(owned.faces.size());
  header.base_faces.assign(owned.base().begin(), owned.base().end());
  header.surface = describe_surface(mesh, forest);
  for (const std::uint32_t root : forest.roots)
    header.roots.push_back({{{root}, forest.size[root]},
                            position[root],
                            encode_box(position[root], boxes.whole[root])});

  SplitStore store(header);
  NEARMESH_RETURN_IF_ERROR(fill_store(forest, position, boxes, owned, store));
  const TrainingCounts counts = count_typical(header, store);
  header.tables = tables == TableChoice::kBuiltIn
                      ? nearest_set(counts, header.lattice_shift)
                      : choose_tables(counts, header.lattice_shift, header.split_count());
  NEARMESH_RETURN_IF_ERROR(check_split_sizes(header, store));

  return BakedModel{std::move(header), std::move(store), std::move(owned.numbers), std::move(log)};
}

}  // namespace nearmesh
