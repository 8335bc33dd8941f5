// SPDX-License-Identifier: Apache-2.0
// Of codec.hpp: what peers tell whoever records, of answers, of what they watch, and of what is
// free by bounds.
#include <algorithm>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "codec.hpp"
#include "codec_fields.hpp"
#include "core/base/short_number.hpp"

namespace nearmesh::wire {

namespace {

constexpr std::size_t kWordsPerPair = 4;
constexpr std::size_t kWordsPerRun = 7;     // known, mover, first, count, content, group, mask
constexpr std::size_t kWordsPerPlaced = 4;  // content, group, mask, own
constexpr std::size_t kNumbersPerPlaced = 12;
constexpr std::uint8_t kFlagAsked = 1;
constexpr std::uint8_t kFlagSolidA = 2;
constexpr std::uint8_t kFlagSolidB = 4;
constexpr std::uint8_t kFlagCut = 16;
constexpr std::uint8_t kFlagPutOff = 32;
constexpr std::uint8_t kFlagOnlyOwn = 1;

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

/// Nine numbers of the rotation, three of the place.
void take_pose(const double* numbers, Pose& pose) {
  std::copy(numbers, numbers + 9, pose.rotation.begin());
  std::copy(numbers + 9, numbers + 12, pose.translation_m.begin());
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
  NEARMESH_RETURN_IF_ERROR(
      check_bits(flags, kFlagAsked | kFlagSolidA | kFlagSolidB | kFlagCut | kFlagPutOff, "flags"));
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
    take_pose(&sample.poses()[12 * at++], body->pose);
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
  for (const ContentHash& content : contents) append_content(content, sample.content_hashes());
}

Result<WatchedBodies> decode(const wire_types::WatchedBodiesSample& sample) {
  WatchedBodies message;
  message.wire_version = sample.wire_version();
  message.part = sample.part();
  message.peer = sample.peer();
  message.edition = sample.edition();
  message.horizon_s = sample.horizon_s();
  message.margin_m = sample.margin_m();
  NEARMESH_RETURN_IF_ERROR(check_bits(sample.flags(), kFlagOnlyOwn, "flags"));
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
    take_pose(&sample.placed_poses()[kNumbersPerPlaced * i], message.placed.back().pose);
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

}  // namespace nearmesh::wire
