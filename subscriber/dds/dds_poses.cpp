// SPDX-License-Identifier: Apache-2.0
#include "dds_poses.hpp"

#include <utility>

namespace nearmesh::subscriber {
namespace {

constexpr std::size_t kMaxContestedBodies = 64;
constexpr double kLook_s = 0.1;

}  // namespace

std::vector<wire::BodyPose> DdsPoses::take(const std::vector<wire::ReaderListener::Match>& matches,
                                           std::vector<Heard> heard, bool more) {
  std::vector<wire::BodyPose> accepted;
  for (const auto& event : matches)
    if (event.gone)
      gone_movers_.emplace_back(event.writer,
                                event.barred ? wire::Mover::kBarred : wire::Mover::kLeft);
  for (Heard& one : heard) accept(std::move(one), accepted);
  look_for_silent();
  // What a writer said before it went is taken before it is forgotten, or it would claim its bodies again.
  if (more || gone_movers_.empty()) return accepted;
  for (const auto& gone : std::exchange(gone_movers_, {})) {
    const wire::Handle& writer = gone.first;
    bodies_.forget(writer);
    lose(writer, gone.second);
    std::erase_if(contested_, [&](const auto& c) { return c.second.writer == writer; });
  }
  // A peer that started again may be heard before its old self is gone.
  for (auto& [body, contested] : std::exchange(contested_, {}))
    accept(std::move(contested), accepted);
  return accepted;
}

void DdsPoses::accept(Heard&& heard, std::vector<wire::BodyPose>& accepted) {
  const std::string body = heard.pose.body;
  const wire::BodyBook::Claim claim = bodies_.claim(body, heard.writer);
  if (claim == wire::BodyBook::Claim::kOwn) {
    Source& source = sources_[heard.writer];
    source.session = heard.pose.peer;
    source.heard_s = clock_.seconds();
    Moved& moved = moved_[body];
    moved.writer = heard.writer;
    tell(body, moved, wire::Mover::kThere);
    accepted.push_back(std::move(heard.pose));
    return;
  }
  const auto known = contested_.find(body);
  if (known != contested_.end()) {
    known->second = std::move(heard);
    return;
  }
  if (contested_.size() >= kMaxContestedBodies) return;
  mailbox_.complain(topic_ + ": body " + body + " of " + wire::name_of(heard.writer, mailbox_) +
                    (claim == wire::BodyBook::Claim::kFull
                         ? " is one too many, its poses are ignored"
                         : " is moved by another peer already, these poses are ignored"));
  contested_.emplace(body, std::move(heard));
}

/// A session's name is not enough: anybody can say it.
void DdsPoses::hear_sign(wire::SessionId session, const wire::Handle& writer) {
  for (auto& [pose_writer, source] : sources_) {
    if (source.session != session || !wire::have_one_participant(pose_writer, writer)) continue;
    source.heard_s = clock_.seconds();
    source.gives_signs = true;
  }
}

void DdsPoses::look_for_silent() {
  const double now_s = clock_.seconds();
  if (now_s - looked_s_ < kLook_s) return;
  looked_s_ = now_s;
  for (auto& [body, moved] : moved_) {
    const auto source = sources_.find(moved.writer);
    if (source == sources_.end() || !source->second.gives_signs) continue;
    const bool is_silent = now_s - source->second.heard_s >= silence_s_;
    tell(body, moved, is_silent ? wire::Mover::kSilent : wire::Mover::kThere);
  }
}

void DdsPoses::lose(const wire::Handle& writer, wire::Mover how) {
  sources_.erase(writer);
  std::erase_if(moved_, [&](const auto& entry) {
    if (entry.second.writer != writer) return false;
    changes_[entry.first] = how;
    return true;
  });
}

void DdsPoses::tell(const std::string& body, Moved& moved, wire::Mover now) {
  if (std::exchange(moved.mover, now) != now) changes_[body] = now;
}

std::map<std::string, wire::Mover> DdsPoses::take_changes() { return std::exchange(changes_, {}); }

void DdsPoses::clear() {
  sources_.clear();
  for (const auto& [body, moved] : std::exchange(moved_, {})) changes_[body] = wire::Mover::kLeft;
  bodies_.clear();
  gone_movers_.clear();
  contested_.clear();
}

}  // namespace nearmesh::subscriber
