// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/session.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "nearmesh/core/base/hash.hpp"
#include "nearmesh/core/base/stopwatch.hpp"
#include "nearmesh/core/demand/collect.hpp"
#include "nearmesh/wire/status_keeper.hpp"
#include "pair_readiness.hpp"
#include "replicas.hpp"

namespace nearmesh::subscriber {
namespace {

struct Body {
  std::string name;
  PeerModel* model = nullptr;
  bool own = false;
  bool solid = false;
  std::optional<Motion> motion;
  bool contested = false;  // another peer moves it too, as was said
};

// A request that was sent and not yet answered in full.
struct Outstanding {
  std::uint32_t request = 0;
  std::uint8_t priority = 0;
  double heard_s = 0;     // when it was sent, or its last batch came
  double patience_s = 0;  // silence after which it counts as lost; doubles with each loss in a row
  wire::SessionId publisher = 0;  // that was asked
  bool is_counted = false;        // as lost
};
constexpr double kMaxPatience_s = 8;

struct Publisher {
  wire::Hello hello;
  std::uint32_t received_sequence = 0;
  std::uint32_t lost_requests =
      0;  // in a row: it may be dead, which DDS tells only when its lease is over
};

/// Of one model; some 20 MB. A publisher that keeps to the window sends far fewer; what is dropped is asked for again.
constexpr std::size_t kMaxWaitingBatches = 16384;

constexpr std::uint8_t kNeededNow = 0;
constexpr std::uint8_t kHorizon = 1;

/// A sweep may take some twenty milliseconds, then it says what it knows.
constexpr std::uint64_t kMaxSweepTests = 200'000;

}  // namespace

bool FrameReport::all_certified() const {
  return std::all_of(answers.begin(), answers.end(),
                     [](const PairAnswer& a) { return is_certified(a.answer.status); });
}

struct Session::Impl {
  std::unique_ptr<Channel> channel;
  SessionOptions options;
  ReplicaSet replicas;
  std::map<std::string, Body> bodies;
  struct Pair {
    Body* a;
    Body* b;
    std::optional<std::pair<std::uint64_t, std::uint64_t>> reported;  // frame and digest
    Readiness last;  // of this pair alone, as of the last update
  };
  std::vector<Pair> pairs;
  std::map<wire::SessionId, Publisher> publishers;
  bool has_new_model = false;  // a body was added whose model nobody has announced since
  std::map<std::uint64_t, Outstanding> outstanding;  // by content hash
  std::uint32_t last_request = 0;
  double time_s = 0;  // of the update
  std::uint64_t refused = 0;
  bool is_dropping = false;  // batches, in this update
  SessionStats stats;
  Stopwatch clock;
  wire::StatusKeeper keeper;
  wire::ProcessStatus told;  // the last status

  void take_inbox(FrameReport& report);
  void take_batch(wire::SplitBatchMessage&& message, FrameReport& report);
  void answer_pair(Pair& pair, std::uint64_t frame, FrameReport& report);
  void sweep_pair(const Pair& pair, PairAnswer& result, FrameReport& report);
  void report_pair(Pair& pair, const PairAnswer& answer, std::uint64_t frame);
  void ask(const FrameReport& report);
  [[nodiscard]] RegionMaker region_of(const PeerModel& model, double lookahead_s,
                                      const FrameReport& report, bool uncertified_only) const;
  [[nodiscard]] std::vector<RegionPart> kept_of(const PeerModel& model,
                                                const FrameReport& report) const;
  [[nodiscard]] std::vector<NodeSpan> missing_of(const PeerModel& model, const FrameReport& report,
                                                 bool ahead) const;
  [[nodiscard]] double horizon_s() const { return std::max(options.lookahead_s, options.sweep_s); }
  bool request_ahead(PeerModel& model, const FrameReport& report, double patience_s);
  bool request(PeerModel& model, const RegionMaker& region, std::vector<NodeSpan> missing,
               std::uint8_t priority, double patience_s);
  void tell_status(const FrameReport& report, const SessionStats& counted);
  [[nodiscard]] Publisher* publisher_of(std::uint64_t content_hash);
  [[nodiscard]] double patience_after(std::uint64_t content_hash, Outstanding& lost);
  [[nodiscard]] std::string why_not_ready(const Body& body) const;
  void take_hello(const wire::Hello& hello, std::vector<std::string>& complaints);
  [[nodiscard]] std::string awaited_of(const PeerModel& model, std::size_t missing);
};

Session::Session(std::unique_ptr<Channel> channel, SessionOptions options)
    : impl_(std::make_unique<Impl>()) {
  NEARMESH_ASSERT(options.region_boxes >= 1 && options.region_boxes <= kMaxRegionBoxes);
  NEARMESH_ASSERT(options.sweep_s >= 0);
  NEARMESH_ASSERT(options.request_splits >= 1 && options.request_splits <= kMaxRequestSplits);
  impl_->channel = std::move(channel);
  impl_->options = options;
}
Session::~Session() = default;

Status Session::add_body(const std::string& name, const std::string& model, bool own, bool solid) {
  for (const std::string& text : {name, model})
    if (text.empty() || text.size() > wire::kMaxNameBytes)
      return {StatusCode::kInvalidArgument, "name '" + text + "': expected 1 to " +
                                                std::to_string(wire::kMaxNameBytes) + " bytes"};
  if (impl_->bodies.contains(name))
    return {StatusCode::kConflict, "body " + name + " is declared twice"};
  impl_->bodies.emplace(
      name, Body{.name = name, .model = &impl_->replicas.add(model), .own = own, .solid = solid});
  impl_->has_new_model = true;
  return Status::ok();
}

Status Session::place_body(const std::string& name, const Pose& pose) {
  const auto at = impl_->bodies.find(name);
  if (at == impl_->bodies.end()) return {StatusCode::kNotFound, "no body named " + name};
  NEARMESH_RETURN_IF_ERROR(check_pose(pose, name));
  at->second.motion = Motion{.pose = pose};
  for (Impl::Pair& pair : impl_->pairs)
    if (pair.a == &at->second || pair.b == &at->second)
      pair.last = not_asked(pair.a->name, pair.b->name);
  return Status::ok();
}

Status Session::watch(const std::string& body_a, const std::string& body_b) {
  const auto a = impl_->bodies.find(body_a), b = impl_->bodies.find(body_b);
  for (const auto& [at, name] : {std::pair(a, body_a), std::pair(b, body_b)})
    if (at == impl_->bodies.end()) return {StatusCode::kNotFound, "no body named " + name};
  if (a == b) return {StatusCode::kInvalidArgument, "body " + body_a + " against itself"};
  impl_->pairs.push_back({&a->second, &b->second, std::nullopt, not_asked(body_a, body_b)});
  return Status::ok();
}

Result<FrameReport> Session::update(std::uint64_t frame, double time_s,
                                    const std::vector<OwnMotion>& motions, double budget_s) {
  Impl& impl = *impl_;
  for (const OwnMotion& own : motions) {
    const auto at = impl.bodies.find(own.body);
    if (at == impl.bodies.end() || !at->second.own)
      return Status{StatusCode::kNotFound, own.body + " is not a body that this peer moves"};
    NEARMESH_RETURN_IF_ERROR(check_motion(own.motion, own.body));
  }
  if (!std::isfinite(time_s))  // it goes out with every pose
    return Status{StatusCode::kInvalidArgument, "time_s of frame " + std::to_string(frame) +
                                                    " is " + std::to_string(time_s) +
                                                    ", expected a finite number"};
  impl.time_s = time_s;
  const Stopwatch spent;
  FrameReport report;
  for (const OwnMotion& own : motions) {
    impl.bodies.at(own.body).motion = own.motion;
    wire::BodyPose pose;
    pose.peer = impl.channel->own_id();
    pose.body = own.body;
    pose.frame = frame;
    pose.time_s = time_s;
    pose.pose = own.motion.pose;
    pose.linear_velocity_mps = own.motion.linear_velocity_mps;
    pose.angular_velocity_radps = own.motion.angular_velocity_radps;
    impl.channel->send(pose);
  }
  impl.take_inbox(report);
  while (impl.replicas.apply_one(report) && spent.seconds() < budget_s) {
  }
  for (const auto& [name, model] : impl.replicas.all())
    report.batches_waiting += model.waiting.size();
  for (const auto& [name, model] : impl.replicas.all())
    report.state_digest =
        mix(report.state_digest ^ (model.is_ready() ? model.replica->mesh().state_hash() + 1 : 0));
  for (Impl::Pair& pair : impl.pairs) impl.answer_pair(pair, frame, report);
  for (const PairAnswer& pair : report.answers)
    report.answers_digest = mix(report.answers_digest ^ digest(pair.answer));
  impl.ask(report);
  if (impl.options.max_held_splits > 0)
    for (auto& [name, model] : impl.replicas.all())
      if (model.is_ready() && model.replica->mesh().split_count() > impl.options.max_held_splits)
        impl.replicas.collapse_outside(model, impl.kept_of(model, report), report);
  for (const std::string& line : report.complaints) impl.keeper.note(line, impl.clock.seconds());
  if (impl.keeper.is_due(impl.clock.seconds())) impl.tell_status(report, stats());
  return report;
}

void Session::Impl::take_inbox(FrameReport& report) {
  Channel::Inbox inbox = channel->take();
  std::vector<std::string>& complaints = report.complaints;
  complaints.insert(complaints.end(), inbox.complaints.begin(), inbox.complaints.end());
  for (const wire::SessionId id : inbox.lost_publishers) {
    publishers.erase(id);
    // Whoever serves next is asked anew.
    std::erase_if(outstanding, [id](const auto& open) { return open.second.publisher == id; });
  }
  for (const wire::Hello& hello : inbox.hellos) take_hello(hello, complaints);
  for (const wire::MeshHeader& header : inbox.headers)
    stats.header_bytes += replicas.take_header(header, complaints);
  is_dropping = false;
  if (std::exchange(has_new_model, false))  // it may have been announced before a body used it
    for (const auto& [id, publisher] : publishers)
      stats.header_bytes += replicas.announce_new(publisher.hello, complaints);
  for (wire::SplitBatchMessage& batch : inbox.batches) take_batch(std::move(batch), report);
  for (const wire::BodyPose& pose : inbox.poses) {
    const auto at = bodies.find(pose.body);
    if (at == bodies.end()) continue;
    if (at->second.own) {
      if (!std::exchange(at->second.contested, true))
        complaints.push_back("another peer also moves body " + pose.body +
                             "; its poses are ignored");
      continue;
    }
    at->second.motion = Motion{pose.pose, pose.linear_velocity_mps, pose.angular_velocity_radps};
  }
}

void Session::Impl::take_hello(const wire::Hello& hello, std::vector<std::string>& complaints) {
  if (!publishers.contains(
          hello.publisher))  // what the others have not answered may be asked of it
    std::erase_if(outstanding, [this](const auto& open) {
      const auto asked = publishers.find(open.second.publisher);
      return clock.seconds() - open.second.heard_s >= options.request_timeout_s ||
             (asked != publishers.end() && asked->second.lost_requests > 0);
    });
  publishers[hello.publisher].hello = hello;
  publishers[hello.publisher].lost_requests = 0;
  stats.header_bytes += replicas.announce(hello, complaints);
}

void Session::Impl::take_batch(wire::SplitBatchMessage&& message, FrameReport& report) {
  // What one that was lost meanwhile sent is good all the same.
  if (const auto at = publishers.find(message.publisher); at != publishers.end()) {
    Publisher& publisher = at->second;
    publisher.lost_requests = 0;
    if (message.sequence > publisher.received_sequence + 1)
      stats.sequence_gaps += message.sequence - publisher.received_sequence - 1;
    publisher.received_sequence = std::max(publisher.received_sequence, message.sequence);
  }
  ++stats.batches;
  stats.batch_bytes += message.bytes.size();
  const auto open = outstanding.find(message.content_hash);
  const bool answers_open = open != outstanding.end() && open->second.request == message.request;
  if (message.refused) {
    // The request stays open until its time-out, so that a refusal is not asked for every frame.
    ++refused;
    report.complaints.push_back("publisher refused request " + std::to_string(message.request) +
                                ": " + std::string(message.bytes.begin(), message.bytes.end()));
    return;
  }
  if (answers_open) {
    open->second.heard_s = clock.seconds();
    if (message.last) outstanding.erase(open);
  }
  PeerModel* model = replicas.find(message.content_hash);
  if (model == nullptr || message.bytes.empty()) return;
  if (model->waiting.size() < kMaxWaitingBatches) {
    model->waiting.push_back(std::move(message.bytes));
  } else if (!std::exchange(is_dropping, true)) {
    report.complaints.push_back("model " + model->name + ": more than " +
                                std::to_string(kMaxWaitingBatches) +
                                " batches wait to be applied; further ones are dropped");
  }
}

std::string Session::Impl::why_not_ready(const Body& body) const {
  if (body.model->content_hash == 0)
    return "model " + body.model->name + " of body " + body.name + ": " +
           (publishers.empty() ? "no publisher found" : "no publisher serves it");
  if (!body.model->is_ready())
    return "model " + body.model->name + " of body " + body.name + ": its header has not come";
  if (body.solid)
    if (const Status status = check_solid(body.model->replica->header(), body.name);
        !status.is_ok())
      return status.message();
  if (!body.motion) return "no pose of body " + body.name + " has come";
  return {};
}

void Session::Impl::answer_pair(Pair& pair, std::uint64_t frame, FrameReport& report) {
  PairAnswer result{.body_a = pair.a->name, .body_b = pair.b->name};
  result.reason = why_not_ready(*pair.a);
  if (result.reason.empty()) result.reason = why_not_ready(*pair.b);
  if (result.reason.empty()) {
    const Stopwatch watch;
    const TreeView a = pair.a->model->view(), b = pair.b->model->view();
    result.pose_a = pair.a->motion->pose;
    result.pose_b = pair.b->motion->pose;
    const Result<PosedPair> posed =
        pose_pair(*a.grid, result.pose_a, pair.a->name, *b.grid, result.pose_b, pair.b->name);
    if (posed.is_ok()) {
      result.asked = true;
      result.answer = query(a, posed.value().a, b, posed.value().b,
                            {.solid_a = pair.a->solid, .solid_b = pair.b->solid});
      if (options.contacts && !result.answer.pairs.empty())
        result.contacts = find_contacts(a, posed.value().a, b, posed.value().b, result.answer);
      if (is_certified(result.answer.status) && result.answer.pair_total == 0)
        result.safe_horizon_s =
            safe_horizon_s(a, *pair.a->motion, b, *pair.b->motion, result.answer.clearance_m);
      if (options.sweep_s > 0) sweep_pair(pair, result, report);
      if (result.answer.status == AnswerStatus::kUncertain && result.answer.missing_a.empty() &&
          result.answer.missing_b.empty())
        result.reason = "body " + (a.surface->has_seeds() ? pair.b : pair.a)->name +
                        " has more than " + std::to_string(kMaxComponentSeeds) +
                        " parts: whether one is inside the other body cannot be told";
    } else {
      result.reason = posed.status().message();
    }
    report.query_s += watch.seconds();
  }
  if (result.reason.empty() && !is_certified(result.answer.status)) {
    result.awaited = awaited_of(*pair.a->model, result.answer.missing_a.size());
    const std::string more = awaited_of(*pair.b->model, result.answer.missing_b.size());
    if (!result.awaited.empty() && !more.empty()) result.awaited += "; ";
    result.awaited += more;
  }
  if (!result.reason.empty()) result.answer.uncertainty_m = std::numeric_limits<double>::infinity();
  pair.last = readiness_of(result);
  if (options.publish_reports) report_pair(pair, result, frame);
  report.answers.push_back(std::move(result));
}

void Session::Impl::sweep_pair(const Pair& pair, PairAnswer& result, FrameReport& report) {
  Result<SweptAnswer> swept = sweep(pair.a->model->view(), *pair.a->motion, pair.a->name,
                                    pair.b->model->view(), *pair.b->motion, pair.b->name,
                                    {.duration_s = options.sweep_s, .max_tests = kMaxSweepTests});
  if (swept.is_ok()) {
    result.swept = std::move(swept).value();
  } else {
    report.complaints.push_back("no swept answer: " + swept.status().message());
  }
}

void Session::Impl::report_pair(Pair& pair, const PairAnswer& answer, std::uint64_t frame) {
  const std::pair now(frame, digest(answer.answer));
  if (pair.reported == now) return;
  pair.reported = now;
  wire::ContactReport report;
  report.peer = channel->own_id();
  report.body_a = answer.body_a;
  report.body_b = answer.body_b;
  report.frame = frame;
  report.time_s = time_s;
  report.status = static_cast<std::uint8_t>(answer.answer.status);
  // The wire carries finite numbers; "cannot be bounded" is the largest of them.
  const auto finite = [](double x) { return std::min(x, std::numeric_limits<double>::max()); };
  report.clearance_m = finite(answer.answer.clearance_m);
  report.uncertainty_m = finite(answer.answer.uncertainty_m);
  report.pair_count = static_cast<std::uint32_t>(answer.answer.pair_total);
  report.asked = answer.asked;
  report.answer_digest = now.second;
  if (report.asked) {
    report.gave_up_detail = pair.a->model->gave_up_detail || pair.b->model->gave_up_detail;
    const auto as_asked = [](const Body& body, const Pose& pose) {
      return wire::ContactReport::Asked{body.model->content_hash,
                                        body.model->replica->mesh().state_hash(),
                                        body.model->applied_batches, body.solid, pose};
    };
    report.a = as_asked(*pair.a, answer.pose_a);
    report.b = as_asked(*pair.b, answer.pose_b);
  }
  for (const FacePair& faces : answer.answer.pairs) {
    if (report.pairs.size() == wire::kMaxReportPairs) break;
    report.pairs.push_back({faces.a, faces.b});
  }
  channel->send(report);
}

// Where, in a model's grid, all bodies are that a body of that model is watched against; of what is not certified,
// the rays instead where only the inside of a solid is open.
RegionMaker Session::Impl::region_of(const PeerModel& model, double lookahead_s,
                                     const FrameReport& report, bool uncertified_only) const {
  std::vector<RegionPart> rays;
  std::vector<std::pair<const Body*, const Body*>> against;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const PairAnswer& answer = report.answers[i];
    if (!answer.reason.empty() || (uncertified_only && is_certified(answer.answer.status)))
      continue;
    const Answer& open = answer.answer;
    if (uncertified_only && !(open.rays_a.empty() && open.rays_b.empty())) {
      // The surfaces are apart: only the rays wait for detail.
      if (pairs[i].a->model == &model)
        rays.insert(rays.end(), open.rays_a.begin(), open.rays_a.end());
      if (pairs[i].b->model == &model)
        rays.insert(rays.end(), open.rays_b.begin(), open.rays_b.end());
      continue;
    }
    if (pairs[i].a->model == &model) against.emplace_back(pairs[i].a, pairs[i].b);
    if (pairs[i].b->model == &model) against.emplace_back(pairs[i].b, pairs[i].a);
  }
  rays.resize(std::min(rays.size(), kMaxRegionBoxes / 2));
  if (rays.empty() && against.empty()) return nullptr;
  return [this, lookahead_s, rays, against](std::size_t max_parts, std::span<const GridBox> near) {
    std::vector<RegionPart> region = rays;
    for (const auto& [own, other] : against) {
      const std::size_t each = std::max<std::size_t>(
          1, std::min(max_parts, (kMaxRegionBoxes - rays.size()) / against.size()));
      const auto parts = swept_region(own->model->view(), *own->motion, other->model->view(),
                                      *other->motion, lookahead_s, options.margin_m, each, near);
      region.insert(region.end(), parts.begin(), parts.end());
    }
    region.resize(std::min(region.size(), kMaxRegionBoxes));
    return region;
  };
}

// What is not given up: somewhat more than will be asked for, or it would come and go.
std::vector<RegionPart> Session::Impl::kept_of(const PeerModel& model,
                                               const FrameReport& report) const {
  const RegionMaker region = region_of(model, horizon_s(), report, false);
  if (region == nullptr) return {};
  std::vector<RegionPart> kept = region(kCoarseParts, root_reach(model.replica->store()));
  for (RegionPart& part : kept) {
    const std::int32_t radius = part.radius;
    part = reach_below(part.box);
    part.radius = radius;
  }
  return kept;
}

// Of those that serve it the one that left the fewest requests in a row unanswered; ties go to the lower id.
Publisher* Session::Impl::publisher_of(std::uint64_t content_hash) {
  Publisher* best = nullptr;
  for (auto& [id, publisher] : publishers) {
    const auto& models = publisher.hello.models;
    const bool serves = std::any_of(models.begin(), models.end(), [&](const auto& model) {
      return model.content_hash == content_hash;
    });
    if (serves && (best == nullptr || publisher.lost_requests < best->lost_requests))
      best = &publisher;
  }
  return best;
}

// Why detail of a model is not here, and whether it may be expected.
std::string Session::Impl::awaited_of(const PeerModel& model, std::size_t missing) {
  if (missing == 0) return {};
  const std::string what =
      std::to_string(missing) + " nodes of model " + model.name + " are missing, ";
  const Publisher* publisher = publisher_of(model.content_hash);
  if (publisher == nullptr)
    return what +
           (publishers.empty() ? "no publisher is there" : "no publisher that is there serves it");
  if (publisher->lost_requests > 0)
    return what + "publisher " + to_hex(publisher->hello.publisher) + " has not answered " +
           std::to_string(publisher->lost_requests) + " requests in a row";
  return what + "publisher " + to_hex(publisher->hello.publisher) + " is asked for them";
}

// The nodes of a model that this update's answers lack, or those for the time ahead; ascending.
std::vector<NodeSpan> Session::Impl::missing_of(const PeerModel& model, const FrameReport& report,
                                                bool ahead) const {
  std::vector<NodeSpan> missing;
  const auto add = [&](const PeerModel* lacks, const std::vector<NodeSpan>& nodes) {
    if (lacks == &model) missing.insert(missing.end(), nodes.begin(), nodes.end());
  };
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const PairAnswer& answer = report.answers[i];
    if (!ahead) {
      add(pairs[i].a->model, answer.answer.missing_a);
      add(pairs[i].b->model, answer.answer.missing_b);
    } else if (answer.swept) {
      add(pairs[i].a->model, answer.swept->missing_a);
      add(pairs[i].b->model, answer.swept->missing_b);
    }
  }
  std::sort(missing.begin(), missing.end());
  missing.erase(std::unique(missing.begin(), missing.end()), missing.end());
  missing.resize(std::min(missing.size(), kMaxAttachNodes));
  return missing;
}

// `missing`, ascending, is asked for in any case, before what else of the frontier meets the region.
bool Session::Impl::request(PeerModel& model, const RegionMaker& region,
                            std::vector<NodeSpan> missing, std::uint8_t priority,
                            double patience_s) {
  Publisher* publisher = publisher_of(model.content_hash);
  if (publisher == nullptr) return false;
  if (region == nullptr) return false;
  std::optional<RegionRequest> region_request =
      make_request(model.replica->store(), region, std::move(missing), options.region_boxes,
                   priority == kNeededNow ? options.request_splits
                                          : std::min(options.request_splits, kMaxAheadSplits),
                   priority == kNeededNow ? Portion::kLargestNodes : Portion::kWholeNodes);
  if (!region_request) return false;
  wire::RegionSubscription subscription;
  subscription.region = std::move(*region_request);
  subscription.peer = channel->own_id();
  subscription.publisher = publisher->hello.publisher;
  subscription.request = ++last_request;
  subscription.content_hash = model.content_hash;
  subscription.priority = priority;
  subscription.window_bytes = options.window_bytes;
  channel->send(subscription);
  outstanding[model.content_hash] = {last_request, priority, clock.seconds(), patience_s,
                                     publisher->hello.publisher};
  ++stats.requests;
  return true;
}

// What the swept answers lack, and what else may be met within the horizon.
bool Session::Impl::request_ahead(PeerModel& model, const FrameReport& report, double patience_s) {
  std::vector<NodeSpan> missing = missing_of(model, report, true);
  // Looking ahead costs more than most answers. Where nothing lacked in the nearer half of the horizon, an eighth of it may
  // pass before the next look.
  if (missing.empty() && std::abs(time_s - model.looked_ahead_s) < horizon_s() / 8) return false;
  model.looked_ahead_s = -std::numeric_limits<double>::infinity();
  // Asked for when the nearer half lacks something, then all of it: fewer and fuller batches than a little in each frame.
  const RegionMaker nearer = region_of(model, horizon_s() / 2, report, false);
  if (missing.empty() && (nearer == nullptr || !make_request(model.replica->store(), nearer, {},
                                                             options.region_boxes, 1))) {
    model.looked_ahead_s = time_s;
    return false;
  }
  return request(model, region_of(model, horizon_s(), report, false), std::move(missing), kHorizon,
                 patience_s);
}

// A request for a model was lost: how long to wait for the answer to the next, perhaps of another publisher.
double Session::Impl::patience_after(std::uint64_t content_hash, Outstanding& lost) {
  const auto asked = publishers.find(lost.publisher);
  if (asked != publishers.end() && !std::exchange(lost.is_counted, true))
    ++asked->second.lost_requests;
  const Publisher* next = publisher_of(content_hash);
  if (next != nullptr && next->lost_requests == 0) return options.request_timeout_s;
  return std::min(2 * lost.patience_s, kMaxPatience_s);
}

void Session::Impl::ask(const FrameReport& report) {
  for (auto& [name, model] : replicas.all()) {
    if (!model.is_ready() || !model.waiting.empty()) continue;
    // One request at a time and model: the next one names the frontier as the answer has left it, so nothing is sent
    // twice. Only what is needed now does not wait for a horizon; the publisher drops what is left of that.
    const auto open = outstanding.find(model.content_hash);
    double patience_s = options.request_timeout_s;
    bool may_prefetch = horizon_s() > 0;
    if (open != outstanding.end()) {
      const bool lost = clock.seconds() - open->second.heard_s >= open->second.patience_s;
      if (!lost && open->second.priority == kNeededNow) continue;
      may_prefetch = may_prefetch && lost;
      if (lost) patience_s = patience_after(model.content_hash, open->second);
    }
    // What an answer lacks is named outright: boxes of nodes need not nest, so the walk may miss a node that the query met.
    if (!request(model, region_of(model, 0, report, true), missing_of(model, report, false),
                 kNeededNow, patience_s) &&
        may_prefetch)
      static_cast<void>(request_ahead(model, report, patience_s));
  }
}

void Session::Impl::tell_status(const FrameReport& report, const SessionStats& counted) {
  wire::ProcessStatus now;
  now.session = channel->own_id();
  now.requests = counted.requests;
  now.refused = refused;
  now.batches = counted.batches;
  now.bytes = counted.batch_bytes;
  now.lost_batches = counted.sequence_gaps;
  now.waiting_batches = report.batches_waiting;
  now.watched_pairs = static_cast<std::uint32_t>(report.answers.size());
  for (const PairAnswer& pair : report.answers) {
    if (is_certified(pair.answer.status)) {
      ++now.certified_pairs;
    } else {
      now.uncertainty_m = std::max(now.uncertainty_m, std::min(pair.answer.uncertainty_m,
                                                               std::numeric_limits<double>::max()));
    }
  }
  for (const auto& [name, model] : replicas.all()) {
    if (now.models.size() == wire::kMaxModels) break;
    wire::ProcessStatus::Model entry{.name = name, .content_hash = model.content_hash};
    if (model.is_ready()) {
      const SpmHeader& header = model.replica->header();
      entry.faces = header.face_count;
      entry.held_splits = model.replica->mesh().split_count();
      entry.splits = header.split_count();
    }
    now.models.push_back(std::move(entry));
  }
  keeper.complete(now, clock.seconds());
  channel->tell(now);
  told = std::move(now);
}

bool Session::has_all_headers() const {
  return std::all_of(impl_->bodies.begin(), impl_->bodies.end(),
                     [](const auto& body) { return body.second.model->is_ready(); });
}

Result<Readiness> Session::readiness(const std::string& body) const {
  const auto at = impl_->bodies.find(body);
  if (at == impl_->bodies.end()) return Status{StatusCode::kNotFound, "no body named " + body};
  Readiness all{.stage = ReadyStage::kCertified};
  for (const Impl::Pair& pair : impl_->pairs)
    if (pair.a == &at->second || pair.b == &at->second) add_pair(all, pair.last);
  if (all.pairs == 0) return Readiness{.reason = "body " + body + " is watched against nothing"};
  return all;
}

Result<RegionReadiness> Session::region_readiness(const std::string& body,
                                                  const std::array<double, 3>& lo_m,
                                                  const std::array<double, 3>& hi_m) const {
  const auto at = impl_->bodies.find(body);
  if (at == impl_->bodies.end()) return Status{StatusCode::kNotFound, "no body named " + body};
  for (std::size_t k = 0; k < 3; ++k)
    if (!std::isfinite(lo_m[k]) || !std::isfinite(hi_m[k]) || lo_m[k] > hi_m[k])
      return Status{StatusCode::kInvalidArgument,
                    "region of body " + body + ": from " + std::to_string(lo_m[k]) + " to " +
                        std::to_string(hi_m[k]) + " m on axis " + std::to_string(k) +
                        ", expected finite numbers in ascending order"};
  const PeerModel& model = *at->second.model;
  if (!model.is_ready())
    return RegionReadiness{.uncertainty_m = std::numeric_limits<double>::infinity(),
                           .reason = impl_->why_not_ready(at->second)};
  return lacks_in_box(model.view(), lo_m, hi_m);
}

const SpmHeader* Session::header_of(const std::string& body) const {
  const auto at = impl_->bodies.find(body);
  if (at == impl_->bodies.end() || !at->second.model->is_ready()) return nullptr;
  return &at->second.model->replica->header();
}

const wire::ProcessStatus& Session::status() const { return impl_->told; }

SessionStats Session::stats() const {
  SessionStats stats = impl_->stats;
  for (const auto& [name, model] : impl_->replicas.all()) {
    stats.mesh_bytes += model.mesh_bytes;
    if (!model.is_ready()) continue;
    const AbTreeStats tree = model.tree->stats();
    stats.held_splits += model.replica->mesh().split_count();
    stats.slots += tree.slots;
    stats.exact_faces += tree.exact_faces;
    stats.tree_bytes += tree.bytes;
  }
  return stats;
}

}  // namespace nearmesh::subscriber
