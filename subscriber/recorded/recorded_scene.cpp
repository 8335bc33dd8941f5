// SPDX-License-Identifier: Apache-2.0
#include "recorded_scene.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "recorded_peer.hpp"

namespace nearmesh::subscriber {
namespace {

std::array<double, 3> to_world(const Grid& grid, const Pose& pose, const GridPoint& p) {
  std::array<double, 3> model{}, world = pose.translation_m;
  for (std::size_t k = 0; k < 3; ++k)
    model[k] = grid.origin_m[k] + std::ldexp(p.v[k], grid.exponent);
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t i = 0; i < 3; ++i) world[k] += pose.rotation[3 * k + i] * model[i];
  return world;
}

}  // namespace

RecordedBody recorded_body(const std::string& name, const Replica& replica, const Pose& pose) {
  const SplitStore& store = replica.store();
  const ActiveMesh& mesh = replica.mesh();
  const Grid& grid = replica.header().grid;
  RecordedBody body{.name = name};
  GridBox whole;
  for (const BaseRoot& root : store.roots()) whole.add(store.box(root.node));
  for (int k = 0; k < 3; ++k)
    body.size_m = std::max(
        body.size_m, std::ldexp(double{1} * whole.hi[k] - double{1} * whole.lo[k], grid.exponent));
  std::vector<std::uint32_t> place(store.vertex_count());
  for (VertexId v{0}; v.value < store.vertex_count(); v = {mesh.current_node(v).end()}) {
    place[v.value] = static_cast<std::uint32_t>(body.positions_world_m.size());
    body.positions_world_m.push_back(to_world(grid, pose, store.position(v)));
    body.eps_m.push_back(mesh.is_resolved(v)
                             ? 0
                             : std::ldexp(node_bound(store, mesh.current_node(v)), grid.exponent));
  }
  for (const ActiveFace& face : extract_faces(mesh))
    body.faces.push_back(
        {place[face.corners[0].value], place[face.corners[1].value], place[face.corners[2].value]});
  return body;
}

namespace {

/// Looks at what it is in some reports.
class ScenePeer final : public RecordedPeer {
 public:
  explicit ScenePeer(std::map<std::int64_t, std::optional<Result<RecordedScene>>>& scenes)
      : scenes_(scenes) {}

 private:
  void visit(const RecordedReport& report, Standing standing) override {
    scenes_.at(report.id) = look(report, standing);
  }

  Result<RecordedScene> look(const RecordedReport& report, Standing standing) const {
    const wire::ContactReport& recorded = report.message;
    const std::string about = "message " + std::to_string(report.id) + ": ";
    switch (standing) {
      case Standing::kNotAsked:
        return Status{StatusCode::kNotFound, about + "the peer had no mesh or no pose then"};
      case Standing::kPutOff:
        return Status{StatusCode::kNotFound,
                      about + "its turn did not come within the frame's budget"};
      case Standing::kStale:
        return Status{StatusCode::kNotFound, about + why_stale(recorded)};
      case Standing::kGaveUp:
        return Status{
            StatusCode::kUnsupported,
            about + "the peer had given up detail, and what it held then is not recorded"};
      case Standing::kLacking:
      case Standing::kNoFile:
        return Status{StatusCode::kNotFound,
                      about + "the recording lacks batches or a header that the peer had"};
      case Standing::kReached:
        break;
    }
    if (recorded.world)
      return Status{StatusCode::kUnsupported, about + "one of the bodies is a world"};
    if (!is_rebuilt(recorded, standing))
      return Status{StatusCode::kConflict,
                    about + "the meshes do not come out as recorded; see verify"};
    RecordedScene scene{.message = report.id, .received_ns = report.received_ns};
    scene.report = recorded;
    scene.bodies = {
        recorded_body(recorded.body_a, replica(recorded.a.content_hash), recorded.a.pose),
        recorded_body(recorded.body_b, replica(recorded.b.content_hash), recorded.b.pose)};
    Result<Answered> asked = ask(recorded, {.contacts = true});
    NEARMESH_RETURN_IF_ERROR(asked);
    if (asked.value().contacts) scene.contacts = std::move(*asked.value().contacts);
    return scene;
  }

  std::map<std::int64_t, std::optional<Result<RecordedScene>>>& scenes_;
};

bool fits(const SceneChoice& choice, const std::string& body, const std::string& other) {
  return (choice.body.empty() || choice.body == body) &&
         (choice.other.empty() || choice.other == other);
}

std::string describe(const SceneChoice& choice) {
  std::string what = "no answer";
  if (!choice.peer.empty()) what += " of peer " + choice.peer;
  if (!choice.body.empty()) what += " about body " + choice.body;
  if (!choice.other.empty()) what += " against " + choice.other;
  return what;
}

}  // namespace

Result<std::int64_t> find_report(RecordingReader& recording, const SceneChoice& choice) {
  const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(recording);
  NEARMESH_RETURN_IF_ERROR(samples);
  constexpr std::int64_t kStep = 1024;
  const Result<std::int64_t> after = recording.find(choice.received_ns + 1);
  NEARMESH_RETURN_IF_ERROR(after);
  std::int64_t found = 0, found_ns = 0;
  for (std::int64_t end = after.value(); end > 1; end -= std::min(kStep, end - 1)) {
    std::int64_t last = 0, last_ns = 0, touching = 0, touching_ns = 0, first_ns = 0;
    NEARMESH_RETURN_IF_ERROR(recording.read(
        std::max<std::int64_t>(1, end - kStep), end,
        [&](std::int64_t id, const RecordedMessage& message) {
          if (first_ns == 0) first_ns = message.received_ns;
          const auto report = samples.value().read<wire::ContactReport>(message);
          if (!report) return true;
          const wire::ContactReport& r = *report;
          if (!r.asked || r.world ||
              (!choice.peer.empty() && wire::partition_of(r.peer) != choice.peer) ||
              !(fits(choice, r.body_a, r.body_b) || fits(choice, r.body_b, r.body_a)))
            return true;
          last = id;
          last_ns = message.received_ns;
          if (r.pair_count == 0) return true;
          touching = id;
          touching_ns = message.received_ns;
          return true;
        }));
    if (found == 0) {
      found = last;
      found_ns = last_ns;
    }
    if (found == 0) continue;
    if (touching != 0 && found_ns - touching_ns <= choice.contact_first_ns) return touching;
    if (found_ns - first_ns > choice.contact_first_ns) return found;
  }
  if (found != 0) return found;
  return Status{
      StatusCode::kNotFound,
      describe(choice) + " until " +
          std::to_string(static_cast<double>(choice.received_ns - recording.begin_ns()) * 1e-9) +
          " s whose meshes are recorded"};
}

Result<std::vector<Result<RecordedScene>>> rebuild_scenes(
    RecordingReader& recording, const std::vector<std::int64_t>& reports) {
  std::map<std::int64_t, std::optional<Result<RecordedScene>>> scenes;
  for (const std::int64_t id : reports) scenes[id] = std::nullopt;
  const Result<Played> played =
      play(recording,
           {.make_peer = [&](const std::string&) { return std::make_unique<ScenePeer>(scenes); },
            .wants = [&](std::int64_t id) { return scenes.contains(id); },
            .has_enough =
                [&] {
                  return std::all_of(scenes.begin(), scenes.end(),
                                     [](const auto& entry) { return entry.second.has_value(); });
                }});
  NEARMESH_RETURN_IF_ERROR(played);
  std::vector<Result<RecordedScene>> result;
  for (const std::int64_t id : reports) {
    const std::optional<Result<RecordedScene>>& scene = scenes.at(id);
    result.push_back(scene ? *scene
                           : Status{StatusCode::kNotFound, "message " + std::to_string(id) +
                                                               " is no readable contact report"});
  }
  return result;
}

}  // namespace nearmesh::subscriber
