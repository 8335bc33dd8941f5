// SPDX-License-Identifier: Apache-2.0
#include "dds_poses.hpp"

#include <utility>

namespace nearmesh::subscriber {
namespace {

constexpr std::size_t kMaxContestedBodies = 64;

}  // namespace

std::vector<wire::BodyPose> DdsPoses::take(const std::vector<wire::ReaderListener::Match>& matches,
                                           std::vector<Heard> heard, bool more) {
  std::vector<wire::BodyPose> accepted;
  for (const auto& event : matches)
    if (event.gone) gone_movers_.push_back(event.writer);
  for (Heard& one : heard) accept(std::move(one), accepted);
  // What a writer said before it went is taken before it is forgotten, or it would claim its bodies again.
  if (more || gone_movers_.empty()) return accepted;
  for (const wire::Handle& writer : std::exchange(gone_movers_, {})) {
    bodies_.forget(writer);
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
    accepted.push_back(std::move(heard.pose));
    return;
  }
  const auto known = contested_.find(body);
  if (known != contested_.end()) {
    known->second = std::move(heard);
    return;
  }
  if (contested_.size() >= kMaxContestedBodies) return;
  mailbox_.complain(topic_ + ": body " + body + " of " + wire::name_of(heard.writer) +
                    (claim == wire::BodyBook::Claim::kFull
                         ? " is one too many, its poses are ignored"
                         : " is moved by another peer already, these poses are ignored"));
  contested_.emplace(body, std::move(heard));
}

void DdsPoses::clear() {
  bodies_.clear();
  gone_movers_.clear();
  contested_.clear();
}

}  // namespace nearmesh::subscriber
