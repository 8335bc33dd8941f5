// SPDX-License-Identifier: Apache-2.0
// Rays through a tree, eight boxes at a time, nearest first; once for each instruction set.
//
// In which units. Boxes stay in the body's grid; a ray is brought there. A posed corner lies within half a lattice cell, along each axis of the
// lattice, of where the frame's matrix M takes its grid point, and a face's points between. So what M's inverse takes back lies within half the
// sum of |M^-1|'s row of the box: `margin`. The rest of it is for doubles. M has exact entries, 30 bits; its cofactors and its determinant, near
// 1 in lattice cells a cell, are off by less than 2^-49 of their size; points are less than 2^36 lattice cells from the
// frame's origin, so they come out right to 2^-12 lattice cells: a sixteenth more of a cell is plenty.
//
// Slabs. On axis k the ray is within [lo, hi] from t = (near - o) / d to (far - o) / d. Coordinates are below 2^35 here: difference, reciprocal and
// product together shift a plane by less than 2^-15 grid units, and margins have 2^-14 for that. A ray that moves by less than 2^-20 along
// an axis is taken to move by so much. So the t at which a ray enters a box, as computed, is never later than the true
// t of anything in the box; and what is entered after it is left, or after what is known to be hit, is not met before that.
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/query/ray_walk.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "ray_walk.hpp"
//
#include "core/geometry/vectors.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

class RayWalk {
 public:
  RayWalk(const TreeView& tree, const PosedFrame& frame, std::vector<NodeOnRay>& nodes,
          QueryStats& stats)
      : tree_(tree), frame_(frame), view_(frame), nodes_(nodes), stats_(stats) {}

  void run(const CutRay& cut, RayFound& found) {
    found = {};
    found.first_node = static_cast<std::uint32_t>(nodes_.size());
    if (cut.is_empty) return;
    aim(cut.ray);
    ray_ = &cut.ray;
    found_ = &found;
    limit_ = 1;
    push_lanes(0);
    while (!stack_.empty()) {
      const Waiting next = stack_.back();
      stack_.pop_back();
      if (next.enter > limit_) continue;
      const TreeNode& node = tree_.nodes[next.place / kLanes];
      const std::uint32_t lane = next.place % kLanes;
      if (node.kind(lane) == TreeEntry::Kind::kInner) {
        push_lanes(node.first[lane]);
      } else if (node.kind(lane) == TreeEntry::Kind::kFaces) {
        test_faces(tree_.blocks[node.first[lane]], node.kind_and_count[lane] >> 2);
      } else {
        nodes_.push_back({next.place, next.enter, next.leave});
      }
    }
    // What was found before a nearer hit was.
    const auto first = nodes_.begin() + found.first_node;
    nodes_.erase(std::remove_if(first, nodes_.end(),
                                [this](const NodeOnRay& node) { return node.enter > limit_; }),
                 nodes_.end());
    found.nodes = static_cast<std::uint32_t>(nodes_.size()) - found.first_node;
  }

 private:
  struct Waiting {
    double enter, leave;
    TreePlace place;
  };

  void aim(const LatticeRay& ray) {
    const std::array<double, 3> from = view_.point(ray.from), to = view_.point(ray.to);
    for (std::size_t k = 0; k < 3; ++k) {
      constexpr double kLeast = 0x1p-20;
      double way = to[k] - from[k];
      if (std::abs(way) < kLeast) way = kLeast;
      inverse_[k] = 1 / way;
      falls_[k] = way < 0;
      const double room = falls_[k] ? -view_.margin[k] : view_.margin[k];
      near_[k] = from[k] + room;
      far_[k] = from[k] - room;
    }
  }

  /// Which lanes the ray is in for a while before limit_; from when to when.
  template <class Load>
  HWY_INLINE std::uint32_t meets(const Load& load_planes, double (&enter)[kLanes],
                                 double (&leave)[kLanes]) {
    const Doubles d;
    std::uint32_t met = 0;
    for (std::size_t i = 0; i < kLanes; i += hn::Lanes(d)) {
      Vec in = hn::Zero(d), out = hn::Set(d, limit_);
      for (std::size_t k = 0; k < 3; ++k) {
        const auto [lo, hi] = load_planes(k, i);
        const Vec inverse = hn::Set(d, inverse_[k]);
        const Vec near = falls_[k] ? hi : lo, far = falls_[k] ? lo : hi;
        in = hn::Max(in, hn::Mul(hn::Sub(near, hn::Set(d, near_[k])), inverse));
        out = hn::Min(out, hn::Mul(hn::Sub(far, hn::Set(d, far_[k])), inverse));
      }
      hn::StoreU(in, d, enter + i);
      hn::StoreU(out, d, leave + i);
      met |= bits_of(hn::Le(in, out)) << i;
    }
    return met;
  }

  void push_lanes(std::uint32_t at) {
    const TreeNode& node = tree_.nodes[at];
    struct Planes {
      Vec lo, hi;
    };
    double enter[kLanes], leave[kLanes];
    std::uint32_t met = node.lanes & meets(
                                         [&node](std::size_t k, std::size_t i) {
                                           return Planes{load(node.boxes.lo[k] + i),
                                                         load(node.boxes.hi[k] + i)};
                                         },
                                         enter, leave);
    stats_.box_tests += kLanes;
    const std::size_t before = stack_.size();
    for (; met != 0; met &= met - 1) {
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(met));
      stack_.push_back({enter[lane], leave[lane], at * kLanes + lane});
      for (std::size_t i = stack_.size() - 1; i > before && stack_[i - 1].enter < stack_[i].enter;
           --i)
        std::swap(stack_[i - 1], stack_[i]);
    }
  }

  void test_faces(const FaceBlock& block, std::uint32_t count) {
    struct Planes {
      Vec lo, hi;
    };
    double enter[kLanes], leave[kLanes];
    std::uint32_t met =
        ((1U << count) - 1) & meets(
                                  [&block](std::size_t k, std::size_t i) {
                                    const Vec a = load(block.triangles.corner[0][k] + i),
                                              b = load(block.triangles.corner[1][k] + i),
                                              c = load(block.triangles.corner[2][k] + i);
                                    return Planes{hn::Min(hn::Min(a, b), c),
                                                  hn::Max(hn::Max(a, b), c)};
                                  },
                                  enter, leave);
    for (; met != 0; met &= met - 1) {
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(met));
      ++stats_.triangle_tests;
      RayFound candidate{.has_face = true, .key = block.keys[lane]};
      candidate.face = pose_triangle(frame_, block.triangles.corners(lane));
      const std::optional<RayHit> hit = first_hit(*ray_, candidate.face);
      if (!hit) continue;
      candidate.hit = *hit;
      if (found_->has_face && !comes_before(*ray_, candidate, *found_)) continue;
      candidate.first_node = found_->first_node;
      *found_ = candidate;
      limit_ = std::min(1.0, found_->limit());
    }
  }

  const TreeView& tree_;
  const PosedFrame& frame_;
  const GridView view_;
  std::vector<NodeOnRay>& nodes_;
  QueryStats& stats_;
  std::vector<Waiting> stack_;
  const LatticeRay* ray_ = nullptr;
  RayFound* found_ = nullptr;
  double limit_ = 1;
  double inverse_[3], near_[3], far_[3];
  bool falls_[3];
};

void walk_all_rays(const TreeView& tree, const PosedFrame& frame, std::span<const CutRay> rays,
                   std::span<RayFound> found, std::vector<NodeOnRay>& nodes, QueryStats& stats) {
  RayWalk walk(tree, frame, nodes, stats);
  for (std::size_t i = 0; i < rays.size(); ++i) walk.run(rays[i], found[i]);
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(walk_all_rays);

GridView::GridView(const PosedFrame& frame) : origin_(frame.translation) {
  std::array<double, 9> m;
  for (std::size_t i = 0; i < 9; ++i) m[i] = static_cast<double>(frame.rotation[i]) * 0x1p-30;
  std::array<double, 9> cofactor;  // [3 i + k]: of m's entry (k, i)
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t r = (k + 1) % 3, s = (k + 2) % 3, c = (i + 1) % 3, e = (i + 2) % 3;
      cofactor[3 * i + k] = m[3 * r + c] * m[3 * s + e] - m[3 * r + e] * m[3 * s + c];
    }
  const double determinant = m[0] * cofactor[0] + m[1] * cofactor[3] + m[2] * cofactor[6];
  const double cells = std::ldexp(1.0, frame.shift - 30);  // a lattice cell in grid units
  for (std::size_t i = 0; i < 3; ++i) {
    double row = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      inverse_[3 * i + k] = cofactor[3 * i + k] / determinant * cells;
      row += std::abs(inverse_[3 * i + k]);
    }
    margin[i] = 0.5625 * row + 0x1p-14;
    beyond_[i] = beyond_translation(frame, i);
  }
}

std::array<double, 3> GridView::point(const LatticePoint& at) const {
  std::array<double, 3> way, out;
  for (std::size_t k = 0; k < 3; ++k)
    way[k] = static_cast<double>(at.v[k] - origin_[k]) - beyond_[k];
  for (std::size_t i = 0; i < 3; ++i)
    out[i] = inverse_[3 * i] * way[0] + inverse_[3 * i + 1] * way[1] + inverse_[3 * i + 2] * way[2];
  return out;
}

CutRay cut_ray(const RayProbe& ray, const LatticeBox& bounds, int lattice_exp) {
  const double cells_per_m = std::ldexp(1.0, -lattice_exp);
  const auto& d = ray.direction;
  const double scale = std::max(std::max(std::abs(d[0]), std::abs(d[1])), std::abs(d[2]));
  std::array<double, 3> along{d[0] / scale, d[1] / scale, d[2] / scale}, from;
  const double length =
      std::sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2]);
  double begin = 0, end = ray.range_m * cells_per_m;
  std::array<double, 3> lo, hi;
  for (std::size_t k = 0; k < 3; ++k) {
    along[k] /= length;
    from[k] = ray.origin_m[k] * cells_per_m;
    lo[k] = static_cast<double>(bounds.lo.v[k]) - 1;
    hi[k] = static_cast<double>(bounds.hi.v[k]) + 1;
    if (along[k] == 0) {
      if (from[k] < lo[k] || from[k] > hi[k]) return {};
      continue;
    }
    const double one = (lo[k] - from[k]) / along[k], two = (hi[k] - from[k]) / along[k];
    begin = std::max(begin, std::min(one, two));
    end = std::min(end, std::max(one, two));
  }
  if (begin > end) return {};
  CutRay cut{.begin_m = begin / cells_per_m, .end_m = end / cells_per_m, .is_empty = false};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto point = [&](double way) {
      const double at = along[k] == 0 ? from[k] : from[k] + way * along[k];
      return static_cast<std::int64_t>(std::floor(std::clamp(at, lo[k], hi[k]) + 0.5));
    };
    cut.ray.from.v[k] = point(begin);
    cut.ray.to.v[k] = point(end);
  }
  return cut;
}

LatticeBox bounds_of(const PosedFrame& frame) {
  const auto most = static_cast<std::int32_t>((std::int64_t{1} << frame.grid.bits) - 1);
  return pose_box(frame, {{{0, 0, 0}}, {{most, most, most}}});
}

bool comes_before(const LatticeRay& ray, const RayFound& one, const RayFound& other) {
  if (one.hit.t + one.hit.error < other.hit.t - other.hit.error) return true;
  if (one.hit.t - one.hit.error > other.hit.t + other.hit.error) return false;
  const ExactTime t = exact_hit(ray, one.face), before = exact_hit(ray, other.face);
  if (t < before) return true;
  return !(before < t) && one.key < other.key;
}

void walk_rays(const TreeView& tree, const PosedFrame& frame, std::span<const CutRay> rays,
               std::span<RayFound> found, std::vector<NodeOnRay>& nodes, QueryStats& stats) {
  if (tree.nodes[0].lanes == 0) {
    for (RayFound& none : found) none = {};
    return;
  }
  HWY_DYNAMIC_DISPATCH(walk_all_rays)(tree, frame, rays, found, nodes, stats);
}

}  // namespace nearmesh
#endif
