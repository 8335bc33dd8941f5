// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber export: a recorded session, or a moment of it, as a file for programs of
// others.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdio>
#include <memory>

#include "commands.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "subscriber/recorded/export_mcap.hpp"
#include "subscriber/report/mesh_files.hpp"
#include "subscriber/report/session_gltf.hpp"

namespace nearmesh::subscriber::program {
namespace {

constexpr std::int64_t kContactFirst_ns = 1'000'000'000;

/// The partition of the one peer whose id begins like this; empty where none is named.
Result<std::string> peer_of(const RecordingReader& recording, const std::string& start) {
  if (start.empty()) return std::string();
  std::vector<std::string> peers, fitting;
  for (const RecordedWriter& writer : recording.writers())
    if (wire::peer_of(writer.partition) != 0) peers.push_back(writer.partition);
  std::sort(peers.begin(), peers.end());
  peers.erase(std::unique(peers.begin(), peers.end()), peers.end());
  std::string list;
  for (const std::string& peer : peers) {
    if (peer.starts_with(start)) fitting.push_back(peer);
    list += (list.empty() ? "" : ", ") + peer;
  }
  if (fitting.size() == 1) return fitting.front();
  if (peers.empty()) return Status{StatusCode::kNotFound, "no peer was sent anything"};
  return Status{
      StatusCode::kInvalidArgument,
      "--peer " + start + (fitting.empty() ? " is none of " : " fits more than one of ") + list};
}

/// Detail that was not recorded; none where no folder is named.
Result<std::unique_ptr<DetailFolder>> models_of(const ExportOptions& options) {
  if (options.models.empty()) return std::unique_ptr<DetailFolder>();
  Result<std::unique_ptr<DetailFolder>> opened = DetailFolder::open(options.models);
  if (!opened.is_ok())
    return Status{opened.status().code(), "--models " + opened.status().message()};
  for (const std::string& line : opened.value()->complaints()) spdlog::warn("{}", line);
  return opened;
}

Status write_mcap(const ExportOptions& options, RecordingReader& recording,
                  const std::string& peer) {
  const Result<std::unique_ptr<DetailFolder>> models = models_of(options);
  NEARMESH_RETURN_IF_ERROR(models);
  const Result<McapExport> done =
      export_mcap(recording, options.out, {options.session}, peer, models.value().get());
  NEARMESH_RETURN_IF_ERROR(done);
  for (const std::string& line : done.value().complaints) spdlog::warn("{}", line);
  std::printf("%s: %llu samples as recorded, %llu messages for ROS 2's tools, %llu bytes; %s\n",
              options.out.c_str(), static_cast<unsigned long long>(done.value().samples),
              static_cast<unsigned long long>(done.value().derived),
              static_cast<unsigned long long>(done.value().bytes),
              done.value().mesh_peer.empty()
                  ? "no meshes: nobody answered"
                  : ("meshes of peer " + done.value().mesh_peer).c_str());
  return Status::ok();
}

Status write_session(const ExportOptions& options, RecordingReader& recording) {
  NEARMESH_RETURN_IF_ERROR(check_output(options.out, report::kGlbFile, {options.session}));
  const Result<std::unique_ptr<DetailFolder>> models = models_of(options);
  NEARMESH_RETURN_IF_ERROR(models);
  const Result<report::SessionGltf> session =
      report::session_to_glb(recording, models.value().get());
  if (!session.is_ok())
    return {session.status().code(), options.session + ": " + session.status().message()};
  NEARMESH_RETURN_IF_ERROR(write_file(options.out, report::kGlbFile, session.value().bytes));
  std::printf("%s: %.3f s of %zu peers, %zu bodies, %zu meshes, %zu bytes\n", options.out.c_str(),
              session.value().seconds, session.value().peers, session.value().bodies,
              session.value().meshes, session.value().bytes.size());
  return Status::ok();
}

/// What a peer held at a moment.
Status write_moment(const ExportOptions& options, RecordingReader& recording,
                    const std::string& peer) {
  const bool is_glb = options.out.ends_with(".glb");
  const FileKind& kind = is_glb ? report::kGlbFile : kPlyFile;
  NEARMESH_RETURN_IF_ERROR(check_output(options.out, kind, {options.session}));
  // Beyond a year or so nothing is recorded, and the sum must fit.
  const auto after_ns = static_cast<std::int64_t>(std::min(*options.time_s, 1e8) * 1e9 + 0.5);
  const Result<std::int64_t> report =
      find_report(recording, {.received_ns = recording.begin_ns() + after_ns,
                              .peer = peer,
                              .body = options.body,
                              .other = options.other,
                              .contact_first_ns = kContactFirst_ns});
  if (!report.is_ok())
    return {report.status().code(), options.session + ": " + report.status().message()};
  Result<std::vector<Result<RecordedScene>>> scenes = rebuild_scenes(recording, {report.value()});
  NEARMESH_RETURN_IF_ERROR(scenes);
  if (!scenes.value().front().is_ok())
    return {scenes.value().front().status().code(),
            options.session + ": " + scenes.value().front().status().message()};
  const RecordedScene& scene = scenes.value().front().value();
  const bool is_b = options.body == scene.report.body_b ||
                    (options.body.empty() && options.other == scene.report.body_a);
  const std::size_t looked_at = is_b ? 1 : 0;
  const Result<std::string> bytes =
      is_glb ? report::to_glb(scene, looked_at) : report::to_ply(scene, looked_at);
  if (!bytes.is_ok()) return {bytes.status().code(), options.out + ": " + bytes.status().message()};
  NEARMESH_RETURN_IF_ERROR(write_file(options.out, kind, bytes.value()));
  std::printf("%s: peer %s, frame %llu, %.6f s after the start: %s, %zu segments of contact\n",
              options.out.c_str(), wire::partition_of(scene.report.peer).c_str(),
              static_cast<unsigned long long>(scene.report.frame),
              static_cast<double>(scene.received_ns - recording.begin_ns()) * 1e-9,
              to_string(static_cast<AnswerStatus>(scene.report.status)),
              scene.contacts.segments.size());
  for (const std::size_t i : {looked_at, 1 - looked_at}) {
    const RecordedBody& body = scene.bodies[i];
    const auto exact = std::count_if(body.faces.begin(), body.faces.end(), [&](const auto& face) {
      return std::all_of(face.begin(), face.end(),
                         [&](std::uint32_t corner) { return body.eps_m[corner] == 0; });
    });
    std::printf("  %-16s %zu vertices, %zu faces, %zu of them exact, eps up to %.4g m\n",
                body.name.c_str(), body.positions_world_m.size(), body.faces.size(),
                static_cast<std::size_t>(exact),
                body.eps_m.empty() ? 0 : *std::max_element(body.eps_m.begin(), body.eps_m.end()));
  }
  return Status::ok();
}

}  // namespace

Status run(const ExportOptions& options) {
  Result<std::unique_ptr<RecordingReader>> opened = RecordingReader::open(options.session);
  NEARMESH_RETURN_IF_ERROR(opened);
  RecordingReader& recording = *opened.value();
  const Result<std::string> peer = peer_of(recording, options.peer);
  if (!peer.is_ok())
    return {peer.status().code(), options.session + ": " + peer.status().message()};
  if (options.out.ends_with(".mcap")) return write_mcap(options, recording, peer.value());
  if (!options.time_s) return write_session(options, recording);
  return write_moment(options, recording, peer.value());
}

}  // namespace nearmesh::subscriber::program
