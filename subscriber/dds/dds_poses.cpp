// SPDX-License-Identifier: Apache-2.0
#include "dds_poses.hpp"

#include <algorithm>
#include <utility>

#include "idl/dds/endpoint_names.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::size_t kMaxContestedBodies = 64;

}  // namespace

PartKey DdsPoses::key_of(const wire::Handle& writer, wire::SessionId peer, std::uint32_t part) {
  return {wire::Routes::participant_of(writer), peer, part};
}

/// As of bodies (body_book.hpp): on a secured bus an identity, which is more than one of its
/// programs.
Participant DdsPoses::speaker_of(const wire::Handle& writer) const {
  Participant speaker = wire::Routes::participant_of(writer);
  if (is_secured_) std::fill(speaker.begin() + wire::kIdentityBytes, speaker.end(), 0);
  return speaker;
}

bool DdsPoses::may_speak_for(wire::SessionId session, const wire::Handle& writer) const {
  const Participant* const known = sessions_.group_of(session);
  return known == nullptr || *known == speaker_of(writer);
}

bool DdsPoses::claim_session(wire::SessionId session, const wire::Handle& writer) {
  if (may_speak_for(session, writer)) {
    if (sessions_.use(session) == nullptr) sessions_.put(session, {}, speaker_of(writer));
    return true;
  }
  ++refused_;
  const std::pair stranger(session, wire::Routes::participant_of(writer));
  if (strangers_.use(stranger) == nullptr) {
    strangers_.put(stranger, {});
    mailbox_.complain(topic_ + ": what " + wire::name_of(writer, mailbox_) +
                      " says of bodies in the name of peer " + wire::partition_of(session) +
                      " is ignored: that is another participant, and is there");
  }
  return false;
}

void DdsPoses::take_directories(const std::vector<wire::ReaderListener::Match>& matches,
                                std::vector<HeardDirectory> heard, bool more) {
  for (const auto& event : matches) {
    if (!event.is_gone()) {
      find_teller(event.writer);
      continue;
    }
    gone_tellers_.emplace_back(event.writer, event.now == wire::Mover::kBarred);
    gone_movers_.emplace_back(event.writer, event.now);
  }
  for (HeardDirectory& one : heard) know(std::move(one));
  if (more) return;
  for (const auto& [gone, is_barred] : std::exchange(gone_tellers_, {}))
    lose_teller(gone, is_barred);
}

/// It has fallen silent, or its lease is over. When it is found again Fast DDS does not send what
/// was sent before.
void DdsPoses::lose_teller(const wire::Handle& writer, bool is_barred) {
  if (is_barred) {
    forget_teller(writer);
    return;
  }
  for (auto& [key, part] : parts_)
    if (part.writer == writer) part.is_absent = true;
  if (is_absent(writer)) return;
  if (absent_.size() == kMaxAbsent) forget_teller(absent_.front());
  absent_.push_back(writer);
}

void DdsPoses::find_teller(const wire::Handle& writer) {
  std::erase_if(gone_tellers_, [&](const auto& gone) { return gone.first == writer; });
  if (!is_absent(writer)) return;
  std::erase(absent_, writer);
  for (auto& [key, part] : parts_) {
    if (part.writer != writer) continue;
    part.is_absent = false;
    told_parts_.push_back(key);
  }
}

void DdsPoses::forget_teller(wire::Handle writer) {
  std::erase_if(parts_, [&](const auto& entry) { return entry.second.writer == writer; });
  part_counts_.erase(writer);
  over_full_.erase(writer);
  std::erase(absent_, writer);
}

bool DdsPoses::is_absent(const wire::Handle& writer) const {
  return std::find(absent_.begin(), absent_.end(), writer) != absent_.end();
}

/// Nothing is kept of a part without bodies: in a long exercise a mover has had many, and who joins
/// late hears of each.
void DdsPoses::know(HeardDirectory&& heard) {
  const wire::BodyDirectory& directory = heard.directory;
  // It claims no session, as poses and promises do: it may be a stranger's, and come first. It is
  // kept all the same: a peer that joined anew says it once, and its old self may not be missed
  // yet.
  const bool is_of_absent = is_absent(heard.writer);
  const PartKey key = key_of(heard.writer, directory.peer, directory.part);
  const auto known = parts_.find(key);
  if (known == parts_.end()) {
    if (directory.bodies.empty()) return;
    while (parts_.size() >= kMaxParts && !absent_.empty()) forget_teller(absent_.front());
    std::size_t& count = part_counts_[heard.writer];
    if (count >= kMaxPartsOfOne || parts_.size() >= kMaxParts) {
      if (over_full_.insert(heard.writer).second)
        mailbox_.complain(
            topic_ + ": " + wire::name_of(heard.writer, mailbox_) +
            " tells of more bodies than are kept, the poses of the others are ignored");
      return;
    }
    ++count;
  } else if (known->second.writer == heard.writer) {
    change_bodies(directory.peer, known->second, directory.bodies);
  }
  if (directory.bodies.empty()) {
    // Another writer may have told of it first, and is gone.
    if (std::size_t& count = part_counts_[known->second.writer]; count > 0) --count;
    parts_.erase(known);
    return;
  }
  parts_[key] = {heard.writer, std::move(heard.directory.bodies), is_of_absent};
  told_parts_.push_back(key);
}

/// Who removes a body moves it no more: its name is free again. One that is told otherwise was
/// there all the time.
void DdsPoses::change_bodies(wire::SessionId peer, const Part& before,
                             const std::vector<wire::BodyDirectory::Body>& now) {
  for (const wire::BodyDirectory::Body& body : before.bodies) {
    const auto moved = moved_.find(body.name);
    if (moved == moved_.end() || moved->second.body != body || moved->second.session != peer ||
        !wire::have_one_participant(moved->second.writer, before.writer))
      continue;
    const auto same = std::find_if(now.begin(), now.end(), [&](const auto& other) {
      return other.number == body.number && other.name == body.name;
    });
    if (same != now.end()) {
      if (*same != body) told_.push_back({*same, false});
      moved->second.body = *same;
      continue;
    }
    told_.push_back({body, true});
    changes_[body.name] = wire::Mover::kLeft;
    ended_.insert(body.name);
    bodies_.release(body.name, moved->second.writer);
    moved_.erase(moved);
    has_released_ = true;
  }
}

std::pair<const wire::BodyDirectory::Body*, const DdsPoses::Part*> DdsPoses::find(
    const wire::Handle& writer, wire::SessionId peer, std::uint32_t number) const {
  const auto part = parts_.find(key_of(writer, peer, number / wire::kBodiesPerPart));
  if (part == parts_.end() || part->second.is_absent) return {};
  for (const wire::BodyDirectory::Body& told : part->second.bodies)
    if (told.number == number) return {&told, &part->second};
  return {};
}

void DdsPoses::hear_promises(std::vector<HeardPromises> heard) {
  for (const auto& [participant, peer, part] : told_parts_) {
    const std::uint32_t first = part * wire::kBodiesPerPart,
                        last = first + wire::kBodiesPerPart - 1;
    for (std::uint32_t of = first / wire::kBodiesPerPromise; of <= last / wire::kBodiesPerPromise;
         ++of)
      if (auto waiting = unnamed_promises_.extract({participant, peer, of}))
        name(std::move(*waiting));
  }
  for (HeardPromises& one : heard) name(std::move(one));
}

/// As of poses. A promise of a body without a greatest speed says nothing.
void DdsPoses::name(HeardPromises&& heard) {
  const PartKey key = key_of(heard.writer, heard.promises.peer, heard.promises.part);
  bool all = true;
  for (const wire::BodyPromises::Body& one : heard.promises.bodies) {
    const auto [body, part] = find(heard.writer, heard.promises.peer, one.number);
    if (body == nullptr) {
      all = false;
    } else if (body->max_speed_mps > 0) {
      accept(NamedPromise{wire::promise_of(heard.promises, one, *body), part->writer, *body});
    }
  }
  unnamed_promises_.erase(key);
  if (!all) unnamed_promises_.put(key, std::move(heard), std::get<0>(key));
}

void DdsPoses::accept(NamedPromise&& heard) {
  const std::string body = heard.promise.body;
  if (is_of_mover(heard.body, heard.promise.peer, heard.writer)) {
    promises_.push_back(std::move(heard.promise));
  } else if (contested_promises_.contains(body) ||
             contested_promises_.size() < kMaxContestedBodies) {
    contested_promises_.insert_or_assign(body, std::move(heard));
  }
}

std::vector<wire::BodyPose> DdsPoses::take(std::vector<Heard> heard, bool more) {
  std::vector<wire::BodyPose> accepted;
  for (const PartKey& part : std::exchange(told_parts_, {}))
    if (auto waiting = unnamed_.extract(part)) name(std::move(*waiting), accepted);
  for (Heard& one : heard) name(std::move(one), accepted);
  if (std::exchange(has_released_, false)) accept_contested(accepted);
  // What a writer said before it went is taken before it is forgotten, or it would claim its bodies
  // again.
  if (more || gone_movers_.empty()) return accepted;
  std::set<std::string> lost;
  for (const auto& gone : std::exchange(gone_movers_, {})) {
    const wire::Handle& writer = gone.first;
    bodies_.forget(writer);
    if (!is_secured_) sessions_.erase_group(speaker_of(writer));
    lost.merge(lose(writer, gone.second));
    std::erase_if(contested_, [&](const auto& c) { return c.second.writer == writer; });
    std::erase_if(contested_promises_, [&](const auto& c) { return c.second.writer == writer; });
    const Participant participant = wire::Routes::participant_of(writer);
    unnamed_.erase_group(participant);
    unnamed_promises_.erase_group(participant);
  }
  const auto is_lost = [&](const auto& said) { return lost.contains(said.body); };
  std::erase_if(accepted, is_lost);
  std::erase_if(promises_, is_lost);
  ended_.merge(lost);
  // A peer that started again may be heard before its old self is gone.
  accept_contested(accepted);
  return accepted;
}

/// Whoever waited may have removed its body meanwhile: what it said of that would claim the name
/// for a body that is not there, and the poses of one that is would be ignored.
void DdsPoses::accept_contested(std::vector<wire::BodyPose>& accepted) {
  const auto is_told = [this](const wire::Handle& writer, wire::SessionId peer,
                              wire::BodyDirectory::Body& body) {
    const wire::BodyDirectory::Body* now = find(writer, peer, body.number).first;
    if (now == nullptr || now->name != body.name) return false;
    body = *now;
    return true;
  };
  for (auto& [name, contested] : std::exchange(contested_, {}))
    if (is_told(contested.writer, contested.pose.peer, contested.body))
      accept(std::move(contested), accepted);
  for (auto& [name, contested] : std::exchange(contested_promises_, {}))
    if (is_told(contested.writer, contested.promise.peer, contested.body))
      accept(std::move(contested));
}

/// Whose number no directory tells yet waits: the two topics are not in one order.
void DdsPoses::name(Heard&& heard, std::vector<wire::BodyPose>& accepted) {
  const PartKey key = key_of(heard.writer, heard.poses.peer, heard.poses.part);
  bool all = true;
  for (const wire::BodyPoses::Body& pose : heard.poses.bodies) {
    const auto [body, part] = find(heard.writer, heard.poses.peer, pose.number);
    if (body == nullptr) {
      all = false;
      continue;
    }
    accept({.pose = {.peer = heard.poses.peer,
                     .body = body->name,
                     .frame = heard.poses.frame,
                     .time_s = pose.time_s,
                     .pose = pose.motion.pose,
                     .linear_velocity_mps = pose.motion.linear_velocity_mps,
                     .angular_velocity_radps = pose.motion.angular_velocity_radps,
                     .number = pose.number,
                     .sequence = heard.poses.sequence,
                     .is_near = heard.is_near,
                     .links = body->links,
                     .first_link = body->first_link},
            .writer = part->writer,
            .body = *body},
           accepted);
  }
  unnamed_.erase(key);
  if (!all) unnamed_.put(key, std::move(heard), std::get<0>(key));
}

bool DdsPoses::is_of_mover(const wire::BodyDirectory::Body& body, wire::SessionId peer,
                           const wire::Handle& writer) {
  if (!claim_session(peer, writer)) return false;
  const wire::BodyBook::Claim claim = bodies_.claim(body.name, writer);
  if (claim != wire::BodyBook::Claim::kOwn) {
    if (!contested_.contains(body.name) && !contested_promises_.contains(body.name) &&
        contested_.size() < kMaxContestedBodies)
      mailbox_.complain(topic_ + ": body " + body.name + " of " + wire::name_of(writer, mailbox_) +
                        (claim == wire::BodyBook::Claim::kFull
                             ? " is one too many, its poses are ignored"
                             : " is moved by another peer already, these poses are ignored"));
    return false;
  }
  const std::pair of_peer(peer, wire::Routes::participant_of(writer));
  if (sources_.use(of_peer) == nullptr) {
    sources_.put(of_peer, {}, of_peer.second);
    new_movers_.emplace_back(peer, writer);
  }
  Moved& moved = moved_[body.name];
  moved.writer = writer;
  moved.session = peer;
  if (moved.body != body) {
    told_.push_back({body, false});
    moved.body = body;
  }
  tell(body.name, moved, wire::Mover::kThere);
  return true;
}

void DdsPoses::accept(Named&& heard, std::vector<wire::BodyPose>& accepted) {
  const std::string body = heard.pose.body;
  if (is_of_mover(heard.body, heard.pose.peer, heard.writer)) {
    accepted.push_back(std::move(heard.pose));
  } else if (contested_.contains(body) || contested_.size() < kMaxContestedBodies) {
    contested_.insert_or_assign(body, std::move(heard));
  }
}

/// Out: the bodies that it moved.
std::set<std::string> DdsPoses::lose(const wire::Handle& writer, wire::Mover how) {
  sources_.erase_group(wire::Routes::participant_of(writer));
  std::set<std::string> lost;
  std::erase_if(moved_, [&](const auto& entry) {
    if (entry.second.writer != writer) return false;
    changes_[entry.first] = how;
    lost.insert(entry.first);
    bodies_.release(entry.first, writer);
    return true;
  });
  return lost;
}

void DdsPoses::tell(const std::string& body, Moved& moved, wire::Mover now) {
  if (std::exchange(moved.mover, now) != now) changes_[body] = now;
}

void DdsPoses::tell_movers(Channel::Inbox& inbox, std::size_t most) {
  for (auto& [body, mover] : std::exchange(changes_, {})) inbox.movers[body] = mover;
  if (inbox.movers.size() <= most) return;
  inbox.are_all_movers = true;
  inbox.movers.clear();
  for (const auto& [body, moved] : moved_) inbox.movers[body] = moved.mover;
}

void DdsPoses::tell_bodies(Channel::Inbox& inbox, std::size_t most) {
  for (Channel::Inbox::Told& told : std::exchange(told_, {}))
    inbox.bodies.push_back(std::move(told));
  if (inbox.bodies.size() <= most) return;
  inbox.are_all_bodies = true;
  inbox.bodies.clear();
  for (const auto& [body, moved] : moved_) inbox.bodies.push_back({moved.body, false});
}

void DdsPoses::clear() {
  sources_.clear();
  for (const auto& [body, moved] : std::exchange(moved_, {})) {
    changes_[body] = wire::Mover::kLeft;
    ended_.insert(body);
    bodies_.release(body, moved.writer);
  }
  bodies_.clear();
  if (!is_secured_) sessions_.clear();
  gone_movers_.clear();
  parts_.clear();
  part_counts_.clear();
  unnamed_.clear();
  told_parts_.clear();
  gone_tellers_.clear();
  absent_.clear();
  over_full_.clear();
  contested_.clear();
  contested_promises_.clear();
  unnamed_promises_.clear();
  promises_.clear();
  new_movers_.clear();
}

}  // namespace nearmesh::subscriber
