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

BodyBook::Claim BodyBook::claim(const std::string& body, const Handle& writer) {
  const Owner owner = owner_of(writer);
  if (const auto known = owners_.find(body); known != owners_.end())
    return known->second == owner ? Claim::kOwn : Claim::kOthers;
  if (owners_.size() >= kMaxOfAll) return Claim::kFull;
  std::size_t& count = counts_[owner];
  if (count >= kMaxOfOne) return Claim::kFull;
  ++count;
  owners_.emplace(body, owner);
  return Claim::kOwn;
}

void BodyBook::release(const std::string& body, const Handle& writer) {
  const auto known = owners_.find(body);
  if (authenticated_ || known == owners_.end() || known->second != owner_of(writer)) return;
  --counts_[known->second];
  owners_.erase(known);
}

void BodyBook::forget(const Handle& writer) {
  if (authenticated_) return;
  const Owner owner = owner_of(writer);
  if (counts_.erase(owner) == 0) return;
  std::erase_if(owners_, [&](const auto& known) { return known.second == owner; });
}

void BodyBook::clear() {
  if (authenticated_) return;
  owners_.clear();
  counts_.clear();
}

}  // namespace nearmesh::wire
