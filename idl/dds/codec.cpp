// SPDX-License-Identifier: Apache-2.0
#include "codec.hpp"

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <optional>
#include <span>
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
constexpr std::uint8_t kFlagPiece = 16;
constexpr std::size_t kWordsPerNode = 2;
constexpr std::size_t kWordsPerPair = 4;
constexpr std::size_t kWordsPerContent = 2;
constexpr std::size_t kNumbersPerPose = 19;  // its time, then those of its motion
constexpr std::size_t kWordsPerRun = 7;      // known, mover, first, count, content, group, mask
constexpr std::size_t kWordsPerPlaced = 4;   // content, group, mask, own
constexpr std::size_t kNumbersPerPlaced = 12;
constexpr std::uint8_t kFlagAsked = 1;
constexpr std::uint8_t kFlagSolidA = 2;
constexpr std::uint8_t kFlagSolidB = 4;
constexpr std::uint8_t kFlagCut = 16;
constexpr std::uint8_t kFlagPutOff = 32;
constexpr std::uint8_t kFlagPublisher = 1;
constexpr std::uint8_t kFlagDoor = 2;
constexpr std::uint8_t kFlagReply = 1;
constexpr std::uint8_t kFlagOnlyOwn = 1;

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

constexpr int kQuantumOffset = 64;
constexpr std::int64_t kMostQuanta = std::int64_t{1} << 52;  // exact in doubles
constexpr unsigned kMostBits = 56;  // of a difference of two places, and its sign

/// Seven bits a byte, the lowest first.
void append_number(std::uint64_t rest, Octets& to) {
  for (; rest >= 128; rest >>= 7U) to.push_back(static_cast<std::uint8_t>(rest % 128 + 128));
  to.push_back(static_cast<std::uint8_t>(rest));
}

/// Small numbers of either sign are short.
void append_signed(std::int64_t number, Octets& to) {
  append_number(static_cast<std::uint64_t>(number) << 1U ^ static_cast<std::uint64_t>(number >> 63),
                to);
}

/// Takes it away from the bytes; nothing where it does not end, is longer than it must be, or too large.
std::optional<std::uint64_t> take_number(std::span<const std::uint8_t>& bytes) {
  std::uint64_t number = 0;
  for (unsigned shift = 0; shift < kMostBits && !bytes.empty(); shift += 7) {
    const std::uint8_t byte = bytes.front();
    bytes = bytes.subspan(1);
    number |= static_cast<std::uint64_t>(byte % 128) << shift;
    if (byte >= 128) continue;
    if (byte == 0 && shift > 0) return std::nullopt;
    return number;
  }
  return std::nullopt;
}

std::optional<std::int64_t> take_signed(std::span<const std::uint8_t>& bytes) {
  const std::optional<std::uint64_t> number = take_number(bytes);
  if (!number) return std::nullopt;
  return static_cast<std::int64_t>(*number >> 1U ^ (0 - (*number & 1U)));
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
  sample.epochs().clear();
  sample.epochs_from_s().clear();
  const bool has_epochs = std::any_of(message.models.begin(), message.models.end(),
                                      [](const auto& model) { return model.epoch.number != 0; });
  for (const Hello::Model& model : message.models) {
    if (has_epochs) {
      sample.epochs().push_back(model.epoch.number);
      sample.epochs_from_s().push_back(model.epoch.from_s);
    }
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
      sample.epochs().size() != sample.epochs_from_s().size() ||
      (!sample.epochs().empty() && sample.epochs().size() != count) ||
      sample.names().size() > kMaxModels * (kMaxNameBytes + 1))
    return malformed("models: lists of " + std::to_string(sample.content_hashes().size()) +
                     " words of hashes, " + std::to_string(sample.replaced_hashes().size()) +
                     " of replaced ones, " + std::to_string(sample.epochs().size()) + " epochs, " +
                     std::to_string(count) + " sizes and " + std::to_string(sample.names().size()) +
                     " bytes of names do not belong together");
  const auto names = split_lines(sample.names(), count, count, "model names");
  NEARMESH_RETURN_IF_ERROR(names);
  message.models.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    message.models[i].name = names.value()[i];
    message.models[i].content_hash = content_at(sample.content_hashes(), i);
    message.models[i].mesh_bytes = sample.mesh_bytes()[i];
    message.models[i].replaces = content_at(sample.replaced_hashes(), i);
    if (!sample.epochs().empty())
      message.models[i].epoch = {sample.epochs()[i], sample.epochs_from_s()[i]};
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
      (message.wants_held ? kFlagWantsHeld : 0) | (message.wants_regions ? kFlagWantsRegions : 0) |
      (message.is_piece ? kFlagPiece : 0)));
  sample.request(message.request);
  sample.publisher(message.publisher);
  sample.content_hash(words_of(message.content_hash));
  sample.sequence_number(message.sequence);
  sample.bytes(message.bytes);
}

Result<SplitBatchMessage> decode(const wire_types::SplitBatchSample& sample) {
  SplitBatchMessage message;
  message.wire_version = sample.wire_version();
  if ((sample.flags() &
       ~(kFlagLast | kFlagRefused | kFlagWantsHeld | kFlagWantsRegions | kFlagPiece)) != 0)
    return malformed("flags: found unknown bits, " + std::to_string(sample.flags()));
  message.last = (sample.flags() & kFlagLast) != 0;
  message.refused = (sample.flags() & kFlagRefused) != 0;
  message.wants_held = (sample.flags() & kFlagWantsHeld) != 0;
  message.wants_regions = (sample.flags() & kFlagWantsRegions) != 0;
  message.is_piece = (sample.flags() & kFlagPiece) != 0;
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
  sample.sequence_number(message.sequence);
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
  message.sequence = sample.sequence_number();
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

void encode(const BodyPromises& message, wire_types::BodyPromisesSample& sample) {
  sample.wire_version(message.wire_version);
  sample.steps(message.steps);
  sample.part(message.part);
  sample.peer(message.peer);
  sample.from_s(message.from_s);
  sample.sequence_number(message.sequence);
  sample.quantum(static_cast<std::uint8_t>(message.quantum + kQuantumOffset));
  sample.bytes().clear();
  std::uint32_t places = 0;
  std::array<std::int64_t, 3> before{};
  for (const BodyPromises::Body& body : message.bodies) {
    places |= 1U << (body.number % kBodiesPerPromise);
    for (std::size_t k = 0; k < before.size(); ++k)
      append_signed(body.place[k] - before[k], sample.bytes());
    before = body.place;
  }
  sample.places(places);
}

Result<BodyPromises> decode(const wire_types::BodyPromisesSample& sample) {
  BodyPromises message;
  message.wire_version = sample.wire_version();
  message.steps = sample.steps();
  message.part = sample.part();
  message.peer = sample.peer();
  message.from_s = sample.from_s();
  message.sequence = sample.sequence_number();
  message.quantum =
      static_cast<std::int8_t>(std::clamp(sample.quantum() - kQuantumOffset, -128, 127));
  std::span<const std::uint8_t> bytes = sample.bytes();
  std::array<std::int64_t, 3> place{};
  for (std::uint32_t at = 0; at < kBodiesPerPromise; ++at) {
    if ((sample.places() >> at & 1U) == 0) continue;
    for (std::int64_t& quanta : place) {
      const std::optional<std::int64_t> step = take_signed(bytes);
      if (!step) return malformed("promises: bytes that end too soon, or a number of too many");
      quanta += *step;
      if (std::abs(quanta) > kMostQuanta) return malformed("promises: a place that is too far");
    }
    message.bodies.push_back({message.part * kBodiesPerPromise + at, place});
  }
  if (!bytes.empty())
    return malformed("promises: " + std::to_string(bytes.size()) + " bytes too many");
  return checked(std::move(message));
}

void encode(const WantedPoses& message, wire_types::WantedPosesSample& sample) {
  sample.wire_version(message.wire_version);
  sample.peer(message.peer);
  sample.mover(message.mover);
  sample.parts().clear();
  sample.places().clear();
  for (const WantedPoses::Part& part : message.parts) {
    sample.parts().push_back(part.part);
    sample.places().push_back(part.places);
  }
}

Result<WantedPoses> decode(const wire_types::WantedPosesSample& sample) {
  WantedPoses message;
  message.wire_version = sample.wire_version();
  message.peer = sample.peer();
  message.mover = sample.mover();
  const std::size_t count = sample.parts().size();
  if (count > kMaxWantedParts || sample.places().size() != count)
    return malformed("wanted poses: lists of " + std::to_string(count) + " parts and " +
                     std::to_string(sample.places().size()) + " places");
  for (std::size_t i = 0; i < count; ++i)
    message.parts.push_back({sample.parts()[i], sample.places()[i]});
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
  sample.max_speeds_mps().clear();
  sample.links().clear();
  const bool has_links = std::any_of(message.bodies.begin(), message.bodies.end(),
                                     [](const auto& body) { return body.links != 1; });
  std::uint8_t solids = 0;
  for (const BodyDirectory::Body& body : message.bodies) {
    sample.max_speeds_mps().push_back(body.max_speed_mps);
    append_line(body.name, sample.names());
    append_line(body.model, sample.names());
    for (const std::uint64_t word : words_of(body.content)) sample.content_hashes().push_back(word);
    sample.companies().push_back(body.group);
    sample.companies().push_back(body.mask);
    if (body.solid) solids |= place_of(body.number);
    if (has_links) sample.links().insert(sample.links().end(), {body.links, body.first_link});
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
      sample.companies().size() != 2 * count || sample.max_speeds_mps().size() != count ||
      (!sample.links().empty() && sample.links().size() != 2 * count) ||
      sample.names().size() > 2 * kBodiesPerPart * (kMaxNameBytes + 1))
    return malformed("bodies: " + std::to_string(count) + " places, " +
                     std::to_string(sample.content_hashes().size()) + " words of contents, " +
                     std::to_string(sample.companies().size()) + " of groups and masks, " +
                     std::to_string(sample.max_speeds_mps().size()) + " speeds, " +
                     std::to_string(sample.links().size()) + " words of links, " +
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
    body.max_speed_mps = sample.max_speeds_mps()[i];
    if (sample.links().empty()) continue;
    body.links = sample.links()[2 * i];
    body.first_link = sample.links()[2 * i + 1];
  }
  return checked(std::move(message));
}

namespace {

void append_word(std::uint64_t word, Octets& to) {
  for (unsigned shift = 0; shift < 64; shift += 8)
    to.push_back(static_cast<std::uint8_t>(word >> shift));
}

std::optional<std::uint64_t> take_word(std::span<const std::uint8_t>& bytes) {
  if (bytes.size() < 8) return std::nullopt;
  std::uint64_t word = 0;
  for (unsigned i = 0; i < 8; ++i) word |= std::uint64_t{bytes[i]} << 8 * i;
  bytes = bytes.subspan(8);
  return word;
}

std::optional<std::uint32_t> take_short(std::span<const std::uint8_t>& bytes) {
  const std::optional<std::uint64_t> number = take_number(bytes);
  if (!number || *number > std::numeric_limits<std::uint32_t>::max()) return std::nullopt;
  return static_cast<std::uint32_t>(*number);
}

void append_world(const ContactReport::World& world, Octets& to) {
  append_number(world.is_a ? 1 : 0, to);
  append_number(world.reach_cells, to);
  append_number(world.tiles.size(), to);
  for (const ContactReport::World::Tile& tile : world.tiles) {
    append_number(tile.asked ? 1 : 0, to);
    if (!tile.asked) continue;
    append_number(tile.applied_batches, to);
    append_number(tile.era, to);
    append_word(tile.state_digest, to);
  }
  for (const ContentHash& page : world.missing_pages) {
    append_word(page.high, to);
    append_word(page.low, to);
  }
}

/// Nothing where the bytes are other than what append_world() makes.
std::optional<ContactReport::World> take_world(std::span<const std::uint8_t> bytes) {
  ContactReport::World world;
  const auto is_a = take_number(bytes);
  const auto reach = take_short(bytes), tiles = take_short(bytes);
  if (!is_a || *is_a > 1 || !reach || !tiles || *tiles > kMaxReportTiles) return std::nullopt;
  world.is_a = *is_a == 1;
  world.reach_cells = *reach;
  for (std::uint32_t i = 0; i < *tiles; ++i) {
    ContactReport::World::Tile& tile = world.tiles.emplace_back();
    const auto asked = take_number(bytes);
    if (!asked || *asked > 1) return std::nullopt;
    tile.asked = *asked == 1;
    if (!tile.asked) continue;
    const auto applied = take_short(bytes), era = take_short(bytes);
    const auto state = take_word(bytes);
    if (!applied || !era || !state) return std::nullopt;
    tile.applied_batches = *applied;
    tile.era = *era;
    tile.state_digest = *state;
  }
  while (!bytes.empty()) {
    const auto high = take_word(bytes), low = take_word(bytes);
    if (!high || !low) return std::nullopt;
    world.missing_pages.push_back({*high, *low});
  }
  return world;
}

}  // namespace

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
      (message.b.solid ? kFlagSolidB : 0) | (message.cut ? kFlagCut : 0) |
      (message.put_off ? kFlagPutOff : 0)));
  sample.answer_digest(message.answer_digest);
  std::size_t at = 0;
  for (const ContactReport::Asked* body : {&message.a, &message.b}) {
    sample.content_hashes()[kWordsPerContent * at] = body->content_hash.high;
    sample.content_hashes()[kWordsPerContent * at + 1] = body->content_hash.low;
    sample.state_digests()[at] = body->state_digest;
    sample.applied_batches()[at] = body->applied_batches;
    sample.eras()[at] = body->era;
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
  sample.world().clear();
  if (message.world) append_world(*message.world, sample.world());
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
  if ((flags & ~(kFlagAsked | kFlagSolidA | kFlagSolidB | kFlagCut | kFlagPutOff)) != 0)
    return malformed("flags: found unknown bits, " + std::to_string(flags));
  message.asked = (flags & kFlagAsked) != 0;
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
    body->era = sample.eras()[at];
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
  if (!sample.world().empty()) {
    message.world = take_world(sample.world());
    if (!message.world) return malformed("world: octets that do not fit what they begin with");
  }
  return checked(std::move(message));
}

namespace {

/// The place of a value in a list, at the end if it is new.
template <class Value>
std::uint32_t index_in(std::vector<Value>& list, const Value& value) {
  const auto at = std::find(list.begin(), list.end(), value);
  const auto index = static_cast<std::uint32_t>(at - list.begin());
  if (at == list.end()) list.push_back(value);
  return index;
}

/// Lists of the lengths that each other asks for, none longer than a part.
Status check_lists(const wire_types::WatchedBodiesSample& sample) {
  const std::size_t runs = sample.max_ages_s().size(),
                    placed = sample.placed_companies().size() / kWordsPerPlaced;
  if (runs > kWatchedPerPart || placed > kWatchedPerPart ||
      sample.runs().size() != kWordsPerRun * runs ||
      sample.placed_companies().size() != kWordsPerPlaced * placed ||
      sample.placed_poses().size() != kNumbersPerPlaced * placed ||
      sample.content_hashes().size() % kWordsPerContent != 0 ||
      sample.content_hashes().size() > kWordsPerContent * kWatchedPerPart ||
      sample.movers().size() > kWatchedPerPart ||
      sample.names().size() > kWatchedPerPart * (kMaxNameBytes + 1))
    return malformed(
        "watched bodies: lists of " + std::to_string(sample.runs().size()) + " words of runs, " +
        std::to_string(runs) + " ages, " + std::to_string(sample.placed_companies().size()) +
        " words of companies, " + std::to_string(sample.placed_poses().size()) +
        " numbers of poses, " + std::to_string(sample.content_hashes().size()) +
        " words of contents, " + std::to_string(sample.movers().size()) + " movers and " +
        std::to_string(sample.names().size()) + " bytes of names do not belong together");
  return Status::ok();
}

Status check_index(std::uint32_t index, std::size_t count, const char* field) {
  if (index < count) return Status::ok();
  return malformed(std::string(field) + ": found " + std::to_string(index) + " of " +
                   std::to_string(count));
}

}  // namespace

void encode(const WatchedBodies& message, wire_types::WatchedBodiesSample& sample) {
  sample.wire_version(message.wire_version);
  sample.part(message.part);
  sample.peer(message.peer);
  sample.edition(message.edition);
  sample.horizon_s(message.horizon_s);
  sample.margin_m(message.margin_m);
  sample.flags(message.only_own ? kFlagOnlyOwn : 0);
  std::vector<ContentHash> contents;
  sample.movers().clear();
  sample.runs().clear();
  sample.max_ages_s().clear();
  for (const WatchedBodies::Run& run : message.runs) {
    const std::uint32_t mover = index_in(sample.movers(), run.mover);
    for (const std::uint32_t word :
         {static_cast<std::uint32_t>(run.known), mover, run.first, run.count,
          index_in(contents, run.content), run.group, run.mask})
      sample.runs().push_back(word);
    sample.max_ages_s().push_back(run.max_age_s);
  }
  sample.names().clear();
  sample.placed_companies().clear();
  sample.placed_poses().clear();
  for (const WatchedBodies::Placed& body : message.placed) {
    append_line(body.name, sample.names());
    for (const std::uint32_t word :
         {index_in(contents, body.content), body.group, body.mask, body.own ? 1U : 0U})
      sample.placed_companies().push_back(word);
    for (const double number : body.pose.rotation) sample.placed_poses().push_back(number);
    for (const double number : body.pose.translation_m) sample.placed_poses().push_back(number);
  }
  sample.content_hashes().clear();
  for (const ContentHash& content : contents)
    for (const std::uint64_t word : words_of(content)) sample.content_hashes().push_back(word);
}

Result<WatchedBodies> decode(const wire_types::WatchedBodiesSample& sample) {
  WatchedBodies message;
  message.wire_version = sample.wire_version();
  message.part = sample.part();
  message.peer = sample.peer();
  message.edition = sample.edition();
  message.horizon_s = sample.horizon_s();
  message.margin_m = sample.margin_m();
  if ((sample.flags() & ~kFlagOnlyOwn) != 0)
    return malformed("flags: found unknown bits, " + std::to_string(sample.flags()));
  message.only_own = (sample.flags() & kFlagOnlyOwn) != 0;
  NEARMESH_RETURN_IF_ERROR(check_lists(sample));
  const std::size_t contents = sample.content_hashes().size() / kWordsPerContent;
  for (std::size_t i = 0; i < sample.max_ages_s().size(); ++i) {
    const std::uint32_t* word = &sample.runs()[kWordsPerRun * i];
    if (word[0] > static_cast<std::uint32_t>(WatchedBodies::Known::kPromised))
      return malformed("runs: found bodies known by " + std::to_string(word[0]));
    NEARMESH_RETURN_IF_ERROR(check_index(word[1], sample.movers().size(), "mover"));
    NEARMESH_RETURN_IF_ERROR(check_index(word[4], contents, "content"));
    message.runs.push_back({.known = static_cast<WatchedBodies::Known>(word[0]),
                            .mover = sample.movers()[word[1]],
                            .first = word[2],
                            .count = word[3],
                            .content = content_at(sample.content_hashes(), word[4]),
                            .group = word[5],
                            .mask = word[6],
                            .max_age_s = sample.max_ages_s()[i]});
  }
  const std::size_t placed = sample.placed_companies().size() / kWordsPerPlaced;
  const auto names = split_lines(sample.names(), placed, placed, "names of bodies");
  NEARMESH_RETURN_IF_ERROR(names);
  for (std::size_t i = 0; i < placed; ++i) {
    const std::uint32_t* word = &sample.placed_companies()[kWordsPerPlaced * i];
    NEARMESH_RETURN_IF_ERROR(check_index(word[0], contents, "content"));
    NEARMESH_RETURN_IF_ERROR(check_index(word[3], 2, "own"));
    message.placed.push_back({.name = names.value()[i],
                              .content = content_at(sample.content_hashes(), word[0]),
                              .group = word[1],
                              .mask = word[2],
                              .own = word[3] != 0,
                              .pose = {}});
    Pose& pose = message.placed.back().pose;
    const double* numbers = &sample.placed_poses()[kNumbersPerPlaced * i];
    std::copy(numbers, numbers + 9, pose.rotation.begin());
    std::copy(numbers + 9, numbers + 12, pose.translation_m.begin());
  }
  return checked(std::move(message));
}

namespace {

constexpr std::size_t kMaxKnownBytes = 131072;

/// A number, and a bit below it.
bool take_flagged(std::span<const std::uint8_t>& bytes, std::uint32_t& word, bool& flag) {
  const std::optional<std::uint64_t> number = take_number(bytes);
  if (!number || *number >> 33 != 0) return false;
  word = static_cast<std::uint32_t>(*number >> 1);
  flag = (*number & 1) != 0;
  return true;
}

bool take_heard(std::span<const std::uint8_t>& bytes, BoundsReport::Heard& heard) {
  bool has_promises = false;
  if (!take_flagged(bytes, heard.poses, has_promises)) return false;
  if (!has_promises) return true;
  const auto promises = take_short(bytes), near = take_short(bytes), posed = take_short(bytes);
  if (!promises || !near || !posed || *posed > kMaxWatchedPosed) return false;
  heard.promises = *promises;
  heard.near = *near;
  std::uint32_t number = 0;
  for (std::uint32_t i = 0; i < *posed; ++i) {
    const auto more = take_short(bytes), sequence = take_short(bytes);
    if (!more || !sequence) return false;
    heard.posed.push_back({number += *more, *sequence});
  }
  return heard.promises != 0 || heard.near != 0 || !heard.posed.empty();
}

}  // namespace

void encode(const BoundsReport& message, wire_types::BoundsReportSample& sample) {
  sample.wire_version(message.wire_version);
  sample.peer(message.peer);
  sample.frame(message.frame);
  sample.time_s(message.time_s);
  sample.places_digest(message.places_digest);
  sample.pairs(message.pairs);
  sample.clearance_m(message.clearance_m);
  sample.horizon_s(message.horizon_s);
  Octets& known = sample.known();
  known.clear();
  const auto append_flagged = [&](std::uint32_t word, bool flag) {
    append_number(std::uint64_t{word} << 1U | (flag ? 1 : 0), known);
  };
  append_flagged(message.edition, message.rests_on_more);
  for (const BoundsReport::Heard& heard : message.heard) {
    const bool has_promises = heard.promises != 0 || heard.near != 0 || !heard.posed.empty();
    append_flagged(heard.poses, has_promises);
    if (!has_promises) continue;
    append_number(heard.promises, known);
    append_number(heard.near, known);
    append_number(heard.posed.size(), known);
    std::uint32_t before = 0;
    for (const BoundsReport::Heard::Posed& posed : heard.posed) {
      append_number(posed.number - std::exchange(before, posed.number), known);
      append_number(posed.sequence, known);
    }
  }
}

Result<BoundsReport> decode(const wire_types::BoundsReportSample& sample) {
  BoundsReport message;
  message.wire_version = sample.wire_version();
  message.peer = sample.peer();
  message.frame = sample.frame();
  message.time_s = sample.time_s();
  message.places_digest = sample.places_digest();
  message.pairs = sample.pairs();
  message.clearance_m = sample.clearance_m();
  message.horizon_s = sample.horizon_s();
  std::span<const std::uint8_t> known = sample.known();
  const char* const kUnfit =
      "bounds report: octets of what is known that end too soon, or are too many";
  if (known.size() > kMaxKnownBytes || !take_flagged(known, message.edition, message.rests_on_more))
    return malformed(kUnfit);
  while (!known.empty()) {
    if (message.heard.size() > kMaxWatchedMovers ||
        !take_heard(known, message.heard.emplace_back()))
      return malformed(kUnfit);
  }
  return checked(std::move(message));
}

void encode(const HeldDetail& message, wire_types::HeldDetailSample& sample) {
  sample.wire_version(message.wire_version);
  sample.applied_batches(message.applied_batches);
  sample.peer(message.peer);
  sample.content_hash(words_of(message.content_hash));
  sample.model(message.model.c_str());
  sample.last_request(message.last_request);
  sample.era(message.era);
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
  message.era = sample.era();
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
