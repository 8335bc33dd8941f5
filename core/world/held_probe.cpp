// SPDX-License-Identifier: Apache-2.0
// Why tiles answer as one mesh would: see world_probe.cpp. A page or tile that is not here is to a
// probe as an unresolved node is: whatever its box holds may be met where the probe enters the box,
// and not before.
#include "held_probe.hpp"

#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/float_guard.hpp"
#include "world_reach.hpp"

namespace nearmesh {

std::uint64_t WorldNeeds::count() const {
  std::uint64_t sum = pages.size() + tiles.size();
  for (const auto& [tile, missing] : nodes) sum += missing.size();
  return sum;
}

namespace {

/// An entry that a probe may meet: a tile, or a page that is not here.
struct Met {
  WorldEntry entry;
  bool is_page = false;
  double enter = 0;  // of a ray
};

class Prober {
 public:
  Prober(const HeldWorld& world, const Pose& pose, const PosedFrame& frame)
      : world_(world), pose_(pose), frame_(frame), view_(frame) {}

  Status answer(const RayProbe& ray, WorldRayAnswer& answer) {
    const LatticeBox bounds = pose_box(frame_, as_grid_box(world_.root.box()));
    const CutRay cut = cut_ray(ray, bounds, frame_.lattice_exp);
    answer = {};
    answer.ray.status = ProbeStatus::kMiss;
    answer.ray.at_least_m = std::numeric_limits<double>::infinity();
    if (cut.is_empty) return Status::ok();
    const SeenRay seen(view_, cut.ray);
    std::vector<Met> on_ray;
    NEARMESH_RETURN_IF_ERROR(
        walk([&](const CellBox& box) { return seen.enters(box).has_value(); }, on_ray));
    for (Met& met : on_ray) met.enter = seen.enters(met.entry.box()).value_or(0);
    std::sort(on_ray.begin(), on_ray.end(), [](const Met& a, const Met& b) {
      return std::tie(a.enter, a.entry) < std::tie(b.enter, b.entry);
    });
    RayFound best;
    double unknown = std::numeric_limits<double>::infinity();  // nothing that is missing is before
    for (const Met& met : on_ray) {
      if (met.enter > best.limit()) break;
      const std::optional<TreeView> held = met.is_page ? std::nullopt : world_.tile_of(met.entry);
      if (!held) {
        lack(met);
        ++answer.ray.missing;
        unknown = std::min(unknown, met.enter);
        continue;
      }
      RayFound found;
      std::vector<NodeOnRay> nodes;
      NEARMESH_RETURN_IF_ERROR(walk_tile(met.entry, *held, cut, found, nodes));
      answer.ray.missing += static_cast<std::uint32_t>(nodes.size());
      for (const NodeOnRay& node : nodes) unknown = std::min(unknown, node.enter);
      if (!found.has_face || (best.has_face && !comes_before(cut.ray, found, best))) continue;
      best = found;
      answer.tile = {met.entry.content, met.entry.place};
    }
    if (best.has_face) {
      answer.ray.status = ProbeStatus::kHit;
      tell_hit(cut, best, frame_.lattice_exp, answer.ray);
    }
    // What lies behind a face that was found later does not matter.
    if (unknown > best.limit()) {
      answer.ray.missing = 0;
      return Status::ok();
    }
    answer.ray.status = ProbeStatus::kUncertain;
    answer.ray.at_least_m = cut.at_m(std::max(0.0, unknown - 0x1p-50)) * (1 - 0x1p-50);
    return Status::ok();
  }

  template <class Shape>
  Status answer(const Shape& shape, WorldShapeAnswer& answer) {
    const Reach reach = reach_of(view_, frame_, shape);
    std::vector<Met> near;
    NEARMESH_RETURN_IF_ERROR(walk([&](const CellBox& box) { return meets(reach, box); }, near));
    std::sort(near.begin(), near.end(),
              [](const Met& a, const Met& b) { return a.entry < b.entry; });
    answer = {};
    answer.shape.status = ProbeStatus::kMiss;
    std::uint32_t missing = 0;
    for (const Met& met : near) {
      const std::optional<TreeView> held = met.is_page ? std::nullopt : world_.tile_of(met.entry);
      if (!held) {
        lack(met);
        ++missing;
        if (answer.shape.status == ProbeStatus::kMiss)
          answer.shape.status = ProbeStatus::kUncertain;
        continue;
      }
      const Grid grid = world_.record.grid_at(met.entry);
      TreeView view = *held;
      view.grid = &grid;
      ShapeAnswer here;
      const Result<ProbeNeeds> needs =
          nearmesh::probe(view, pose_, std::span(&shape, 1), std::span(&here, 1));
      NEARMESH_RETURN_IF_ERROR(needs);
      note(met.entry, needs.value());
      missing += here.missing;
      if (here.status == ProbeStatus::kMiss) continue;
      answer = {here, {met.entry.content, met.entry.place}};
      if (here.status == ProbeStatus::kHit) return Status::ok();
    }
    answer.shape.missing = missing;
    return Status::ok();
  }

  /// What the last answer lacks counts where it is uncertain.
  void settle(ProbeStatus status) {
    WorldNeeds its = std::exchange(its_, {});
    if (status != ProbeStatus::kUncertain) return;
    needs_.pages.merge(its.pages);
    needs_.tiles.merge(its.tiles);
    for (const auto& [tile, missing] : its.nodes) {
      std::vector<NodeSpan>& all = needs_.nodes[tile];
      all.insert(all.end(), missing.begin(), missing.end());
    }
    for (const auto& [tile, where] : its.where) {
      std::vector<GridBox>& all = needs_.where[tile];
      all.insert(all.end(), where.begin(), where.end());
    }
  }

  WorldNeeds take() {
    for (auto& [tile, missing] : needs_.nodes) {
      std::sort(missing.begin(), missing.end());
      missing.erase(std::unique(missing.begin(), missing.end()), missing.end());
    }
    return std::move(needs_);
  }

 private:
  template <class Meets>
  Status walk(const Meets& accepts, std::vector<Met>& out) {
    MetPages met(world_.record);
    return walk(world_.root, accepts, out, met);
  }
  template <class Meets>
  Status walk(const WorldPage& from, const Meets& accepts, std::vector<Met>& out, MetPages& met) {
    for (const WorldEntry& entry : from.entries) {
      if (!accepts(entry.box())) continue;
      if (from.level == 0) {
        out.push_back({entry});
        continue;
      }
      NEARMESH_RETURN_IF_ERROR(met.meet(entry.content));
      const Result<const WorldPage*> below = world_.page_of(entry, from.level - 1);
      NEARMESH_RETURN_IF_ERROR(below);
      if (below.value() == nullptr) {
        out.push_back({entry, true});
        continue;
      }
      NEARMESH_RETURN_IF_ERROR(walk(*below.value(), accepts, out, met));
    }
    return Status::ok();
  }

  void lack(const Met& met) {
    if (met.is_page) {
      its_.pages.insert(met.entry.content);
    } else {
      its_.tiles.insert(met.entry);
    }
  }
  void note(const WorldEntry& tile, const ProbeNeeds& needs) {
    if (needs.is_nothing()) return;
    std::vector<NodeSpan>& missing = its_.nodes[tile];
    missing.insert(missing.end(), needs.missing.begin(), needs.missing.end());
    std::vector<GridBox>& where = its_.where[tile];
    where.insert(where.end(), needs.where.begin(), needs.where.end());
  }

  Status walk_tile(const WorldEntry& entry, const TreeView& held, const CutRay& cut,
                   RayFound& found, std::vector<NodeOnRay>& nodes) {
    const Result<PosedFrame> frame = probe_frame(world_.record.grid_at(entry), pose_);
    NEARMESH_RETURN_IF_ERROR(frame);
    QueryStats stats;
    walk_rays(held, frame.value(), std::span(&cut, 1), std::span(&found, 1), nodes, stats);
    if (nodes.empty()) return Status::ok();
    const GridView view(frame.value());
    NeedsMaker needs;
    for (const NodeOnRay& node : nodes)
      add_node_on_ray(held, view, cut, node, found.limit(), needs);
    note(entry, needs.take(stats));
    return Status::ok();
  }

  const HeldWorld& world_;
  const Pose& pose_;
  const PosedFrame frame_;
  const GridView view_;
  WorldNeeds needs_, its_;  // of all, of the last
};

ProbeStatus status_of(const WorldRayAnswer& answer) { return answer.ray.status; }
ProbeStatus status_of(const WorldShapeAnswer& answer) { return answer.shape.status; }

template <class Probe, class Answer, class Check>
Result<WorldNeeds> probe_all(const HeldWorld& world, const Pose& pose,
                             std::span<const Probe> probes, std::span<Answer> answers,
                             const Check& check) {
  const FloatGuard guard;
  NEARMESH_ASSERT(probes.size() == answers.size());
  const Result<PosedFrame> frame = probe_frame(world_grid(world.record), pose);
  NEARMESH_RETURN_IF_ERROR(frame);
  for (std::size_t i = 0; i < probes.size(); ++i)
    NEARMESH_RETURN_IF_ERROR(check(probes[i], i, frame.value().lattice_exp));
  Prober prober(world, pose, frame.value());
  for (std::size_t i = 0; i < probes.size(); ++i) {
    NEARMESH_RETURN_IF_ERROR(prober.answer(probes[i], answers[i]));
    prober.settle(status_of(answers[i]));
  }
  return prober.take();
}

}  // namespace

Result<WorldNeeds> probe(const HeldWorld& world, const Pose& pose, std::span<const RayProbe> rays,
                         std::span<WorldRayAnswer> answers) {
  return probe_all(world, pose, rays, answers,
                   [](const RayProbe& ray, std::size_t i, int) { return check_ray(ray, i); });
}
Result<WorldNeeds> probe(const HeldWorld& world, const Pose& pose, std::span<const BallProbe> balls,
                         std::span<WorldShapeAnswer> answers) {
  return probe_all(world, pose, balls, answers,
                   [](const BallProbe& ball, std::size_t i, int lattice_exp) {
                     return check_ball(ball, i, lattice_exp);
                   });
}
Result<WorldNeeds> probe(const HeldWorld& world, const Pose& pose, std::span<const BoxProbe> boxes,
                         std::span<WorldShapeAnswer> answers) {
  return probe_all(world, pose, boxes, answers,
                   [](const BoxProbe& box, std::size_t i, int) { return check_box(box, i); });
}

}  // namespace nearmesh
