// SPDX-License-Identifier: Apache-2.0
#include "film.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "core/replica/triangles.hpp"
#include "film_stream.hpp"
#include "film_world.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "recorded_peer.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::size_t kMostMissing = 256;      ///< nodes that are told of one answer and body
constexpr std::size_t kMostSegments = 4096;    ///< of contact, of one answer
constexpr std::int64_t kLeastByteStep_ms = 5;  ///< between two counts of bytes

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
  // Of bodies, by mover and number.
  std::map<std::pair<wire::SessionId, std::uint32_t>, std::string> names_;
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
