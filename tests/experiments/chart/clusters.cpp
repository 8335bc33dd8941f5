// SPDX-License-Identifier: Apache-2.0
#include "clusters.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "nearmesh/core/geometry/detail/box_overlap.hpp"

namespace nearmesh::chart {
namespace {

GridBox box_of(const std::vector<TreeFace>& faces, std::size_t begin, std::size_t end) {
  GridBox box;
  for (std::size_t f = begin; f < end; ++f)
    for (const GridPoint& p : faces[f].corners) box.add(p);
  return box;
}
// The greatest code whose extent is at most x, so that the box stays outside.
std::uint8_t inward_code(std::int64_t x) {
  std::uint8_t code = box_extent_code(x);
  while (box_extent(code) > x) --code;
  return code;
}
std::array<std::uint8_t, 6> codes(const GridBox& parent, const GridBox& box) {
  std::array<std::uint8_t, 6> out;
  for (int k = 0; k < 3; ++k) {
    out[static_cast<std::size_t>(2 * k)] = inward_code(std::int64_t{box.lo[k]} - parent.lo[k]);
    out[static_cast<std::size_t>(2 * k + 1)] = inward_code(std::int64_t{parent.hi[k]} - box.hi[k]);
  }
  return out;
}
GridBox decoded(const GridBox& parent, const std::array<std::uint8_t, 6>& codes) {
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    box.lo[k] = static_cast<std::int32_t>(parent.lo[k] +
                                          box_extent(codes[static_cast<std::size_t>(2 * k)]));
    box.hi[k] = static_cast<std::int32_t>(parent.hi[k] -
                                          box_extent(codes[static_cast<std::size_t>(2 * k + 1)]));
  }
  return box;
}

}  // namespace

Clusters::Clusters(const perf::Model& model, std::size_t cluster_faces, bool coded)
    : header_(&model.baked.header), cluster_faces_(cluster_faces) {
  std::vector<TreeFace> faces;
  for (const TreeNode& node : model.tree.nodes)
    for (std::uint32_t lane = 0; lane < kLanes; ++lane)
      if (const TreeEntry entry = node.entry(lane); entry.kind() == TreeEntry::Kind::kFaces)
        model.tree.view().for_each_face(entry,
                                        [&](const TreeFace& face) { faces.push_back(face); });
  build(faces, 0, faces.size(), box_of(faces, 0, faces.size()));
  if (coded) train();
}

double Clusters::bits(const std::vector<TreeFace>& faces, const GridPoint& from) const {
  double sum = 0;
  code_faces(faces, header_->lattice_shift, from,
             [&](int context, int symbol, int raw) { sum += costs_.bits(context, symbol) + raw; });
  return sum;
}

std::uint32_t Clusters::build(std::vector<TreeFace>& faces, std::size_t begin, std::size_t end,
                              const GridBox& box) {
  const auto self = static_cast<std::uint32_t>(nodes_.size());
  nodes_.push_back({box, {}, {}, 0});
  if (end - begin <= cluster_faces_) {
    const auto first = faces.begin() + static_cast<std::ptrdiff_t>(begin);
    nodes_[self].faces.assign(first, faces.begin() + static_cast<std::ptrdiff_t>(end));
    return self;
  }
  std::vector<std::pair<std::size_t, std::size_t>> parts{{begin, end}};
  for (int level = 0; level < 3; ++level) {
    std::vector<std::pair<std::size_t, std::size_t>> halves;
    for (const auto& [from, to] : parts) {
      if (to - from <= cluster_faces_) {
        halves.emplace_back(from, to);
        continue;
      }
      const GridBox whole = box_of(faces, from, to);
      int axis = 0;
      for (int k = 1; k < 3; ++k)
        if (std::int64_t{whole.hi[k]} - whole.lo[k] > std::int64_t{whole.hi[axis]} - whole.lo[axis])
          axis = k;
      // In whole clusters, so that they are full.
      const std::size_t clusters = (to - from + cluster_faces_ - 1) / cluster_faces_;
      const std::size_t middle = from + (clusters / 2) * cluster_faces_;
      const auto at = [&](std::size_t i) { return faces.begin() + static_cast<std::ptrdiff_t>(i); };
      std::nth_element(at(from), at(middle), at(to), [axis](const TreeFace& x, const TreeFace& y) {
        const auto sum = [axis](const TreeFace& f) {
          return std::int64_t{f.corners[0][axis]} + f.corners[1][axis] + f.corners[2][axis];
        };
        return sum(x) != sum(y) ? sum(x) < sum(y) : x.key < y.key;
      });
      halves.emplace_back(from, middle);
      halves.emplace_back(middle, to);
    }
    parts = std::move(halves);
  }
  for (const auto& [from, to] : parts) {
    const GridBox part = decoded(box, codes(box, box_of(faces, from, to)));
    const std::uint32_t child = build(faces, from, to, part);
    nodes_[self].children.push_back(child);
  }
  return self;
}

template <class Emit>
void Clusters::code_node(const Node& node, const Emit& emit) const {
  for (const std::uint32_t child : node.children)
    for (const auto code : codes(node.box, nodes_[child].box)) emit(kBoxAxis, code, 0);
  const GridPoint& from = node.box.lo;
  if (!node.faces.empty()) code_faces(node.faces, header_->lattice_shift, from, emit);
}

void Clusters::train() {
  for (const Node& node : nodes_)
    code_node(node, [&](int context, int symbol, int) { costs_.count(context, symbol); });
  for (Node& node : nodes_) {
    node.bits = static_cast<double>(node.children.size());  // inner node or cluster
    code_node(node, [&](int context, int symbol, int raw) {
      node.bits += costs_.bits(context, symbol) + raw;
    });
  }
}

Walk walk(const Clusters& a, const Clusters& b, const PosedPair& posed) {
  const RelativeFrame frame = make_relative_frame(posed.a, posed.b);
  const auto size = [](const Node& node, const Grid& grid) {
    return std::ldexp(static_cast<double>(size_of(node.box)), grid.exponent);
  };
  std::set<std::uint32_t> opened_a, opened_b;
  Walk found;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> stack{{0, 0}};
  while (!stack.empty()) {
    const auto [i, j] = stack.back();
    stack.pop_back();
    const Node &x = a.node(i), &y = b.node(j);
    if (boxes_apart(frame, centered(x.box), centered(y.box))) continue;
    if (x.children.empty() && y.children.empty()) {
      opened_a.insert(i);
      opened_b.insert(j);
      found.clusters.emplace_back(i, j);
    } else if (y.children.empty() ||
               (!x.children.empty() && size(x, posed.a.grid) >= size(y, posed.b.grid))) {
      opened_a.insert(i);
      for (const std::uint32_t child : x.children) stack.emplace_back(child, j);
    } else {
      opened_b.insert(j);
      for (const std::uint32_t child : y.children) stack.emplace_back(i, child);
    }
  }
  found.a.assign(opened_a.begin(), opened_a.end());  // a node's number is above its parent's
  found.b.assign(opened_b.begin(), opened_b.end());
  std::sort(found.clusters.begin(), found.clusters.end());
  return found;
}

}  // namespace nearmesh::chart
