// SPDX-License-Identifier: Apache-2.0
// Of codec.hpp: who the bodies of a mover are, where they are and stay, and who wants to know.
#include <algorithm>
#include <array>
#include <cstdlib>
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

constexpr std::size_t kNumbersPerPose = 19;  // its time, then those of its motion
constexpr int kQuantumOffset = 64;
constexpr std::int64_t kMostQuanta = std::int64_t{1} << 52;  // exact in doubles

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
  NEARMESH_RETURN_IF_ERROR(check_bits(sample.places(), (1U << kBodiesPerPart) - 1, "places"));
  for (std::uint32_t place = 0; place < kBodiesPerPart; ++place) {
    if ((sample.places() >> place & 1U) == 0) continue;
    message.bodies.emplace_back();
    message.bodies.back().number = message.part * kBodiesPerPart + place;
  }
  return Status::ok();
}

/// Small numbers of either sign are short.
void append_signed(std::int64_t number, Octets& to) {
  append_number(static_cast<std::uint64_t>(number) << 1U ^ static_cast<std::uint64_t>(number >> 63),
                to);
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

}  // namespace

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
    append_content(body.content, sample.content_hashes());
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

}  // namespace nearmesh::wire
