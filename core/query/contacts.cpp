// SPDX-License-Identifier: Apache-2.0
// Contacts of touching faces.
//
// Position error. An end is computed relative to the first corner of its pair's a-face: error at
// most 9 u E cells (triangle_intersection.hpp), with u = 2^-53 and E the pair's extent. Moving it
// to the world rounds the corner's coordinate (only beyond 2^53 cells) and the sum: at most u
// |corner| + 1.01 u (|corner| + E) a coordinate, hence 3.5 u |corner| + 1.8 u E in length. 11 u E +
// 4 u |corner| covers both, with the greatest of each over all pairs. Scaling by a power of two is
// exact. Segments between such ends lie as near, since both faces are convex.
//
// Normal error. A face's normal is an exact integer vector; as a double unit vector it is off by
// less than 6 u (u for each conversion, 4 u for the length, u for the division), the mean likewise
// from unit length, and their difference rounds by less than 8 u: 32 u are added to the chord
// between them. The angle comes from the chord by halvings, square roots alone: library sines
// differ between machines.
#include "nearmesh/core/query/contacts.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "contacts_in_time.hpp"
#include "core/base/float_guard.hpp"
#include "core/geometry/nearest_points.hpp"
#include "core/geometry/triangle_intersection.hpp"
#include "core/geometry/vec3.hpp"
#include "touching_faces.hpp"

namespace nearmesh {
namespace {

__extension__ typedef __int128 Int128;

double length(const Vec3& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/// origin + offset (cells) in metres.
Vec3 to_world_m(const LatticePoint& origin, const Vec3& offset, int lattice_exp) {
  Vec3 p;
  for (std::size_t k = 0; k < 3; ++k)
    p[k] = std::ldexp(static_cast<double>(origin.v[k]) + offset[k], lattice_exp);
  return p;
}

// ---- patches ------------------------------------------------------------------------------------

/// Disjoint sets of pairs; each is represented by its least.
class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0U);
  }
  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t i, std::uint32_t j) {
    i = find(i);
    j = find(j);
    parent_[std::max(i, j)] = std::min(i, j);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

/// Joins pairs with the same face of `own` and faces of `other` that have a corner in common.
void join_neighbours(const TouchingFaces& own, const TouchingFaces& other, Groups& groups) {
  struct Touch {
    std::uint32_t own_face;
    GridPoint other_corner;
    std::uint32_t pair;
    auto operator<=>(const Touch&) const = default;
  };
  std::vector<Touch> touches;
  touches.reserve(3 * own.of_pair.size());
  for (std::uint32_t i = 0; i < own.of_pair.size(); ++i)
    for (const GridPoint& corner : other.corners[other.of_pair[i]])
      touches.push_back({own.of_pair[i], corner, i});
  std::sort(touches.begin(), touches.end());
  for (std::size_t i = 1; i < touches.size(); ++i)
    if (touches[i - 1].own_face == touches[i].own_face &&
        touches[i - 1].other_corner == touches[i].other_corner)
      groups.join(touches[i - 1].pair, touches[i].pair);
}

// ---- normals ------------------------------------------------------------------------------------

struct FaceWeight {
  std::uint32_t face;
  double weight;  // length of the segments on it
};

constexpr double kNormalRounding = 32 * 0x1p-53;

/// The mean normal of a body's faces in a patch.
struct MeanNormal {
  Vec3 direction{0, 0, 0};  // unit length; zero where no face has a normal
  double chord = 2;         // at least the distance of any face's unit normal from it; 2: unknown
  double area = 0;          // twice that of the faces, cells
};

/// Outward, of twice the face's area in length; exact but for the conversion.
Vec3 area_vector(const LatticeTriangle& t) {
  std::array<Int128, 3> u, v;
  for (std::size_t k = 0; k < 3; ++k) {
    u[k] = t[1].v[k] - t[0].v[k];
    v[k] = t[2].v[k] - t[0].v[k];
  }
  return {static_cast<double>(u[1] * v[2] - u[2] * v[1]),
          static_cast<double>(u[2] * v[0] - u[0] * v[2]),
          static_cast<double>(u[0] * v[1] - u[1] * v[0])};
}

/// `weights` by face, each face once.
MeanNormal mean_normal(const TouchingFaces& faces, const std::vector<FaceWeight>& weights) {
  MeanNormal mean;
  std::vector<Vec3> normals;
  Vec3 by_length{}, by_count{};
  for (const FaceWeight& item : weights) {
    Vec3 n = area_vector(faces.posed[item.face]);
    const double area = length(n);
    if (area == 0) continue;  // a point or a segment
    mean.area += area;
    for (std::size_t k = 0; k < 3; ++k) {
      n[k] /= area;
      by_length[k] += item.weight * n[k];
      by_count[k] += n[k];
    }
    normals.push_back(n);
  }
  if (normals.empty()) return mean;
  const Vec3& sum = length(by_length) > 0 ? by_length : by_count;
  const double size = length(sum);
  if (size == 0) {  // they cancel
    mean.direction = normals.front();
    return mean;
  }
  for (std::size_t k = 0; k < 3; ++k) mean.direction[k] = sum[k] / size;
  double greatest = 0;
  for (const Vec3& n : normals)
    greatest = std::max(greatest, length({n[0] - mean.direction[0], n[1] - mean.direction[1],
                                          n[2] - mean.direction[2]}));
  // Spreads below the rounding count as equal, so that it does not choose the reference.
  mean.chord = std::max(greatest, kNormalRounding) + kNormalRounding;
  return mean;
}

/// The angle of a chord of the unit circle, rounded up. In: chord < sqrt 2.
double angle_of_chord(double chord) {
  double c = chord;
  for (int i = 0; i < 8; ++i) c /= std::sqrt(2 + std::sqrt(4 - c * c));  // of half the angle
  // 2 asin(c / 2); the first term left out is below 1e-16 of it, and rounding adds less than 2^-46.
  return 256 * c * (1 + c * c * (1.0 / 24 + c * c * (3.0 / 640))) * (1 + 0x1p-44);
}

void set_normal(const MeanNormal& a, const MeanNormal& b, ContactPatch& patch) {
  const auto rank = [](const MeanNormal& m) { return std::tuple(m.chord, -m.area, m.direction); };
  patch.normal_is_of_a = rank(a) <= rank(b);
  const MeanNormal& mean = patch.normal_is_of_a ? a : b;
  patch.normal = mean.direction;
  if (mean.direction == Vec3{}) patch.normal = {0, 0, patch.normal_is_of_a ? 1.0 : -1.0};
  if (!patch.normal_is_of_a)
    for (double& x : patch.normal) x = 0 - x;  // no negative zeros
  patch.normal_error_rad = mean.chord * mean.chord < 2 ? angle_of_chord(mean.chord) : kNoNormal_rad;
}

// ---- manifold ---------------------------------------------------------------------------------

/// Up to four of a patch's ends, farthest first.
struct Manifold {
  std::array<std::uint32_t, 4> ends{};
  std::uint32_t count = 0;
  double error = 0;  // no end is farther from their hull
};

/// What is nearer is one point: ends that neighbours share are rounded apart.
constexpr double kOnePoint = 0x1p-30;

Manifold span(const std::vector<Vec3>& ends, const Vec3& middle) {
  Manifold manifold;
  const auto farthest = [&ends](const auto& distance) {
    std::pair<double, std::uint32_t> best{-1, 0};
    for (std::uint32_t i = 0; i < ends.size(); ++i)
      if (const double d = distance(ends[i]); d > best.first) best = {d, i};
    return best;
  };
  const auto at = [&](std::size_t i) -> const Vec3& { return ends[manifold.ends[i]]; };
  const auto from_hull = [&](const Vec3& p) {
    switch (manifold.count) {
      case 0:
        return distance_to_triangle(p, {middle, middle, middle});
      case 1:
        return distance_to_triangle(p, {at(0), at(0), at(0)});
      case 2:
        return distance_to_triangle(p, {at(0), at(1), at(1)});
      case 3:
        return distance_to_triangle(p, {at(0), at(1), at(2)});
      default:  // by the faces of the hull: of what is inside it a bound
        return std::min({distance_to_triangle(p, {at(0), at(1), at(2)}),
                         distance_to_triangle(p, {at(0), at(1), at(3)}),
                         distance_to_triangle(p, {at(0), at(2), at(3)}),
                         distance_to_triangle(p, {at(1), at(2), at(3)})});
    }
  };
  double size = 0;
  while (true) {
    const auto [distance, end] = farthest(from_hull);
    if (manifold.count == 0) size = distance;
    if (manifold.count == manifold.ends.size() ||
        (manifold.count > 0 && distance <= size * kOnePoint)) {
      manifold.error = distance * (1 + 0x1p-40);
      return manifold;
    }
    manifold.ends[manifold.count++] = end;
  }
}

// ---- assembly -----------------------------------------------------------------------------------

class Assembly {
 public:
  Assembly(TouchingFaces a, TouchingFaces b, int lattice_exp, const Answer& answer)
      : a_(std::move(a)), b_(std::move(b)), lattice_exp_(lattice_exp), pairs_(answer.pairs) {
    contacts_.pair_total = answer.pair_total;
    contacts_.truncated = answer.truncated;
  }

  /// Nothing where time is over before the end.
  std::optional<Contacts> run(const IsOver* is_over) {
    Groups groups(pairs_.size());
    join_neighbours(a_, b_, groups);
    if (is_time_over(is_over)) return std::nullopt;
    join_neighbours(b_, a_, groups);
    std::vector<std::array<std::uint32_t, 2>> order;  // group, pair
    for (std::uint32_t i = 0; i < pairs_.size(); ++i) order.push_back({groups.find(i), i});
    std::sort(order.begin(), order.end());
    for (std::size_t begin = 0; begin < order.size();) {
      std::size_t end = begin;
      while (end < order.size() && order[end][0] == order[begin][0]) ++end;
      start_patch();
      for (; begin < end; ++begin) {
        if (begin % kPairsALook == 0 && is_time_over(is_over)) return std::nullopt;
        add_pair(order[begin][1]);
      }
      finish_patch();
    }
    contacts_.position_error_m =
        std::ldexp((11 * greatest_extent_ + 4 * greatest_coordinate_) * 0x1p-53, lattice_exp_);
    return std::move(contacts_);
  }

 private:
  void start_patch() {
    contacts_.patches.push_back(
        {.first = static_cast<std::uint32_t>(contacts_.segments.size()), .count = 0});
    length_ = 0;
    by_length_ = by_count_ = {};
    ends_.clear();
    weights_a_.clear();
    weights_b_.clear();
  }

  void add_pair(std::uint32_t i) {
    const std::uint32_t fa = a_.of_pair[i], fb = b_.of_pair[i];
    const LatticeTriangle &ta = a_.posed[fa], &tb = b_.posed[fb];
    note_extent(ta, tb);
    ContactPatch& patch = contacts_.patches.back();
    const double uncertainty = std::max(a_.uncertainty(fa), b_.uncertainty(fb));
    patch.uncertainty_m = std::max(patch.uncertainty_m, uncertainty);
    patch.approximate = patch.approximate || uncertainty > 0;
    if (patch.count == 0) anchor_ = ta[0];
    double pair_length = 0;
    const TriangleIntersection common = intersect_triangles(ta, tb);
    for (std::size_t j = 0; j < common.count; ++j) {
      const auto& [p, q] = common.pieces[j];
      contacts_.segments.push_back({to_world_m(ta[0], p, lattice_exp_),
                                    to_world_m(ta[0], q, lattice_exp_), pairs_[i],
                                    uncertainty > 0});
      ++patch.count;
      const double piece_length = length({q[0] - p[0], q[1] - p[1], q[2] - p[2]});
      pair_length += piece_length;
      ends_.resize(ends_.size() + 2);
      for (std::size_t k = 0; k < 3; ++k) {
        const auto offset = static_cast<double>(ta[0].v[k] - anchor_.v[k]);
        ends_[ends_.size() - 2][k] = offset + p[k];
        ends_.back()[k] = offset + q[k];
        const double middle = offset + (p[k] + q[k]) / 2;
        by_length_[k] += piece_length * middle;
        by_count_[k] += middle;
      }
    }
    length_ += pair_length;
    weights_a_.push_back({fa, pair_length});
    weights_b_.push_back({fb, pair_length});
  }

  void finish_patch() {
    ContactPatch& patch = contacts_.patches.back();
    patch.length_m = std::ldexp(length_, lattice_exp_);
    Vec3 mean = length_ > 0 ? by_length_ : by_count_;
    for (double& x : mean) x /= length_ > 0 ? length_ : patch.count;
    patch.centroid_m = to_world_m(anchor_, mean, lattice_exp_);
    const Manifold manifold = span(ends_, mean);
    patch.manifold_count = manifold.count;
    patch.manifold_error_m = std::ldexp(manifold.error, lattice_exp_);
    for (std::uint32_t i = 0; i < manifold.count; ++i) {
      const ContactSegment& segment = contacts_.segments[patch.first + manifold.ends[i] / 2];
      patch.manifold_m[i] = manifold.ends[i] % 2 == 0 ? segment.p_m : segment.q_m;
    }
    set_normal(mean_normal(a_, merge(weights_a_)), mean_normal(b_, merge(weights_b_)), patch);
  }

  // Each face once, ascending. Weights are added in the order of the other side's faces, whichever
  // body comes first.
  static const std::vector<FaceWeight>& merge(std::vector<FaceWeight>& weights) {
    std::stable_sort(weights.begin(), weights.end(),
                     [](const FaceWeight& x, const FaceWeight& y) { return x.face < y.face; });
    std::size_t kept = 0;
    for (std::size_t i = 1; i < weights.size(); ++i) {
      if (weights[i].face == weights[kept].face) {
        weights[kept].weight += weights[i].weight;
      } else {
        weights[++kept] = weights[i];
      }
    }
    weights.resize(kept + 1);
    return weights;
  }

  void note_extent(const LatticeTriangle& ta, const LatticeTriangle& tb) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [lo, hi] =
          std::minmax({ta[0].v[k], ta[1].v[k], ta[2].v[k], tb[0].v[k], tb[1].v[k], tb[2].v[k]});
      greatest_extent_ = std::max(greatest_extent_, static_cast<double>(hi - lo));
      greatest_coordinate_ =
          std::max(greatest_coordinate_, std::abs(static_cast<double>(ta[0].v[k])));
    }
  }

  const TouchingFaces a_, b_;
  const int lattice_exp_;
  const std::vector<FacePair>& pairs_;
  Contacts contacts_;
  double greatest_extent_ = 0, greatest_coordinate_ = 0;  // cells
  // Of the patch at hand, in cells relative to its first pair's first corner.
  LatticePoint anchor_;
  double length_ = 0;
  Vec3 by_length_{}, by_count_{};
  std::vector<Vec3> ends_;  // of its segments, two each
  std::vector<FaceWeight> weights_a_, weights_b_;
};

/// 0 for an exact face. Else how far a current face may be from the original face that it stands
/// for: each corner moved by at most its node's bound, times what a near-rotation may stretch (R^T
/// R is the identity within 1e-5), and both ends were rounded to the lattice.
double face_uncertainty_m(const ActiveMesh& mesh, const PosedFrame& frame, const FaceKey& key) {
  const SplitFace face = mesh.store().face(key);
  if (mesh.is_exact(face)) return 0;
  double greatest = 0;
  for (const VertexId corner : face.corners()) {
    const NodeSpan node = mesh.current_node(mesh.active_predecessor(corner));
    if (node.size > 1) greatest = std::max(greatest, node_bound(mesh.store(), node));
  }
  return std::ldexp(greatest * (1 + 0x1p-15), frame.grid.exponent) +
         std::ldexp(2.0, frame.lattice_exp);
}

}  // namespace

Contacts find_contacts(const TreeView& a, const PosedFrame& frame_a, const TreeView& b,
                       const PosedFrame& frame_b, const Answer& answer) {
  return *find_contacts(a, frame_a, b, frame_b, answer, nullptr);
}

std::optional<Contacts> find_contacts(const TreeView& a, const PosedFrame& frame_a,
                                      const TreeView& b, const PosedFrame& frame_b,
                                      const Answer& answer, const IsOver* is_over) {
  const FloatGuard guard;
  NEARMESH_ASSERT(frame_a.lattice_exp == frame_b.lattice_exp);
  TouchingFaces faces_a = collect_faces(a, frame_a, answer.pairs, &FacePair::a);
  if (is_time_over(is_over)) return std::nullopt;
  TouchingFaces faces_b = collect_faces(b, frame_b, answer.pairs, &FacePair::b);
  return Assembly(std::move(faces_a), std::move(faces_b), frame_a.lattice_exp, answer).run(is_over);
}

Contacts approximate_contacts(const ActiveMesh& a, const PosedFrame& frame_a, const ActiveMesh& b,
                              const PosedFrame& frame_b, std::size_t max_pairs) {
  const FloatGuard guard;
  const TriangleTree tree_a = build_triangle_tree(frame_a.grid, current_triangles(a));
  const TriangleTree tree_b = build_triangle_tree(frame_b.grid, current_triangles(b));
  const Answer answer =
      query(tree_a.view(), frame_a, tree_b.view(), frame_b,
            {.any = false, .clearance = Clearance::kNone, .max_pairs = max_pairs});
  TouchingFaces faces_a = collect_faces(tree_a.view(), frame_a, answer.pairs, &FacePair::a);
  TouchingFaces faces_b = collect_faces(tree_b.view(), frame_b, answer.pairs, &FacePair::b);
  for (const FaceKey& key : faces_a.keys)
    faces_a.uncertainty_m.push_back(face_uncertainty_m(a, frame_a, key));
  for (const FaceKey& key : faces_b.keys)
    faces_b.uncertainty_m.push_back(face_uncertainty_m(b, frame_b, key));
  return *Assembly(std::move(faces_a), std::move(faces_b), frame_a.lattice_exp, answer)
              .run(nullptr);
}

}  // namespace nearmesh
