// SPDX-License-Identifier: Apache-2.0
#include "session.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "nearmesh/core/base/parse_content_hash.hpp"
#include "nearmesh/subscriber/peer/wait_ready.hpp"
#include "run_jobs.hpp"

namespace nearmesh::c {
namespace {

using subscriber::BodyId;
using subscriber::LocalChannel;
using subscriber::Session;
using subscriber::SessionOptions;

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr wire::SessionId kOtherPeer = 3;  // beside LocalChannel's own two

static_assert(NEARMESH_WAITING == static_cast<int>(subscriber::ReadyStage::kWaiting) &&
              NEARMESH_ANSWERING == static_cast<int>(subscriber::ReadyStage::kAnswering) &&
              NEARMESH_CERTIFIED == static_cast<int>(subscriber::ReadyStage::kCertified));

nearmesh_session_options session_defaults() {
  const SessionOptions built_in;
  nearmesh_session_options options{};
  options.size = sizeof options;
  options.max_pose_age_s = built_in.max_pose_age_s;
  options.lookahead_s = built_in.lookahead_s;
  options.margin_m = built_in.margin_m;
  options.sweep_s = built_in.sweep_s;
  options.request_timeout_s = built_in.request_timeout_s;
  options.audit_s = built_in.audit_s;
  options.audit_seed = built_in.audit_seed;
  options.window_bytes = built_in.window_bytes;
  options.max_held_splits = built_in.max_held_splits;
  options.clearance = static_cast<int32_t>(built_in.clearance);
  options.contacts = built_in.contacts;
  options.publish_reports = built_in.publish_reports;
  options.any = built_in.any;
  options.max_pairs = built_in.max_pairs;
  options.max_tests = built_in.max_tests;
  options.max_sweep_tests = built_in.max_sweep_tests;
  options.depth = built_in.depth;
  options.max_depth_tests = built_in.max_depth_tests;
  options.promise_s = built_in.promise_s;
  return options;
}

constexpr nearmesh_body_options kBodyDefaults{.size = sizeof(nearmesh_body_options),
                                              .name = nullptr,
                                              .model = nullptr,
                                              .content = nullptr,
                                              .max_pose_age_s = -1,
                                              .own = 0,
                                              .solid = 0,
                                              .group = 1,
                                              .mask = 0xffffffffU,
                                              .max_speed_mps = 0};

Result<SessionOptions> session_options_of(const nearmesh_session_options* given) {
  nearmesh_session_options read = session_defaults();
  NEARMESH_RETURN_IF_ERROR(read_options(given, "nearmesh_session_options", read));
  NEARMESH_RETURN_IF_ERROR(
      check_number(read.clearance, NEARMESH_CLEARANCE_NONE, NEARMESH_CLEARANCE_EXACT, "clearance"));
  SessionOptions options;
  options.max_pose_age_s = read.max_pose_age_s;
  options.lookahead_s = read.lookahead_s;
  options.margin_m = read.margin_m;
  options.sweep_s = read.sweep_s;
  options.window_bytes = read.window_bytes;
  options.request_timeout_s = read.request_timeout_s;
  options.max_held_splits = read.max_held_splits;
  options.audit_s = read.audit_s;
  options.audit_seed = read.audit_seed;
  options.clearance = static_cast<Clearance>(read.clearance);
  if (read.cache_folder != nullptr) options.cache_folder = read.cache_folder;
  options.contacts = read.contacts != 0;
  options.depth = read.depth != 0;
  options.run_jobs = run_jobs_of(read.run_jobs, read.run_jobs_user);
  options.publish_reports = read.publish_reports != 0;
  options.any = read.any != 0;
  options.max_pairs = static_cast<std::size_t>(std::min<std::uint64_t>(read.max_pairs, kAllPairs));
  options.max_tests = read.max_tests;
  options.max_sweep_tests = read.max_sweep_tests;
  options.max_depth_tests = read.max_depth_tests;
  options.promise_s = read.promise_s;
  NEARMESH_RETURN_IF_ERROR(subscriber::check(options));
  return options;
}

/// None for no text.
Result<ContentHash> content_of(const char* digits) {
  if (digits == nullptr) return ContentHash{};
  return parse_content_hash(digits);
}

Result<subscriber::BodyOptions> body_options_of(const nearmesh_body_options* given) {
  NEARMESH_RETURN_IF_ERROR(check_given(given, "options"));
  nearmesh_body_options read = kBodyDefaults;
  NEARMESH_RETURN_IF_ERROR(read_options(given, "nearmesh_body_options", read));
  NEARMESH_RETURN_IF_ERROR(check_given(read.name, "name"));
  NEARMESH_RETURN_IF_ERROR(check_given(read.model, "model"));
  if (std::isnan(read.max_pose_age_s))
    NEARMESH_RETURN_IF_ERROR(check_number(read.max_pose_age_s, 0, kInfinite, "max_pose_age_s"));
  const Result<ContentHash> content = content_of(read.content);
  NEARMESH_RETURN_IF_ERROR(content);
  subscriber::BodyOptions options;
  options.name = read.name;
  options.model = read.model;
  options.own = read.own != 0;
  options.solid = read.solid != 0;
  options.content = content.value();
  if (read.max_pose_age_s >= 0) options.max_pose_age_s = read.max_pose_age_s;
  options.group = read.group;
  options.mask = read.mask;
  options.max_speed_mps = read.max_speed_mps;
  return options;
}

Status take_motions(nearmesh_session& handle, const nearmesh_body* bodies,
                    const nearmesh_motion* motions, std::size_t count) {
  NEARMESH_RETURN_IF_ERROR(check_array(bodies, count, "bodies"));
  NEARMESH_RETURN_IF_ERROR(check_array(motions, count, "motions"));
  handle.motions.clear();
  for (std::size_t i = 0; i < count; ++i)
    handle.motions.push_back({BodyId{bodies[i]}, from_c(motions[i])});
  return Status::ok();
}

/// Of the last update.
void keep_frame(nearmesh_session& handle, subscriber::FrameReport&& report,
                const nearmesh_frame** frame) {
  if (!handle.frame) handle.frame.emplace();
  handle.frame->fill(std::move(report));
  if (frame != nullptr) *frame = &handle.frame->frame;
}

void keep_readiness(nearmesh_session& handle, subscriber::Readiness&& readiness) {
  handle.readiness_reason = std::move(readiness.reason);
  handle.readiness.stage = static_cast<int32_t>(readiness.stage);
  handle.readiness.pairs = readiness.pairs;
  handle.readiness.certified = readiness.certified;
  handle.readiness.reason = handle.readiness_reason.c_str();
}

Status check_local(const nearmesh_session& handle) {
  if (handle.local != nullptr) return Status::ok();
  return {StatusCode::kUnsupported, "the session is on DDS; this is for local ones"};
}

Status no_such(nearmesh_body body, const char* what) {
  return {StatusCode::kNotFound, std::string(what) + " of body " + std::to_string(body)};
}

}  // namespace

void OwnedWorld::fill(const subscriber::WorldAnswer& of) {
  text = ContentText(of.world);
  content = text.digits;
  tiles.clear();
  for (const subscriber::NearTile& tile : of.tiles)
    tiles.push_back({.tile = to_c(tile.tile),
                     .is_here = tile.is_here,
                     .asked = tile.asked,
                     .status = static_cast<int32_t>(tile.status),
                     .pairs = tile.pairs,
                     .missing = tile.missing.size()});
  tile_count = tiles.size();
  missing_page_count = of.missing_pages.size();
}

void OwnedPair::fill(const subscriber::PairAnswer& of) {
  answer.fill(of.answer, of.contacts, of.depth);
  content_a = ContentText(of.content_a);
  content_b = ContentText(of.content_b);
  pair.a = of.a.value;
  pair.b = of.b.value;
  pair.answer = &answer.answer;
  pair.reason = of.reason.c_str();
  pair.awaited = of.awaited.c_str();
  pair.asked = of.asked;
  pair.age_a_s = of.age_a_s;
  pair.age_b_s = of.age_b_s;
  pair.pose_a = to_c(of.pose_a);
  pair.pose_b = to_c(of.pose_b);
  pair.content_a = content_a.digits;
  pair.content_b = content_b.digits;
  pair.safe_horizon_s = of.safe_horizon_s;
  pair.put_off = of.put_off;
  if (of.last_certified)
    last_certified = {.status = static_cast<int32_t>(of.last_certified->status),
                      .contained = static_cast<int32_t>(of.last_certified->contained),
                      .pair_total = of.last_certified->pair_total,
                      .age_s = of.last_certified->age_s,
                      .clearance_m = of.last_certified->clearance_m,
                      .safe_s = of.last_certified->safe_s};
  pair.last_certified = of.last_certified ? &last_certified : nullptr;
  if (of.swept) swept = to_c(*of.swept);
  pair.swept = of.swept ? &swept : nullptr;
  pair.contact_ids = of.contact_ids.data();
  if (of.world) world.fill(*of.world);
  pair.world = of.world ? &world : nullptr;
}

void OwnedFrame::fill(subscriber::FrameReport of) {
  report = std::move(of);
  while (pairs.size() < report.answers.size()) pairs.emplace_back();
  for (std::size_t i = 0; i < report.answers.size(); ++i) pairs[i].fill(report.answers[i]);
  contact_events.clear();
  for (const subscriber::ContactEvent& event : report.contact_events)
    contact_events.push_back({.change = static_cast<int32_t>(event.change),
                              .patch = event.patch,
                              .id = event.id,
                              .a = event.a.value,
                              .b = event.b.value});
  unknown.clear();
  for (const subscriber::UnknownBody& body : report.unknown)
    unknown.push_back({body.body.value, 0, body.reason.c_str()});
  frame.answer_count = report.answers.size();
  frame.unknown_count = report.unknown.size();
  frame.complaint_count = report.complaints.size();
  frame.all_certified = report.all_certified();
  frame.free_by_bounds = report.free_by_bounds.pairs;
  frame.free_clearance_m = report.free_by_bounds.clearance_m;
  frame.free_horizon_s = report.free_by_bounds.horizon_s;
  frame.free_digest = report.free_by_bounds.digest;
  frame.unknown_pairs = report.unknown_pairs;
  frame.load_s = report.load_s;
  frame.refine_s = report.refine_s;
  frame.tree_s = report.tree_s;
  frame.broad_s = report.broad_s;
  frame.query_s = report.query_s;
  frame.batches_waiting = report.batches_waiting;
  frame.state_digest = report.state_digest;
  frame.answers_digest = report.answers_digest;
  frame.pairs_put_off = report.pairs_put_off;
  frame.contact_event_count = contact_events.size();
  frame.came_count = report.came.size();
  frame.went_count = report.went.size();
  frame.promised = report.promised;
}

}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C
using subscriber::BodyId;

nearmesh_status nearmesh_session_options_init(nearmesh_session_options* options,
                                              size_t size) noexcept {
  return c::init_options(options, size, c::session_defaults());
}

nearmesh_status nearmesh_body_options_init(nearmesh_body_options* options, size_t size) noexcept {
  return c::init_options(options, size, c::kBodyDefaults);
}

nearmesh_status nearmesh_session_create_local(const nearmesh_session_options* options,
                                              nearmesh_session** session,
                                              nearmesh_error* error) noexcept {
  if (session != nullptr) *session = nullptr;
  return c::guarded(error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(session, "session"));
    Result<subscriber::SessionOptions> read = c::session_options_of(options);
    NEARMESH_RETURN_IF_ERROR(read);
    auto made = std::make_unique<nearmesh_session>();
    auto channel = std::make_unique<subscriber::LocalChannel>();
    made->local = channel.get();
    made->session =
        std::make_unique<subscriber::Session>(std::move(channel), std::move(read).value());
    *session = made.release();
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_create_dds(const nearmesh_dds_options* dds,
                                            const nearmesh_session_options* options,
                                            nearmesh_session** session,
                                            nearmesh_error* error) noexcept {
  if (session != nullptr) *session = nullptr;
  return c::guarded(error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(session, "session"));
    Result<subscriber::SessionOptions> read = c::session_options_of(options);
    NEARMESH_RETURN_IF_ERROR(read);
    Result<std::unique_ptr<subscriber::Channel>> channel = c::make_dds_channel(dds);
    NEARMESH_RETURN_IF_ERROR(channel);
    auto made = std::make_unique<nearmesh_session>();
    made->session =
        std::make_unique<subscriber::Session>(std::move(channel).value(), std::move(read).value());
    *session = made.release();
    return Status::ok();
  });
}

void nearmesh_session_destroy(nearmesh_session* session) noexcept {
  if (!c::is_handle(session)) return;
  const FloatGuard guard;
  session->kind = c::Kind::kNone;
  delete session;
}

// ---- Of local sessions

nearmesh_status nearmesh_session_add_model(nearmesh_session* session, const char* name,
                                           const char* path, nearmesh_error* error) noexcept {
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_local(*session));
    NEARMESH_RETURN_IF_ERROR(c::check_given(name, "name"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(path, "path"));
    Result<ModelFile> file = ModelFile::open(path);
    NEARMESH_RETURN_IF_ERROR(file);
    return session->local->add_model(name, std::move(file).value());
  });
}

nearmesh_status nearmesh_session_add_world(nearmesh_session* session, const char* name,
                                           const char* folder, nearmesh_error* error) noexcept {
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_local(*session));
    NEARMESH_RETURN_IF_ERROR(c::check_given(name, "name"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(folder, "folder"));
    return session->local->add_world(name, folder);
  });
}

nearmesh_status nearmesh_session_set_connected(nearmesh_session* session, int32_t connected,
                                               nearmesh_error* error) noexcept {
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_local(*session));
    session->local->set_connected(connected != 0);
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_deliver(nearmesh_session* session, const char* body_name,
                                         const nearmesh_motion* motion, double time_s,
                                         nearmesh_error* error) noexcept {
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_local(*session));
    NEARMESH_RETURN_IF_ERROR(c::check_given(body_name, "body_name"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(motion, "motion"));
    const Motion moved = c::from_c(*motion);
    wire::BodyPose pose;
    pose.peer = c::kOtherPeer;
    pose.body = body_name;
    pose.time_s = time_s;
    pose.pose = moved.pose;
    pose.linear_velocity_mps = moved.linear_velocity_mps;
    pose.angular_velocity_radps = moved.angular_velocity_radps;
    return session->local->deliver(pose);
  });
}

// ---- Bodies and pairs

nearmesh_status nearmesh_session_add_body(nearmesh_session* session,
                                          const nearmesh_body_options* options, nearmesh_body* body,
                                          nearmesh_error* error) noexcept {
  if (body != nullptr) *body = NEARMESH_NONE;
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(body, "body"));
    Result<subscriber::BodyOptions> read = c::body_options_of(options);
    NEARMESH_RETURN_IF_ERROR(read);
    const Result<BodyId> added = session->session->add_body(std::move(read).value());
    NEARMESH_RETURN_IF_ERROR(added);
    *body = added.value().value;
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_place_body(nearmesh_session* session, nearmesh_body body,
                                            const nearmesh_pose* pose,
                                            nearmesh_error* error) noexcept {
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(pose, "pose"));
    return session->session->place_body(BodyId{body}, c::from_c(*pose));
  });
}

nearmesh_status nearmesh_session_link_bodies(nearmesh_session* session, const nearmesh_body* bodies,
                                             size_t count, nearmesh_error* error) noexcept {
  return c::changing(session, error, [&]() -> Status {
    if (count > 0) NEARMESH_RETURN_IF_ERROR(c::check_given(bodies, "bodies"));
    std::vector<BodyId> links;
    links.reserve(count);
    for (std::size_t i = 0; i < count; ++i) links.push_back(BodyId{bodies[i]});
    return session->session->link_bodies(links);
  });
}

nearmesh_status nearmesh_session_remove_body(nearmesh_session* session, nearmesh_body body,
                                             nearmesh_error* error) noexcept {
  return c::changing(session, error, [&] { return session->session->remove_body(BodyId{body}); });
}

nearmesh_status nearmesh_session_replace_model(nearmesh_session* session, nearmesh_body body,
                                               const char* model, const char* content,
                                               nearmesh_error* error) noexcept {
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(model, "model"));
    const Result<ContentHash> pin = c::content_of(content);
    NEARMESH_RETURN_IF_ERROR(pin);
    return session->session->replace_model(BodyId{body}, model, pin.value());
  });
}

nearmesh_status nearmesh_session_watch_all(nearmesh_session* session,
                                           nearmesh_error* error) noexcept {
  return c::changing(session, error, [&] {
    session->session->watch_all();
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_watch_own(nearmesh_session* session,
                                           nearmesh_error* error) noexcept {
  return c::changing(session, error, [&] {
    session->session->watch_own();
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_discover_bodies(nearmesh_session* session,
                                                 nearmesh_error* error) noexcept {
  return c::changing(session, error, [&] {
    session->session->discover_bodies();
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_watch(nearmesh_session* session, nearmesh_body a, nearmesh_body b,
                                       nearmesh_error* error) noexcept {
  return c::changing(session, error, [&] { return session->session->watch(BodyId{a}, BodyId{b}); });
}

nearmesh_status nearmesh_session_unwatch(nearmesh_session* session, nearmesh_body a,
                                         nearmesh_body b, nearmesh_error* error) noexcept {
  return c::changing(session, error,
                     [&] { return session->session->unwatch(BodyId{a}, BodyId{b}); });
}

// ---- A frame

nearmesh_status nearmesh_session_update(nearmesh_session* session, uint64_t frame_number,
                                        double time_s, const nearmesh_body* bodies,
                                        const nearmesh_motion* motions, size_t count,
                                        double budget_s, const nearmesh_frame** frame,
                                        nearmesh_error* error) noexcept {
  if (frame != nullptr) *frame = nullptr;
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::take_motions(*session, bodies, motions, count));
    Result<subscriber::FrameReport> report =
        session->session->update(frame_number, time_s, session->motions, budget_s);
    NEARMESH_RETURN_IF_ERROR(report);
    c::keep_frame(*session, std::move(report).value(), frame);
    return Status::ok();
  });
}

const nearmesh_pair_answer* nearmesh_session_answer(const nearmesh_session* session,
                                                    size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->frame.answer_count)
    return nullptr;
  return &session->frame->pairs[index].pair;
}

const nearmesh_near_tile* nearmesh_world_answer_tile(const nearmesh_world_answer* answer,
                                                     size_t index) noexcept {
  if (answer == nullptr || index >= answer->tile_count) return nullptr;
  return &static_cast<const c::OwnedWorld*>(answer)->tiles[index];
}

const nearmesh_pair_answer* nearmesh_session_find(const nearmesh_session* session, nearmesh_body a,
                                                  nearmesh_body b) noexcept {
  if (!c::is_handle(session) || !session->frame) return nullptr;
  const auto* found = session->frame->report.find(BodyId{a}, BodyId{b});
  if (found == nullptr) return nullptr;
  return &session->frame
              ->pairs[static_cast<std::size_t>(found - session->frame->report.answers.data())]
              .pair;
}

const nearmesh_contact_event* nearmesh_session_contact_event(const nearmesh_session* session,
                                                             size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->contact_events.size())
    return nullptr;
  return &session->frame->contact_events[index];
}

const nearmesh_unknown_body* nearmesh_session_unknown(const nearmesh_session* session,
                                                      size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->unknown.size())
    return nullptr;
  return &session->frame->unknown[index];
}

nearmesh_body nearmesh_session_came(const nearmesh_session* session, size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->report.came.size())
    return NEARMESH_NONE;
  return session->frame->report.came[index].value;
}

nearmesh_body nearmesh_session_went(const nearmesh_session* session, size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame || index >= session->frame->report.went.size())
    return NEARMESH_NONE;
  return session->frame->report.went[index].value;
}

const char* nearmesh_session_complaint(const nearmesh_session* session, size_t index) noexcept {
  if (!c::is_handle(session) || !session->frame ||
      index >= session->frame->report.complaints.size())
    return nullptr;
  return session->frame->report.complaints[index].c_str();
}

// ---- What a session knows

nearmesh_status nearmesh_session_readiness(nearmesh_session* session, nearmesh_body body,
                                           const nearmesh_readiness** readiness,
                                           nearmesh_error* error) noexcept {
  if (readiness != nullptr) *readiness = nullptr;
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(readiness, "readiness"));
    Result<subscriber::Readiness> found = session->session->readiness(BodyId{body});
    NEARMESH_RETURN_IF_ERROR(found);
    c::keep_readiness(*session, std::move(found).value());
    *readiness = &session->readiness;
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_wait_ready(nearmesh_session* session, nearmesh_body body,
                                            double timeout_s, uint64_t frame_number, double time_s,
                                            const nearmesh_body* bodies,
                                            const nearmesh_motion* motions, size_t count,
                                            const nearmesh_readiness** readiness,
                                            const nearmesh_frame** frame,
                                            nearmesh_error* error) noexcept {
  if (readiness != nullptr) *readiness = nullptr;
  if (frame != nullptr) *frame = nullptr;
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::take_motions(*session, bodies, motions, count));
    // Before it waits: whether there is such a body.
    NEARMESH_RETURN_IF_ERROR(session->session->readiness(BodyId{body}));
    Result<subscriber::Waited> waited = subscriber::wait_ready(
        *session->session, BodyId{body}, timeout_s, session->motions, frame_number, time_s);
    NEARMESH_RETURN_IF_ERROR(waited);
    subscriber::Waited all = std::move(waited).value();
    c::keep_readiness(*session, std::move(all.readiness));
    c::keep_frame(*session, std::move(all.report), frame);
    if (readiness != nullptr) *readiness = &session->readiness;
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_region_readiness(nearmesh_session* session, nearmesh_body body,
                                                  const double lo_m[3], const double hi_m[3],
                                                  const nearmesh_region_readiness** readiness,
                                                  nearmesh_error* error) noexcept {
  if (readiness != nullptr) *readiness = nullptr;
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(readiness, "readiness"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(lo_m, "lo_m"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(hi_m, "hi_m"));
    Result<subscriber::RegionReadiness> found = session->session->region_readiness(
        BodyId{body}, {lo_m[0], lo_m[1], lo_m[2]}, {hi_m[0], hi_m[1], hi_m[2]});
    NEARMESH_RETURN_IF_ERROR(found);
    session->region_reason = found.value().reason;
    session->region.resolved = found.value().resolved;
    session->region.unresolved_nodes = found.value().unresolved_nodes;
    session->region.missing_vertices = found.value().missing_vertices;
    session->region.uncertainty_m = found.value().uncertainty_m;
    session->region.reason = session->region_reason.c_str();
    *readiness = &session->region;
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_motion_of(const nearmesh_session* session, nearmesh_body body,
                                           nearmesh_motion* motion,
                                           nearmesh_error* error) noexcept {
  return c::reading(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(motion, "motion"));
    const std::optional<Motion> found = session->session->motion_of(BodyId{body});
    if (!found) return c::no_such(body, "no motion is known");
    *motion = c::to_c(*found);
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_name_of(nearmesh_session* session, nearmesh_body body,
                                         const char** name, nearmesh_error* error) noexcept {
  if (name != nullptr) *name = nullptr;
  return c::reading(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(name, "name"));
    session->name = session->session->name_of(BodyId{body});
    if (session->name.empty()) return c::no_such(body, "this session has no name");
    *name = session->name.c_str();
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_body_facts(nearmesh_session* session, nearmesh_body body,
                                            const nearmesh_body_facts** facts,
                                            nearmesh_error* error) noexcept {
  if (facts != nullptr) *facts = nullptr;
  return c::reading(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(facts, "facts"));
    Result<subscriber::BodyOptions> found = session->session->options_of(BodyId{body});
    NEARMESH_RETURN_IF_ERROR(found);
    const subscriber::BodyOptions& of = session->declared = std::move(found).value();
    session->pin = c::ContentText(of.content);
    session->body = {.name = of.name.c_str(),
                     .model = of.model.c_str(),
                     .content = session->pin.digits,
                     .own = of.own,
                     .solid = of.solid,
                     .group = of.group,
                     .mask = of.mask,
                     .max_speed_mps = of.max_speed_mps};
    *facts = &session->body;
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_held_mesh(nearmesh_session* session, nearmesh_body body,
                                           const nearmesh_held_mesh** mesh,
                                           nearmesh_error* error) noexcept {
  if (mesh != nullptr) *mesh = nullptr;
  return c::reading(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(mesh, "mesh"));
    Result<subscriber::Session::HeldMesh> found = session->session->held_mesh(BodyId{body});
    NEARMESH_RETURN_IF_ERROR(found);
    session->held = std::move(found).value();
    const auto numbers = [](const std::vector<std::array<double, 3>>& corners) {
      return corners.empty() ? nullptr : corners[0].data();
    };
    session->mesh = {.exact_count = session->held.exact_m.size() / 3,
                     .coarse_count = session->held.coarse_m.size() / 3,
                     .exact_m = numbers(session->held.exact_m),
                     .coarse_m = numbers(session->held.coarse_m)};
    *mesh = &session->mesh;
    return Status::ok();
  });
}

uint64_t nearmesh_session_held_state(const nearmesh_session* session, nearmesh_body body) noexcept {
  if (!c::is_handle(session) || session->is_spoiled) return 0;
  return session->session->held_state(BodyId{body});
}

nearmesh_status nearmesh_session_model_facts(nearmesh_session* session, nearmesh_body body,
                                             const nearmesh_model_facts** facts,
                                             nearmesh_error* error) noexcept {
  if (facts != nullptr) *facts = nullptr;
  return c::reading(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(facts, "facts"));
    const SpmHeader* header = session->session->header_of(BodyId{body});
    if (header == nullptr) return c::no_such(body, "no header has come for the model");
    session->content = c::ContentText(header->content);
    session->facts = c::facts_of(*header, session->content);
    *facts = &session->facts;
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_heard_time(const nearmesh_session* session, double* time_s,
                                            nearmesh_error* error) noexcept {
  if (time_s != nullptr) *time_s = 0;
  return c::reading(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(time_s, "time_s"));
    const std::optional<double> heard = session->session->heard_time_s();
    if (!heard) return {StatusCode::kNotFound, "no pose of another peer has come"};
    *time_s = *heard;
    return Status::ok();
  });
}

nearmesh_status nearmesh_session_write_cache(nearmesh_session* session,
                                             nearmesh_error* error) noexcept {
  return c::changing(session, error, [&] { return session->session->write_cache(); });
}

nearmesh_status nearmesh_session_get_stats(nearmesh_session* session,
                                           const nearmesh_session_stats** stats,
                                           nearmesh_error* error) noexcept {
  if (stats != nullptr) *stats = nullptr;
  return c::reading(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(stats, "stats"));
    const subscriber::SessionStats now = session->session->stats();
    session->stats = {.batches = now.batches,
                      .batch_bytes = now.batch_bytes,
                      .header_bytes = now.header_bytes,
                      .requests = now.requests,
                      .looks_ahead = now.looks_ahead,
                      .sequence_gaps = now.sequence_gaps,
                      .audits = now.audits,
                      .audit_bytes = now.audit_bytes,
                      .refused_headers = now.refused_headers,
                      .held_splits = now.held_splits,
                      .slots = now.slots,
                      .exact_faces = now.exact_faces,
                      .tree_bytes = now.tree_bytes,
                      .mesh_bytes = now.mesh_bytes,
                      .refused_poses = now.refused_poses,
                      .strange_times = now.strange_times};
    *stats = &session->stats;
    return Status::ok();
  });
}
