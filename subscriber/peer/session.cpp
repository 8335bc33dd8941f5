// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "content_choice.hpp"
#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "core/replica/held_nodes.hpp"
#include "pair_readiness.hpp"
#include "region_readiness.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// Of one model; some 20 MB. A publisher that keeps to the window sends far fewer; what is dropped is asked for again.
constexpr std::size_t kMaxWaitingBatches = 16384;
constexpr std::size_t kMaxRefusedOf = 256;

/// A sweep may take some twenty milliseconds, then it says what it knows.
constexpr std::uint64_t kMaxSweepTests = 200'000;

/// An own body at rest is published again after this share of max_pose_age_s: of the rest half may be lost on the way, and
/// the frames of neither side need to be frequent.
constexpr double kRepeatShare = 0.25;

Status no_such(BodyId body) {
  return {StatusCode::kNotFound, "body " + (body.is_valid() ? std::to_string(body.value) : "none") +
                                     " is not of this session"};
}

}  // namespace

bool FrameReport::all_certified() const {
  return std::all_of(answers.begin(), answers.end(),
                     [](const PairAnswer& a) { return is_certified(a.answer.status); });
}

Session::Session(std::unique_ptr<Channel> channel, SessionOptions options)
    : impl_(std::make_unique<Impl>()) {
  NEARMESH_ASSERT(options.sweep_s >= 0);
  NEARMESH_ASSERT(options.max_pose_age_s >= 0);
  impl_->channel = std::move(channel);
  impl_->options = options;
}
Session::~Session() = default;

Result<BodyId> Session::add_body(BodyOptions options) {
  const FloatGuard guard;
  for (const std::string& text : {options.name, options.model})
    if (text.empty() || text.size() > wire::kMaxNameBytes)
      return Status{
          StatusCode::kInvalidArgument,
          "name '" + text + "': expected 1 to " + std::to_string(wire::kMaxNameBytes) + " bytes"};
  const double max_age_s = options.max_pose_age_s.value_or(
      options.own ? std::numeric_limits<double>::infinity() : impl_->options.max_pose_age_s);
  if (!(max_age_s >= 0))
    return Status{StatusCode::kInvalidArgument, "body " + options.name + ": max_pose_age_s is " +
                                                    std::to_string(max_age_s) +
                                                    ", expected seconds, not negative"};
  const BodyId id{static_cast<std::uint32_t>(impl_->bodies.size())};
  NEARMESH_RETURN_IF_ERROR(impl_->check_pin(options));
  if (!impl_->named.emplace(options.name, id).second)
    return Status{StatusCode::kConflict, "body " + options.name + " is declared twice"};
  PeerModel& model = impl_->replicas.add(options.model);
  if (options.content.is_set()) model.pinned = options.content;
  impl_->bodies.push_back({.id = id,
                           .name = std::move(options.name),
                           .model = &model,
                           .own = options.own,
                           .solid = options.solid,
                           .stamp = {.max_age_s = max_age_s}});
  impl_->has_news = true;
  return id;
}

/// One content for each model that is pinned, and one model for each content: a replica belongs to both.
Status Session::Impl::check_pin(const BodyOptions& body) const {
  if (!body.content.is_set()) return Status::ok();
  const std::string pins = "body " + body.name + " pins model " + body.model + " to content " +
                           to_hex(body.content) + ", another body ";
  for (const auto& [name, model] : replicas.all()) {
    if (name == body.model && model.pinned.is_set() && model.pinned != body.content)
      return {StatusCode::kConflict, pins + "to " + to_hex(model.pinned)};
    if (name != body.model && model.pinned == body.content)
      return {StatusCode::kConflict, pins + "model " + name + " to the same"};
  }
  return Status::ok();
}

Status Session::place_body(BodyId body, const Pose& pose) {
  const FloatGuard guard;
  Body* placed = impl_->find(body);
  if (placed == nullptr) return no_such(body);
  NEARMESH_RETURN_IF_ERROR(check_pose(pose, placed->name));
  placed->motion = Motion{.pose = pose};
  placed->stamp.mover = wire::Mover::kThere;
  placed->is_placed = true;
  for (Impl::Pair& pair : impl_->pairs)
    if (pair.has(*placed)) pair.last = not_asked(pair.names());
  return Status::ok();
}

Result<PairId> Session::watch(BodyId a, BodyId b) {
  for (const BodyId body : {a, b})
    if (impl_->find(body) == nullptr) return no_such(body);
  if (a == b) return Status{StatusCode::kInvalidArgument, "body " + name_of(a) + " against itself"};
  Impl::Pair pair{.a = impl_->find(a), .b = impl_->find(b)};
  pair.last = not_asked(pair.names());
  impl_->pairs.push_back(std::move(pair));
  return PairId{static_cast<std::uint32_t>(impl_->pairs.size() - 1)};
}

std::string Session::name_of(BodyId body) const {
  const Body* named = impl_->find(body);
  return named == nullptr ? std::string() : named->name;
}

Result<FrameReport> Session::update(std::uint64_t frame, double time_s,
                                    const std::vector<OwnMotion>& motions, double budget_s) {
  const FloatGuard guard;
  Impl& impl = *impl_;
  for (const OwnMotion& own : motions) {
    const Body* body = impl.find(own.body);
    if (body == nullptr) return no_such(own.body);
    if (!body->own)
      return Status{StatusCode::kNotFound, body->name + " is not a body that this peer moves"};
    NEARMESH_RETURN_IF_ERROR(check_motion(own.motion, body->name));
  }
  if (!wire::is_time(time_s))  // it goes out with every pose
    return Status{StatusCode::kInvalidArgument, "time_s of frame " + std::to_string(frame) +
                                                    " is " + std::to_string(time_s) +
                                                    ", expected seconds, at most " +
                                                    std::to_string(wire::kMaxTime_s) + " from 0"};
  const Stopwatch spent;
  FrameReport report;
  if (impl.has_updated && time_s < impl.time_s)
    report.complaints.push_back("time_s of frame " + std::to_string(frame) + " is " +
                                std::to_string(time_s) + ", before it was " +
                                std::to_string(impl.time_s) + ": the exercise's clock went back");
  impl.has_updated = true;
  impl.time_s = time_s;
  for (const OwnMotion& own : motions) {
    Body& body = *impl.find(own.body);
    body.motion = own.motion;
    body.is_placed = false;
    body.stamp.mover = wire::Mover::kThere;
    body.stamp.time_s = time_s;
    impl.publish(body, frame);
  }
  for (Body& body : impl.bodies)
    if (body.own && body.motion && !body.is_placed && is_at_rest(*body.motion) &&
        std::abs(time_s - body.published_s) >= kRepeatShare * impl.options.max_pose_age_s)
      impl.publish(body, frame);
  impl.take_inbox(report);
  while (impl.replicas.apply_one(report) && spent.seconds() < budget_s) {
  }
  for (const auto& [name, model] : impl.replicas.all())
    report.batches_waiting += model.waiting.size();
  for (const auto& [name, model] : impl.replicas.all())
    report.state_digest =
        mix(report.state_digest ^ (model.is_ready() ? model.replica->mesh().state_hash() + 1 : 0));
  for (std::uint32_t i = 0; i < impl.pairs.size(); ++i) impl.answer_pair(PairId{i}, frame, report);
  impl.ask(report);
  if (impl.options.max_held_splits > 0)
    for (auto& [name, model] : impl.replicas.all())
      if (model.is_ready() && model.replica->mesh().split_count() > impl.options.max_held_splits)
        impl.give_up(model, report);
  impl.tell_held(report);
  for (const std::string& line : report.complaints) impl.keeper.note(line, impl.clock.seconds());
  if (impl.keeper.is_due(impl.clock.seconds())) impl.tell_status(report, stats());
  return report;
}

void Session::Impl::publish(Body& body, std::uint64_t frame) {
  wire::BodyPose pose;
  pose.peer = channel->own_id();
  pose.body = body.name;
  pose.frame = frame;
  pose.time_s = time_s;
  pose.pose = body.motion->pose;
  pose.linear_velocity_mps = body.motion->linear_velocity_mps;
  pose.angular_velocity_radps = body.motion->angular_velocity_radps;
  channel->send(pose);
  body.published_s = time_s;
}

/// A body in place is where it is, and so is an own one at rest until the host moves it: their poses are of now.
wire::PoseStamp Session::Impl::stamp_of(const Body& body) const {
  wire::PoseStamp stamp = body.stamp;
  if (body.is_placed || (body.own && body.motion && is_at_rest(*body.motion)))
    stamp.time_s = time_s;
  return stamp;
}

void Session::Impl::give_up(PeerModel& model, FrameReport& report) {
  const Replica::Times times = model.replica->give_up(kept_of(model, report));
  report.refine_s += times.refine_s;
  report.tree_s += times.tree_s;
}

/// Not while batches of the model wait: what is said to have come must have been taken in. Nor where it distrusts a publisher:
/// of what comes, recorders would not know what it drops.
void Session::Impl::tell_held(FrameReport& report) {
  for (auto& [name, model] : replicas.all()) {
    if (model.told_recorders == recorders || !model.is_ready() || !model.waiting.empty() ||
        model.replica->parked_splits() > 0 || model.replica->distrusts_anybody())
      continue;
    model.told_recorders = recorders;
    HeldNodes held = held_nodes(*model.replica);
    if (held.bits.size() > wire::kMaxHeldBytes) {
      report.complaints.push_back(
          "model " + name + ": what is held takes " + std::to_string(held.bits.size()) +
          " bytes to tell a recorder, at most " + std::to_string(wire::kMaxHeldBytes) +
          " are sent: one that came late cannot prove what follows");
      continue;
    }
    wire::HeldDetail message{.peer = channel->own_id(),
                             .content_hash = model.content_hash,
                             .model = name,
                             .applied_batches = model.replica->taken_batches(),
                             .last_request = last_request,
                             .state_digest = model.replica->mesh().state_hash(),
                             .box_digest = held.box_digest,
                             .nodes = std::move(held.bits)};
    for (const auto& [publisher, sequence] : last_sequence)
      message.heard.push_back({publisher, sequence});
    channel->tell_held(message);
  }
}

void Session::Impl::take_inbox(FrameReport& report) {
  Channel::Inbox inbox = channel->take();
  std::vector<std::string>& complaints = report.complaints;
  complaints.insert(complaints.end(), inbox.complaints.begin(), inbox.complaints.end());
  for (const wire::SessionId id : inbox.lost_publishers) {
    publishers.erase(id);
    // Whoever serves next is asked anew.
    std::erase_if(outstanding, [id](const auto& open) { return open.second.publisher == id; });
    has_news = true;
  }
  for (const wire::Hello& hello : inbox.hellos) take_hello(hello);
  // Not before all who came and went are known: one that was lost may be there again.
  if (std::exchange(has_news, false)) settle_contents(complaints);
  stats.refused_headers += inbox.refused_headers;
  for (const Channel::Header& header : inbox.headers) take_header(header, complaints);
  is_dropping = false;
  for (wire::SplitBatchMessage& batch : inbox.batches) take_batch(std::move(batch), report);
  if (inbox.recorder_came) ++recorders;
  take_poses(inbox, complaints);
}

void Session::Impl::take_poses(const Channel::Inbox& inbox, std::vector<std::string>& complaints) {
  for (const wire::BodyPose& pose : inbox.poses) {
    heard_time_s = std::max(heard_time_s.value_or(pose.time_s), pose.time_s);
    const auto at = named.find(pose.body);
    if (at == named.end()) continue;
    Body& body = bodies[at->second.value];
    if (body.own) {
      if (!std::exchange(body.contested, true))
        complaints.push_back("another peer also moves body " + pose.body +
                             "; its poses are ignored");
      continue;
    }
    if (body.stamp.mover != wire::Mover::kNone && !body.is_placed &&
        pose.time_s < body.stamp.time_s && !std::exchange(body.has_gone_back, true))
      complaints.push_back("the time of body " + pose.body + "'s poses went back from " +
                           std::to_string(body.stamp.time_s) + " to " +
                           std::to_string(pose.time_s) + " s; this is said once");
    body.motion = Motion{pose.pose, pose.linear_velocity_mps, pose.angular_velocity_radps};
    body.is_placed = false;
    body.stamp.mover = wire::Mover::kThere;
    body.stamp.time_s = pose.time_s;
  }
  for (const auto& [name, mover] : inbox.movers) {
    const auto at = named.find(name);
    if (at == named.end()) continue;
    Body& body = bodies[at->second.value];
    const bool is_of_another = !body.own && !body.is_placed;
    if (is_of_another && body.stamp.mover != wire::Mover::kNone) body.stamp.mover = mover;
  }
}

void Session::Impl::take_hello(const wire::Hello& hello) {
  if (!publishers.contains(
          hello.publisher))  // what the others have not answered may be asked of it
    std::erase_if(outstanding, [this](const auto& open) {
      const auto asked = publishers.find(open.second.publisher);
      return clock.seconds() - open.second.heard_s >= options.request_timeout_s ||
             (asked != publishers.end() && asked->second.lost_requests > 0);
    });
  publishers[hello.publisher].hello = hello;
  publishers[hello.publisher].lost_requests = 0;
  has_news = true;
}

/// Anybody can write a header; it counts from who serves that content.
void Session::Impl::take_header(const Channel::Header& header,
                                std::vector<std::string>& complaints) {
  const auto publisher = publishers.find(header.publisher);
  if (publisher != publishers.end() && publisher->second.serves(header.message.content_hash)) {
    stats.header_bytes += replicas.take_header(header.message, complaints);
    return;
  }
  ++stats.refused_headers;
  if (refused_of.size() < kMaxRefusedOf && refused_of.insert(header.publisher).second)
    complaints.push_back("header of content " + to_hex(header.message.content_hash) + " from " +
                         to_hex(header.publisher) +
                         " does not count: nobody of that name announces that content");
}

/// What each model's name stands for, by all that publishers say now.
void Session::Impl::settle_contents(std::vector<std::string>& complaints) {
  for (auto& [name, model] : replicas.all()) {
    std::vector<wire::Offer> offers;
    for (const auto& [id, publisher] : publishers) wire::add_offer(publisher.hello, name, offers);
    const ContentHash before = model.content_hash;
    ContentChoice choice = choose_content(
        {.pinned = model.pinned, .held = model.is_ready() ? before : ContentHash{}}, offers);
    if (!choice.change.empty())
      complaints.push_back("model " + name + ": " + choice.change + "; starting again with it");
    if (model.is_ready() && model.pinned.is_set() && before != model.pinned)
      complaints.push_back("model " + name + ": content " + to_hex(model.pinned) +
                           " is pinned now; content " + to_hex(before) + " is dropped");
    stats.header_bytes += replicas.assign(model, choice.content, complaints);
    if (choice.mesh_bytes != 0) model.mesh_bytes = choice.mesh_bytes;
    if (!choice.conflict.empty() && choice.conflict != model.conflict)
      complaints.push_back("model " + name + ": " + choice.conflict);
    model.conflict = std::move(choice.conflict);
  }
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
  note_sequence(message);
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
    model->waiting.push_back({message.publisher, std::move(message.bytes)});
  } else if (!std::exchange(is_dropping, true)) {
    report.complaints.push_back("model " + model->name + ": more than " +
                                std::to_string(kMaxWaitingBatches) +
                                " batches wait to be applied; further ones are dropped");
  }
}

/// The last, not the highest: a publisher that lost us for a while counts from 1 again.
void Session::Impl::note_sequence(const wire::SplitBatchMessage& message) {
  last_sequence[message.publisher] = message.sequence;
  if (last_sequence.size() > wire::kMaxHeardPublishers)
    std::erase_if(last_sequence, [&](const auto& heard) {
      return heard.first != message.publisher && !publishers.contains(heard.first);
    });
  if (last_sequence.size() > wire::kMaxHeardPublishers) last_sequence.erase(last_sequence.begin());
}

/// Why no base mesh of a model is here.
std::string Session::Impl::why_no_mesh(const PeerModel& model) const {
  const bool is_served = std::any_of(publishers.begin(), publishers.end(), [&](const auto& entry) {
    return entry.second.serves(model.content_hash);
  });
  if (is_served) return "its header has not come";
  if (!model.conflict.empty()) return model.conflict;
  if (publishers.empty()) return "no publisher found";
  if (!model.pinned.is_set()) return "no publisher serves it";
  return "no publisher serves content " + to_hex(model.pinned) + ", which is pinned";
}

std::string Session::Impl::why_not_ready(const Body& body) const {
  if (!body.model->is_ready())
    return "model " + body.model->name + " of body " + body.name + ": " + why_no_mesh(*body.model);
  if (body.solid)
    if (const Status status = check_solid(body.model->replica->header().surface, body.name);
        !status.is_ok())
      return status.message();
  return wire::why_stale(stamp_of(body), time_s, body.name);
}

namespace {

void take_answer(Answered&& all, PairAnswer& result, std::vector<std::string>& complaints) {
  result.answer = std::move(all.answer);
  result.contacts = std::move(all.contacts);
  result.safe_horizon_s = all.safe_horizon_s;
  if (!all.swept) return;
  if (all.swept->is_ok()) {
    result.swept = std::move(*all.swept).value();
  } else {
    complaints.push_back("no swept answer: " + all.swept->status().message());
  }
}

}  // namespace

void Session::Impl::answer_pair(PairId id, std::uint64_t frame, FrameReport& report) {
  Pair& pair = pairs[id.value];
  PairAnswer result{.pair = id, .a = pair.a->id, .b = pair.b->id, .answer = nothing_known()};
  result.content_a = pair.a->model->content_hash;
  result.content_b = pair.b->model->content_hash;
  result.age_a_s = wire::age_s(stamp_of(*pair.a), time_s);
  result.age_b_s = wire::age_s(stamp_of(*pair.b), time_s);
  result.reason = why_not_ready(*pair.a);
  if (result.reason.empty()) result.reason = why_not_ready(*pair.b);
  if (result.reason.empty()) {
    const Stopwatch watch;
    const auto body = [](const Body& of, double age_s) {
      return AskedBody{of.model->replica->view(), *of.motion, of.name, of.solid, age_s};
    };
    const AskedBody a = body(*pair.a, result.age_a_s), b = body(*pair.b, result.age_b_s);
    result.pose_a = a.motion.pose;
    result.pose_b = b.motion.pose;
    Result<Answered> asked = answer(a, b,
                                    {.contacts = options.contacts,
                                     .sweep_s = options.sweep_s,
                                     .max_sweep_tests = kMaxSweepTests});
    if (asked.is_ok()) {
      result.asked = true;
      take_answer(std::move(asked).value(), result, report.complaints);
      if (is_beyond_detail(result.answer))
        result.reason = "body " + (a.view.surface->has_seeds() ? pair.b : pair.a)->name +
                        " has more than " + std::to_string(kMaxComponentSeeds) +
                        " parts: whether one is inside the other body cannot be told";
    } else {
      result.reason = asked.status().message();
    }
    report.query_s += watch.seconds();
  }
  if (result.reason.empty() && !is_certified(result.answer.status)) {
    result.awaited = awaited_of(*pair.a->model, result.answer.missing_a.size());
    const std::string more = awaited_of(*pair.b->model, result.answer.missing_b.size());
    if (!result.awaited.empty() && !more.empty()) result.awaited += "; ";
    result.awaited += more;
  }
  pair.last = readiness_of(result, pair.names());
  const std::uint64_t answer_digest = digest(result.answer);
  report.answers_digest = mix(report.answers_digest ^ answer_digest);
  if (options.publish_reports) report_pair(pair, result, {frame, answer_digest});
  report.answers.push_back(std::move(result));
}

void Session::Impl::report_pair(Pair& pair, const PairAnswer& answer, const Reported& now) {
  if (pair.reported == now) return;
  pair.reported = now;
  wire::ContactReport report;
  report.peer = channel->own_id();
  report.body_a = pair.a->name;
  report.body_b = pair.b->name;
  report.frame = now.first;
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
    report.gave_up_detail =
        pair.a->model->replica->gave_up_detail() || pair.b->model->replica->gave_up_detail();
    const auto as_asked = [](const Body& body, const Pose& pose) {
      return wire::ContactReport::Asked{body.model->content_hash,
                                        body.model->replica->mesh().state_hash(),
                                        body.model->replica->taken_batches(),
                                        body.solid,
                                        pose,
                                        {}};
    };
    report.a = as_asked(*pair.a, answer.pose_a);
    report.b = as_asked(*pair.b, answer.pose_b);
  }
  report.a.stamp = stamp_of(*pair.a);
  report.b.stamp = stamp_of(*pair.b);
  for (const FacePair& faces : answer.answer.pairs) {
    if (report.pairs.size() == wire::kMaxReportPairs) break;
    report.pairs.push_back({faces.a, faces.b});
  }
  channel->send(report);
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
  for (const auto& [name, model] : replicas.all())  // as long as it lasts
    if (!model.conflict.empty())
      keeper.note("model " + name + ": " + model.conflict, clock.seconds());
  keeper.complete(now, clock.seconds());
  channel->tell(now);
  told = std::move(now);
}

Result<Readiness> Session::readiness(BodyId body) const {
  const FloatGuard guard;
  const Body* asked = impl_->find(body);
  if (asked == nullptr) return no_such(body);
  Readiness all{.stage = ReadyStage::kCertified};
  for (const Impl::Pair& pair : impl_->pairs)
    if (pair.has(*asked)) add_pair(all, pair.last);
  if (all.pairs == 0)
    return Readiness{.reason = "body " + asked->name + " is watched against nothing"};
  return all;
}

Result<RegionReadiness> Session::region_readiness(BodyId body, const std::array<double, 3>& lo_m,
                                                  const std::array<double, 3>& hi_m) const {
  const FloatGuard guard;
  const Body* asked = impl_->find(body);
  if (asked == nullptr) return no_such(body);
  for (std::size_t k = 0; k < 3; ++k)
    if (!std::isfinite(lo_m[k]) || !std::isfinite(hi_m[k]) || lo_m[k] > hi_m[k])
      return Status{StatusCode::kInvalidArgument,
                    "region of body " + asked->name + ": from " + std::to_string(lo_m[k]) + " to " +
                        std::to_string(hi_m[k]) + " m on axis " + std::to_string(k) +
                        ", expected finite numbers in ascending order"};
  const PeerModel& model = *asked->model;
  if (!model.is_ready())
    return RegionReadiness{.uncertainty_m = std::numeric_limits<double>::infinity(),
                           .reason = impl_->why_not_ready(*asked)};
  return lacks_in_box(model.replica->view(), lo_m, hi_m);
}

const SpmHeader* Session::header_of(BodyId body) const {
  const Body* asked = impl_->find(body);
  if (asked == nullptr || !asked->model->is_ready()) return nullptr;
  return &asked->model->replica->header();
}

std::optional<Motion> Session::motion_of(BodyId body) const {
  const Body* asked = impl_->find(body);
  return asked == nullptr ? std::nullopt : asked->motion;
}

std::optional<double> Session::heard_time_s() const { return impl_->heard_time_s; }

const wire::ProcessStatus& Session::status() const { return impl_->told; }

SessionStats Session::stats() const {
  SessionStats stats = impl_->stats;
  for (const auto& [name, model] : impl_->replicas.all()) {
    stats.mesh_bytes += model.mesh_bytes;
    if (!model.is_ready()) continue;
    const AbTreeStats tree = model.replica->tree().stats();
    stats.held_splits += model.replica->mesh().split_count();
    stats.slots += tree.slots;
    stats.exact_faces += tree.exact_faces;
    stats.tree_bytes += tree.bytes;
  }
  return stats;
}

}  // namespace nearmesh::subscriber
