// SPDX-License-Identifier: Apache-2.0
#include "pose_tape.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "core/base/hash.hpp"

namespace nearmesh::subscriber {

namespace {

constexpr std::size_t kMaxHoles = 4096;
/// Of a robot's poses: samples of each part that are looked at for the last whole instant.
constexpr std::size_t kMaxInstants = 64;

/// Sessions round against the body, so what they let pass is in here.
std::string why_broken(const wire::BodyPromise& promise, const wire::BodyPoses::Body& pose) {
  const std::optional<double> radius_m = promise.radius_m(pose.time_s);
  if (!radius_m) return {};
  double square = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double way_m = pose.motion.pose.translation_m[k] - promise.place_m[k];
    square += way_m * way_m;
  }
  if (std::sqrt(square) <= *radius_m) return {};
  return "body " + promise.body + " of " + to_hex(promise.peer) + " is " +
         std::to_string(std::sqrt(square)) + " m from its promised place at " +
         std::to_string(pose.time_s) + " s, promised were " + std::to_string(*radius_m) + " m";
}

}  // namespace

Participant participant_of(const RecordedWriter& writer) {
  Participant participant{};
  std::copy_n(writer.guid.begin(), participant.size(), participant.begin());
  return participant;
}

void PoseSamples::take(wire::BodyPoses&& poses, int round) {
  if (poses.sequence == 0) return;
  const std::uint64_t before = numbers_.last(), place = numbers_.take(poses.sequence);
  if (before == 0) {
    unknown_until_ = place;  // what was said before nobody can tell
  } else if (place > before + 1 && !(place == before + 2 && SampleNumbers::is_none(before + 1))) {
    holes_.emplace_back(before + 1, place - 1);
  }
  if (holes_.size() > kMaxHoles) {
    unknown_until_ = holes_.front().second;
    holes_.pop_front();
  }
  parts_[poses.part].try_emplace(place, Sample{std::move(poses.bodies), round});
}

void PoseSamples::forget(int round) {
  for (auto& [part, samples] : parts_)
    while (samples.size() > samples_a_part_ &&
           std::next(samples.begin())->second.round + kRoundsKept < round)
      samples.erase(samples.begin());
}

PoseSamples::Found PoseSamples::find(std::uint32_t number, std::uint32_t last) const {
  const auto part = parts_.find(number / wire::kBodiesPerPart);
  if (part == parts_.end()) return {};
  auto at = part->second.upper_bound(numbers_.place_of(last));
  for (std::size_t i = 0; i < samples_a_part_ && at != part->second.begin(); ++i) {
    --at;
    for (const wire::BodyPoses::Body& body : at->second.bodies)
      if (body.number == number) return {&body, at->first};
  }
  return {};
}

PoseSamples::Links PoseSamples::find_links(std::uint32_t first, std::uint32_t links,
                                           std::uint32_t last) const {
  struct Instant {
    Links links;
    std::uint64_t newest = 0;
  };
  std::map<std::pair<std::uint32_t, double>, Instant> instants;  // by update and time
  for (std::uint32_t at = first / wire::kBodiesPerPart;
       at <= (first + links - 1) / wire::kBodiesPerPart; ++at) {
    const auto part = parts_.find(at);
    if (part == parts_.end()) return {};
    auto sample = part->second.upper_bound(numbers_.place_of(last));
    for (std::size_t i = 0; i < kMaxInstants && sample != part->second.begin(); ++i) {
      --sample;
      for (const wire::BodyPoses::Body& body : sample->second.bodies) {
        if (body.number < first || body.number >= first + links) continue;
        const std::uint32_t update = wire::first_sample_of_robot(
            static_cast<std::uint32_t>(sample->first), body.number, first);
        Instant& instant = instants[{update, body.time_s}];
        instant.newest = std::max(instant.newest, sample->first);
        instant.links.try_emplace(body.number, Found{&body, sample->first});
      }
    }
  }
  Instant* whole = nullptr;
  for (auto& [when, instant] : instants)
    if (instant.links.size() == links && (whole == nullptr || whole->newest < instant.newest))
      whole = &instant;
  return whole == nullptr ? Links{} : std::move(whole->links);
}

bool PoseSamples::is_whole(const Found& first, std::uint32_t last) const {
  const std::uint64_t end = numbers_.place_of(last);
  if (end > numbers_.last() || first.place < unknown_until_) return false;
  // Ascending, since each begins after what had come.
  const auto next = std::partition_point(
      holes_.begin(), holes_.end(), [&](const auto& hole) { return hole.second <= first.place; });
  return next == holes_.end() || next->first > end;
}

PoseSamples::Found FoundLinks::find(const PoseSamples& samples,
                                    const wire::BodyDirectory::Body& link, std::uint32_t last) {
  const auto [at, is_new] = robots_.try_emplace({&samples, link.first_link, link.links, last});
  if (is_new) at->second = samples.find_links(link.first_link, link.links, last);
  const auto found = at->second.find(link.number);
  return found == at->second.end() ? PoseSamples::Found{} : found->second;
}

void PoseTape::take(wire::BodyDirectory&& directory) {
  for (wire::BodyDirectory::Body& body : directory.bodies) {
    const std::uint32_t number = body.number;  // none is used again
    who_[number] = std::move(body);
  }
}

std::string PoseTape::take(wire::NearPoses&& message, int round) {
  std::string broken;
  for (const wire::BodyPoses::Body& body : message.bodies) {
    const auto part = promises_.find(body.number / wire::kBodiesPerPromise);
    if (part == promises_.end()) continue;
    for (const auto& [place, promised] : part->second)
      if (const auto promise = promise_in(promised.message, body.number); promise && broken.empty())
        broken = why_broken(*promise, body);
  }
  near.take(std::move(message), round);
  return broken;
}

std::string PoseTape::take(wire::BodyPromises&& message, int round) {
  std::string broken;
  for (const wire::BodyPromises::Body& body : message.bodies)
    if (const auto promise = promise_in(message, body.number))
      near.for_each(body.number, [&](const wire::BodyPoses::Body& pose) {
        if (broken.empty()) broken = why_broken(*promise, pose);
      });
  if (message.sequence != 0)
    promises_[message.part].try_emplace(promise_numbers_.take(message.sequence),
                                        Promised{std::move(message), round});
  return broken;
}

void PoseTape::forget(int round) {
  poses.forget(round);
  near.forget(round);
  for (auto& [part, promised] : promises_)
    while (promised.size() > 2 &&
           std::next(promised.begin(), 2)->second.round + kRoundsKept < round)
      promised.erase(promised.begin());
}

const wire::BodyDirectory::Body* PoseTape::who_is(std::uint32_t number) const {
  const auto at = who_.find(number);
  return at == who_.end() ? nullptr : &at->second;
}

PoseTape::FoundPromise PoseTape::find_promise(std::uint32_t number, std::uint32_t last,
                                              double time_s) const {
  FoundPromise found;
  const auto part = promises_.find(number / wire::kBodiesPerPromise);
  if (part == promises_.end()) return found;
  auto at = part->second.upper_bound(promise_numbers_.place_of(last));
  for (int heard = 0; heard < 2 && at != part->second.begin();) {
    --at;
    const std::optional<wire::BodyPromise> promise = promise_in(at->second.message, number);
    if (!promise) continue;
    ++heard;
    found.is_known = true;
    if (promise->radius_m(time_s) && (!found.holds || found.holds->from_s < promise->from_s))
      found.holds = promise;
  }
  return found;
}

std::optional<wire::BodyPromise> PoseTape::promise_in(const wire::BodyPromises& message,
                                                      std::uint32_t number) const {
  const auto who = who_.find(number);
  if (who == who_.end() || who->second.max_speed_mps <= 0) return std::nullopt;
  for (const wire::BodyPromises::Body& body : message.bodies)
    if (body.number == number) return wire::promise_of(message, body, who->second);
  return std::nullopt;
}

}  // namespace nearmesh::subscriber
