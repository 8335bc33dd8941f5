// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/messages/messages.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string_view>
#include <utility>

#include "core/base/digest.hpp"
#include "core/base/hash.hpp"
#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "process_name.hpp"

namespace nearmesh::wire {

namespace {

constexpr std::uint8_t kPriorityCount = 2;
constexpr std::uint8_t kAnswerStatusCount = 5;  // free, contact, partial, uncertain, contained
constexpr std::uint32_t kMaxWindowBytes = 64U << 20;
constexpr std::uint32_t kMaxPart = 1U << 24;

Status invalid(std::string message) { return {StatusCode::kInvalidArgument, std::move(message)}; }

Status check_version(std::uint16_t version) {
  if (version == kWireVersion) return Status::ok();
  return {StatusCode::kUnsupported, "wire version " + std::to_string(version) +
                                        ", this build speaks " + std::to_string(kWireVersion)};
}

std::string in_seconds(double time_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g s", time_s);
  return text;
}

Status check_session(SessionId id, const char* field) {
  return id != 0 ? Status::ok() : invalid(std::string(field) + ": expected a session id, found 0");
}

Status check_most(std::size_t found, std::size_t limit, const char* field) {
  if (found <= limit) return Status::ok();
  return invalid(std::string(field) + ": expected at most " + std::to_string(limit) + ", found " +
                 std::to_string(found));
}

Status check_time(double time_s, const std::string& what) {
  if (is_time(time_s)) return Status::ok();
  return invalid(what + ": expected seconds, at most " + in_seconds(kMaxTime_s) +
                 " from 0, found " + in_seconds(time_s));
}

Status check_distance(double value, const char* field) {
  if (std::isfinite(value) && value >= 0) return Status::ok();
  return invalid(std::string(field) + ": expected a finite distance, not negative");
}

}  // namespace

Status check_name(std::string_view name, const char* field) {
  const Status status = check_process_name(name);
  return status.is_ok() ? status : invalid(std::string(field) + ": " + status.message());
}

Status check_new_model(const std::string& name, std::size_t served) {
  NEARMESH_RETURN_IF_ERROR(check_name(name, "model name"));
  if (served >= kMaxModels)
    return invalid("model " + name + ": expected at most " + std::to_string(kMaxModels) +
                   " models of one publisher, found one more: serve it by another");
  return Status::ok();
}

MeshHeader announce_model(const std::string& name, const ModelFile& file, ContentHash replaces,
                          const Epoch& epoch, Hello& hello) {
  hello.models.push_back({name, file.content_hash(), file.mesh_bytes(), replaces, epoch});
  const auto bytes = file.header_bytes();
  return {kWireVersion, name, file.content_hash(), {bytes.begin(), bytes.end()}};
}

MeshHeader announce_world(const std::string& name, const ContentHash& content,
                          std::vector<std::uint8_t> record, ContentHash replaces,
                          const Epoch& epoch, Hello& hello) {
  hello.models.push_back({name, content, 0, replaces, epoch});
  return {kWireVersion, name, content, std::move(record)};
}

std::vector<SplitBatchMessage> answer_messages(SessionId publisher, std::uint32_t request,
                                               const ContentHash& content,
                                               std::vector<std::vector<std::uint8_t>> batches,
                                               bool last, bool are_pieces) {
  if (batches.empty() && last) batches.emplace_back();
  std::vector<SplitBatchMessage> messages;
  for (std::size_t i = 0; i < batches.size(); ++i) {
    if (!batches[i].empty()) seal_batch(content, batches[i]);
    messages.push_back({.publisher = publisher,
                        .content_hash = content,
                        .request = request,
                        .last = last && i + 1 == batches.size(),
                        .is_piece = are_pieces,
                        .bytes = std::move(batches[i])});
  }
  return messages;
}

std::size_t sample_bytes(const SplitBatchMessage& message) {
  std::size_t bytes = message.bytes.size();
  if (!message.joined.empty()) bytes += kJoinSizeBytes;
  for (const SplitBatchMessage::Joined& next : message.joined)
    bytes += kJoinBytes + next.bytes.size();
  return bytes;
}

bool join(SplitBatchMessage& message, SplitBatchMessage& next) {
  const auto is_batch = [](const SplitBatchMessage& one) { return !one.refused && !one.is_piece; };
  if (message.publisher != next.publisher || message.request != next.request || message.last ||
      !is_batch(message) || !is_batch(next) || !next.joined.empty())
    return false;
  // Only that it was the last is said by it.
  if (next.bytes.empty()) {
    message.last = next.last;
    return true;
  }
  SplitBatchMessage::Joined added{next.content_hash, std::move(next.bytes)};
  message.joined.push_back(std::move(added));
  if (sample_bytes(message) <= kMaxSealedBytes) {
    message.last = next.last;
    return true;
  }
  next.bytes = std::move(message.joined.back().bytes);
  message.joined.pop_back();
  return false;
}

std::vector<SplitBatchMessage> take_apart(SplitBatchMessage&& message) {
  std::vector<SplitBatchMessage> apart;
  apart.push_back(std::move(message));
  const bool is_last = std::exchange(apart.front().last, false);
  for (SplitBatchMessage::Joined& next : std::exchange(apart.front().joined, {}))
    apart.push_back({.publisher = apart.front().publisher,
                     .content_hash = next.content_hash,
                     .request = apart.front().request,
                     .sequence = apart.back().sequence + 1,
                     .bytes = std::move(next.bytes)});
  apart.back().last = is_last;
  return apart;
}

SplitBatchMessage refusal_message(SessionId publisher, const RegionSubscription& request,
                                  const std::string& why) {
  const auto length = static_cast<std::ptrdiff_t>(std::min(why.size(), kMaxSealedBytes));
  return {.publisher = publisher,
          .content_hash = request.content_hash,
          .request = request.request,
          .last = true,
          .refused = true,
          .bytes = {why.begin(), why.begin() + length}};
}

SplitBatchMessage redirection_message(SessionId publisher, const RegionSubscription& request,
                                      const std::string& why, const ContentHash& content,
                                      bool wants_regions) {
  SplitBatchMessage message = refusal_message(publisher, request, why);
  message.content_hash = content;
  message.wants_held = !wants_regions;
  message.wants_regions = wants_regions;
  return message;
}

double age_s(const PoseStamp& pose, double frame_time_s) {
  return pose.mover == Mover::kNone ? std::numeric_limits<double>::infinity()
                                    : frame_time_s - pose.time_s;
}

std::string why_stale(const PoseStamp& pose, double frame_time_s, const std::string& body) {
  switch (pose.mover) {
    case Mover::kNone:
      return "no pose of body " + body + " has come";
    case Mover::kLeft:
      return "the peer that moves body " + body + " has left";
    case Mover::kSilent:
      return "the peer that moves body " + body + " gives no sign of life";
    case Mover::kBarred:
      return "the identity of the peer that moves body " + body + " was revoked or has expired";
    case Mover::kThere:
      break;
  }
  const double age = age_s(pose, frame_time_s);
  if (std::abs(age) <= pose.max_age_s) return {};
  return "the pose of body " + body + " is " +
         (age > 0 ? in_seconds(age) + " old" : in_seconds(-age) + " ahead of the frame's time") +
         ", more than " + in_seconds(pose.max_age_s);
}

Status check(const Hello& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.publisher, "publisher"));
  if (!message.name.empty()) NEARMESH_RETURN_IF_ERROR(check_name(message.name, "name"));
  NEARMESH_RETURN_IF_ERROR(check_most(message.models.size(), kMaxModels, "models"));
  std::vector<std::string_view> names;
  for (const Hello::Model& model : message.models) {
    NEARMESH_RETURN_IF_ERROR(check_name(model.name, "model name"));
    if (!model.content_hash.is_set()) return invalid("model " + model.name + ": no content");
    NEARMESH_RETURN_IF_ERROR(check_time(model.epoch.from_s, "model " + model.name + ": epoch"));
    if (model.epoch.number == 0 && model.epoch.from_s != 0)
      return invalid("model " + model.name + ": epoch 0 has no beginning");
    names.push_back(model.name);
  }
  std::sort(names.begin(), names.end());
  const auto twice = std::adjacent_find(names.begin(), names.end());
  if (twice != names.end()) return invalid("model name \"" + std::string(*twice) + "\" twice");
  return Status::ok();
}

Status check(const MeshHeader& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_name(message.name, "model name"));
  if (message.bytes.empty()) return invalid("header: no bytes");
  NEARMESH_RETURN_IF_ERROR(check_most(message.bytes.size(), kMaxHeaderBytes, "header bytes"));
  if (const ContentHash found = digest_of(message.bytes); found != message.content_hash)
    return {StatusCode::kCorrupt, "header of model " + message.name + ": expected content " +
                                      to_hex(message.content_hash) + ", the bytes give " +
                                      to_hex(found)};
  return Status::ok();
}

Status check(const RegionSubscription& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.peer, "peer"));
  NEARMESH_RETURN_IF_ERROR(check_session(message.publisher, "publisher"));
  if (message.priority >= kPriorityCount)
    return invalid("priority: expected below " + std::to_string(kPriorityCount) + ", found " +
                   std::to_string(message.priority));
  if (message.window_bytes == 0) return invalid("window_bytes is 0: nothing could ever be sent");
  NEARMESH_RETURN_IF_ERROR(check_most(message.window_bytes, kMaxWindowBytes, "window_bytes"));
  if (message.request == 0) {
    if (!message.region.attach.empty() || !message.region.region.empty())
      return invalid("request 0 (only credit) with a region");
    if (message.certificate) return invalid("request 0 (only credit) with bodies");
    return Status::ok();
  }
  if (message.certificate) {
    if (!message.region.attach.empty() || !message.region.region.empty())
      return invalid("a request with bodies and with a region");
    for (const CertificateRequest::Model& model : message.certificate->models)
      NEARMESH_RETURN_IF_ERROR(check_most(model.held.size(), kMaxHeldBytes, "held bytes"));
    return check_request(*message.certificate);
  }
  return check_request(message.region);
}

Status check(const SplitBatchMessage& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.publisher, "publisher"));
  if (message.sequence == 0) return invalid("sequence: expected from 1, found 0");
  NEARMESH_RETURN_IF_ERROR(check_most(sample_bytes(message), kMaxSealedBytes, "batch bytes"));
  if (!message.joined.empty() && (message.refused || message.is_piece))
    return invalid("batches are joined to what is none");
  for (const SplitBatchMessage::Joined& next : message.joined)
    if (next.bytes.empty()) return invalid("a joined batch has no bytes");
  if ((message.wants_held || message.wants_regions) && !message.refused)
    return invalid("a batch that is not refused wants another request");
  if (message.refused) {
    const auto printable = [](std::uint8_t c) { return is_printable(static_cast<char>(c)); };
    if (!std::all_of(message.bytes.begin(), message.bytes.end(), printable))
      return invalid("reason of a refusal: expected printable ASCII");
  }
  return Status::ok();
}

namespace {

/// In the part, and in ascending order.
template <std::uint32_t kPerPart = kBodiesPerPart, class Message>
Status check_numbers(const Message& message) {
  if (message.part > kMaxPart)
    return invalid("part: expected at most " + std::to_string(kMaxPart) + ", found " +
                   std::to_string(message.part));
  std::uint32_t least = message.part * kPerPart;
  const std::uint32_t end = least + kPerPart;
  for (const auto& body : message.bodies) {
    if (body.number < least || body.number >= end)
      return invalid("part " + std::to_string(message.part) + ": body " +
                     std::to_string(body.number) + " is out of place");
    least = body.number + 1;
  }
  return Status::ok();
}

}  // namespace

Status check(const BodyPoses& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.peer, "peer"));
  NEARMESH_RETURN_IF_ERROR(check_numbers(message));
  for (const BodyPoses::Body& body : message.bodies) {
    const std::string name =
        "pose of body " + std::to_string(body.number) + " of peer " + to_hex(message.peer);
    NEARMESH_RETURN_IF_ERROR(check_time(body.time_s, name + ": time_s"));
    NEARMESH_RETURN_IF_ERROR(check_motion(body.motion, name));
  }
  return Status::ok();
}

bool WantedPoses::wants(std::uint32_t number) const {
  const auto at =
      std::lower_bound(parts.begin(), parts.end(), number / kBodiesPerPart,
                       [](const Part& one, std::uint32_t part) { return one.part < part; });
  return at != parts.end() && at->part == number / kBodiesPerPart &&
         (at->places >> (number % kBodiesPerPart) & 1U) != 0;
}

BodyPromise promise_of(const BodyPromises& promises, const BodyPromises::Body& body,
                       const BodyDirectory::Body& who) {
  const double quantum_m = std::ldexp(1.0, promises.quantum);
  BodyPromise promise{.peer = promises.peer,
                      .number = body.number,
                      .body = who.name,
                      .from_s = promises.from_s,
                      .until_s = promises.until_s(),
                      .slack_m = quantum_m,
                      .max_speed_mps = who.max_speed_mps,
                      .sequence = promises.sequence};
  for (std::size_t k = 0; k < 3; ++k)
    promise.place_m[k] = static_cast<double>(body.place[k]) * quantum_m;
  return promise;
}

std::optional<double> BodyPromise::radius_m(double time_s) const {
  constexpr double kRounding = 0x1p-48;
  if (!(time_s >= from_s && time_s <= until_s)) return std::nullopt;
  return (slack_m + max_speed_mps * (time_s - from_s)) * (1 + kRounding);
}

Status check(const BodyPromises& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.peer, "peer"));
  const std::string of = "promises of peer " + to_hex(message.peer);
  NEARMESH_RETURN_IF_ERROR(check_time(message.from_s, of + ": from_s"));
  if (message.steps == 0 || message.steps * kPromiseStep_s > kMaxPromise_s)
    return invalid(of + ": expected to hold up to " + in_seconds(kMaxPromise_s) + ", found " +
                   in_seconds(message.steps * kPromiseStep_s));
  if (message.quantum < kMinQuantum || message.quantum > kMaxQuantum)
    return invalid(of + ": quantum of 2^" + std::to_string(message.quantum) + " m");
  NEARMESH_RETURN_IF_ERROR(check_numbers<kBodiesPerPromise>(message));
  for (const BodyPromises::Body& body : message.bodies)
    for (const std::int64_t quanta : body.place)
      if (!(std::abs(std::ldexp(static_cast<double>(quanta), message.quantum)) <= kMaxPlace_m))
        return invalid(of + ": body " + std::to_string(body.number) + " is too far away");
  return Status::ok();
}

Status check(const WantedPoses& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.peer, "peer"));
  NEARMESH_RETURN_IF_ERROR(check_session(message.mover, "mover"));
  NEARMESH_RETURN_IF_ERROR(check_most(message.parts.size(), kMaxWantedParts, "wanted parts"));
  for (std::size_t i = 0; i < message.parts.size(); ++i) {
    const WantedPoses::Part& part = message.parts[i];
    if (part.part > kMaxPart || part.places == 0 || part.places >> kBodiesPerPart != 0 ||
        (i > 0 && part.part <= message.parts[i - 1].part))
      return invalid("wanted poses: part " + std::to_string(part.part) + " with places " +
                     std::to_string(part.places));
  }
  return Status::ok();
}

Status check(const BodyDirectory& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.peer, "peer"));
  NEARMESH_RETURN_IF_ERROR(check_numbers(message));
  std::vector<std::string_view> names;
  for (const BodyDirectory::Body& body : message.bodies) {
    NEARMESH_RETURN_IF_ERROR(check_name(body.name, "body"));
    NEARMESH_RETURN_IF_ERROR(check_name(body.model, "model name"));
    if (!(body.max_speed_mps >= 0 && body.max_speed_mps <= kMaxSpeed_mps))
      return invalid("body " + body.name + ": max_speed_mps: expected 0 to " +
                     std::to_string(kMaxSpeed_mps) + ", found " +
                     std::to_string(body.max_speed_mps));
    const std::uint64_t first = body.first_link;
    if (body.links != 1 && (body.links == 0 || body.links > kMaxLinks || body.number < first ||
                            body.number >= first + body.links || body.max_speed_mps > 0))
      return invalid("body " + body.name + ": links: expected up to " + std::to_string(kMaxLinks) +
                     ", itself among them, and no max_speed_mps; found " +
                     std::to_string(body.links) + " from " + std::to_string(body.first_link) +
                     " of body " + std::to_string(body.number));
    names.push_back(body.name);
  }
  std::sort(names.begin(), names.end());
  const auto twice = std::adjacent_find(names.begin(), names.end());
  if (twice != names.end()) return invalid("body \"" + std::string(*twice) + "\" twice");
  return Status::ok();
}

Status check(const BodyPose& pose) {
  NEARMESH_RETURN_IF_ERROR(check_session(pose.peer, "peer"));
  NEARMESH_RETURN_IF_ERROR(check_name(pose.body, "body"));
  NEARMESH_RETURN_IF_ERROR(check_time(pose.time_s, "pose of " + pose.body + ": time_s"));
  return check_motion({pose.pose, pose.linear_velocity_mps, pose.angular_velocity_radps},
                      pose.body);
}

Status check(const ContactReport& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.peer, "peer"));
  NEARMESH_RETURN_IF_ERROR(check_name(message.body_a, "body_a"));
  NEARMESH_RETURN_IF_ERROR(check_name(message.body_b, "body_b"));
  NEARMESH_RETURN_IF_ERROR(check_time(message.time_s, "time_s"));
  if (message.status >= kAnswerStatusCount)
    return invalid("status: expected below " + std::to_string(kAnswerStatusCount) + ", found " +
                   std::to_string(message.status));
  NEARMESH_RETURN_IF_ERROR(check_distance(message.clearance_m, "clearance_m"));
  NEARMESH_RETURN_IF_ERROR(check_distance(message.uncertainty_m, "uncertainty_m"));
  NEARMESH_RETURN_IF_ERROR(check_most(message.pairs.size(), kMaxReportPairs, "pairs"));
  for (const PoseStamp& stamp : {message.a.stamp, message.b.stamp}) {
    NEARMESH_RETURN_IF_ERROR(check_time(stamp.time_s, "time of a pose"));
    if (!(stamp.max_age_s >= 0)) return invalid("max_age_s: expected a time, not negative");
  }
  if (message.put_off && message.asked) return invalid("put_off: the answer was asked");
  if (message.world && !message.asked) return invalid("world: nothing was asked");
  if (message.world) {
    NEARMESH_RETURN_IF_ERROR(check_most(message.world->tiles.size(), kMaxReportTiles, "tiles"));
    NEARMESH_RETURN_IF_ERROR(
        check_most(message.world->missing_pages.size(), kMaxReportPages, "missing pages"));
  }
  if (message.asked) {
    NEARMESH_RETURN_IF_ERROR(check_pose(message.a.pose, message.body_a));
    NEARMESH_RETURN_IF_ERROR(check_pose(message.b.pose, message.body_b));
  }
  if (message.pairs.size() > message.pair_count)
    return invalid("pairs: " + std::to_string(message.pairs.size()) +
                   " listed, but pair_count is " + std::to_string(message.pair_count));
  return Status::ok();
}

namespace {

Status check_runs(const WatchedBodies& message) {
  constexpr std::uint64_t kMaxNumbers = (std::uint64_t{kMaxPart} + 1) * kBodiesPerPart;
  std::uint64_t count = message.placed.size();
  std::vector<std::pair<SessionId, std::uint64_t>> bodies;
  for (const WatchedBodies::Run& run : message.runs) {
    NEARMESH_RETURN_IF_ERROR(check_session(run.mover, "mover"));
    count += run.count;
    if (run.count == 0 || count > kWatchedPerPart ||
        run.first + std::uint64_t{run.count} > kMaxNumbers)
      return invalid("runs: " + std::to_string(run.count) + " bodies from number " +
                     std::to_string(run.first) + ", expected 1 to " +
                     std::to_string(kWatchedPerPart) + " in a part");
    if (!run.content.is_set()) return invalid("runs: no content");
    if (!(run.max_age_s >= 0)) return invalid("max_age_s: expected a time, not negative");
    for (std::uint32_t i = 0; i < run.count; ++i) bodies.emplace_back(run.mover, run.first + i);
  }
  std::sort(bodies.begin(), bodies.end());
  const auto twice = std::adjacent_find(bodies.begin(), bodies.end());
  if (twice != bodies.end())
    return invalid("runs: body " + std::to_string(twice->second) + " of " + to_hex(twice->first) +
                   " twice");
  return Status::ok();
}

}  // namespace

Status check(const WatchedBodies& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.peer, "peer"));
  NEARMESH_RETURN_IF_ERROR(check_most(message.part, kMaxPart, "part"));
  if (message.edition == 0) return invalid("edition: expected from 1, found 0");
  NEARMESH_RETURN_IF_ERROR(check_distance(message.horizon_s, "horizon_s"));
  NEARMESH_RETURN_IF_ERROR(check_distance(message.margin_m, "margin_m"));
  NEARMESH_RETURN_IF_ERROR(check_most(message.placed.size(), kWatchedPerPart, "placed"));
  NEARMESH_RETURN_IF_ERROR(check_runs(message));
  std::vector<std::string_view> names;
  for (const WatchedBodies::Placed& body : message.placed) {
    NEARMESH_RETURN_IF_ERROR(check_name(body.name, "body in place"));
    if (!body.content.is_set()) return invalid("body " + body.name + ": no content");
    NEARMESH_RETURN_IF_ERROR(check_pose(body.pose, body.name));
    names.push_back(body.name);
  }
  std::sort(names.begin(), names.end());
  const auto twice = std::adjacent_find(names.begin(), names.end());
  if (twice != names.end()) return invalid("body \"" + std::string(*twice) + "\" twice");
  return Status::ok();
}

Status check(const BoundsReport& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.peer, "peer"));
  NEARMESH_RETURN_IF_ERROR(check_time(message.time_s, "time_s"));
  if (message.edition == 0 && !message.rests_on_more)
    return invalid("edition: expected from 1, found 0");
  if (message.pairs == 0) return invalid("pairs: expected from 1, found 0");
  NEARMESH_RETURN_IF_ERROR(check_distance(message.clearance_m, "clearance_m"));
  NEARMESH_RETURN_IF_ERROR(check_distance(message.horizon_s, "horizon_s"));
  NEARMESH_RETURN_IF_ERROR(check_most(message.heard.size(), kMaxWatchedMovers, "heard"));
  std::size_t posed = 0;
  for (const BoundsReport::Heard& heard : message.heard) {
    posed += heard.posed.size();
    const auto unordered = std::adjacent_find(
        heard.posed.begin(), heard.posed.end(),
        [](const auto& one, const auto& next) { return one.number >= next.number; });
    if (unordered != heard.posed.end())
      return invalid("posed: body " + std::to_string(unordered->number) +
                     " is not before the next");
  }
  return check_most(posed, kMaxWatchedPosed, "posed");
}

Status check(const HeldDetail& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.peer, "peer"));
  NEARMESH_RETURN_IF_ERROR(check_name(message.model, "model name"));
  NEARMESH_RETURN_IF_ERROR(check_most(message.heard.size(), kMaxHeardPublishers, "heard"));
  for (const HeldDetail::Heard& heard : message.heard)
    NEARMESH_RETURN_IF_ERROR(check_session(heard.publisher, "publisher"));
  return check_most(message.nodes.size(), kMaxHeldBytes, "nodes");
}

Status check(const ProcessStatus& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.session, "session"));
  if (!message.name.empty()) NEARMESH_RETURN_IF_ERROR(check_name(message.name, "name"));
  NEARMESH_RETURN_IF_ERROR(check_name(message.host, "host"));
  NEARMESH_RETURN_IF_ERROR(check_distance(message.uptime_s, "uptime_s"));
  NEARMESH_RETURN_IF_ERROR(check_distance(message.bytes_per_s, "bytes_per_s"));
  NEARMESH_RETURN_IF_ERROR(check_distance(message.uncertainty_m, "uncertainty_m"));
  if (message.certified_pairs > message.watched_pairs)
    return invalid("certified_pairs: " + std::to_string(message.certified_pairs) + " of " +
                   std::to_string(message.watched_pairs) + " that are watched");
  NEARMESH_RETURN_IF_ERROR(check_most(message.moved.size(), kMaxStatusBodies, "moved"));
  for (const std::string& body : message.moved) NEARMESH_RETURN_IF_ERROR(check_name(body, "moved"));
  if (message.moved.size() > message.moved_bodies || message.stale_bodies > message.heard_bodies)
    return invalid("bodies: counts that contradict each other");
  if (!message.oldest_body.empty())
    NEARMESH_RETURN_IF_ERROR(check_name(message.oldest_body, "oldest_body"));
  if (std::isnan(message.oldest_age_s)) return invalid("oldest_age_s: expected a time");
  NEARMESH_RETURN_IF_ERROR(check_most(message.models.size(), kMaxModels, "models"));
  for (const ProcessStatus::Model& model : message.models) {
    NEARMESH_RETURN_IF_ERROR(check_name(model.name, "model name"));
    if (model.held_splits > model.splits)
      return invalid("model " + model.name + ": holds " + std::to_string(model.held_splits) +
                     " of " + std::to_string(model.splits) + " splits");
  }
  NEARMESH_RETURN_IF_ERROR(check_most(message.complaints.size(), kMaxStatusLines, "complaints"));
  for (const std::string& line : message.complaints)
    if (line.size() > kMaxStatusLineBytes || !std::all_of(line.begin(), line.end(), is_printable))
      return invalid("complaint: expected printable ASCII, at most " +
                     std::to_string(kMaxStatusLineBytes) + " bytes");
  return Status::ok();
}

Status check(const Echo& message) {
  NEARMESH_RETURN_IF_ERROR(check_version(message.wire_version));
  NEARMESH_RETURN_IF_ERROR(check_session(message.from, "from"));
  return check_most(message.bytes.size(), kMaxEchoBytes, "echo bytes");
}

const char* to_string(DoorRefusal refusal) {
  switch (refusal) {
    case DoorRefusal::kHeader:
      return "header";
    case DoorRefusal::kSubmessages:
      return "submessages";
    case DoorRefusal::kStatistics:
      return "statistics";
    case DoorRefusal::kSequence:
      return "sequence";
    case DoorRefusal::kFragments:
      return "fragments";
    case DoorRefusal::kParameters:
      return "parameters";
    case DoorRefusal::kSource:
      return "source";
    case DoorRefusal::kCrowd:
      return "crowd";
    case DoorRefusal::kIdentity:
      return "identity";
  }
  return "unknown";
}

std::string status_line(std::string line) {
  if (line.size() > kMaxStatusLineBytes) line.resize(kMaxStatusLineBytes);
  for (char& c : line)
    if (!is_printable(c)) c = '?';
  return line;
}

}  // namespace nearmesh::wire
