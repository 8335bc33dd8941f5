// SPDX-License-Identifier: Apache-2.0
#pragma once
// What participants tell of bodies in their announcements (user data): which ones their hosts will
// ever name, and which of these they move. Names are hashes: two that are alike by accident make
// two participants know each other sooner than need be, no more. No Fast DDS, no clock.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nearmesh::wire {

/// Names that a participant tells at most, all together: more do not fit into one datagram beside
/// the rest.
inline constexpr std::size_t kMaxToldBodies = 64;

/// Bodies that a host names.
struct BodyNames {
  std::vector<std::string> named;
  std::vector<std::string> moved;  ///< by itself; they may be among the others, too
};

/// What of that is announced: hashes, ascending.
struct ToldBodies {
  std::vector<std::uint32_t> named;  ///< all, moved or not
  std::vector<std::uint32_t> moved;
};

/// Hashes of names, ascending, each once.
[[nodiscard]] std::vector<std::uint32_t> body_hashes(const std::vector<std::string>& names);
/// Of two such lists.
[[nodiscard]] bool have_one_in_common(const std::vector<std::uint32_t>& a,
                                      const std::vector<std::uint32_t>& b);
/// User data. Nothing: they are more than kMaxToldBodies.
[[nodiscard]] std::optional<std::vector<std::uint8_t>> user_data_of(const BodyNames& bodies);
/// Of user data. Nothing: it is not ours, or malformed; then the participant may name any body, and
/// move any.
[[nodiscard]] std::optional<ToldBodies> told_bodies_in(std::span<const std::uint8_t> user_data);

/// Whether the two have nothing to do with each other: neither names a body that the other moves.
/// The same for both, whoever asks.
[[nodiscard]] bool are_strangers(const ToldBodies& one, const ToldBodies& other);

}  // namespace nearmesh::wire
