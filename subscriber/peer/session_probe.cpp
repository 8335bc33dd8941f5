// SPDX-License-Identifier: Apache-2.0
// Probes of bodies: answered from what is held; what they lack waits to be asked for.
#include <algorithm>
#include <iterator>
#include <utility>

#include "core/base/float_guard.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// So long what a probe has lacked is kept, above max_held_splits too: it shall be there when the host probes again.
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

template <class Probe, class Answer>
Result<ProbeReport> Session::Impl::probe(BodyId id, std::span<const Probe> probes,
                                         std::span<Answer> answers) {
  NEARMESH_ASSERT(probes.size() == answers.size());
  const Body* body = find(id);
  if (body == nullptr) return no_such(id);
  PeerModel& model = *body->model;
  ProbeReport report{.reason = why_unknown(*body),
                     .awaited = {},
                     .age_s = wire::age_s(stamp_of(*body), time_s),
                     .pose = {},
                     .content = model.content_hash};
  if (report.reason.empty() && model.world) report.reason = why_not_ready(*body);
  if (!report.reason.empty()) {
    std::fill(answers.begin(), answers.end(), Answer{});
    return report;
  }
  report.pose = body->motion->pose;
  Result<ProbeNeeds> lacking = nearmesh::probe(model.replica->view(), report.pose, probes, answers);
  if (!lacking.is_ok()) return as_of_body(lacking.status(), body->name);
  ProbeNeeds& needs = lacking.value();
  if (needs.is_nothing()) return report;
  report.missing = needs.missing.size();
  report.awaited = awaited_of(model, needs.missing.size());
  note_lacking(model, needs.missing, std::move(needs.where));
  return report;
}

/// One request a model, of whoever serves it, by region. Pairs and probes take turns where both need detail all the time.
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
  std::move(poses.begin(), poses.end(), std::back_inserter(impl_->heard_by_host));
  return Status::ok();
}

}  // namespace nearmesh::subscriber
