// SPDX-License-Identifier: Apache-2.0
#pragma once
// How the bytes that a content is the digest of are asked for and sent: a page of a world, or the
// header of a tile. The request is an audit of a node that no model has; the answer comes in pieces
// of a datagram that travel as batches do, under a seal. Whoever has all pieces holds their digest
// against the content, so nothing else proves them.

#include <optional>
#include <span>
#include <vector>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/spm/detail/types.hpp"

namespace nearmesh {

/// Larger than the largest model.
inline constexpr NodeSpan kContentBytes{VertexId{0}, 0x80000000U};

[[nodiscard]] RegionRequest content_bytes_request();
/// Of a request that check_request() accepted.
[[nodiscard]] bool asks_for_content_bytes(const RegionRequest& request);

/// Without seals, each with where it begins and how many bytes there are in all. In: at least one
/// byte, at most kMaxContentBytes.
inline constexpr std::size_t kMaxContentBytes = 1 << 20;
[[nodiscard]] std::vector<std::vector<std::uint8_t>> content_pieces(
    std::span<const std::uint8_t> bytes);

/// Puts pieces together, in any order. Trusts none of them.
class ContentReader {
 public:
  explicit ContentReader(const ContentHash& content) : content_(content) {}
  /// Out: the bytes, once they are all there and have the digest. What does not fit those before,
  /// or makes up other bytes, starts anew: kCorrupt.
  /// In: a piece without its seal.
  [[nodiscard]] Result<std::optional<std::vector<std::uint8_t>>> take(
      std::span<const std::uint8_t> piece);

 private:
  ContentHash content_;
  std::vector<std::uint8_t> bytes_;
  std::vector<bool> is_here_;  // by piece
  std::size_t missing_ = 0;
};

}  // namespace nearmesh
