// SPDX-License-Identifier: Apache-2.0
#include "writer_books.hpp"

#include <algorithm>
#include <utility>

namespace nearmesh::wire {

// --- SessionBook

SessionBook::Claim SessionBook::claim(SessionId session, const Handle& writer,
                                      Microseconds received) {
  const auto gone = gone_.find(writer);
  if (gone != gone_.end() && received <= gone->second) return Claim::kStale;
  const auto by_writer = writers_.find(writer);
  if (by_writer != writers_.end())
    return by_writer->second == session ? Claim::kKnown : Claim::kTaken;
  if (sessions_.contains(session)) return Claim::kTaken;
  writers_.emplace(writer, session);
  sessions_.emplace(session, writer);
  return Claim::kNew;
}

std::optional<SessionId> SessionBook::forget(const Handle& writer, Microseconds when) {
  gone_[writer] = when;
  if (gone_.size() > kMaxGone)
    gone_.erase(std::min_element(gone_.begin(), gone_.end(),
                                 [](const auto& a, const auto& b) { return a.second < b.second; }));
  const auto found = writers_.find(writer);
  if (found == writers_.end()) return std::nullopt;
  const SessionId session = found->second;
  sessions_.erase(session);
  writers_.erase(found);
  return session;
}

std::optional<Handle> SessionBook::writer_of(SessionId session) const {
  const auto found = sessions_.find(session);
  return found == sessions_.end() ? std::nullopt : std::optional(found->second);
}

void SessionBook::release(SessionId session) {
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return;
  writers_.erase(found->second);
  sessions_.erase(found);
}

std::vector<SessionId> SessionBook::clear() {
  std::vector<SessionId> known;
  for (const auto& [session, writer] : sessions_) known.push_back(session);
  *this = {};
  return known;
}

// --- HelloMemory

void HelloMemory::heard(const Hello& hello, const Handle& writer) {
  // Of a writer that is found again it may be read before the match, and be taken for one from
  // before the loss where the clock was set back meanwhile: it then counts with the match.
  bool gone = false;
  std::erase_if(known_, [&](const Known& known) {
    if (known.writer != writer) return false;
    gone = known.gone;
    return true;
  });
  known_.push_back({hello, writer, gone});
  if (known_.size() > kMaxKnown) known_.pop_front();
}

void HelloMemory::lost(const Handle& writer) {
  for (Known& known : known_)
    if (known.writer == writer) known.gone = true;
}

const Hello* HelloMemory::found(const Handle& writer) {
  for (Known& known : known_)
    if (known.writer == writer && std::exchange(known.gone, false)) return &known.hello;
  return nullptr;
}

// --- SilenceWatch

void SilenceWatch::matched(const Handle& writer, double now_s) {
  if (!heard_.contains(writer)) waiting_.emplace(writer, now_s);
}

void SilenceWatch::heard(const Handle& writer) {
  heard_.insert(writer);
  waiting_.erase(writer);
}

void SilenceWatch::gone(const Handle& writer) {
  heard_.erase(writer);
  waiting_.erase(writer);
}

std::vector<Handle> SilenceWatch::take_silent(double now_s) {
  std::vector<Handle> silent;
  std::erase_if(waiting_, [&](const auto& waiting) {
    if (now_s - waiting.second < patience_s_) return false;
    silent.push_back(waiting.first);
    return true;
  });
  return silent;
}

}  // namespace nearmesh::wire
