// SPDX-License-Identifier: Apache-2.0
#include "predict.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <utility>

#include "core/geometry/motion_bounds.hpp"
#include "vector3.hpp"

namespace nearmesh {
namespace {

Vector3d vector(const std::array<double, 3>& v) { return {v}; }
Matrix3d rotation(const Pose& pose) { return {pose.rotation}; }

struct MetreBox {
  Vector3d center, half;
};

MetreBox in_metres(const Grid& grid, const GridBox& box) {
  Vector3d lo, hi;
  const double cell_m = std::ldexp(1.0, grid.exponent);  // so that products are exact
  for (int k = 0; k < 3; ++k) {
    lo[k] = box.lo[k] * cell_m;
    hi[k] = box.hi[k] * cell_m;
  }
  return {vector(grid.origin_m) + (lo + hi) * 0.5, (hi - lo) * 0.5};
}

std::int32_t clamp_grid(double x) {
  return static_cast<std::int32_t>(std::clamp(x, -2147483648.0, 2147483647.0));
}

// So many items are found for each part of a region, then grouped.
constexpr std::size_t kItemsPerPart = 16;

// Something of the other body's tree: an entry, or one face of it.
struct Item {
  GridBox box;
  TreeEntry entry;
  std::uint32_t faces = kAllLanes;  // of a block: those meant
};

// Calls emit for each of `groups` parts of what has boxes, alike in number and close together.
template <class Boxed, class Emit>
void cut(std::span<Boxed> items, std::size_t groups, const Emit& emit) {
  if (groups == 1) {
    emit(items);
    return;
  }
  const auto twice_center = [](const Boxed& item, int axis) {
    return std::int64_t{item.box.lo[axis]} + item.box.hi[axis];
  };
  int axis = 0;
  std::int64_t longest = -1;
  for (int k = 0; k < 3; ++k) {
    const auto [least, most] = std::minmax_element(
        items.begin(), items.end(),
        [&](const Boxed& x, const Boxed& y) { return twice_center(x, k) < twice_center(y, k); });
    const std::int64_t length = twice_center(*most, k) - twice_center(*least, k);
    if (length <= longest) continue;
    longest = length;
    axis = k;
  }
  // Stable, so that equal centres stay in the tree's order.
  std::stable_sort(items.begin(), items.end(), [&](const Boxed& x, const Boxed& y) {
    return twice_center(x, axis) < twice_center(y, axis);
  });
  const std::size_t left = groups / 2, middle = items.size() * left / groups;
  cut(items.first(middle), left, emit);
  cut(items.subspan(middle), groups - left, emit);
}

// Carries what is in the other body's tree into own's model frame and over the look-ahead.
class Sweep {
 public:
  Sweep(const TreeView& own, const Motion& own_motion, const TreeView& other,
        const Motion& other_motion, double lookahead_s, double margin_m)
      : own_(*own.grid),
        other_(other),
        margin_m_(margin_m),
        cell_(std::ldexp(1.0, own.grid->exponent)) {
    const Matrix3d to_own = rotation(own_motion.pose).transposed();
    turn_ = to_own * rotation(other_motion.pose);
    offset_ =
        to_own * (vector(other_motion.pose.translation_m) - vector(own_motion.pose.translation_m));
    // Drift of the other body over the look-ahead; turning is covered by growing each box.
    drift_ = to_own *
             (vector(other_motion.linear_velocity_mps) - vector(own_motion.linear_velocity_mps)) *
             lookahead_s;
    own_turn_ = norm(vector(own_motion.angular_velocity_radps)) * lookahead_s;
    other_turn_ = norm(vector(other_motion.angular_velocity_radps)) * lookahead_s;
  }

  // Where a box of the other's grid may be.
  [[nodiscard]] GridBox box(const GridBox& box) const {
    const MetreBox m = in_metres(*other_.grid, box);
    const Vector3d center = offset_ + turn_ * m.center, half = absolute(turn_) * m.half;
    return covering(center - half, center + half, growth(box) / cell_);
  }
  // Where what some items bound may be: closer than their boxes.
  [[nodiscard]] RegionPart part(std::span<const Item> items) const {
    Pieces pieces;
    GridBox box;
    for (const Item& item : items) {
      gather(item.entry, item.faces, kPartDepth, pieces);
      box.add(item.box);
    }
    Vector3d lo{{1e300, 1e300, 1e300}}, hi{{-1e300, -1e300, -1e300}};
    for (const MetreBox& piece : pieces.boxes) {
      const Vector3d half = absolute(turn_) * piece.half;
      lo = least_of(lo, piece.center - half);
      hi = greatest_of(hi, piece.center + half);
    }
    for (const Vector3d& point : pieces.points) {
      lo = least_of(lo, point);
      hi = greatest_of(hi, point);
    }
    const double growth_m = growth(box);
    const double radius = std::min(std::ceil(growth_m / cell_), double{kMaxRegionRadius});
    RegionPart part = covering(lo, hi, std::max(0.0, growth_m / cell_ - radius));
    part.radius = static_cast<std::int32_t>(radius);
    add_slab(pieces, growth_m, part);
    part.min_extent = min_extent(items);
    return part;
  }

 private:
  // Own nodes down to so much of the size of the other's unresolved nodes are asked for: finer ones
  // would be tested against boxes that are about to shrink. Below 1, so that two bodies never wait
  // for each other.
  static constexpr double kFinest = 0.5;
  static constexpr int kPartDepth = 1;
  // In own's model frame, metres; halves along the other's axes.
  struct Pieces {
    std::vector<Vector3d> points;
    std::vector<MetreBox> boxes;
    Vector3d normal;
  };

  [[nodiscard]] double growth(const GridBox& box) const {
    const MetreBox m = in_metres(*other_.grid, box);
    const Vector3d center = offset_ + turn_ * m.center, half = absolute(turn_) * m.half;
    return margin_m_ + other_turn_ * reach_m(*other_.grid, box) +
           own_turn_ * (norm(center) + norm(half) + norm(drift_)) + cell_;
  }
  // The drifting box, grown by so many cells.
  [[nodiscard]] GridBox covering(const Vector3d& lo, const Vector3d& hi, double cells) const {
    GridBox covering;
    for (int k = 0; k < 3; ++k) {
      const double origin = own_.origin_m[static_cast<std::size_t>(k)];
      const double from = (lo[k] + std::min(drift_[k], 0.0) - origin) / cell_;
      const double to = (hi[k] + std::max(drift_[k], 0.0) - origin) / cell_;
      covering.lo[k] = clamp_grid(std::floor(from - cells));
      covering.hi[k] = clamp_grid(std::ceil(to + cells));
    }
    return covering;
  }
  [[nodiscard]] std::int32_t min_extent(std::span<const Item> items) const {
    double least = 1e300;  // cells of the other's grid
    for (const Item& item : items)
      least = item.entry.kind() == TreeEntry::Kind::kUnresolved
                  ? std::min(least, static_cast<double>(item.box.extent()))
                  : 0;
    return clamp_grid(std::floor(kFinest * std::ldexp(least, other_.grid->exponent) / cell_));
  }
  void gather(const TreeEntry& entry, std::uint32_t faces, int depth, Pieces& pieces) const {
    if (entry.kind() == TreeEntry::Kind::kFaces) {
      for (std::uint32_t i = 0; i < entry.count(); ++i) {
        if ((faces >> i & 1U) == 0) continue;
        const TreeFace face = other_.blocks[entry.first].face(i);
        std::array<Vector3d, 3> at;
        for (std::size_t k = 0; k < 3; ++k) {
          const GridPoint& p = face.corners[k];
          at[k] = offset_ + turn_ * in_metres(*other_.grid, {p, p}).center;
          pieces.points.push_back(at[k]);
        }
        pieces.normal = pieces.normal + cross(at[1] - at[0], at[2] - at[0]);
      }
    } else if (entry.kind() == TreeEntry::Kind::kInner && depth > 0) {
      other_.for_each_child(
          entry, [&](const TreeEntry& child) { gather(child, kAllLanes, depth - 1, pieces); });
    } else {
      const MetreBox m = in_metres(*other_.grid, entry.box);
      pieces.boxes.push_back({offset_ + turn_ * m.center, m.half});
    }
  }
  // The slab across the faces' mean normal; none where they have none.
  void add_slab(const Pieces& pieces, double growth_m, RegionPart& part) const {
    const Vector3d sizes = absolute(pieces.normal);
    const double size = sizes[0] + sizes[1] + sizes[2];
    if (!(size > 0)) return;
    Vector3d normal;
    for (int k = 0; k < 3; ++k) {
      // Truncated, so that the sum keeps its bound.
      normal[k] = std::trunc(pieces.normal[k] / size * kMaxSlabNormal);
      part.normal[static_cast<std::size_t>(k)] = static_cast<std::int8_t>(normal[k]);
    }
    double least = 1e300, most = -1e300;
    for (const Vector3d& point : pieces.points) {
      least = std::min(least, dot(normal, point));
      most = std::max(most, dot(normal, point));
    }
    for (const MetreBox& piece : pieces.boxes) {
      const double at = dot(normal, piece.center);
      const double half = dot(absolute(turn_.transposed() * normal), piece.half);
      least = std::min(least, at - half);
      most = std::max(most, at + half);
    }
    const double from = dot(normal, vector(own_.origin_m)), along = dot(normal, drift_);
    const double wider = norm(normal) * growth_m;
    part.slab_lo =
        clamp_grid(std::floor((least - from + std::min(along, 0.0) - wider) / cell_ / 128));
    part.slab_hi =
        clamp_grid(std::ceil((most - from + std::max(along, 0.0) + wider) / cell_ / 128));
  }

  const Grid& own_;
  const TreeView& other_;
  const double margin_m_, cell_;
  Matrix3d turn_;
  Vector3d offset_, drift_;
  double own_turn_ = 0, other_turn_ = 0;
};

// ---- what an answer brings ----------------------------------------------------------------------

// A part takes 17 bytes of a request, a split some 9 of a small answer, its share of datagrams
// included: with one part for so many splits a small request weighs no more than its answer.
constexpr double kSplitsPerPart = 2;

// Where a part reaches.
GridBox reach_of(const RegionPart& part) {
  GridBox reach;
  for (int k = 0; k < 3; ++k) {
    reach.lo[k] = clamp_grid(double{0} + part.box.lo[k] - part.radius);
    reach.hi[k] = clamp_grid(double{0} + part.box.hi[k] + part.radius);
  }
  return reach;
}

// Splits to expect below a node of so many vertices where a region reaches into its box: nodes k
// levels down are 2^k, spread evenly, of 2^(-k/2) times its size.
double expected_splits(const GridBox& box, std::uint32_t vertices, const GridBox& reach,
                       std::int32_t min_extent) {
  std::array<double, 3> share;
  for (int k = 0; k < 3; ++k) {
    const double lo = std::max(reach.lo[k], box.lo[k]), hi = std::min(reach.hi[k], box.hi[k]);
    if (lo > hi) return 0;
    share[static_cast<std::size_t>(k)] = (hi - lo + 1) / (double{1} + box.hi[k] - box.lo[k]);
  }
  double splits = 0, side = 1;
  for (double nodes = 1; nodes<vertices&& static_cast<double>(box.extent()) * side> min_extent;
       nodes *= 2, side *= 0.70710678) {
    double met = nodes;
    for (const double s : share) met *= (s + side) / (1 + side);
    splits += met;
  }
  return std::min(splits, double{0} + vertices - 1);
}
// The same for all parts of a region: no more than their sum, nor than one box around them.
double expected_splits(const GridBox& box, std::uint32_t vertices,
                       std::span<const RegionPart> region) {
  double sum = 0;
  GridBox whole;
  std::int32_t least = std::numeric_limits<std::int32_t>::max();
  for (const RegionPart& part : region) {
    if (!part.asks_for(box)) continue;
    const GridBox reach = reach_of(part);
    sum += expected_splits(box, vertices, reach, part.min_extent);
    whole.add(reach);
    least = std::min(least, part.min_extent);
  }
  return sum > 0 ? std::min(sum, expected_splits(box, vertices, whole, least)) : 0;
}

// Of the nodes that a region asks for, those in the order of their ids of which `max_splits` are
// expected; one at least. Neighbours by id are neighbours in space.
void keep_whole_nodes(const SplitStore& store, std::span<const RegionPart> region,
                      std::uint32_t max_splits, std::vector<NodeSpan>& nodes) {
  const auto expected = [&](const NodeSpan& node) {
    return expected_splits(store.box(node), node.size, region);
  };
  double sum = 0;
  for (const NodeSpan& node : nodes) sum += expected(node);
  if (sum <= max_splits || nodes.empty()) return;
  std::sort(nodes.begin(), nodes.end());
  sum = expected(nodes.front());
  std::size_t count = 1;
  while (count < nodes.size() && (sum += expected(nodes[count])) <= max_splits) ++count;
  nodes.resize(count);
}

}  // namespace

std::vector<RegionPart> swept_region(const TreeView& own, const Motion& own_motion,
                                     const TreeView& other, const Motion& other_motion,
                                     double lookahead_s, double margin_m, std::size_t max_parts,
                                     std::span<const GridBox> near) {
  const Sweep sweep(own, own_motion, other, other_motion, lookahead_s, margin_m);
  const auto is_near = [near](const RegionPart& part) {
    return std::any_of(near.begin(), near.end(),
                       [&](const GridBox& box) { return part.meets(box); });
  };
  // Largest first, so that the items end up alike in size.
  struct Open {
    std::int64_t extent;
    std::uint32_t order;
    Item item;
    bool operator<(const Open& o) const {
      return extent != o.extent ? extent < o.extent : order > o.order;
    }
  };
  std::priority_queue<Open> open;
  std::uint32_t order = 0;
  std::vector<Item> items;
  const auto offer = [&](const Item& item) {
    if (is_near(sweep.box(item.box))) open.push({item.box.extent(), order++, item});
  };
  const TreeEntry root = other.root();
  if (root.kind() != TreeEntry::Kind::kEmpty) offer({root.box, root});
  while (!open.empty()) {
    const Item item = open.top().item;
    open.pop();
    const bool has_room = open.size() + items.size() + kLanes <= kItemsPerPart * max_parts;
    if (has_room && item.entry.kind() == TreeEntry::Kind::kInner) {
      other.for_each_child(item.entry, [&](const TreeEntry& child) { offer({child.box, child}); });
    } else if (has_room && item.entry.kind() == TreeEntry::Kind::kFaces &&
               item.faces == kAllLanes) {
      for (std::uint32_t i = 0; i < item.entry.count(); ++i) {
        Item face{{}, item.entry, 1U << i};
        for (const GridPoint& p : other.blocks[item.entry.first].face(i).corners) face.box.add(p);
        offer(face);
      }
    } else {
      items.push_back(item);
    }
  }
  std::vector<RegionPart> region;
  if (!items.empty())
    cut(std::span(items), std::min(items.size(), max_parts), [&](std::span<const Item> group) {
      if (const RegionPart part = sweep.part(group); is_near(part)) region.push_back(part);
    });
  return region;
}

std::vector<RegionPart> merge_by_place(std::vector<RegionPart> parts, std::size_t most) {
  if (parts.size() <= most) return parts;
  std::vector<RegionPart> merged;
  cut(std::span(parts), most, [&](std::span<const RegionPart> group) {
    RegionPart all = group.front();
    if (group.size() > 1) {
      all = RegionPart(reach_of(group.front()));
      all.min_extent = group.front().min_extent;
      for (const RegionPart& part : group) {
        all.box.add(reach_of(part));
        all.min_extent = std::min(all.min_extent, part.min_extent);
      }
    }
    merged.push_back(all);
  });
  return merged;
}

std::vector<GridBox> root_reach(const SplitStore& store) {
  std::vector<GridBox> reach;
  for (const BaseRoot& root : store.roots()) reach.push_back(reach_below(store.box(root.node)));
  return reach;
}

namespace {

/// What is unresolved within a region of a few parts: the nodes, largest first, and that region.
struct Unresolved {
  std::vector<NodeSpan> nodes;
  std::vector<RegionPart> region;
};

Unresolved find_unresolved(const SplitStore& store, const RegionMaker& region) {
  Unresolved found;
  found.region = region(kCoarseParts, root_reach(store));
  found.nodes = unresolved_in(store, found.region, store.vertex_count());
  return found;
}

std::vector<GridBox> reach_of(const SplitStore& store, std::span<const NodeSpan> nodes) {
  std::vector<GridBox> reach;
  for (const NodeSpan& node : nodes) reach.push_back(reach_below(store.box(node)));
  return reach;
}

bool asks_for(std::span<const RegionPart> region, const GridBox& box) {
  return std::any_of(region.begin(), region.end(),
                     [&](const RegionPart& part) { return part.asks_for(box); });
}

}  // namespace

std::optional<RegionRequest> make_request(const SplitStore& store, const RegionMaker& region,
                                          std::vector<NodeSpan> missing, std::size_t max_parts,
                                          std::uint32_t max_splits, Portion portion) {
  const auto [unresolved, coarse] = find_unresolved(store, region);
  if (unresolved.empty() && missing.empty()) return std::nullopt;
  std::vector<GridBox> near = reach_of(store, unresolved);
  const std::vector<GridBox> near_missing = reach_of(store, missing);
  near.insert(near.end(), near_missing.begin(), near_missing.end());
  auto expected = static_cast<double>(missing.size());
  for (const NodeSpan& node : unresolved)
    expected += expected_splits(store.box(node), node.size, coarse);
  const double parts = std::min<double>(expected, max_splits) / kSplitsPerPart;
  max_parts = std::clamp<std::size_t>(static_cast<std::size_t>(parts), 1, max_parts);

  RegionRequest request{{}, region(max_parts, near), max_splits};
  for (const NodeSpan& node : unresolved)
    if (!std::binary_search(missing.begin(), missing.end(), node) &&
        asks_for(request.region, store.box(node)))
      request.attach.push_back(node);
  if (portion == Portion::kWholeNodes)
    keep_whole_nodes(store, request.region, max_splits, request.attach);
  request.attach.resize(
      std::min(request.attach.size(), kMaxAttachNodes - std::min(kMaxAttachNodes, missing.size())));
  request.attach.insert(request.attach.end(), missing.begin(), missing.end());
  if (request.attach.empty()) return std::nullopt;
  // Parts that matter to none of these nodes need not travel.
  near = reach_of(store, request.attach);
  std::erase_if(request.region, [&near](const RegionPart& part) {
    return std::none_of(near.begin(), near.end(),
                        [&part](const GridBox& box) { return part.meets(box); });
  });
  // A node that was met, but by no region: it is asked for all the same.
  if (request.region.empty()) request.region.emplace_back(store.box(request.attach.front()));
  std::sort(request.attach.begin(), request.attach.end());
  return request;
}

}  // namespace nearmesh
