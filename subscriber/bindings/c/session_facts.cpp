// SPDX-License-Identifier: Apache-2.0
// What a session knows: how ready it is, and facts about its bodies.
#include <utility>

#include "nearmesh/subscriber/peer/wait_ready.hpp"
#include "session.hpp"

namespace nearmesh::c {
namespace {

static_assert(NEARMESH_WAITING == static_cast<int>(subscriber::ReadyStage::kWaiting) &&
              NEARMESH_ANSWERING == static_cast<int>(subscriber::ReadyStage::kAnswering) &&
              NEARMESH_CERTIFIED == static_cast<int>(subscriber::ReadyStage::kCertified));

void keep_readiness(nearmesh_session& handle, subscriber::Readiness&& readiness) {
  handle.readiness_reason = std::move(readiness.reason);
  handle.readiness.stage = static_cast<int32_t>(readiness.stage);
  handle.readiness.pairs = readiness.pairs;
  handle.readiness.certified = readiness.certified;
  handle.readiness.reason = handle.readiness_reason.c_str();
}

Status no_such(nearmesh_body body, const char* what) {
  return {StatusCode::kNotFound, std::string(what) + " of body " + std::to_string(body)};
}

}  // namespace
}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C
using subscriber::BodyId;

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
