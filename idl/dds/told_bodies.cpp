// SPDX-License-Identifier: Apache-2.0
#include "told_bodies.hpp"

#include <algorithm>
#include <array>
#include <iterator>

#include "core/base/hash.hpp"
#include "rtps_cursor.hpp"

namespace nearmesh::wire {
namespace {

/// What user data begins with that is ours. Behind it each body's hash, ascending.
constexpr std::array<std::uint8_t, 8> kMark{'n', 'm', 'b', 'o', 'd', 'i', 'e', 's'};
/// Of a hash: the body is moved.
constexpr std::uint32_t kMoved = 1;

std::uint32_t hash_of(const std::string& name) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(name.data());
  return static_cast<std::uint32_t>(hash_bytes({bytes, name.size()})) & ~kMoved;
}

}  // namespace

std::vector<std::uint32_t> body_hashes(const std::vector<std::string>& names) {
  std::vector<std::uint32_t> hashes;
  hashes.reserve(names.size());
  for (const std::string& name : names) hashes.push_back(hash_of(name));
  std::sort(hashes.begin(), hashes.end());
  hashes.erase(std::unique(hashes.begin(), hashes.end()), hashes.end());
  return hashes;
}

std::optional<std::vector<std::uint8_t>> user_data_of(const BodyNames& bodies) {
  const std::vector<std::uint32_t> moved = body_hashes(bodies.moved),
                                   others = body_hashes(bodies.named);
  std::vector<std::uint32_t> named;
  std::set_union(moved.begin(), moved.end(), others.begin(), others.end(),
                 std::back_inserter(named));
  if (named.size() > kMaxToldBodies) return std::nullopt;
  std::vector<std::uint8_t> data(kMark.begin(), kMark.end());
  for (const std::uint32_t hash : named) {
    const std::uint32_t word =
        hash | (std::binary_search(moved.begin(), moved.end(), hash) ? kMoved : 0);
    for (int shift = 0; shift < 32; shift += 8)
      data.push_back(static_cast<std::uint8_t>(word >> shift));
  }
  return data;
}

std::optional<ToldBodies> told_bodies_in(std::span<const std::uint8_t> user_data) {
  if (user_data.size() < kMark.size() || !std::equal(kMark.begin(), kMark.end(), user_data.begin()))
    return std::nullopt;
  const std::span<const std::uint8_t> words = user_data.subspan(kMark.size());
  if (words.size() % 4 != 0 || words.size() / 4 > kMaxToldBodies) return std::nullopt;
  ToldBodies told;
  Cursor in(words, true);
  while (in.left() != 0) {
    const std::uint32_t word = in.u32(), hash = word & ~kMoved;
    if (!told.named.empty() && hash <= told.named.back()) return std::nullopt;
    told.named.push_back(hash);
    if (word != hash) told.moved.push_back(hash);
  }
  return told;
}

bool have_one_in_common(const std::vector<std::uint32_t>& a, const std::vector<std::uint32_t>& b) {
  return std::any_of(a.begin(), a.end(), [&](std::uint32_t hash) {
    return std::binary_search(b.begin(), b.end(), hash);
  });
}

bool are_strangers(const ToldBodies& one, const ToldBodies& other) {
  return !have_one_in_common(one.moved, other.named) && !have_one_in_common(other.moved, one.named);
}

}  // namespace nearmesh::wire
