// SPDX-License-Identifier: Apache-2.0
// Rays through a tree, eight boxes at a time; once for each instruction set. Of all rays of a batch
// sixteen parts are in flight, as in walk.cpp, so that none waits for another's memory, and what a
// test comes to need not be foretold.
//
// In which units. Boxes stay in the body's grid; a ray is brought there. A posed corner lies within
// half a lattice cell, along each axis of the lattice, of where the frame's matrix M takes its grid
// point, and a face's points between. So what M's inverse takes back lies within half the sum of
// |M^-1|'s row of the box: `margin`. The rest of it is for doubles. M has exact entries, 30 bits;
// its cofactors and its determinant, near 1 in lattice cells a cell, are off by less than 2^-49 of
// their size; points are less than 2^36 lattice cells from the frame's origin, so they come out
// right to 2^-12 lattice cells: a sixteenth more of a cell is plenty.
//
// Slabs. On axis k the ray is within [lo, hi] from t = (near - o) / d to (far - o) / d. Coordinates
// are below 2^35 here: difference, reciprocal and product together shift a plane by less than 2^-15
// grid units, and margins have 2^-14 for that. A ray that moves by less than 2^-20 along an axis is
// taken to move by so much. So the t at which a ray enters a box, as computed, is never later than
// the true t of anything in the box; and what is entered after it is left, or after what is known
// to be hit, is not met before that.
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/query/ray_walk.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "lane_lists.hpp"
#include "ray_walk.hpp"
//
#include "core/geometry/vectors.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

class RayWalk {
 public:
  RayWalk(const TreeView& tree, const PosedFrame& frame)
      : tree_(tree), frame_(frame), view_(frame) {}

  void run(std::span<const CutRay> rays, std::span<RayFound> found, std::vector<NodeOnRay>& nodes,
           QueryStats& stats) {
    rays_ = rays;
    found_ = found;
    aims_.resize(rays.size());
    waiting_.resize(std::max(waiting_.size(), rays.size() + kBatch * kLanes));
    for (std::uint32_t i = 0; i < rays.size(); ++i) {
      found[i] = {};
      if (rays[i].is_empty) continue;
      aim(rays[i].ray, aims_[i]);
      waiting_[count_++] = {0, i, 0};
    }
    while (count_ != 0) {
      step();
      if (count_ == 0 || ends_.size() >= kBatch) test_ends();
    }
    settle_nodes(nodes);
    stats.box_tests += box_tests_;
    stats.triangle_tests += face_tests_;
  }

 private:
  struct Aim {
    double inverse[3], above[3], below[3];  // of where the ray starts, by the margin
    double limit;
  };
  struct Waiting {
    double enter;
    std::uint32_t ray;
    TreePlace place;
  };

  void aim(const LatticeRay& ray, Aim& aim) const {
    const std::array<double, 3> from = view_.point(ray.from), to = view_.point(ray.to);
    for (std::size_t k = 0; k < 3; ++k) {
      constexpr double kLeast = 0x1p-20;
      double way = to[k] - from[k];
      if (std::abs(way) < kLeast) way = kLeast;
      aim.inverse[k] = 1 / way;
      aim.above[k] = from[k] + view_.margin[k];
      aim.below[k] = from[k] - view_.margin[k];
    }
    aim.limit = 1;
  }

  /// Which lanes the ray is in for a while before its limit, and from when on. `planes(k, i, lo,
  /// hi)` loads those of the lanes from i on.
  template <class Planes>
  static HWY_INLINE std::uint32_t meets(const Aim& aim, const Planes& planes,
                                        double (&enter)[kLanes]) {
    const Doubles d;
    std::uint32_t met = 0;
    for (std::size_t i = 0; i < kLanes; i += hn::Lanes(d)) {
      Vec in = hn::Zero(d), out = hn::Set(d, aim.limit);
      for (std::size_t k = 0; k < 3; ++k) {
        Vec lo, hi;
        planes(k, i, lo, hi);
        const Vec inverse = hn::Set(d, aim.inverse[k]);
        const Vec one = hn::Mul(hn::Sub(lo, hn::Set(d, aim.above[k])), inverse),
                  two = hn::Mul(hn::Sub(hi, hn::Set(d, aim.below[k])), inverse);
        in = hn::Max(in, hn::Min(one, two));
        out = hn::Min(out, hn::Max(one, two));
      }
      hn::StoreU(in, d, enter + i);
      met |= bits_of(hn::Le(in, out)) << i;
    }
    return met;
  }

  /// All of its lines that a test reads.
  template <class Thing>
  static HWY_INLINE void prefetch(const Thing& thing) {
    const char* const first = reinterpret_cast<const char*>(&thing);
    for (std::size_t at = 0; at < sizeof(Thing); at += 64) __builtin_prefetch(first + at);
  }

  /// The latest few parts at once, so that one test need not wait for the other; what of them is
  /// inner is opened. Of several lanes that a ray meets the nearest comes next.
  void step() {
    const std::size_t count = std::min(count_, kBatch);
    Waiting opened[kBatch];
    std::size_t open = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Waiting& next = waiting_[--count_];
      const TreeNode& node = tree_.nodes[next.place / kLanes];
      const std::uint32_t lane = next.place % kLanes;
      const bool counts = next.enter <= aims_[next.ray].limit;
      if (node.kind(lane) == TreeEntry::Kind::kInner) {
        opened[open] = {next.enter, next.ray, node.first[lane]};
        prefetch(tree_.nodes[node.first[lane]]);
        open += counts ? 1 : 0;
      } else if (counts) {
        if (node.kind(lane) == TreeEntry::Kind::kFaces) prefetch(tree_.blocks[node.first[lane]]);
        ends_.push_back(next);
      }
    }
    if (count_ + kBatch * kLanes > waiting_.size()) waiting_.resize(2 * waiting_.size());
    box_tests_ += open * kLanes;
    for (std::size_t i = open; i-- > 0;) push_lanes(opened[i]);
  }

  void push_lanes(const Waiting& opened) {
    const TreeNode& node = tree_.nodes[opened.place];
    double enter[kLanes];
    const std::uint32_t met =
        node.lanes & meets(
                         aims_[opened.ray],
                         [&node](std::size_t k, std::size_t first, Vec& lo, Vec& hi) {
                           lo = load(node.boxes.lo[k] + first);
                           hi = load(node.boxes.hi[k] + first);
                         },
                         enter);
    // Two are written whatever there is, and as many counted as there are: most often one or two.
    const std::array<std::uint8_t, kLanes>& order = kLanesOf[met];
    const auto of_lane = [&](std::uint32_t lane) {
      return Waiting{enter[lane], opened.ray, opened.place * kLanes + lane};
    };
    Waiting* const top = waiting_.data() + count_;
    const Waiting one = of_lane(order[0]), two = of_lane(order[1]);
    const auto number = static_cast<std::size_t>(std::popcount(met));
    const bool in_order = number < 2 || one.enter >= two.enter;
    top[0] = in_order ? one : two;
    top[1] = in_order ? two : one;
    if (HWY_UNLIKELY(number > 2)) {
      for (std::size_t n = 2; n < number; ++n) {
        std::size_t at = n;
        const Waiting next = of_lane(order[n]);
        for (; at > 0 && top[at - 1].enter < next.enter; --at) top[at] = top[at - 1];
        top[at] = next;
      }
    }
    count_ += number;
  }

  /// Blocks of faces, and unresolved nodes, that were put aside.
  void test_ends() {
    for (const Waiting& end : ends_) {
      const TreeNode& node = tree_.nodes[end.place / kLanes];
      const std::uint32_t lane = end.place % kLanes;
      if (node.kind(lane) == TreeEntry::Kind::kUnresolved) {
        nodes_.push_back(end);
        continue;
      }
      const FaceBlock& block = tree_.blocks[node.first[lane]];
      double enter[kLanes];
      std::uint32_t met = meets(
                              aims_[end.ray],
                              [&block](std::size_t k, std::size_t first, Vec& lo, Vec& hi) {
                                const Ints d;
                                const auto a = hn::LoadU(d, block.triangles.corner[0][k] + first),
                                           b = hn::LoadU(d, block.triangles.corner[1][k] + first),
                                           c = hn::LoadU(d, block.triangles.corner[2][k] + first);
                                lo = hn::PromoteTo(Doubles(), hn::Min(hn::Min(a, b), c));
                                hi = hn::PromoteTo(Doubles(), hn::Max(hn::Max(a, b), c));
                              },
                              enter) &
                          ((1U << (node.kind_and_count[lane] >> 2)) - 1);
      for (; met != 0; met &= met - 1)
        test_face(end.ray, block, static_cast<std::uint32_t>(std::countr_zero(met)));
    }
    ends_.clear();
  }

  void test_face(std::uint32_t ray, const FaceBlock& block, std::uint32_t lane) {
    ++face_tests_;
    const LatticeTriangle face = pose_triangle(frame_, block.triangles.corners(lane));
    const std::optional<RayHit> hit = first_hit(rays_[ray].ray, face);
    if (!hit) return;
    RayFound candidate;
    candidate.has_face = true;
    candidate.hit = *hit;
    candidate.key = block.keys[lane];
    candidate.face = face;
    RayFound& found = found_[ray];
    if (found.has_face && !comes_before(rays_[ray].ray, candidate, found)) return;
    found = candidate;
    aims_[ray].limit = std::min(1.0, found.limit());
  }

  /// By ray; without those that a nearer hit has made needless.
  void settle_nodes(std::vector<NodeOnRay>& nodes) {
    std::stable_sort(nodes_.begin(), nodes_.end(),
                     [](const Waiting& a, const Waiting& b) { return a.ray < b.ray; });
    std::size_t next = 0;
    for (std::uint32_t i = 0; i < rays_.size(); ++i) {
      found_[i].first_node = static_cast<std::uint32_t>(nodes.size());
      for (; next < nodes_.size() && nodes_[next].ray == i; ++next)
        if (nodes_[next].enter <= aims_[i].limit)
          nodes.push_back({nodes_[next].place, nodes_[next].enter});
      found_[i].nodes = static_cast<std::uint32_t>(nodes.size()) - found_[i].first_node;
    }
  }

  static constexpr std::size_t kBatch = 16;  // parts in flight
  const TreeView& tree_;
  const PosedFrame& frame_;
  const GridView view_;
  std::span<const CutRay> rays_;
  std::span<RayFound> found_;
  std::vector<Aim> aims_;         // by ray
  std::vector<Waiting> waiting_;  // the first count_; the latest last
  std::size_t count_ = 0;
  std::vector<Waiting> ends_, nodes_;
  std::uint64_t box_tests_ = 0, face_tests_ = 0;
};

void walk_all_rays(const TreeView& tree, const PosedFrame& frame, std::span<const CutRay> rays,
                   std::span<RayFound> found, std::vector<NodeOnRay>& nodes, QueryStats& stats) {
  RayWalk(tree, frame).run(rays, found, nodes, stats);
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
  const double length = std::sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2]);
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
