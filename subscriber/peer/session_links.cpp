// SPDX-License-Identifier: Apache-2.0
// Robots: bodies whose poses count together. Those that fit travel in one sample; of others each
// hearer takes the parts of an instant when all of them are here, and rests on the last whole one
// until then. An instant is one time in one update of the mover: of two updates of one time parts
// may be lost, and what is left of both is no robot.
#include <algorithm>
#include <utility>

#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// Instants of which not all has come: so many are waited for, of each robot.
constexpr std::size_t kMaxInstants = 8;
constexpr std::size_t kMaxRobots = 4096;
/// Nothing is on its way for longer. What is of a time so much before, with numbers of before, is
/// said anew: a recording is played in a loop, or from an earlier moment on.
constexpr double kMostLate_s = 10;

}  // namespace

Status Session::link_bodies(const std::vector<BodyId>& links) { return impl_->link_bodies(links); }

Status Session::Impl::link_bodies(const std::vector<BodyId>& links) {
  NEARMESH_RETURN_IF_ERROR(check_whole());
  if (links.size() < 2 || links.size() > wire::kMaxLinks)
    return {StatusCode::kInvalidArgument, "links of a robot: expected 2 to " +
                                              std::to_string(wire::kMaxLinks) + ", found " +
                                              std::to_string(links.size())};
  std::set<BodyId> distinct;
  for (const BodyId id : links) {
    const Body* body = find(id);
    if (body == nullptr) return no_such(id);
    const std::string link = "link " + body->name + ": ";
    if (!body->own || body->max_speed_mps > 0)
      return {StatusCode::kInvalidArgument,
              link + "expected a body that is moved here, without a max_speed_mps"};
    if (body->links > 1 || !distinct.insert(id).second)
      return {StatusCode::kConflict, link + "it is a link already"};
    if (body->motion)
      return {StatusCode::kConflict, link + "it was given a pose already, as a body of its own"};
  }
  const Change change(*this);
  // In as few samples as it takes.
  const auto count = static_cast<std::uint32_t>(links.size());
  const std::uint32_t place = next_number % wire::kBodiesPerPart;
  if (place + count > wire::kBodiesPerPart && place > 0)
    next_number += wire::kBodiesPerPart - place;
  const std::uint32_t first = next_number;
  for (const BodyId id : links) {
    Body& link = *find(id);
    untold_parts.insert(part_of(link));
    own_bodies.erase(own_from(link.number));
    link.number = next_number++;
    link.links = count;
    link.first_link = first;
    own_bodies.push_back(&link);
    untold_parts.insert(part_of(link));
  }
  return Status::ok();
}

/// Of a robot all links are given, or none.
Status Session::Impl::check_links(const std::vector<OwnMotion>& motions) const {
  std::map<std::uint32_t, std::set<std::uint32_t>> given;  // by first link
  std::map<std::uint32_t, const Body*> robots;
  for (const OwnMotion& own : motions) {
    const Body& body = *by_id[own.body.value];
    if (body.links == 1) continue;
    given[body.first_link].insert(body.number);
    robots[body.first_link] = &body;
  }
  for (const auto& [first, numbers] : given)
    if (const Body& link = *robots[first]; numbers.size() != link.links)
      return {StatusCode::kInvalidArgument,
              "the robot of link " + link.name + " has " + std::to_string(link.links) +
                  " links, of which " + std::to_string(numbers.size()) +
                  " were given motions: expected all, of one instant"};
  return Status::ok();
}

/// All that go out with it.
void Session::Impl::add_parts_of(const Body& own, std::vector<std::uint32_t>& parts) const {
  const std::uint32_t first = own.links > 1 ? own.first_link : own.number;
  for (std::uint32_t number = first; number < first + own.links; ++number)
    parts.push_back(number / wire::kBodiesPerPart);
}

void Session::Impl::take_link(const wire::BodyPose& pose, std::vector<std::string>& complaints) {
  if (pose.sequence == 0 || pose.is_near) return;  // nothing tells which others it goes with
  const std::pair robot(pose.peer, pose.first_link);
  if (heard_links.size() >= kMaxRobots && !heard_links.contains(robot)) forget_robots_of_nobody();
  if (heard_links.size() >= kMaxRobots && !heard_links.contains(robot)) return;
  HeardLinks& heard = heard_links[robot];
  const HeardLinks::Update update =
      wire::first_sample_of_robot(pose.sequence, pose.number, pose.first_link);
  HeardLinks::Instant& instant = heard.instants[{update, pose.time_s}];
  instant.insert_or_assign(pose.number, pose);
  const auto is_older = [](const auto& one, const auto& other) {
    return is_after(other.first.first, one.first.first);
  };
  if (instant.size() < pose.links) {
    if (heard.instants.size() > kMaxInstants)
      heard.instants.erase(
          std::min_element(heard.instants.begin(), heard.instants.end(), is_older));
    return;
  }
  // What was sent before what counts already is late.
  const bool is_said_anew = pose.time_s < heard.taken_s - kMostLate_s;
  if (is_said_anew || !is_after(heard.taken, update)) {
    heard.taken = update;
    heard.taken_s = pose.time_s;
    for (const auto& [number, link] : instant) take_pose(link, complaints);
  }
  std::erase_if(heard.instants,
                [&](const auto& entry) { return !is_after(entry.first.first, heard.taken); });
}

/// Those of which no body here is a link: their links are not looked at here, so nothing says when
/// they are gone. Of one that is there the next instant counts as the first did.
void Session::Impl::forget_robots_of_nobody() {
  if (std::exchange(looked_for_robots_in, updates) == updates) return;
  std::set<std::pair<wire::SessionId, std::uint32_t>> robots;
  for (const Body* body : present)
    if (body->heard_robot) robots.emplace(body->posed_by, *body->heard_robot);
  std::erase_if(heard_links, [&](const auto& entry) { return !robots.contains(entry.first); });
}

/// Its mover has left, or moves it no more.
void Session::Impl::forget_robot(Body& body) {
  if (body.heard_robot) heard_links.erase({body.posed_by, *body.heard_robot});
  body.heard_robot.reset();
}

}  // namespace nearmesh::subscriber
