// SPDX-License-Identifier: Apache-2.0
// Probes of bodies: answered from what is held; what they lack waits to be asked for.
#include <algorithm>
#include <iterator>
#include <type_traits>
#include <utility>

#include "core/base/counted.hpp"
#include "core/base/float_guard.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// So long what a probe has lacked is kept, above max_held_splits too: it shall be there when the
/// host probes again.
constexpr double kKept_s = 1;

/// Sorted, each once.
void add_nodes(std::vector<NodeSpan>& nodes, const std::vector<NodeSpan>& more) {
  nodes.insert(nodes.end(), more.begin(), more.end());
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
}

/// At most so many boxes that cover them.
std::vector<GridBox> merged(std::vector<GridBox> boxes, std::size_t most) {
  if (boxes.size() <= most) return boxes;
  std::vector<RegionPart> parts(boxes.begin(), boxes.end());
  parts = merge_by_place(std::move(parts), most);
  boxes.clear();
  for (const RegionPart& part : parts) {
    GridBox& box = boxes.emplace_back(part.box);
    for (int k = 0; k < 3; ++k) {
      box.lo[k] = static_cast<std::int32_t>(std::max<std::int64_t>(
          std::int64_t{box.lo[k]} - part.radius, std::numeric_limits<std::int32_t>::min()));
      box.hi[k] = static_cast<std::int32_t>(std::min<std::int64_t>(
          std::int64_t{box.hi[k]} + part.radius, std::numeric_limits<std::int32_t>::max()));
    }
  }
  return boxes;
}

Status as_of_body(const Status& status, const std::string& name) {
  return {status.code(), "probes of body " + name + ": " + status.message()};
}

}  // namespace

/// Notes what is to be asked for, and where in the model's grid.
void Session::Impl::note_lacking(PeerModel& model, const std::vector<NodeSpan>& missing,
                                 std::vector<GridBox> where) {
  PeerModel::Probed& probed = model.probed;
  add_nodes(probed.missing, missing);
  std::move(where.begin(), where.end(), std::back_inserter(probed.where));
  probed.where = merged(std::move(probed.where), kMaxRegionBoxes);
  if (options.max_held_splits > 0) {
    if (clock.seconds() >= probed.kept_until_s) probed.kept.clear();
    probed.kept.insert(probed.kept.end(), probed.where.begin(), probed.where.end());
    probed.kept = merged(std::move(probed.kept), kMaxRegionBoxes);
    probed.kept_until_s = clock.seconds() + kKept_s;
  }
}

namespace {

/// Of a world's answers those of any body.
template <class Answer>
struct InWorld {
  using Type = void;
};
template <>
struct InWorld<RayAnswer> {
  using Type = WorldRayAnswer;
  static RayAnswer of(const WorldRayAnswer& answer) { return answer.ray; }
};
template <>
struct InWorld<ShapeAnswer> {
  using Type = WorldShapeAnswer;
  static ShapeAnswer of(const WorldShapeAnswer& answer) { return answer.shape; }
};

}  // namespace

/// What is lacked is asked for in the updates of the next second, tiles and pages too.
template <class Probe, class Answer>
Result<ProbeReport> Session::Impl::probe_world(Body& body, std::span<const Probe> probes,
                                               std::span<Answer> answers, ProbeReport report) {
  PeerWorld& world = *body.model->world;
  const HeldWorld held{
      .record = world.record(),
      .root = *world.root(),
      .page_of = [&](const WorldEntry& entry,
                     int level) { return world.page(entry, level, time_s); },
      .tile_of = [&](const WorldEntry& entry) -> std::optional<TreeView> {
        const PeerModel* tile = replicas.find(entry.content);
        if (tile == nullptr || !tile->is_ready() ||
            !check_tile_grid(tile->replica->header().grid, world.record()).is_ok())
          return std::nullopt;
        if (const auto at = tile_bodies.find({body.id.value, entry}); at != tile_bodies.end())
          at->second.needed_s = time_s;
        return tile->replica->view();
      }};
  const Result<WorldNeeds> lacking = nearmesh::probe(held, report.pose, probes, answers);
  if (!lacking.is_ok()) return as_of_body(lacking.status(), body.name);
  const WorldNeeds& needs = lacking.value();
  report.missing = needs.count();
  const double until_s = clock.seconds() + kKept_s;
  const auto want = [&](const WorldEntry& entry, bool is_page) {
    probed_parts[{body.id.value, {entry, is_page}}] = until_s;
  };
  const auto await = [&report](const std::string& what) {
    if (!what.empty()) report.awaited += (report.awaited.empty() ? "" : "; ") + what;
  };
  for (const ContentHash& page : needs.pages) want({.content = page}, true);
  if (!needs.pages.empty())
    await(counted(needs.pages.size(), "page") + " of world " + body.model->name +
          " not here yet, " + who_gives(body.model->content_hash));
  for (const WorldEntry& tile : needs.tiles) want(tile, false);
  if (!needs.tiles.empty())
    await(counted(needs.tiles.size(), "tile") + " of world " + body.model->name +
          " not here yet, " + who_gives(body.model->content_hash));
  for (const auto& [tile, missing] : needs.nodes) {
    want(tile, false);
    PeerModel& model = *replicas.find(tile.content);
    await(awaited_of(model, missing.size()));
    note_lacking(model, missing, needs.where.at(tile));
  }
  return report;
}

/// Before tiles and pages that nothing wants are left.
void Session::Impl::want_probed(FrameReport& report) {
  std::erase_if(probed_parts, [this](const auto& one) { return clock.seconds() >= one.second; });
  for (const auto& [part, until_s] : probed_parts) {
    const Body* world = find({part.first});
    if (world == nullptr || !world->model->world || world->model->world->root() == nullptr)
      continue;
    const WorldEntry& entry = part.second.entry;
    std::string why_not;
    if (!part.second.is_page) {
      static_cast<void>(tile_body(*world, entry, why_not, report.complaints));
    } else if (!world->model->world->has_page(entry.content)) {
      want_bytes(entry.content, world->model->content_hash, true);
    }
  }
}

template <class Probe, class Answer>
Result<ProbeReport> Session::Impl::probe(BodyId id, std::span<const Probe> probes,
                                         std::span<Answer> answers) {
  NEARMESH_ASSERT(probes.size() == answers.size());
  NEARMESH_RETURN_IF_ERROR(check_whole());
  Body* body = find(id);
  if (body == nullptr) return no_such(id);
  PeerModel& model = *body->model;
  ProbeReport report{.reason = why_unknown(*body),
                     .awaited = {},
                     .age_s = wire::age_s(stamp_of(*body), time_s),
                     .pose = {},
                     .content = model.content_hash};
  constexpr bool is_of_any =
      std::is_same_v<Answer, RayAnswer> || std::is_same_v<Answer, ShapeAnswer>;
  if (report.reason.empty() && model.world && std::is_same_v<Answer, PointAnswer>)
    report.reason =
        "body " + body->name + " is a world: whether something is inside cannot be told";
  if (!report.reason.empty()) {
    std::fill(answers.begin(), answers.end(), Answer{});
    return report;
  }
  report.pose = body->motion->pose;
  if constexpr (is_of_any) {
    if (model.world) {
      std::vector<typename InWorld<Answer>::Type> found(probes.size());
      const Change change(*this);
      Result<ProbeReport> result = probe_world(*body, probes, std::span(found), std::move(report));
      NEARMESH_RETURN_IF_ERROR(result);
      std::transform(found.begin(), found.end(), answers.begin(), InWorld<Answer>::of);
      return result;
    }
  }
  model.needed_s = time_s;
  Result<ProbeNeeds> lacking = nearmesh::probe(model.replica->view(), report.pose, probes, answers);
  if (!lacking.is_ok()) return as_of_body(lacking.status(), body->name);
  ProbeNeeds& needs = lacking.value();
  if (needs.is_nothing()) return report;
  report.missing = needs.missing.size();
  report.awaited = awaited_of(model, needs.missing.size());
  const Change change(*this);
  note_lacking(model, needs.missing, std::move(needs.where));
  return report;
}

/// One request a model, of whoever serves it, by region. Pairs and probes take turns where both
/// need detail all the time.
void Session::Impl::ask_for_probes() {
  for (auto& entry : replicas.all()) {
    PeerModel& model = entry.second;
    PeerModel::Probed& probed = model.probed;
    const auto open = outstanding.find(model.content_hash);
    const bool is_open =
        open != outstanding.end() && !is_lost(open->second) && open->second.priority == kNeededNow;
    if (is_open || !model.is_ready() || !model.waiting.empty()) continue;
    if (std::exchange(probed.had_turn, false) || probed.missing.empty()) continue;
    std::erase_if(probed.missing,
                  [&](const NodeSpan& node) { return !model.replica->mesh().is_current(node); });
    if (probed.missing.empty()) {  // what they lacked has come meanwhile
      probed.where.clear();
      continue;
    }
    if (open != outstanding.end() && is_lost(open->second)) count_lost(open->second);
    std::vector<NodeSpan> missing = probed.missing;
    missing.resize(std::min(missing.size(), kMaxAttachNodes));
    const RegionMaker region = [&probed](std::size_t most, std::span<const GridBox>) {
      return merge_by_place({probed.where.begin(), probed.where.end()}, most);
    };
    if (!request(model, region, std::move(missing), kNeededNow)) continue;
    probed.missing.clear();
    probed.where.clear();
    probed.had_turn = true;
  }
}

Result<ProbeReport> Session::probe(BodyId body, std::span<const RayProbe> rays,
                                   std::span<RayAnswer> answers) {
  const FloatGuard guard;
  return impl_->probe(body, rays, answers);
}
Result<ProbeReport> Session::probe(BodyId body, std::span<const std::array<double, 3>> points_m,
                                   std::span<PointAnswer> answers) {
  const FloatGuard guard;
  return impl_->probe(body, points_m, answers);
}
Result<ProbeReport> Session::probe(BodyId body, std::span<const BallProbe> balls,
                                   std::span<ShapeAnswer> answers) {
  const FloatGuard guard;
  return impl_->probe(body, balls, answers);
}
Result<ProbeReport> Session::probe(BodyId body, std::span<const BoxProbe> boxes,
                                   std::span<ShapeAnswer> answers) {
  const FloatGuard guard;
  return impl_->probe(body, boxes, answers);
}

Status Session::hear(std::span<const HeardPose> heard) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  std::vector<wire::BodyPose> poses;
  for (const HeardPose& pose : heard) {
    const Body* body = impl_->find(pose.body);
    if (body == nullptr) return no_such(pose.body);
    if (body->own)
      return {StatusCode::kInvalidArgument, body->name + " is a body that this peer moves"};
    NEARMESH_RETURN_IF_ERROR(check_motion(pose.motion, body->name));
    if (!wire::is_time(pose.time_s))
      return {StatusCode::kInvalidArgument,
              "time_s of the pose of " + body->name + " is " + std::to_string(pose.time_s) +
                  ", expected seconds, at most " + std::to_string(wire::kMaxTime_s) + " from 0"};
    poses.push_back({.body = body->name,
                     .time_s = pose.time_s,
                     .pose = orthonormal(pose.motion.pose),
                     .linear_velocity_mps = pose.motion.linear_velocity_mps,
                     .angular_velocity_radps = pose.motion.angular_velocity_radps});
  }
  auto& all = impl_->heard_by_host;
  all.insert(all.end(), std::make_move_iterator(poses.begin()),
             std::make_move_iterator(poses.end()));
  return Status::ok();
}

}  // namespace nearmesh::subscriber
