// SPDX-License-Identifier: Apache-2.0
#include "dds_hellos.hpp"

#include <utility>

#include "idl/dds/endpoint_names.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber {

using wire::Handle;
using wire::Microseconds;
using wire::SessionId;

namespace {

constexpr std::size_t kMaxContested = 64;
constexpr double kSilence_s = 5;  ///< of a publisher that was matched; it may still read its models

}  // namespace

DdsHellos::DdsHellos(wire::Mailbox& mailbox, std::string topic)
    : mailbox_(mailbox), topic_(std::move(topic)), silence_(kSilence_s) {}

std::vector<SessionId> DdsHellos::take(const std::vector<wire::ReaderListener::Match>& matches,
                                       std::vector<Heard> heard) {
  std::vector<SessionId> lost;
  for (const auto& event : matches) {
    if (event.is_gone()) {
      if (const auto session = lose(event)) lost.push_back(*session);
    } else {
      welcome(event.writer);
    }
  }
  for (const Heard& one : heard) {
    memory_.heard(one.hello, one.writer);
    accept(one.hello, one.writer, one.received);
  }
  return lost;
}

std::optional<SessionId> DdsHellos::lose(const wire::ReaderListener::Match& event) {
  writers_.erase(event.writer);
  silence_.gone(event.writer);
  memory_.lost(event.writer);
  const auto is_its = [&](const Said& said) { return said.writer == event.writer; };
  std::erase_if(waiting_, is_its);
  // Who contested a session and left is nobody's writer any more: with the session it would keep
  // that from who bears it.
  std::erase_if(contested_, is_its);
  const std::optional<SessionId> lost = book_.forget(event.writer, event.when);
  if (!lost) return lost;
  // A publisher that joined anew may be heard before its old self is gone.
  for (const Said& contested : std::exchange(contested_, {}))
    accept(contested.hello, contested.writer, wire::now_us());
  mailbox_.wake();
  return lost;
}

void DdsHellos::welcome(const Handle& writer) {
  book_.welcome(writer);
  writers_.insert(writer);
  silence_.matched(writer, clock_.seconds());
  if (const wire::Hello* known = memory_.found(writer)) {
    silence_.heard(writer);
    accept(*known, writer, wire::now_us());
  }
  mailbox_.wake();  // subscriptions may have waited for it
}

void DdsHellos::accept(const wire::Hello& hello, const Handle& writer, Microseconds received) {
  switch (book_.claim(hello.publisher, writer, received)) {
    case wire::SessionBook::Claim::kStale:
      return;
    case wire::SessionBook::Claim::kNew:
    case wire::SessionBook::Claim::kKnown:
      std::erase_if(waiting_, [&](const Said& waiting) { return waiting.writer == writer; });
      waiting_.push_back({hello, writer});
      return;
    case wire::SessionBook::Claim::kTaken:
      break;
  }
  mailbox_.complain(topic_ + ": publisher " + wire::partition_of(hello.publisher) +
                    " is heard from " + wire::name_of(writer, mailbox_) +
                    " too, which is ignored while the first is there");
  std::erase_if(contested_, [&](const Said& contested) { return contested.writer == writer; });
  if (contested_.size() < kMaxContested) contested_.push_back({hello, writer});
}

void DdsHellos::complain_of_silence() {
  for (const Handle& writer : silence_.take_silent(clock_.seconds()))
    mailbox_.complain("publisher " + wire::name_of(writer, mailbox_) + wire::kSilentHint);
}

std::vector<SessionId> DdsHellos::clear() {
  waiting_.clear();
  contested_.clear();
  for (const Handle& writer : writers_) silence_.gone(writer);
  writers_.clear();
  return book_.clear();
}

}  // namespace nearmesh::subscriber
