// SPDX-License-Identifier: Apache-2.0
// Batches of probes against one body: what is asked is put on the body's lattice, held against its
// tree, and told in metres.
#include "nearmesh/core/query/probe.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>
#include <utility>

#include "containment.hpp"
#include "core/base/float_guard.hpp"
#include "probe_needs.hpp"
#include "ray_walk.hpp"

namespace nearmesh {
namespace {

constexpr double kMaxPlaceM = 1e9;

Status refuse(const char* kind, std::size_t place, const std::string& what) {
  return {StatusCode::kInvalidArgument,
          std::string(kind) + " " + std::to_string(place) + ": " + what};
}

bool is_place(const std::array<double, 3>& at_m) {
  return std::all_of(at_m.begin(), at_m.end(), [](double x) { return std::abs(x) <= kMaxPlaceM; });
}
const char* const kPlaceRange = "expected finite numbers within 1e9 m of 0";

/// The point of the lattice next to one within the bounds; none where it lies beyond them.
std::optional<LatticePoint> lattice_point(const std::array<double, 3>& at_m,
                                          const LatticeBox& bounds, int lattice_exp) {
  const CutRay cut = cut_ray({.origin_m = at_m, .range_m = 0}, bounds, lattice_exp);
  if (cut.is_empty) return std::nullopt;
  return cut.ray.from;
}

GridBox around(const std::array<double, 3>& lo, const std::array<double, 3>& hi,
               const GridBox& within) {
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    const auto i = static_cast<std::size_t>(k);
    box.lo[k] = static_cast<std::int32_t>(
        std::clamp<double>(std::floor(lo[i]) - 1, within.lo[k], within.hi[k]));
    box.hi[k] = static_cast<std::int32_t>(
        std::clamp<double>(std::ceil(hi[i]) + 1, within.lo[k], within.hi[k]));
  }
  return box;
}

}  // namespace

const char* to_string(ProbeStatus status) {
  switch (status) {
    case ProbeStatus::kMiss:
      return "miss";
    case ProbeStatus::kHit:
      return "hit";
    case ProbeStatus::kUncertain:
      return "uncertain";
  }
  return "unknown";
}

Result<PosedFrame> probe_frame(const Grid& grid, const Pose& pose) {
  NEARMESH_RETURN_IF_ERROR(check_pose(pose, "the probed body"));
  return make_posed_frame(grid, pose, lattice_exponent(grid, grid));
}

// ---- what answers lack --------------------------------------------------------------------------

void NeedsMaker::add(NodeSpan node, const GridBox& where) {
  const auto [at, is_new] = parts_.try_emplace(node.begin(), Part{node, where});
  if (!is_new) at->second.where.add(where);
}

ProbeNeeds NeedsMaker::take(const QueryStats& stats) {
  ProbeNeeds needs{.missing = {}, .where = {}, .stats = stats};
  for (const auto& [first, part] : parts_) {
    needs.missing.push_back(part.node);
    needs.where.push_back(part.where);
  }
  return needs;
}

// ---- rays ---------------------------------------------------------------------------------------

Status check_ray(const RayProbe& ray, std::size_t place) {
  if (!is_place(ray.origin_m)) return refuse("ray", place, std::string("origin_m: ") + kPlaceRange);
  const auto& d = ray.direction;
  if (!std::isfinite(d[0]) || !std::isfinite(d[1]) || !std::isfinite(d[2]) ||
      (d[0] == 0 && d[1] == 0 && d[2] == 0))
    return refuse("ray", place, "direction: expected finite numbers, not all 0");
  if (!(ray.range_m >= 0)) return refuse("ray", place, "range_m: expected metres, not negative");
  return Status::ok();
}

void tell_hit(const CutRay& cut, const RayFound& found, int lattice_exp, RayAnswer& answer) {
  const RayHit& hit = found.hit;
  // A few roundings more come from where the time is along the ray.
  const double error = hit.error + 0x1p-50;
  answer.has_face = true;
  answer.face = found.key;
  answer.at_most_m = cut.at_m(std::min(1.0, hit.t + error)) * (1 + 0x1p-50);
  answer.at_least_m = cut.at_m(std::max(0.0, hit.t - error)) * (1 - 0x1p-50);
  std::array<double, 3> normal{};
  const LatticeTriangle& face = found.face;
  std::array<std::array<double, 3>, 2> sides;
  for (std::size_t k = 0; k < 3; ++k) {
    const double way = static_cast<double>(cut.ray.to.v[k] - cut.ray.from.v[k]);
    answer.point_m[k] =
        std::ldexp(static_cast<double>(cut.ray.from.v[k]) + hit.t * way, lattice_exp);
    sides[0][k] = static_cast<double>(face[1].v[k] - face[0].v[k]);
    sides[1][k] = static_cast<double>(face[2].v[k] - face[0].v[k]);
  }
  double square = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
    normal[k] = sides[0][i] * sides[1][j] - sides[0][j] * sides[1][i];
    square += normal[k] * normal[k];
  }
  if (square > 0)
    for (std::size_t k = 0; k < 3; ++k) answer.normal[k] = normal[k] / std::sqrt(square);
}

void add_node_on_ray(const TreeView& tree, const GridView& view, const CutRay& cut,
                     const NodeOnRay& node, double limit, NeedsMaker& needs) {
  const TreeEntry entry = tree.nodes[node.place / kLanes].entry(node.place % kLanes);
  const std::array<double, 3> from = view.point(cut.ray.from), to = view.point(cut.ray.to);
  double until = limit;
  for (int k = 0; k < 3; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const double way = to[i] - from[i], far = way < 0 ? entry.box.lo[k] : entry.box.hi[k];
    if (way != 0) until = std::min(until, (far - from[i]) / way);
  }
  until = std::max(until, node.enter);
  std::array<double, 3> lo, hi;
  for (std::size_t k = 0; k < 3; ++k) {
    const double way = to[k] - from[k];
    std::tie(lo[k], hi[k]) = std::minmax({from[k] + node.enter * way, from[k] + until * way});
  }
  needs.add(entry, around(lo, hi, entry.box));
}

Result<ProbeNeeds> probe(const TreeView& body, const Pose& pose, std::span<const RayProbe> rays,
                         std::span<RayAnswer> answers) {
  const FloatGuard guard;
  NEARMESH_ASSERT(rays.size() == answers.size());
  const Result<PosedFrame> frame = probe_frame(*body.grid, pose);
  NEARMESH_RETURN_IF_ERROR(frame);
  for (std::size_t i = 0; i < rays.size(); ++i) NEARMESH_RETURN_IF_ERROR(check_ray(rays[i], i));
  const LatticeBox bounds = bounds_of(frame.value());
  const GridView view(frame.value());
  NeedsMaker needs;
  QueryStats stats;
  std::vector<NodeOnRay> nodes;
  constexpr std::size_t kBatch = 64;  // what is found of so many stays in the nearest cache
  CutRay cuts[kBatch];
  RayFound found[kBatch];
  for (std::size_t first = 0; first < rays.size(); first += kBatch) {
    const std::size_t count = std::min(kBatch, rays.size() - first);
    for (std::size_t i = 0; i < count; ++i)
      cuts[i] = cut_ray(rays[first + i], bounds, frame.value().lattice_exp);
    nodes.clear();
    walk_rays(body, frame.value(), {cuts, count}, {found, count}, nodes, stats);
    for (std::size_t i = 0; i < count; ++i) {
      RayAnswer& answer = answers[first + i];
      answer = {};
      if (found[i].has_face) tell_hit(cuts[i], found[i], frame.value().lattice_exp, answer);
      answer.missing = found[i].nodes;
      if (answer.missing == 0) {
        answer.status = answer.has_face ? ProbeStatus::kHit : ProbeStatus::kMiss;
        if (!answer.has_face) answer.at_least_m = std::numeric_limits<double>::infinity();
        continue;
      }
      double enter = 1;
      for (std::uint32_t n = 0; n < answer.missing; ++n) {
        const NodeOnRay& node = nodes[found[i].first_node + n];
        enter = std::min(enter, node.enter);
        add_node_on_ray(body, view, cuts[i], node, found[i].limit(), needs);
      }
      answer.at_least_m = cuts[i].at_m(std::max(0.0, enter - 0x1p-50)) * (1 - 0x1p-50);
    }
  }
  return needs.take(stats);
}

// ---- points -------------------------------------------------------------------------------------

namespace {

/// Of a point that the bounds hold.
PointAnswer locate_point(const TreeView& solid, const PosedFrame& frame, const GridView& view,
                         const LatticePoint& point, NeedsMaker& needs, QueryStats& stats) {
  const CutRay here{.ray = {point, point}, .is_empty = false};
  RayFound found;
  std::vector<NodeOnRay> nodes;
  walk_rays(solid, frame, {&here, 1}, {&found, 1}, nodes, stats);
  if (found.has_face) return {.status = ProbeStatus::kHit, .on_surface = true};
  PointAnswer answer;
  answer.missing = found.nodes;
  for (const NodeOnRay& node : nodes) add_node_on_ray(solid, view, here, node, 1, needs);
  if (answer.missing != 0) return answer;  // the surface may pass here
  const Location at = locate(solid, frame, point, stats);
  if (at.side != Side::kUndecided) {
    answer.status = at.side == Side::kInside ? ProbeStatus::kHit : ProbeStatus::kMiss;
    return answer;
  }
  answer.missing = static_cast<std::uint32_t>(at.missing.size());
  std::vector<GridBox> boxes;
  for (const TreeEntry& node : at.missing) {
    boxes.clear();
    add_ray_boxes(frame, at.ray, node.box, boxes);
    for (const GridBox& box : boxes) needs.add(node, box);
  }
  return answer;
}

}  // namespace

Result<ProbeNeeds> probe(const TreeView& solid, const Pose& pose,
                         std::span<const std::array<double, 3>> points_m,
                         std::span<PointAnswer> answers) {
  const FloatGuard guard;
  NEARMESH_ASSERT(points_m.size() == answers.size());
  if (solid.surface == nullptr)
    return Status{StatusCode::kInvalidArgument,
                  "the probed body: nothing tells whether it is closed"};
  NEARMESH_RETURN_IF_ERROR(check_solid(*solid.surface, "probed"));
  const Result<PosedFrame> frame = probe_frame(*solid.grid, pose);
  NEARMESH_RETURN_IF_ERROR(frame);
  for (std::size_t i = 0; i < points_m.size(); ++i)
    if (!is_place(points_m[i])) return refuse("point", i, kPlaceRange);
  const LatticeBox bounds = bounds_of(frame.value());
  const GridView view(frame.value());
  NeedsMaker needs;
  QueryStats stats;
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    const auto point = lattice_point(points_m[i], bounds, frame.value().lattice_exp);
    answers[i] = point ? locate_point(solid, frame.value(), view, *point, needs, stats)
                       : PointAnswer{.status = ProbeStatus::kMiss};
  }
  return needs.take(stats);
}

// ---- balls --------------------------------------------------------------------------------------

namespace {

constexpr auto kMaxBallRadiusCells = static_cast<double>(kMaxBallRadius);
double radius_cells(const BallProbe& ball, int lattice_exp) {
  return std::floor(std::ldexp(ball.radius_m, -lattice_exp) + 0.5);
}

class BallWalk {
 public:
  BallWalk(const TreeView& body, const PosedFrame& frame)
      : body_(body), frame_(frame), view_(frame) {}

  ShapeAnswer run(const LatticeBall& ball, NeedsMaker& needs, QueryStats& stats) {
    // Rotations are within 1e-5 of one, so the ball is a ball in the grid but for that.
    const double radius =
        static_cast<double>(ball.radius) * std::ldexp(1.0, frame_.shift - 30) * (1 + 1e-4);
    const std::array<double, 3> center = view_.point(ball.center);
    std::array<double, 3> lo, hi;
    for (std::size_t k = 0; k < 3; ++k) {
      lo[k] = center[k] - radius;
      hi[k] = center[k] + radius;
    }
    ShapeAnswer answer;
    std::vector<TreeEntry> open, missing;
    const auto offer = [&](const TreeEntry& part) {
      ++stats.box_tests;
      double square = 0;
      for (int k = 0; k < 3; ++k) {
        const auto i = static_cast<std::size_t>(k);
        const double off = std::max({0.0, part.box.lo[k] - view_.margin[i] - center[i],
                                     center[i] - view_.margin[i] - part.box.hi[k]});
        square += off * off;
      }
      if (square <= radius * radius * (1 + 0x1p-40)) open.push_back(part);
    };
    if (body_.root().kind() != TreeEntry::Kind::kEmpty) offer(body_.root());
    while (!open.empty()) {
      const TreeEntry part = open.back();
      open.pop_back();
      if (part.kind() == TreeEntry::Kind::kInner) {
        body_.for_each_child(part, offer);
      } else if (part.kind() == TreeEntry::Kind::kUnresolved) {
        missing.push_back(part);
      } else {
        body_.for_each_face(part, [&](const TreeFace& face) {
          ++stats.triangle_tests;
          if (answer.has_face && answer.face < face.key) return;
          if (!ball_meets(ball, pose_triangle(frame_, face.corners))) return;
          answer.has_face = true;
          answer.face = face.key;
        });
      }
    }
    if (answer.has_face || missing.empty()) {
      answer.status = answer.has_face ? ProbeStatus::kHit : ProbeStatus::kMiss;
      return answer;
    }
    answer.missing = static_cast<std::uint32_t>(missing.size());
    for (const TreeEntry& node : missing) needs.add(node, around(lo, hi, node.box));
    return answer;
  }

 private:
  const TreeView& body_;
  const PosedFrame& frame_;
  const GridView view_;
};

}  // namespace

Status check_ball(const BallProbe& ball, std::size_t place, int lattice_exp) {
  if (!is_place(ball.center_m))
    return refuse("ball", place, std::string("center_m: ") + kPlaceRange);
  if (!(ball.radius_m >= 0) || !(radius_cells(ball, lattice_exp) <= kMaxBallRadiusCells))
    return refuse("ball", place,
                  "radius_m: expected metres, at least 0, at most " +
                      std::to_string(std::ldexp(kMaxBallRadiusCells, lattice_exp)));
  return Status::ok();
}

Result<ProbeNeeds> probe(const TreeView& body, const Pose& pose, std::span<const BallProbe> balls,
                         std::span<ShapeAnswer> answers) {
  const FloatGuard guard;
  NEARMESH_ASSERT(balls.size() == answers.size());
  const Result<PosedFrame> frame = probe_frame(*body.grid, pose);
  NEARMESH_RETURN_IF_ERROR(frame);
  const int lattice_exp = frame.value().lattice_exp;
  for (std::size_t i = 0; i < balls.size(); ++i)
    NEARMESH_RETURN_IF_ERROR(check_ball(balls[i], i, lattice_exp));
  const LatticeBox bounds = bounds_of(frame.value());
  BallWalk walk(body, frame.value());
  NeedsMaker needs;
  QueryStats stats;
  for (std::size_t i = 0; i < balls.size(); ++i) {
    const double cells = radius_cells(balls[i], lattice_exp);
    LatticeBall ball{.center = {}, .radius = static_cast<std::int64_t>(cells)};
    LatticeBox reach = bounds;
    for (int k = 0; k < 3; ++k) {
      reach.lo[k] -= ball.radius;
      reach.hi[k] += ball.radius;
    }
    answers[i] = {.status = ProbeStatus::kMiss};
    const auto center = lattice_point(balls[i].center_m, reach, lattice_exp);
    if (!center) continue;
    ball.center = *center;
    answers[i] = walk.run(ball, needs, stats);
  }
  return needs.take(stats);
}

// ---- boxes --------------------------------------------------------------------------------------

namespace {

/// The box as a closed body of twelve faces, on a grid of the probed body's cell or, where it is
/// very large, of a coarser one.
TriangleTree make_box(const std::array<double, 3>& half_m, const Grid& body) {
  constexpr int kMostBits = 30;
  const double most_m = std::max({half_m[0], half_m[1], half_m[2]});
  Grid grid{.exponent = body.exponent, .bits = kMostBits + 1};
  while (std::ldexp(most_m, -grid.exponent) >= std::ldexp(1.0, kMostBits - 1)) ++grid.exponent;
  GridPoint far;
  for (int k = 0; k < 3; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const double half = std::max(1.0, std::floor(std::ldexp(half_m[i], -grid.exponent) + 0.5));
    grid.origin_m[i] = -std::ldexp(half, grid.exponent);
    far[k] = static_cast<std::int32_t>(2 * half);
  }
  const std::int32_t extent = std::max({far[0], far[1], far[2]});
  while (grid.bits > kMinGridBits && extent < std::int32_t{1} << (grid.bits - 1)) --grid.bits;
  std::vector<TreeFace> faces;
  for (int axis = 0; axis < 3; ++axis)
    for (const bool upper : {false, true}) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      const auto corner = [&](bool at_u, bool at_v) {
        GridPoint p;
        p[axis] = upper ? far[axis] : 0;
        p[u] = at_u ? far[u] : 0;
        p[v] = at_v ? far[v] : 0;
        return p;
      };
      std::array<GridPoint, 4> around{corner(false, false), corner(true, false), corner(true, true),
                                      corner(false, true)};
      if (!upper) std::swap(around[1], around[3]);
      for (const std::size_t i : {1U, 2U})
        faces.push_back({{around[0], around[i], around[i + 1]},
                         {{}, static_cast<std::uint32_t>(faces.size())}});
    }
  TriangleTree tree = build_triangle_tree(grid, faces);
  tree.surface = SurfaceFacts{};
  tree.surface->component_count = 1;
  tree.surface->component_seeds = {GridPoint{}};
  return tree;
}

}  // namespace

Status check_box(const BoxProbe& box, std::size_t place) {
  for (const double half : box.half_m)
    if (!(half >= 0 && half <= kMaxPlaceM))
      return refuse("box", place, "half_m: expected metres, at least 0, at most 1e9");
  return check_pose(box.pose, "box " + std::to_string(place));
}

Result<ProbeNeeds> probe(const TreeView& body, const Pose& pose, std::span<const BoxProbe> boxes,
                         std::span<ShapeAnswer> answers) {
  const FloatGuard guard;
  NEARMESH_ASSERT(boxes.size() == answers.size());
  if (body.surface == nullptr)
    return Status{StatusCode::kInvalidArgument, "the probed body: nothing is known of its parts"};
  NeedsMaker needs;
  QueryStats stats;
  std::vector<ShapeAnswer> found(boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    NEARMESH_RETURN_IF_ERROR(check_box(boxes[i], i));
    const TriangleTree box = make_box(boxes[i].half_m, *body.grid);
    const Result<PosedPair> posed = pose_pair(*body.grid, pose, "the probed body", box.grid,
                                              boxes[i].pose, "box " + std::to_string(i));
    NEARMESH_RETURN_IF_ERROR(posed);
    const Answer answer = query(body, posed.value().a, box.view(), posed.value().b,
                                {.clearance = Clearance::kNone, .solid_b = true});
    stats.box_tests += answer.stats.box_tests;
    stats.triangle_tests += answer.stats.triangle_tests;
    ShapeAnswer& told = found[i];
    if (!answer.pairs.empty()) {
      told = {
          .status = ProbeStatus::kHit, .has_face = true, .missing = 0, .face = answer.pairs[0].a};
    } else if (answer.status == AnswerStatus::kContained) {
      told.status = ProbeStatus::kHit;
    } else if (answer.status == AnswerStatus::kFree) {
      told.status = ProbeStatus::kMiss;
    } else {
      told.missing = static_cast<std::uint32_t>(answer.missing_a.size());
      const RelativeFrame seen = make_relative_frame(posed.value().a, posed.value().b);
      const CenteredBox whole = centered(box.nodes[0].boxes.box(0));
      std::array<double, 3> lo, hi;
      for (std::size_t k = 0; k < 3; ++k) {
        double middle = seen.translation[k], reach = 0;
        for (std::size_t j = 0; j < 3; ++j) {
          middle += seen.rotation[3 * k + j] * whole.center[j];
          reach += seen.abs_rotation[3 * k + j] * whole.half[j];
        }
        lo[k] = middle - reach;
        hi[k] = middle + reach;
      }
      for (const NodeSpan& node : answer.missing_a) {
        const GridBox reach = body.store->box(node);
        needs.add(node, around(lo, hi, reach));
      }
    }
  }
  std::copy(found.begin(), found.end(), answers.begin());
  return needs.take(stats);
}

}  // namespace nearmesh
