// SPDX-License-Identifier: Apache-2.0
#include "session.hpp"

#include <utility>

namespace nearmesh::c {

using subscriber::BodyId;

namespace {

constexpr wire::SessionId kOtherPeer = 3;  // beside LocalChannel's own two

Status check_local(const nearmesh_session& handle) {
  if (handle.local != nullptr) return Status::ok();
  return {StatusCode::kUnsupported, "the session is on DDS; this is for local ones"};
}

}  // namespace

Status take_motions(nearmesh_session& handle, const nearmesh_body* bodies,
                    const nearmesh_motion* motions, std::size_t count) {
  NEARMESH_RETURN_IF_ERROR(check_array(bodies, count, "bodies"));
  NEARMESH_RETURN_IF_ERROR(check_array(motions, count, "motions"));
  handle.motions.clear();
  for (std::size_t i = 0; i < count; ++i)
    handle.motions.push_back({BodyId{bodies[i]}, from_c(motions[i])});
  return Status::ok();
}

void keep_frame(nearmesh_session& handle, subscriber::FrameReport&& report,
                const nearmesh_frame** frame) {
  if (!handle.frame) handle.frame.emplace();
  handle.frame->fill(std::move(report));
  if (frame != nullptr) *frame = &handle.frame->frame;
}

}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C
using subscriber::BodyId;

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
