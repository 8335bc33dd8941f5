// SPDX-License-Identifier: Apache-2.0
#include "body_book.hpp"

#include <algorithm>

namespace nearmesh::wire {

namespace {
/// Leading bytes of a participant's identifier that an identity decides.
constexpr std::size_t kIdentityBytes = 6;
}  // namespace

BodyBook::Owner BodyBook::owner_of(const Handle& writer) const {
  Owner owner{};
  const std::size_t count = authenticated_ ? kIdentityBytes : owner.size();
  for (std::size_t i = 0; i < count; ++i) owner[i] = writer.value[i];
  return owner;
}

/// Out: false where all are moved.
bool BodyBook::drop_longest_released(Owned& owned) {
  const auto longest = owned.released.begin();
  if (longest == owned.released.end()) return false;
  bodies_.erase(longest->second);
  owned.released.erase(longest);
  --owned.count;
  return true;
}

/// Null where nobody has one.
BodyBook::Owned* BodyBook::longest_released() {
  Owned* longest = nullptr;
  for (auto& [owner, owned] : owners_)
    if (!owned.released.empty() &&
        (longest == nullptr || owned.released.begin()->first < longest->released.begin()->first))
      longest = &owned;
  return longest;
}

BodyBook::Claim BodyBook::claim(const std::string& body, const Handle& writer) {
  const Owner owner = owner_of(writer);
  if (const auto known = bodies_.find(body); known != bodies_.end()) {
    if (known->second.owner != owner) return Claim::kOthers;
    if (known->second.released != 0) owners_[owner].released.erase(known->second.released);
    known->second.released = 0;
    return Claim::kOwn;
  }
  if (const auto has = owners_.find(owner);
      has != owners_.end() && has->second.count >= kMaxOfOne && !drop_longest_released(has->second))
    return Claim::kFull;
  if (bodies_.size() >= kMaxOfAll) {
    Owned* const longest = longest_released();
    if (longest == nullptr || !drop_longest_released(*longest)) return Claim::kFull;
  }
  ++owners_[owner].count;
  bodies_.emplace(body, Kept{owner});
  return Claim::kOwn;
}

void BodyBook::release(const std::string& body, const Handle& writer) {
  const auto known = bodies_.find(body);
  if (known == bodies_.end() || known->second.owner != owner_of(writer)) return;
  Owned& owned = owners_[known->second.owner];
  if (!authenticated_) {
    --owned.count;
    bodies_.erase(known);
  } else if (known->second.released == 0) {
    owned.released.emplace(++releases_, body);
    known->second.released = releases_;
  }
}

void BodyBook::forget(const Handle& writer) {
  if (authenticated_) return;
  const Owner owner = owner_of(writer);
  if (owners_.erase(owner) == 0) return;
  std::erase_if(bodies_, [&](const auto& known) { return known.second.owner == owner; });
}

void BodyBook::clear() {
  if (authenticated_) return;
  bodies_.clear();
  owners_.clear();
}

}  // namespace nearmesh::wire
