// SPDX-License-Identifier: Apache-2.0
#include "body_book.hpp"

namespace nearmesh::wire {

BodyBook::Owner BodyBook::owner_of(const Handle& writer) const {
  Owner owner{};
  const std::size_t count = authenticated_ ? kIdentityBytes : owner.size();
  for (std::size_t i = 0; i < count; ++i) owner[i] = writer.value[i];
  return owner;
}

BodyBook::Claim BodyBook::claim(const std::string& body, const Handle& writer) {
  const Owner owner = owner_of(writer);
  if (const Owner* const known = bodies_.group_of(body)) {
    if (*known != owner) return Claim::kOthers;
  } else if (bodies_.put(body, {}, owner) == nullptr) {
    return Claim::kFull;
  }
  bodies_.pin(body);
  return Claim::kOwn;
}

void BodyBook::release(const std::string& body, const Handle& writer) {
  const Owner* const known = bodies_.group_of(body);
  if (known == nullptr || *known != owner_of(writer)) return;
  if (authenticated_)
    bodies_.unpin(body);
  else
    bodies_.erase(body);
}

void BodyBook::forget(const Handle& writer) {
  if (!authenticated_) bodies_.erase_group(owner_of(writer));
}

void BodyBook::clear() {
  if (!authenticated_) bodies_.clear();
}

}  // namespace nearmesh::wire
