// SPDX-License-Identifier: Apache-2.0
// Probes of bodies of sessions and of files at hand; poses that the host heard.
#include <utility>
#include <vector>

#include "model.hpp"
#include "probes.hpp"
#include "session.hpp"

namespace nearmesh::c {
namespace {

template <class Probe, class Answer, class From, class To>
nearmesh_status of_session(nearmesh_session* session, nearmesh_body body, const From* given,
                           std::size_t count, const char* name, To* answers,
                           const nearmesh_probe_report** report, nearmesh_error* error) noexcept {
  if (report != nullptr) *report = nullptr;
  return changing(session, error, [&] {
    return asked<Probe, Answer>(
        given, count, name, answers, [&](auto probes, auto found) -> Status {
          Result<subscriber::ProbeReport> told =
              session->session->probe(subscriber::BodyId{body}, probes, found);
          NEARMESH_RETURN_IF_ERROR(told);
          session->probe_reason = std::move(told.value().reason);
          session->probe_awaited = std::move(told.value().awaited);
          session->probe = {session->probe_reason.c_str(), session->probe_awaited.c_str(),
                            told.value().age_s, to_c(told.value().pose), told.value().missing};
          if (report != nullptr) *report = &session->probe;
          return Status::ok();
        });
  });
}

template <class Probe, class Answer, class From, class To>
nearmesh_status of_model(nearmesh_model* model, const nearmesh_pose* pose, const From* given,
                         std::size_t count, const char* name, To* answers,
                         nearmesh_error* error) noexcept {
  return guarded(model, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(check_given(pose, "pose"));
    return asked<Probe, Answer>(given, count, name, answers, [&](auto probes, auto found) {
      SharedModel& shared = *model->shared;
      const Status status = with_files(shared, shared, [&] {
        ModelFile& file = shared.file;
        if (!model->probed) model->probed.emplace(file.store(), file.header().grid);
        return certify_probes(
            *model->probed, from_c(*pose), [&file](NodeSpan node) { return file.require(node); },
            probes, found);
      });
      // Mesh and tree may have parted half-way.
      if (status.code() == StatusCode::kCorrupt || status.code() == StatusCode::kIo ||
          status.code() == StatusCode::kNotFound)
        model->probed.reset();
      return status;
    });
  });
}

}  // namespace
}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C

nearmesh_status nearmesh_session_probe_rays(nearmesh_session* session, nearmesh_body body,
                                            const nearmesh_ray* rays, size_t count,
                                            nearmesh_ray_answer* answers,
                                            const nearmesh_probe_report** report,
                                            nearmesh_error* error) noexcept {
  return c::of_session<RayProbe, RayAnswer>(session, body, rays, count, "rays", answers, report,
                                            error);
}
nearmesh_status nearmesh_session_probe_points(nearmesh_session* session, nearmesh_body body,
                                              const double* points_m, size_t count,
                                              nearmesh_point_answer* answers,
                                              const nearmesh_probe_report** report,
                                              nearmesh_error* error) noexcept {
  return c::of_session<std::array<double, 3>, PointAnswer>(
      session, body, c::points_of(points_m), count, "points_m", answers, report, error);
}
nearmesh_status nearmesh_session_probe_balls(nearmesh_session* session, nearmesh_body body,
                                             const nearmesh_ball* balls, size_t count,
                                             nearmesh_shape_answer* answers,
                                             const nearmesh_probe_report** report,
                                             nearmesh_error* error) noexcept {
  return c::of_session<BallProbe, ShapeAnswer>(session, body, balls, count, "balls", answers,
                                               report, error);
}
nearmesh_status nearmesh_session_probe_boxes(nearmesh_session* session, nearmesh_body body,
                                             const nearmesh_box* boxes, size_t count,
                                             nearmesh_shape_answer* answers,
                                             const nearmesh_probe_report** report,
                                             nearmesh_error* error) noexcept {
  return c::of_session<BoxProbe, ShapeAnswer>(session, body, boxes, count, "boxes", answers, report,
                                              error);
}

nearmesh_status nearmesh_model_probe_rays(nearmesh_model* model, const nearmesh_pose* pose,
                                          const nearmesh_ray* rays, size_t count,
                                          nearmesh_ray_answer* answers,
                                          nearmesh_error* error) noexcept {
  return c::of_model<RayProbe, RayAnswer>(model, pose, rays, count, "rays", answers, error);
}
nearmesh_status nearmesh_model_probe_points(nearmesh_model* model, const nearmesh_pose* pose,
                                            const double* points_m, size_t count,
                                            nearmesh_point_answer* answers,
                                            nearmesh_error* error) noexcept {
  return c::of_model<std::array<double, 3>, PointAnswer>(model, pose, c::points_of(points_m), count,
                                                         "points_m", answers, error);
}
nearmesh_status nearmesh_model_probe_balls(nearmesh_model* model, const nearmesh_pose* pose,
                                           const nearmesh_ball* balls, size_t count,
                                           nearmesh_shape_answer* answers,
                                           nearmesh_error* error) noexcept {
  return c::of_model<BallProbe, ShapeAnswer>(model, pose, balls, count, "balls", answers, error);
}
nearmesh_status nearmesh_model_probe_boxes(nearmesh_model* model, const nearmesh_pose* pose,
                                           const nearmesh_box* boxes, size_t count,
                                           nearmesh_shape_answer* answers,
                                           nearmesh_error* error) noexcept {
  return c::of_model<BoxProbe, ShapeAnswer>(model, pose, boxes, count, "boxes", answers, error);
}

nearmesh_status nearmesh_session_hear(nearmesh_session* session, const nearmesh_body* bodies,
                                      const double* times_s, const nearmesh_motion* motions,
                                      size_t count, nearmesh_error* error) noexcept {
  return c::changing(session, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_array(bodies, count, "bodies"));
    NEARMESH_RETURN_IF_ERROR(c::check_array(times_s, count, "times_s"));
    NEARMESH_RETURN_IF_ERROR(c::check_array(motions, count, "motions"));
    std::vector<subscriber::Session::HeardPose> heard;
    for (std::size_t i = 0; i < count; ++i)
      heard.push_back({subscriber::BodyId{bodies[i]}, times_s[i], c::from_c(motions[i])});
    return session->session->hear(heard);
  });
}
