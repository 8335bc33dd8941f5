// SPDX-License-Identifier: Apache-2.0
#include "session_gltf.hpp"

#include <algorithm>
#include <map>
#include <memory>
#include <utility>

#include "gltf.hpp"
#include "subscriber/recorded/recorded_peer.hpp"
#include "subscriber/recorded/recorded_scene.hpp"

namespace nearmesh::subscriber::report {
namespace {

constexpr double kMeshStep_s = 1;
constexpr double kContactStep_s = 0.1;

using Vector = std::array<double, 3>;

/// What all peers share: the file, and which meshes are in it.
struct Picture {
  Gltf gltf;
  std::int64_t begin_ns = 0;
  double end_s = 0;
  std::size_t bodies = 0;
  Vector origin{};
  bool has_origin = false;
  std::map<std::pair<ContentHash, std::uint64_t>, std::size_t> meshes;  // by content and state

  std::size_t mesh_of(const std::string& name, const ContentHash& content, const Replica& replica) {
    const auto [at, is_new] =
        meshes.try_emplace(std::pair(content, replica.mesh().state_hash()), std::size_t{0});
    if (!is_new) return at->second;
    const RecordedBody body = recorded_body(name, replica);
    std::vector<Colour> colours;
    for (const double eps_m : body.eps_m)
      colours.push_back(vertex_colour(eps_m, body.size_m, false));
    const auto positions = gltf.add_positions(body.positions_world_m, {});
    at->second = gltf.add_mesh(name, {{{"attributes",
                                        {{"POSITION", positions},
                                         {"COLOR_0", gltf.add_colours(colours)},
                                         {"_EPS_M", gltf.add_numbers(body.eps_m)}}},
                                       {"indices", gltf.add_indices(body.faces)},
                                       {"mode", 4}}});
    return at->second;
  }
};

/// Nodes of which one at a time is seen.
struct Versions {
  struct Version {
    std::size_t node = 0;
    double from_s = 0;
  };
  std::vector<Version> all;

  /// The last one ends at `end_s`.
  void animate(Gltf& gltf, double end_s) const {
    for (std::size_t i = 0; i < all.size(); ++i) {
      std::vector<double> times{0}, scales(3, all[i].from_s <= 0 ? 1 : 0);
      const auto change = [&](double at_s, double scale) {
        if (at_s <= times.back()) return;
        times.push_back(at_s);
        scales.insert(scales.end(), 3, scale);
      };
      change(all[i].from_s, 1);
      if (i + 1 < all.size()) change(all[i + 1].from_s, 0);
      change(end_s, scales.back());
      gltf.animate(all[i].node, "scale", times, scales, true);
    }
  }
};

class GltfPeer final : public RecordedPeer {
 public:
  GltfPeer(Picture& picture, std::string name) : picture_(picture), name_(std::move(name)) {}

  /// Once all was visited: how what it held moved.
  void animate() {
    for (auto& [name, body] : bodies_) {
      body.meshes.animate(picture_.gltf, picture_.end_s);
      picture_.gltf.animate(body.node, "translation", body.times_s, body.places, false);
      picture_.gltf.animate(body.node, "rotation", body.times_s, body.turns, false);
    }
    for (auto& [pair, contacts] : contacts_) contacts.animate(picture_.gltf, picture_.end_s);
  }

 private:
  struct Body {
    std::size_t node = 0;
    std::vector<double> times_s, places, turns;
    Versions meshes;
    std::uint64_t state = 0;
  };

  void visit(const RecordedReport& report, Standing standing) override {
    const wire::ContactReport& r = report.message;
    if (!is_rebuilt(r, standing)) return;
    const double time_s = 1e-9 * static_cast<double>(report.received_ns - picture_.begin_ns);
    picture_.end_s = std::max(picture_.end_s, time_s);
    if (!std::exchange(picture_.has_origin, true)) picture_.origin = r.a.pose.translation_m;
    if (!std::exchange(has_node_, true)) node_ = picture_.gltf.add_node("peer " + name_);
    take(r.body_a, r.a, time_s);
    take(r.body_b, r.b, time_s);
    take_contacts(r, time_s);
  }

  void take(const std::string& name, const wire::ContactReport::Asked& asked, double time_s) {
    const auto [at, is_new] = bodies_.try_emplace(name);
    Body& body = at->second;
    if (is_new) {
      body.node = picture_.gltf.add_node(name, node_);
      ++picture_.bodies;
    }
    // A body of several pairs is told of more than once a moment.
    if (body.times_s.empty() || time_s > body.times_s.back()) {
      body.times_s.push_back(time_s);
      for (std::size_t k = 0; k < 3; ++k)
        body.places.push_back(asked.pose.translation_m[k] - picture_.origin[k]);
      std::array<double, 4> q = quaternion_of_rotation(asked.pose.rotation);
      // Of the two that stand for a rotation the nearer one: or it would turn once around between
      // them.
      if (!body.turns.empty()) {
        const double* last = &body.turns[body.turns.size() - 4];
        if (q[1] * last[0] + q[2] * last[1] + q[3] * last[2] + q[0] * last[3] < 0)
          for (double& part : q) part = -part;
      }
      for (const std::size_t i : {1U, 2U, 3U, 0U}) body.turns.push_back(q[i]);
    }
    const Replica& held = replica(asked.content_hash);
    auto& versions = body.meshes.all;
    const std::uint64_t state = held.mesh().state_hash();
    if (!versions.empty() && (state == body.state || time_s - versions.back().from_s < kMeshStep_s))
      return;
    body.state = state;
    const std::size_t node = picture_.gltf.add_node(name + " mesh", body.node);
    picture_.gltf.set(node, "mesh", picture_.mesh_of(name, asked.content_hash, held));
    versions.push_back({node, versions.empty() ? 0 : time_s});
  }

  void take_contacts(const wire::ContactReport& r, double time_s) {
    const auto [at, is_new] = contacts_.try_emplace(std::pair(r.body_a, r.body_b));
    auto& versions = at->second.all;
    const bool touched = !is_new && touches_[{r.body_a, r.body_b}];
    if (r.pair_count == 0
            ? !touched
            : !versions.empty() && touched && time_s - versions.back().from_s < kContactStep_s)
      return;
    touches_[{r.body_a, r.body_b}] = r.pair_count > 0;
    const std::size_t node = picture_.gltf.add_node("contacts", node_);
    versions.push_back({node, time_s});
    if (r.pair_count == 0) return;  // nothing is seen from now on
    const Result<Answered> asked = ask(r, {.clearance = Clearance::kNone, .contacts = true});
    if (!asked.is_ok() || !asked.value().contacts || asked.value().contacts->segments.empty())
      return;
    std::vector<Vector> ends;
    for (const ContactSegment& segment : asked.value().contacts->segments)
      for (const Vector& end : {segment.p_m, segment.q_m}) ends.push_back(end);
    const auto positions = picture_.gltf.add_positions(ends, picture_.origin);
    const auto colours =
        picture_.gltf.add_colours(std::vector<Colour>(ends.size(), kContactColour));
    picture_.gltf.set(
        node, "mesh",
        picture_.gltf.add_mesh(
            "contacts",
            {{{"attributes", {{"POSITION", positions}, {"COLOR_0", colours}}}, {"mode", 1}}}));
  }

  Picture& picture_;
  std::string name_;
  std::size_t node_ = 0;
  bool has_node_ = false;
  std::map<std::string, Body> bodies_;
  std::map<std::pair<std::string, std::string>, Versions> contacts_;
  std::map<std::pair<std::string, std::string>, bool> touches_;
};

}  // namespace

Result<SessionGltf> session_to_glb(RecordingReader& recording, DetailFolder* models) {
  Picture picture{.begin_ns = recording.begin_ns()};
  // One thread: nodes are numbered in the order of the recording.
  const Result<Played> played =
      play(recording, {.threads = 1,
                       .make_peer =
                           [&](const std::string& partition) {
                             return std::make_unique<GltfPeer>(picture, partition);
                           },
                       .models = models});
  NEARMESH_RETURN_IF_ERROR(played);
  SessionGltf session{.meshes = picture.meshes.size()};
  if (!picture.has_origin)
    return Status{StatusCode::kNotFound, "no answer whose meshes are recorded"};
  for (const auto& [partition, peer] : played.value().peers) {
    static_cast<GltfPeer&>(*peer).animate();
    ++session.peers;
  }
  session.bodies = picture.bodies;
  session.seconds = picture.end_s;
  Result<std::string> bytes =
      std::move(picture.gltf).finish(picture.origin, {{"colours", kColourScale}});
  NEARMESH_RETURN_IF_ERROR(bytes);
  session.bytes = std::move(bytes).value();
  return session;
}

}  // namespace nearmesh::subscriber::report
