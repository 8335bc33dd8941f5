// SPDX-License-Identifier: Apache-2.0
#include "codec.hpp"

#include <algorithm>
#include <utility>

#include "core/spm/packed_certificate.hpp"
#include "core/spm/packed_region.hpp"
#include "idl/messages/process_name.hpp"

namespace nearmesh::wire {

namespace {

constexpr std::uint8_t kFlagLast = 1;
constexpr std::uint8_t kFlagRefused = 2;
constexpr std::uint8_t kFlagWantsHeld = 4;
constexpr std::uint8_t kFlagWantsRegions = 8;
constexpr std::size_t kWordsPerNode = 2;
constexpr std::size_t kWordsPerPair = 4;
constexpr std::size_t kWordsPerContent = 2;
constexpr std::size_t kNumbersPerPose = 19;  // its time, then those of its motion
constexpr std::uint8_t kFlagAsked = 1;
constexpr std::uint8_t kFlagSolidA = 2;
constexpr std::uint8_t kFlagSolidB = 4;
constexpr std::uint8_t kFlagGaveUp = 8;
constexpr std::uint8_t kFlagCut = 16;
constexpr std::uint8_t kFlagPutOff = 32;
constexpr std::uint8_t kFlagPublisher = 1;
constexpr std::uint8_t kFlagDoor = 2;
constexpr std::uint8_t kFlagReply = 1;

Status malformed(std::string message) { return {StatusCode::kInvalidArgument, std::move(message)}; }

/// A flat list must hold whole records, and no more than the message may have.
Status check_words(std::size_t found, std::size_t per_record, std::size_t limit,
                   const char* field) {
  if (found % per_record == 0 && found / per_record <= limit) return Status::ok();
  return malformed(std::string(field) + ": expected at most " + std::to_string(limit) + " times " +
                   std::to_string(per_record) + " words, found " + std::to_string(found));
}

using Octets = std::vector<std::uint8_t>;

void append_line(const std::string& line, Octets& to) {
  to.insert(to.end(), line.begin(), line.end());
  to.push_back('\n');
}

/// The lines, each of which must end; `least` to `most` of them.
Result<std::vector<std::string>> split_lines(const Octets& octets, std::size_t least,
                                             std::size_t most, const std::string& field) {
  std::vector<std::string> lines;
  std::string line;
  for (const std::uint8_t c : octets) {
    if (c != '\n') {
      line.push_back(static_cast<char>(c));
      continue;
    }
    if (lines.size() == most) return malformed(field + ": more than " + std::to_string(most));
    lines.push_back(std::exchange(line, {}));
  }
  if (lines.size() < least || !line.empty())
    return malformed(field + ": fewer whole ones than " + std::to_string(least));
  return lines;
}

/// That of the place `at` in a list.
template <class Words>
ContentHash content_at(const Words& words, std::size_t at) {
  return {words[kWordsPerContent * at], words[kWordsPerContent * at + 1]};
}

/// The bit of a body in its part.
std::uint8_t place_of(std::uint32_t number) {
  return static_cast<std::uint8_t>(1U << (number % kBodiesPerPart));
}

template <class Message>
std::uint8_t places_of(const Message& message) {
  std::uint8_t places = 0;
  for (const auto& body : message.bodies) places |= place_of(body.number);
  return places;
}

/// The part, and its bodies' numbers.
template <class Sample, class Message>
Status take_places(const Sample& sample, Message& message) {
  message.part = sample.part();
  if (sample.places() >> kBodiesPerPart != 0)
    return malformed("places: found unknown bits, " + std::to_string(sample.places()));
  for (std::uint32_t place = 0; place < kBodiesPerPart; ++place) {
    if ((sample.places() >> place & 1U) == 0) continue;
    message.bodies.emplace_back();
    message.bodies.back().number = message.part * kBodiesPerPart + place;
  }
  return Status::ok();
}

/// use(number) of each, in the order in which they travel.
template <class AnyMotion, class Use>
void for_each_number(AnyMotion& motion, const Use& use) {
  const auto all = [&use](auto& numbers) {
    for (auto& number : numbers) use(number);
  };
  all(motion.pose.rotation);
  all(motion.pose.translation_m);
  all(motion.linear_velocity_mps);
  all(motion.angular_velocity_radps);
}

template <class Message>
Result<Message> checked(Message message) {
  NEARMESH_RETURN_IF_ERROR(check(message));
  return message;
}

}  // namespace

void encode(const Hello& message, wire_types::HelloSample& sample) {
  sample.wire_version(message.wire_version);
  sample.publisher(message.publisher);
  sample.name(message.name.c_str());
  sample.names().clear();
  sample.content_hashes().clear();
  sample.mesh_bytes().clear();
  sample.replaced_hashes().clear();
  for (const Hello::Model& model : message.models) {
    append_line(model.name, sample.names());
    for (const std::uint64_t word : words_of(model.content_hash))
      sample.content_hashes().push_back(word);
    sample.mesh_bytes().push_back(model.mesh_bytes);
    for (const std::uint64_t word : words_of(model.replaces))
      sample.replaced_hashes().push_back(word);
  }
}

Result<Hello> decode(const wire_types::HelloSample& sample) {
  Hello message;
  message.wire_version = sample.wire_version();
  message.publisher = sample.publisher();
  message.name = shown_name(sample.name().to_string());
  const std::size_t count = sample.mesh_bytes().size();
  if (count > kMaxModels || sample.content_hashes().size() != kWordsPerContent * count ||
      sample.replaced_hashes().size() != kWordsPerContent * count ||
      sample.names().size() > kMaxModels * (kMaxNameBytes + 1))
    return malformed("models: lists of " + std::to_string(sample.content_hashes().size()) +
                     " words of hashes, " + std::to_string(sample.replaced_hashes().size()) +
                     " of replaced ones, " + std::to_string(count) + " sizes and " +
                     std::to_string(sample.names().size()) +
                     " bytes of names do not belong together");
  const auto names = split_lines(sample.names(), count, count, "model names");
  NEARMESH_RETURN_IF_ERROR(names);
  message.models.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    message.models[i].name = names.value()[i];
    message.models[i].content_hash = content_at(sample.content_hashes(), i);
    message.models[i].mesh_bytes = sample.mesh_bytes()[i];
    message.models[i].replaces = content_at(sample.replaced_hashes(), i);
  }
  return checked(std::move(message));
}

void encode(const MeshHeader& message, wire_types::MeshHeaderSample& sample) {
  sample.wire_version(message.wire_version);
  sample.content_hash(words_of(message.content_hash));
  sample.name(message.name.c_str());
  sample.bytes(message.bytes);
}

Result<MeshHeader> decode(const wire_types::MeshHeaderSample& sample) {
  MeshHeader message;
  message.wire_version = sample.wire_version();
  message.content_hash = content_at(sample.content_hash(), 0);
  message.name = sample.name().to_string();
  message.bytes = sample.bytes();
  return checked(std::move(message));
}

void encode(const RegionSubscription& message, wire_types::RegionSubscriptionSample& sample) {
  sample.wire_version(message.wire_version);
  sample.priority(message.priority);
  sample.request(message.request);
  sample.peer(message.peer);
  sample.content_hash(words_of(message.content_hash));
  sample.publisher(message.publisher);
  sample.acknowledged_sequence(message.acknowledged_sequence);
  sample.window_bytes(message.window_bytes);
  sample.max_splits(message.region.max_splits);
  sample.attach().clear();
  for (const NodeSpan& node : message.region.attach) {
    sample.attach().push_back(node.first.value);
    sample.attach().push_back(node.size);
  }
  PackedRegion region = pack_region(message.region.region);
  sample.region_origin(region.origin);
  sample.region_shift(region.shift);
  sample.region_radius(region.radius);
  sample.region_parts(std::move(region.parts));
  sample.certificate(message.certificate ? pack_certificate(*message.certificate) : Octets());
}

Result<RegionSubscription> decode(const wire_types::RegionSubscriptionSample& sample) {
  RegionSubscription message;
  message.wire_version = sample.wire_version();
  message.priority = sample.priority();
  message.request = sample.request();
  message.peer = sample.peer();
  message.content_hash = content_at(sample.content_hash(), 0);
  message.publisher = sample.publisher();
  message.acknowledged_sequence = sample.acknowledged_sequence();
  message.window_bytes = sample.window_bytes();
  message.region.max_splits = sample.max_splits();
  const auto& attach = sample.attach();
  NEARMESH_RETURN_IF_ERROR(check_words(attach.size(), kWordsPerNode, kMaxAttachNodes, "attach"));
  for (std::size_t i = 0; i < attach.size(); i += kWordsPerNode)
    message.region.attach.push_back({VertexId{attach[i]}, attach[i + 1]});
  Result<std::vector<RegionPart>> region =
      unpack_region({sample.region_origin(), sample.region_shift(), sample.region_radius(),
                     sample.region_parts()});
  NEARMESH_RETURN_IF_ERROR(region);
  message.region.region = std::move(region).value();
  if (!sample.certificate().empty()) {
    auto certificate = unpack_certificate(sample.certificate());
    NEARMESH_RETURN_IF_ERROR(certificate);
    message.certificate = std::move(certificate).value();
  }
  return checked(std::move(message));
}

void encode(const SplitBatchMessage& message, wire_types::SplitBatchSample& sample) {
  sample.wire_version(message.wire_version);
  sample.flags(static_cast<std::uint8_t>(
      (message.last ? kFlagLast : 0) | (message.refused ? kFlagRefused : 0) |
      (message.wants_held ? kFlagWantsHeld : 0) | (message.wants_regions ? kFlagWantsRegions : 0)));
  sample.request(message.request);
  sample.publisher(message.publisher);
  sample.content_hash(words_of(message.content_hash));
  sample.sequence_number(message.sequence);
  sample.bytes(message.bytes);
}

Result<SplitBatchMessage> decode(const wire_types::SplitBatchSample& sample) {
  SplitBatchMessage message;
  message.wire_version = sample.wire_version();
  if ((sample.flags() & ~(kFlagLast | kFlagRefused | kFlagWantsHeld | kFlagWantsRegions)) != 0)
    return malformed("flags: found unknown bits, " + std::to_string(sample.flags()));
  message.last = (sample.flags() & kFlagLast) != 0;
  message.refused = (sample.flags() & kFlagRefused) != 0;
  message.wants_held = (sample.flags() & kFlagWantsHeld) != 0;
  message.wants_regions = (sample.flags() & kFlagWantsRegions) != 0;
  message.request = sample.request();
  message.publisher = sample.publisher();
  message.content_hash = content_at(sample.content_hash(), 0);
  message.sequence = sample.sequence_number();
  message.bytes = sample.bytes();
  return checked(std::move(message));
}

void encode(const BodyPoses& message, wire_types::BodyPosesSample& sample) {
  sample.wire_version(message.wire_version);
  sample.places(places_of(message));
  sample.part(message.part);
  sample.peer(message.peer);
  sample.frame(message.frame);
  std::vector<double>& motions = sample.motions();
  motions.clear();
  for (const BodyPoses::Body& body : message.bodies) {
    motions.push_back(body.time_s);
    for_each_number(body.motion, [&](double number) { motions.push_back(number); });
  }
}

Result<BodyPoses> decode(const wire_types::BodyPosesSample& sample) {
  BodyPoses message;
  message.wire_version = sample.wire_version();
  message.peer = sample.peer();
  message.frame = sample.frame();
  NEARMESH_RETURN_IF_ERROR(take_places(sample, message));
  const std::vector<double>& motions = sample.motions();
  if (motions.size() != kNumbersPerPose * message.bodies.size())
    return malformed("motions: " + std::to_string(motions.size()) + " numbers of " +
                     std::to_string(message.bodies.size()) + " bodies");
  auto next = motions.begin();
  for (BodyPoses::Body& body : message.bodies) {
    body.time_s = *next++;
    for_each_number(body.motion, [&](double& number) { number = *next++; });
  }
  return checked(std::move(message));
}

void encode(const BodyDirectory& message, wire_types::BodyDirectorySample& sample) {
  sample.wire_version(message.wire_version);
  sample.places(places_of(message));
  sample.part(message.part);
  sample.peer(message.peer);
  sample.names().clear();
  sample.content_hashes().clear();
  sample.companies().clear();
  std::uint8_t solids = 0;
  for (const BodyDirectory::Body& body : message.bodies) {
    append_line(body.name, sample.names());
    append_line(body.model, sample.names());
    for (const std::uint64_t word : words_of(body.content)) sample.content_hashes().push_back(word);
    sample.companies().push_back(body.group);
    sample.companies().push_back(body.mask);
    if (body.solid) solids |= place_of(body.number);
  }
  sample.solids(solids);
}

Result<BodyDirectory> decode(const wire_types::BodyDirectorySample& sample) {
  BodyDirectory message;
  message.wire_version = sample.wire_version();
  message.peer = sample.peer();
  NEARMESH_RETURN_IF_ERROR(take_places(sample, message));
  const std::size_t count = message.bodies.size();
  if (sample.content_hashes().size() != kWordsPerContent * count ||
      sample.companies().size() != 2 * count ||
      sample.names().size() > 2 * kBodiesPerPart * (kMaxNameBytes + 1))
    return malformed("bodies: " + std::to_string(count) + " places, " +
                     std::to_string(sample.content_hashes().size()) + " words of contents, " +
                     std::to_string(sample.companies().size()) + " of groups and masks, " +
                     std::to_string(sample.names().size()) + " bytes of names");
  if ((sample.solids() & ~sample.places()) != 0)
    return malformed("solids: found " + std::to_string(sample.solids()));
  const auto names = split_lines(sample.names(), 2 * count, 2 * count, "names of bodies");
  NEARMESH_RETURN_IF_ERROR(names);
  for (std::size_t i = 0; i < count; ++i) {
    BodyDirectory::Body& body = message.bodies[i];
    body.name = names.value()[2 * i];
    body.model = names.value()[2 * i + 1];
    body.content = content_at(sample.content_hashes(), i);
    body.solid = (sample.solids() & place_of(body.number)) != 0;
    body.group = sample.companies()[2 * i];
    body.mask = sample.companies()[2 * i + 1];
  }
  return checked(std::move(message));
}

void encode(const ContactReport& message, wire_types::ContactReportSample& sample) {
  sample.wire_version(message.wire_version);
  sample.status(message.status);
  sample.pair_count(message.pair_count);
  sample.peer(message.peer);
  sample.body_a(message.body_a.c_str());
  sample.body_b(message.body_b.c_str());
  sample.frame(message.frame);
  sample.time_s(message.time_s);
  sample.clearance_m(message.clearance_m);
  sample.uncertainty_m(message.uncertainty_m);
  sample.flags(static_cast<std::uint8_t>(
      (message.asked ? kFlagAsked : 0) | (message.a.solid ? kFlagSolidA : 0) |
      (message.b.solid ? kFlagSolidB : 0) | (message.gave_up_detail ? kFlagGaveUp : 0) |
      (message.cut ? kFlagCut : 0) | (message.put_off ? kFlagPutOff : 0)));
  sample.answer_digest(message.answer_digest);
  std::size_t at = 0;
  for (const ContactReport::Asked* body : {&message.a, &message.b}) {
    sample.content_hashes()[kWordsPerContent * at] = body->content_hash.high;
    sample.content_hashes()[kWordsPerContent * at + 1] = body->content_hash.low;
    sample.state_digests()[at] = body->state_digest;
    sample.applied_batches()[at] = body->applied_batches;
    double* pose = &sample.poses()[12 * at++];
    std::copy(body->pose.rotation.begin(), body->pose.rotation.end(), pose);
    std::copy(body->pose.translation_m.begin(), body->pose.translation_m.end(), pose + 9);
  }
  at = 0;
  for (const PoseStamp& stamp : {message.a.stamp, message.b.stamp}) {
    sample.movers()[at] = static_cast<std::uint8_t>(stamp.mover);
    sample.pose_times_s()[at] = stamp.time_s;
    sample.max_ages_s()[at++] = stamp.max_age_s;
  }
  sample.pairs().clear();
  for (const auto& pair : message.pairs)
    for (const FaceKey& face : pair) {
      sample.pairs().push_back(face.split.value);
      sample.pairs().push_back(face.index);
    }
}

Result<ContactReport> decode(const wire_types::ContactReportSample& sample) {
  ContactReport message;
  message.wire_version = sample.wire_version();
  message.status = sample.status();
  message.pair_count = sample.pair_count();
  message.peer = sample.peer();
  message.body_a = sample.body_a().to_string();
  message.body_b = sample.body_b().to_string();
  message.frame = sample.frame();
  message.time_s = sample.time_s();
  message.clearance_m = sample.clearance_m();
  message.uncertainty_m = sample.uncertainty_m();
  const std::uint8_t flags = sample.flags();
  if ((flags & ~(kFlagAsked | kFlagSolidA | kFlagSolidB | kFlagGaveUp | kFlagCut | kFlagPutOff)) !=
      0)
    return malformed("flags: found unknown bits, " + std::to_string(flags));
  message.asked = (flags & kFlagAsked) != 0;
  message.gave_up_detail = (flags & kFlagGaveUp) != 0;
  message.cut = (flags & kFlagCut) != 0;
  message.put_off = (flags & kFlagPutOff) != 0;
  message.a.solid = (flags & kFlagSolidA) != 0;
  message.b.solid = (flags & kFlagSolidB) != 0;
  message.answer_digest = sample.answer_digest();
  std::size_t at = 0;
  for (ContactReport::Asked* body : {&message.a, &message.b}) {
    body->content_hash = content_at(sample.content_hashes(), at);
    body->state_digest = sample.state_digests()[at];
    body->applied_batches = sample.applied_batches()[at];
    const double* pose = &sample.poses()[12 * at++];
    std::copy(pose, pose + 9, body->pose.rotation.begin());
    std::copy(pose + 9, pose + 12, body->pose.translation_m.begin());
  }
  at = 0;
  for (PoseStamp* stamp : {&message.a.stamp, &message.b.stamp}) {
    const std::uint8_t mover = sample.movers()[at];
    if (mover > static_cast<std::uint8_t>(Mover::kBarred))
      return malformed("movers: found " + std::to_string(mover));
    *stamp = {static_cast<Mover>(mover), sample.pose_times_s()[at], sample.max_ages_s()[at]};
    ++at;
  }
  const auto& words = sample.pairs();
  NEARMESH_RETURN_IF_ERROR(check_words(words.size(), kWordsPerPair, kMaxReportPairs, "pairs"));
  for (std::size_t i = 0; i < words.size(); i += kWordsPerPair)
    message.pairs.push_back(
        {FaceKey{VertexId{words[i]}, words[i + 1]}, FaceKey{VertexId{words[i + 2]}, words[i + 3]}});
  return checked(std::move(message));
}

void encode(const HeldDetail& message, wire_types::HeldDetailSample& sample) {
  sample.wire_version(message.wire_version);
  sample.applied_batches(message.applied_batches);
  sample.peer(message.peer);
  sample.content_hash(words_of(message.content_hash));
  sample.model(message.model.c_str());
  sample.last_request(message.last_request);
  sample.state_digest(message.state_digest);
  sample.box_digest(message.box_digest);
  sample.heard_publishers().clear();
  sample.heard_sequences().clear();
  for (const HeldDetail::Heard& heard : message.heard) {
    sample.heard_publishers().push_back(heard.publisher);
    sample.heard_sequences().push_back(heard.sequence);
  }
  sample.nodes(message.nodes);
}

Result<HeldDetail> decode(const wire_types::HeldDetailSample& sample) {
  HeldDetail message;
  message.wire_version = sample.wire_version();
  message.applied_batches = sample.applied_batches();
  message.peer = sample.peer();
  message.content_hash = content_at(sample.content_hash(), 0);
  message.model = sample.model().to_string();
  message.last_request = sample.last_request();
  message.state_digest = sample.state_digest();
  message.box_digest = sample.box_digest();
  const std::size_t count = sample.heard_publishers().size();
  if (count > kMaxHeardPublishers || sample.heard_sequences().size() != count)
    return malformed("heard: lists that do not belong together");
  for (std::size_t i = 0; i < count; ++i)
    message.heard.push_back({sample.heard_publishers()[i], sample.heard_sequences()[i]});
  message.nodes = sample.nodes();
  return checked(std::move(message));
}

void encode(const ProcessStatus& message, wire_types::ProcessStatusSample& sample) {
  sample.wire_version(message.wire_version);
  sample.flags(static_cast<std::uint8_t>((message.is_publisher ? kFlagPublisher : 0) |
                                         (message.has_door ? kFlagDoor : 0)));
  sample.process_id(message.process_id);
  sample.session(message.session);
  sample.name(message.name.c_str());
  sample.host(message.host.c_str());
  sample.uptime_s(message.uptime_s);
  sample.bytes_per_s(message.bytes_per_s);
  sample.uncertainty_m(message.uncertainty_m);
  sample.peers(message.peers);
  sample.watched_pairs(message.watched_pairs);
  sample.certified_pairs(message.certified_pairs);
  sample.requests(message.requests);
  sample.refused(message.refused);
  sample.batches(message.batches);
  sample.bytes(message.bytes);
  sample.lost_batches(message.lost_batches);
  sample.waiting_batches(message.waiting_batches);
  sample.resident_bytes(message.resident_bytes);
  sample.moved_bodies(message.moved_bodies);
  sample.heard_bodies(message.heard_bodies);
  sample.stale_bodies(message.stale_bodies);
  sample.oldest_body(message.oldest_body.c_str());
  sample.oldest_age_s(message.oldest_age_s);
  sample.moved().clear();
  for (const std::string& body : message.moved) append_line(body, sample.moved());
  sample.door_refused(message.door_refused);
  sample.names().clear();
  sample.content_hashes().clear();
  sample.faces().clear();
  sample.held_splits().clear();
  sample.splits().clear();
  for (const ProcessStatus::Model& model : message.models) {
    append_line(model.name, sample.names());
    for (const std::uint64_t word : words_of(model.content_hash))
      sample.content_hashes().push_back(word);
    sample.faces().push_back(model.faces);
    sample.held_splits().push_back(model.held_splits);
    sample.splits().push_back(model.splits);
  }
  sample.complaints().clear();
  for (const std::string& line : message.complaints) append_line(line, sample.complaints());
}

Result<ProcessStatus> decode(const wire_types::ProcessStatusSample& sample) {
  ProcessStatus message;
  message.wire_version = sample.wire_version();
  if ((sample.flags() & ~(kFlagPublisher | kFlagDoor)) != 0)
    return malformed("flags: found unknown bits, " + std::to_string(sample.flags()));
  message.is_publisher = (sample.flags() & kFlagPublisher) != 0;
  message.has_door = (sample.flags() & kFlagDoor) != 0;
  message.process_id = sample.process_id();
  message.session = sample.session();
  message.name = shown_name(sample.name().to_string());
  message.host = sample.host().to_string();
  message.uptime_s = sample.uptime_s();
  message.bytes_per_s = sample.bytes_per_s();
  message.uncertainty_m = sample.uncertainty_m();
  message.peers = sample.peers();
  message.watched_pairs = sample.watched_pairs();
  message.certified_pairs = sample.certified_pairs();
  message.requests = sample.requests();
  message.refused = sample.refused();
  message.batches = sample.batches();
  message.bytes = sample.bytes();
  message.lost_batches = sample.lost_batches();
  message.waiting_batches = sample.waiting_batches();
  message.resident_bytes = sample.resident_bytes();
  message.moved_bodies = sample.moved_bodies();
  message.heard_bodies = sample.heard_bodies();
  message.stale_bodies = sample.stale_bodies();
  message.oldest_body = sample.oldest_body().to_string();
  message.oldest_age_s = sample.oldest_age_s();
  auto moved = split_lines(sample.moved(), 0, kMaxStatusBodies, "moved");
  NEARMESH_RETURN_IF_ERROR(moved);
  message.moved = std::move(moved).value();
  message.door_refused = sample.door_refused();
  const std::size_t count = sample.faces().size();
  if (count > kMaxModels || sample.content_hashes().size() != kWordsPerContent * count ||
      sample.held_splits().size() != count || sample.splits().size() != count)
    return malformed("models: lists that do not belong together");
  const auto names = split_lines(sample.names(), count, count, "model names");
  NEARMESH_RETURN_IF_ERROR(names);
  for (std::size_t i = 0; i < count; ++i)
    message.models.push_back({names.value()[i], content_at(sample.content_hashes(), i),
                              sample.faces()[i], sample.held_splits()[i], sample.splits()[i]});
  auto lines = split_lines(sample.complaints(), 0, kMaxStatusLines, "complaints");
  NEARMESH_RETURN_IF_ERROR(lines);
  message.complaints = std::move(lines).value();
  return checked(std::move(message));
}

void encode(const Echo& message, wire_types::EchoSample& sample) {
  sample.wire_version(message.wire_version);
  sample.flags(message.is_reply ? kFlagReply : 0);
  sample.number(message.number);
  sample.from(message.from);
  sample.to(message.to);
  sample.bytes(message.bytes);
}

Result<Echo> decode(const wire_types::EchoSample& sample) {
  Echo message;
  message.wire_version = sample.wire_version();
  if ((sample.flags() & ~kFlagReply) != 0)
    return malformed("flags: found unknown bits, " + std::to_string(sample.flags()));
  message.is_reply = (sample.flags() & kFlagReply) != 0;
  message.number = sample.number();
  message.from = sample.from();
  message.to = sample.to();
  message.bytes = sample.bytes();
  return checked(std::move(message));
}

}  // namespace nearmesh::wire
