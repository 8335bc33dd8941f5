// SPDX-License-Identifier: Apache-2.0
#include "film.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/base/hash.hpp"
#include "core/replica/triangles.hpp"
#include "film_stream.hpp"
#include "nearmesh/core/spm/detail/half_space.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "recorded_peer.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::size_t kMostMissing = 256;      ///< nodes that are told of one answer and body
constexpr std::size_t kMostSegments = 4096;    ///< of contact, of one answer
constexpr std::int64_t kLeastByteStep_ms = 5;  ///< between two counts of bytes
constexpr int kBodyUnit =
    -12;  ///< of a body whose model is unknown: 2^-12 m, a quarter of a millimetre

/// What was told of one model.
class FilmModel {
 public:
  FilmModel(FilmStream& out, std::uint32_t index) : out_(out), index_(index) {}

  /// The faces and nodes of a peer's mesh, by number, ascending.
  struct Mesh {
    std::vector<std::uint32_t> faces, nodes;
  };
  Mesh add(const ActiveMesh& mesh) {
    Mesh held;
    const SplitStore& store = mesh.store();
    for (VertexId v{0}; v.value < store.vertex_count();) {
      const NodeSpan node = mesh.current_node(v);
      held.nodes.push_back(add(mesh, node));
      v = {node.end()};
    }
    for (const ActiveFace& face : extract_faces(mesh)) {
      std::array<std::uint32_t, 3> corners{};
      for (std::size_t i = 0; i < 3; ++i) corners[i] = vertices_.at(face.corners[i].value);
      const auto [at, is_new] =
          faces_.try_emplace(corners, static_cast<std::uint32_t>(faces_.size()));
      if (is_new) new_faces_.push_back(corners);
      held.faces.push_back(at->second);
    }
    std::sort(held.faces.begin(), held.faces.end());
    std::sort(held.nodes.begin(), held.nodes.end());
    tell();
    return held;
  }
  /// The number of an unresolved node that is in the mesh.
  std::uint32_t number_of(const ActiveMesh& mesh, NodeSpan node) {
    const std::uint32_t number = add(mesh, node);
    tell();
    return number;
  }

 private:
  struct NewNode {
    std::uint32_t vertex = 0;
    bool is_exact = true;
    std::array<std::int64_t, 6> reach{};  // -x +x -y +y -z +z of the vertex
    std::vector<HalfSpace> half_spaces;
  };
  struct NodeName {
    std::uint32_t first = 0, size = 0;
    std::uint64_t told = 0;  // digest of its half-spaces
    auto operator<=>(const NodeName&) const = default;
  };
  struct Hash {
    std::size_t operator()(const std::array<std::uint32_t, 3>& c) const {
      return mix(mix(std::uint64_t{c[0]} << 32 | c[1]) ^ c[2]);
    }
    std::size_t operator()(const NodeName& n) const {
      return mix(mix(std::uint64_t{n.first} << 32 | n.size) ^ n.told);
    }
  };

  std::uint32_t add(const ActiveMesh& mesh, NodeSpan node) {
    const SplitStore& store = mesh.store();
    const auto half_spaces = mesh.half_spaces().of(node.first);
    NodeName name{node.begin(), node.size, 0};
    for (const HalfSpace& told : half_spaces)
      name.told = mix(name.told ^ (std::uint64_t{told.direction} << 8 | told.reach));
    const auto [at, is_new] = nodes_.try_emplace(name, static_cast<std::uint32_t>(nodes_.size()));
    if (!is_new) return at->second;
    const GridPoint& position = store.position(node.first);
    const auto [vertex, is_new_vertex] =
        vertices_.try_emplace(node.begin(), static_cast<std::uint32_t>(vertices_.size()));
    if (is_new_vertex) new_vertices_.push_back(position);
    NewNode told{.vertex = vertex->second, .is_exact = node.size == 1};
    if (!told.is_exact) {
      const GridBox box = store.box(node);
      for (int k = 0; k < 3; ++k) {
        const auto axis = static_cast<std::size_t>(2 * k);
        told.reach[axis] = std::max<std::int64_t>(0, std::int64_t{position[k]} - box.lo[k]);
        told.reach[axis + 1] = std::max<std::int64_t>(0, std::int64_t{box.hi[k]} - position[k]);
      }
      told.half_spaces.assign(half_spaces.begin(), half_spaces.end());
    }
    new_nodes_.push_back(std::move(told));
    return at->second;
  }

  /// Says what is new.
  void tell() {
    if (!new_vertices_.empty()) {
      out_.begin('V', index_, new_vertices_.size());
      for (int k = 0; k < 3; ++k)
        for (const GridPoint& point : new_vertices_)
          out_.difference(last_vertex_[static_cast<std::size_t>(k)], point[k]);
      new_vertices_.clear();
    }
    if (!new_nodes_.empty()) {
      out_.begin('N', index_, new_nodes_.size());
      for (const NewNode& node : new_nodes_) out_.difference(last_node_, node.vertex);
      for (const NewNode& node : new_nodes_)
        out_.number(node.is_exact ? 0 : 1 + node.half_spaces.size());
      for (const NewNode& node : new_nodes_)
        if (!node.is_exact)
          for (const std::int64_t reach : node.reach)
            out_.number(static_cast<std::uint64_t>(reach));
      for (const NewNode& node : new_nodes_)
        for (const HalfSpace& told : node.half_spaces) {
          for (const std::int8_t n : half_space_normal(told.direction)) out_.signed_number(n);
          out_.number(static_cast<std::uint64_t>(half_space_reach(told.reach)));
        }
      new_nodes_.clear();
    }
    if (!new_faces_.empty()) {
      out_.begin('F', index_, new_faces_.size());
      for (std::size_t i = 0; i < 3; ++i)
        for (const auto& corners : new_faces_)
          if (i == 0)
            out_.difference(last_corner_, corners[0]);
          else
            out_.signed_number(std::int64_t{corners[i]} - corners[0]);
      new_faces_.clear();
    }
  }

  FilmStream& out_;
  std::uint32_t index_;
  std::unordered_map<std::uint32_t, std::uint32_t> vertices_;  // numbers by id
  std::unordered_map<NodeName, std::uint32_t, Hash> nodes_;
  std::unordered_map<std::array<std::uint32_t, 3>, std::uint32_t, Hash> faces_;
  std::vector<GridPoint> new_vertices_;
  std::vector<NewNode> new_nodes_;
  std::vector<std::array<std::uint32_t, 3>> new_faces_;
  std::array<std::int64_t, 3> last_vertex_{};
  std::int64_t last_node_ = 0, last_corner_ = 0;
};

/// What all peers share: the numbers of models and bodies.
class FilmWorld {
 public:
  FilmWorld() = default;
  FilmWorld(const FilmWorld&) = delete;
  FilmWorld& operator=(const FilmWorld&) = delete;

  /// What is known of the recording as a whole.
  void look(const RecordingReader& recording) {
    begin_ns_ = recording.begin_ns();
    for (const RecordedModel& model : recording.models()) names_[model.content_hash] = model.name;
  }

  [[nodiscard]] std::int64_t ms_of(std::int64_t received_ns) const {
    return std::max<std::int64_t>(0, (received_ns - begin_ns_) / 1'000'000);
  }
  struct KnownModel {
    std::uint32_t number = 0;
    int unit = 0;
    std::unique_ptr<FilmModel> model;
  };
  KnownModel& model_of(const ContentHash& content, const SpmHeader& header) {
    KnownModel& known = models_[content];
    if (known.model) return known;
    known.number = static_cast<std::uint32_t>(models_.size() - 1);
    known.unit = header.grid.exponent + 4;
    known.model = std::make_unique<FilmModel>(models, known.number);
    models.begin('M', known.number, header.face_count);
    models.text(names_[content]);
    models.text(to_hex(content));
    models.signed_number(header.grid.exponent);
    for (const double origin : header.grid.origin_m) models.real(origin);
    return known;
  }
  [[nodiscard]] const KnownModel* known_model(const ContentHash& content) const {
    const auto at = models_.find(content);
    return at == models_.end() || !at->second.model ? nullptr : &at->second;
  }
  /// `model`: none where only a pose was heard.
  std::uint32_t body_of(const std::string& name, const KnownModel* model) {
    const auto [at, is_new] = bodies_.try_emplace(name, bodies_.size());
    Body& body = at->second;
    const std::int64_t now = model == nullptr ? -1 : std::int64_t{model->number};
    if (is_new || (now >= 0 && now != body.model)) {
      if (now >= 0) body.model = now;
      body.unit = model == nullptr ? kBodyUnit : model->unit;
      body.way = {};
      world.begin('B', body.number, static_cast<std::uint64_t>(body.model + 1));
      world.signed_number(body.unit);
      world.text(name);
    }
    return body.number;
  }
  [[nodiscard]] int unit_of(const std::string& name) const { return bodies_.at(name).unit; }
  void take(const std::string& name, const Pose& pose, std::int64_t ms) {
    const std::uint32_t number = body_of(name, nullptr);
    Body& body = bodies_.at(name);
    FilmPose told(pose, body.unit);
    if (body.way.is_at(told)) return;
    ms = std::max(ms, last_ms_);  // the recorder's clock may have gone back
    world.begin('P', number, static_cast<std::uint64_t>(ms - last_ms_));
    last_ms_ = ms;
    body.way.tell(told, world);
  }

  FilmStream models, world;

 private:
  struct Body {
    explicit Body(std::size_t count) : number(static_cast<std::uint32_t>(count)) {}
    std::uint32_t number;
    std::int64_t model = -1;
    int unit = kBodyUnit;
    FilmWay way{};
  };
  std::int64_t begin_ns_ = 0;
  std::map<ContentHash, std::string> names_;
  std::map<ContentHash, KnownModel> models_;
  std::map<std::string, Body> bodies_;
  std::int64_t last_ms_ = 0;
};

/// Writes down what it is in each report.
class FilmPeer final : public RecordedPeer {
 public:
  FilmPeer(FilmWorld& world, const FilmPlan& plan) : world_(world), plan_(plan) {}
  FilmStream mesh, answers;

 private:
  /// As the page knows it.
  struct Held {
    std::uint64_t state = 0;
    std::int64_t ms = 0;
    bool is_told = false;
    FilmModel::Mesh mesh;
  };
  struct Pair {
    std::uint32_t number;
    std::string said;  ///< of the last answer
  };

  void visit(const RecordedReport& report, Standing standing) override {
    const wire::ContactReport& r = report.message;
    constexpr int kOfWorld = 8;  // after all standings
    // A frame may be answered again when detail has come.
    if (!frame_ || r.frame != *frame_ || !answered_.emplace(r.body_a, r.body_b).second) {
      begin_frame(r.frame, world_.ms_of(report.received_ns));
      answered_ = {{r.body_a, r.body_b}};
    }
    const bool has_both = is_rebuilt(r, standing);
    const auto status = static_cast<AnswerStatus>(r.status);
    std::optional<Answered> asked;
    if (has_both && (r.pair_count > 0 || !is_certified(status)))
      if (Result<Answered> again = ask(r, {.clearance = Clearance::kNone, .contacts = true});
          again.is_ok())
        asked = std::move(again).value();
    if (plan_.onlooker != nullptr) {
      std::optional<FilmOnlooker::Held> held;
      if (has_both)
        held.emplace(FilmOnlooker::Held{FilmOnlooker::HeldBody(replica(r.a.content_hash)),
                                        FilmOnlooker::HeldBody(replica(r.b.content_hash)),
                                        asked && asked->contacts ? &*asked->contacts : nullptr});
      plan_.onlooker->see(r, report.received_ns, held);
    }
    const bool is_near = r.pair_count > 0 || !is_certified(status);
    std::array<std::uint32_t, 2> bodies{};
    for (std::size_t side = 0; side < 2; ++side)
      bodies[side] = tell_body(side == 0 ? r.body_a : r.body_b, side == 0 ? r.a : r.b, has_both,
                               standing, is_near);
    const bool is_of_world = r.world && standing == Standing::kReached;
    tell_answer(r, bodies,
                has_both      ? 0
                : is_of_world ? kOfWorld
                              : 1 + static_cast<int>(standing),
                asked);
  }

  void begin_frame(std::uint64_t frame, std::int64_t ms) {
    ms = std::max(ms, ms_);
    answers.begin('T', static_cast<std::uint64_t>(ms - ms_), frame);
    ms_ = ms;
    frame_ = frame;
  }

  std::uint32_t tell_body(const std::string& name, const wire::ContactReport::Asked& asked,
                          bool has_both, Standing standing, bool is_near) {
    const FilmWorld::KnownModel* model = nullptr;
    if (has_both) {
      FilmWorld::KnownModel& known =
          world_.model_of(asked.content_hash, replica(asked.content_hash).header());
      tell_mesh(known, replica(asked.content_hash).mesh(), is_near);
      model = &known;
    } else {
      model = world_.known_model(asked.content_hash);
    }
    const std::uint32_t number = world_.body_of(name, model);
    if (standing == Standing::kNotAsked) return number;
    const FilmPose pose(asked.pose, world_.unit_of(name));
    FilmWay& way = ways_[number];
    if (!way.is_at(pose)) {
      answers.begin('P', number, static_cast<std::uint64_t>(pose.unit + 1024));
      way.tell(pose, answers);
    }
    return number;
  }

  void tell_mesh(FilmWorld::KnownModel& known, const ActiveMesh& now, bool is_near) {
    Held& held = held_[known.number];
    if (held.is_told && held.state == now.state_hash()) return;
    if (held.is_told && !is_near && ms_ - held.ms < plan_.least_step_ms) return;
    FilmModel::Mesh next = known.model->add(now);
    mesh.begin('H', static_cast<std::uint64_t>(ms_ - mesh_ms_), known.number);
    mesh_ms_ = ms_;
    tell_changes(held.mesh.nodes, next.nodes);
    tell_changes(held.mesh.faces, next.faces);
    held = {now.state_hash(), ms_, true, std::move(next)};
  }
  void tell_changes(const std::vector<std::uint32_t>& before,
                    const std::vector<std::uint32_t>& after) {
    std::vector<std::uint32_t> only;
    for (const auto& [from, but] : {std::pair(&after, &before), std::pair(&before, &after)}) {
      only.clear();
      std::set_difference(from->begin(), from->end(), but->begin(), but->end(),
                          std::back_inserter(only));
      mesh.number(only.size());
      std::int64_t last = 0;
      for (const std::uint32_t number : only) mesh.difference(last, number);
    }
  }

  void tell_answer(const wire::ContactReport& r, const std::array<std::uint32_t, 2>& bodies,
                   int unknown, const std::optional<Answered>& asked) {
    const auto [at, is_new] = pairs_.try_emplace(
        std::pair(bodies[0], bodies[1]), Pair{static_cast<std::uint32_t>(pairs_.size()), {}});
    Pair& pair = at->second;
    if (is_new) {
      answers.begin('D', bodies[0], bodies[1]);
    }
    FilmStream said;
    said.begin('A', pair.number, r.status);
    said.number(static_cast<std::uint64_t>(unknown));
    said.rough(r.clearance_m);
    said.rough(r.uncertainty_m);
    said.number(r.pair_count);
    for (const wire::ContactReport::Asked* body : {&r.a, &r.b})
      said.rough(body->stamp.mover == wire::Mover::kNone ? 0 : wire::age_s(body->stamp, r.time_s));
    for (const bool is_a : {true, false}) {
      const wire::ContactReport::Asked& body = is_a ? r.a : r.b;
      std::vector<NodeSpan> missing;
      if (asked) missing = is_a ? asked->answer.missing_a : asked->answer.missing_b;
      said.number(missing.size());
      const std::size_t told = std::min(missing.size(), kMostMissing);
      said.number(told);
      if (told == 0) continue;
      FilmWorld::KnownModel& known =
          world_.model_of(body.content_hash, replica(body.content_hash).header());
      std::int64_t last = 0;
      for (std::size_t i = 0; i < told; ++i)
        said.difference(last,
                        known.model->number_of(replica(body.content_hash).mesh(), missing[i]));
    }
    tell_contacts(asked, std::min(world_.unit_of(r.body_a), world_.unit_of(r.body_b)), said);
    // What is as it was is not said again.
    if (said.bytes == pair.said) return;
    pair.said = said.bytes;
    answers.bytes += said.bytes;
  }

  static void tell_contacts(const std::optional<Answered>& asked, int unit, FilmStream& said) {
    const std::size_t count =
        asked && asked->contacts ? std::min(asked->contacts->segments.size(), kMostSegments) : 0;
    said.number(count);
    if (count == 0) return;
    said.signed_number(unit);
    std::array<std::int64_t, 3> last{};
    for (std::size_t i = 0; i < count; ++i)
      for (const auto& end : {asked->contacts->segments[i].p_m, asked->contacts->segments[i].q_m})
        for (std::size_t k = 0; k < 3; ++k) said.difference(last[k], FilmPose::cells(end[k], unit));
  }

  FilmWorld& world_;
  const FilmPlan& plan_;
  std::optional<std::uint64_t> frame_;
  std::set<std::pair<std::string, std::string>> answered_;  // pairs of this frame
  std::int64_t ms_ = 0, mesh_ms_ = 0;
  std::map<std::uint32_t, Held> held_;     // by model
  std::map<std::uint32_t, FilmWay> ways_;  // by body
  std::map<std::pair<std::uint32_t, std::uint32_t>, Pair> pairs_;
};

/// What was said on the bus: poses, bytes, requests.
class FilmBus {
 public:
  FilmBus(FilmWorld& world, FilmOnlooker* onlooker) : world_(world), onlooker_(onlooker) {}

  /// `partition`: of the message's writer.
  void take(const RecordedMessage& message, const std::string& partition,
            const wire::RecordedSamples& samples) {
    const std::int64_t ms = world_.ms_of(message.received_ns);
    if (const auto told = samples.read<wire::BodyDirectory>(message)) {
      for (const wire::BodyDirectory::Body& body : told->bodies)
        names_[{told->peer, body.number}] = body.name;
    } else if (const auto poses = samples.read_poses(message)) {
      for (const wire::BodyPoses::Body& body : poses->bodies)
        if (const auto name = names_.find({poses->peer, body.number}); name != names_.end()) {
          world_.take(name->second, body.motion.pose, ms);
          if (onlooker_ != nullptr)
            onlooker_->see(name->second, body.motion.pose, message.received_ns);
        }
    } else if (samples.is<wire::SplitBatchMessage>(message)) {
      if (wire::peer_of(partition) == 0) return;
      Peer& peer = peers_[partition];
      if (peer.bytes > 0 && ms >= peer.bytes_ms + kLeastByteStep_ms) peer.tell_bytes();
      if (peer.bytes == 0) peer.bytes_ms = ms;
      peer.bytes += message.cdr.size();
    } else if (const auto asked = samples.read<wire::RegionSubscription>(message)) {
      take(*asked, ms);
    }
  }
  /// Says the bytes that were counted.
  void tell() {
    for (auto& [partition, peer] : peers_) peer.tell_bytes();
  }
  [[nodiscard]] std::map<std::string, const std::string*> streams() const {
    std::map<std::string, const std::string*> streams;
    for (const auto& [partition, peer] : peers_) streams[partition] = &peer.out.bytes;
    return streams;
  }

 private:
  struct Peer {
    FilmStream out;
    std::int64_t last_ms = 0, bytes_ms = 0;
    std::uint64_t bytes = 0;

    void tell_bytes() {
      if (bytes == 0) return;
      out.begin('S', static_cast<std::uint64_t>(std::max<std::int64_t>(0, bytes_ms - last_ms)),
                bytes);
      last_ms = std::max(last_ms, bytes_ms);
      bytes = 0;
    }
  };

  void take(const wire::RegionSubscription& asked, std::int64_t ms) {
    if (asked.request == 0) return;  // only credit
    Peer& peer = peers_[wire::partition_of(asked.peer)];
    peer.tell_bytes();
    ms = std::max(ms, peer.last_ms);
    const auto after = static_cast<std::uint64_t>(ms - peer.last_ms);
    if (asked.certificate) {
      peer.out.begin('Q', after, asked.certificate->pairs.size());
      peer.out.rough(asked.certificate->horizon_s);
      peer.out.rough(asked.certificate->margin_m);
      for (const CertificateRequest::Pair& pair : asked.certificate->pairs) {
        for (const std::uint8_t i : {pair.a, pair.b}) {
          const auto& models = asked.certificate->models;
          const FilmWorld::KnownModel* known =
              i < models.size() ? world_.known_model(models[i].content) : nullptr;
          peer.out.number(known == nullptr ? 0 : known->number + 1);
        }
        for (const auto& vector : {pair.translation_m, pair.linear_velocity_mps})
          for (const float x : vector) peer.out.real(x);
      }
    } else {
      const FilmWorld::KnownModel* known = world_.known_model(asked.content_hash);
      if (known == nullptr || asked.region.is_audit()) return;
      peer.out.begin('R', after, asked.region.region.size());
      peer.out.number(known->number);
      for (const RegionPart& part : asked.region.region) {
        for (int k = 0; k < 3; ++k) {
          peer.out.signed_number(part.box.lo[k]);
          peer.out.signed_number(part.box.hi[k]);
        }
        peer.out.number(static_cast<std::uint64_t>(part.radius));
      }
    }
    peer.last_ms = ms;
  }

  FilmWorld& world_;
  FilmOnlooker* const onlooker_;
  std::map<std::string, Peer> peers_;
  std::map<std::pair<wire::SessionId, std::uint32_t>, std::string>
      names_;  // of bodies, by mover and number
};

}  // namespace

int FilmOnlooker::HeldBody::exponent() const { return replica_.header().grid.exponent; }
std::uint64_t FilmOnlooker::HeldBody::state() const { return replica_.mesh().state_hash(); }
void FilmOnlooker::HeldBody::add_triangles(std::vector<std::array<double, 3>>& exact_m,
                                           std::vector<std::array<double, 3>>& coarse_m) const {
  nearmesh::add_triangles(replica_, exact_m, coarse_m);
}

class FilmMaker::Impl {
 public:
  explicit Impl(const FilmPlan& plan)
      : plan_(plan),
        // One thread: the numbers of faces and nodes are those of their first coming.
        playing_(
            {.threads = 1,
             .make_peer =
                 [this](const std::string&) { return std::make_unique<FilmPeer>(world_, plan_); },
             .models = plan.models}) {}

  Status go_on(RecordingReader& recording, bool final) {
    const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(recording);
    NEARMESH_RETURN_IF_ERROR(samples);
    world_.look(recording);
    NEARMESH_RETURN_IF_ERROR(playing_.go_on(recording, final));
    const std::int64_t end = recording.message_count() + 1;
    NEARMESH_RETURN_IF_ERROR(
        recording.read(next_, end, [&](std::int64_t, const RecordedMessage& message) {
          bus_.take(message, recording.writers()[message.writer].partition, samples.value());
          return true;
        }));
    next_ = end;
    bus_.tell();
    return Status::ok();
  }
  void visit(
      const std::function<void(const std::string& name, const std::string& bytes)>& visit) const {
    visit("models", world_.models.bytes);
    visit("world", world_.world.bytes);
    for (const auto& [partition, peer] : playing_.played().peers) {
      const auto& seen = static_cast<const FilmPeer&>(*peer);
      visit("answers-" + partition, seen.answers.bytes);
      visit("mesh-" + partition, seen.mesh.bytes);
    }
    for (const auto& [partition, bytes] : bus_.streams()) visit("bus-" + partition, *bytes);
  }

 private:
  FilmPlan plan_;
  FilmWorld world_;
  Playing playing_;
  FilmBus bus_{world_, plan_.onlooker};
  std::int64_t next_ = 1;
};

FilmMaker::FilmMaker(const FilmPlan& plan) : impl_(std::make_unique<Impl>(plan)) {}
FilmMaker::~FilmMaker() = default;
Status FilmMaker::go_on(RecordingReader& recording, bool final) {
  return impl_->go_on(recording, final);
}
void FilmMaker::visit(
    const std::function<void(const std::string& name, const std::string& bytes)>& visit) const {
  impl_->visit(visit);
}

Result<Film> make_film(RecordingReader& recording, const FilmPlan& plan) {
  FilmMaker maker(plan);
  NEARMESH_RETURN_IF_ERROR(maker.go_on(recording, true));
  Film film;
  maker.visit([&](const std::string& name, const std::string& bytes) {
    film.streams.push_back({name, bytes});
    if (name.starts_with("answers-")) film.peers.push_back(name.substr(8));
  });
  return film;
}

}  // namespace nearmesh::subscriber
