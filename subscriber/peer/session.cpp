// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "pair_readiness.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// Of one model; some 20 MB. A publisher that keeps to the window sends far fewer; what is dropped is asked for again.
constexpr std::size_t kMaxWaitingBatches = 16384;

/// A sweep may take some twenty milliseconds, then it says what it knows.
constexpr std::uint64_t kMaxSweepTests = 200'000;

}  // namespace

bool FrameReport::all_certified() const {
  return std::all_of(answers.begin(), answers.end(),
                     [](const PairAnswer& a) { return is_certified(a.answer.status); });
}

Session::Session(std::unique_ptr<Channel> channel, SessionOptions options)
    : impl_(std::make_unique<Impl>()) {
  NEARMESH_ASSERT(options.sweep_s >= 0);
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
  const FloatGuard guard;
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
  const FloatGuard guard;
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

Result<Readiness> Session::readiness(const std::string& body) const {
  const FloatGuard guard;
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
  const FloatGuard guard;
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
