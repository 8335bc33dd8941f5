// SPDX-License-Identifier: Apache-2.0
#include "routes.hpp"

#include <algorithm>
#include <cstring>
#include <iterator>
#include <string_view>

#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::wire {
namespace {

/// Sessions of this process that write routed samples.
struct Writers {
  std::mutex mutex;
  std::map<SessionId, Routes*> of;
};
Writers& writers() {
  static auto* all = new Writers;  // never destroyed: threads of Fast DDS may outlive main()
  return *all;
}

/// Of a sample in plain CDR, as this machine writes it. Precondition: it is long enough.
template <class Number>
Number number_at(std::span<const std::uint8_t> cdr, std::size_t at) {
  Number number{};
  std::memcpy(&number, cdr.data() + at, sizeof number);
  return number;
}

// Where the fields stand, behind the four bytes of the encapsulation: nearmesh.idl.
constexpr std::size_t kPlacesAt = 6, kPartAt = 8, kPeerAt = 12, kNearBytes = 20;
constexpr std::size_t kWanterAt = 12, kMoverAt = 20, kWantedBytes = 28;

using Gets = bool (*)(Routes& routes, std::span<const std::uint8_t> cdr,
                      const Routes::Participant& reader);

class RoutesFilter : public fdds::IContentFilter {
 public:
  /// The session that writes stands at `session_at`.
  RoutesFilter(std::size_t session_at, std::size_t least_bytes, Gets gets)
      : session_at_(session_at), least_bytes_(least_bytes), gets_(gets) {}

  bool evaluate(const SerializedPayload& payload, const FilterSampleInfo&,
                const GUID_t& reader) const override {
    const std::span<const std::uint8_t> cdr(payload.data, payload.length);
    if (cdr.size() < least_bytes_ || cdr[1] != 1) return true;
    Writers& all = writers();
    const std::lock_guard lock(all.mutex);
    const auto own = all.of.find(number_at<SessionId>(cdr, session_at_));
    if (own == all.of.end()) return true;  // at a reader: the writer has chosen
    return gets_(*own->second, cdr, Routes::participant_of(Handle(reader)));
  }

 private:
  const std::size_t session_at_, least_bytes_;
  const Gets gets_;
};

class Filters : public fdds::IContentFilterFactory {
 public:
  ReturnCode create_content_filter(const char* name, const char* type, const fdds::TopicDataType*,
                                   const char*, const ParameterSeq&,
                                   fdds::IContentFilter*& filter) override {
    if (std::string_view(name) != kRoutesFilter || type == nullptr) return unsupported();
    if (filter != nullptr) return {};  // nothing that could change
    if (type == topic_of<NearPoses>().type) {
      filter = &near_;
    } else if (type == topic_of<WantedPoses>().type) {
      filter = &wanted_;
    } else {
      return unsupported();
    }
    return {};
  }
  ReturnCode delete_content_filter(const char*, fdds::IContentFilter*) override { return {}; }

 private:
  RoutesFilter near_{kPeerAt, kNearBytes, [](Routes& routes, auto cdr, const auto& reader) {
                       return routes.gets_near_poses(cdr, reader);
                     }};
  RoutesFilter wanted_{kWanterAt, kWantedBytes, [](Routes& routes, auto cdr, const auto& reader) {
                         return routes.gets_wanted_poses(cdr, reader);
                       }};
};

}  // namespace

fdds::IContentFilterFactory& routes_filters() {
  static auto* all = new Filters;  // as writers()
  return *all;
}

Routes::Participant Routes::participant_of(const Handle& endpoint) {
  Participant participant{};
  for (std::size_t i = 0; i < participant.size(); ++i) participant[i] = endpoint.value[i];
  return participant;
}

Routes::Routes(SessionId own) : own_(own) {
  const std::lock_guard lock(writers().mutex);
  writers().of[own_] = this;
}

Routes::~Routes() {
  const std::lock_guard lock(writers().mutex);
  writers().of.erase(own_);
}

void Routes::want(const WantedPoses& wanted, const Participant& from) {
  const std::lock_guard lock(mutex_);
  const auto now = std::chrono::steady_clock::now();
  std::erase_if(wishes_, [&](const auto& entry) {
    return now - entry.second.heard > std::chrono::duration<double>(kWantedFor_s);
  });
  const std::pair whose{from, wanted.peer};
  if (wanted.parts.empty()) {
    wishes_.erase(whose);
  } else if (wishes_.size() < kMaxPeers || wishes_.contains(whose)) {
    wishes_[whose] = {wanted, now};
  }
}

void Routes::find(SessionId session, const Participant& at) {
  const std::lock_guard lock(mutex_);
  if (places_.size() >= kMaxPeers && !places_.contains(session)) return;
  std::set<Participant>& known = places_[session];
  if (known.size() <= kMaxPlaces) known.insert(at);
}

/// Where there were too many not all of them are known: it stays so.
void Routes::lose(const Participant& at) {
  const std::lock_guard lock(mutex_);
  for (auto place = places_.begin(); place != places_.end();) {
    std::set<Participant>& known = place->second;
    if (known.size() <= kMaxPlaces) known.erase(at);
    place = known.empty() ? places_.erase(place) : std::next(place);
  }
}

void Routes::clear() {
  const std::lock_guard lock(mutex_);
  wishes_.clear();
  places_.clear();
}

std::map<SessionId, std::uint64_t> Routes::sent() const {
  const std::lock_guard lock(mutex_);
  return sent_;
}

bool Routes::gets_near_poses(std::span<const std::uint8_t> cdr, const Participant& reader) {
  const std::lock_guard lock(mutex_);
  const auto places = cdr[kPlacesAt];
  const auto part = number_at<std::uint32_t>(cdr, kPartAt);
  const auto now = std::chrono::steady_clock::now();
  bool is_wanted = false;
  for (auto at = wishes_.lower_bound({reader, 0}); at != wishes_.end() && at->first.first == reader;
       ++at) {
    const SessionId peer = at->first.second;
    const Wish& wish = at->second;
    if (now - wish.heard > std::chrono::duration<double>(kWantedFor_s)) continue;
    const bool is_its = std::any_of(wish.wanted.parts.begin(), wish.wanted.parts.end(),
                                    [&](const WantedPoses::Part& one) {
                                      return one.part == part && (one.places & places) != 0;
                                    });
    if (is_its) {
      if (sent_.size() >= kMaxPeers && !sent_.contains(peer)) forget_who_wants_nothing();
      ++sent_[peer];
    }
    is_wanted |= is_its;
  }
  return is_wanted;
}

/// No more peers than are counted have wishes, and one of these is not. The mutex is held.
void Routes::forget_who_wants_nothing() {
  std::set<SessionId> want;
  for (const auto& [whose, wish] : wishes_) want.insert(whose.second);
  std::erase_if(sent_, [&](const auto& entry) { return !want.contains(entry.first); });
}

bool Routes::gets_wanted_poses(std::span<const std::uint8_t> cdr, const Participant& reader) const {
  const std::lock_guard lock(mutex_);
  const auto place = places_.find(number_at<SessionId>(cdr, kMoverAt));
  return place == places_.end() || place->second.size() > kMaxPlaces ||
         place->second.contains(reader);
}

// --- Wishers

Wishers::Claim Wishers::claim(SessionId peer, const Handle& writer, Time now) {
  const auto has_ended = [now](const Held& held) {
    return now - held.heard > std::chrono::duration<double>(kWantedFor_s);
  };
  if (const auto known = held_.find(peer); known != held_.end()) {
    if (known->second.writer != writer && !has_ended(known->second)) return Claim::kOthers;
    known->second = {writer, now};
    return Claim::kOwn;
  }
  // Counted where somebody is new alone.
  std::erase_if(held_, [&](const auto& entry) { return has_ended(entry.second); });
  const auto of_one = std::count_if(
      held_.begin(), held_.end(), [&](const auto& entry) { return entry.second.writer == writer; });
  if (held_.size() >= Routes::kMaxPeers || static_cast<std::size_t>(of_one) >= kMaxOfOne)
    return Claim::kFull;
  held_[peer] = {writer, now};
  return Claim::kOwn;
}

void Wishers::forget(const Handle& writer) {
  std::erase_if(held_, [&](const auto& entry) { return entry.second.writer == writer; });
}

}  // namespace nearmesh::wire
