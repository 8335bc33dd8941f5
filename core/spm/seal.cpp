// SPDX-License-Identifier: Apache-2.0
// The seal that follows a batch.
#include <algorithm>
#include <array>
#include <string>

#include "core/base/hash.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh {
namespace {

std::array<std::uint8_t, kSealBytes> seal_of(const ContentHash& content,
                                             std::span<const std::uint8_t> bytes) {
  const std::uint64_t hash = hash_bytes(bytes, content.low);
  std::array<std::uint8_t, kSealBytes> seal{};
  for (std::size_t i = 0; i < seal.size(); ++i) seal[i] = static_cast<std::uint8_t>(hash >> 8 * i);
  return seal;
}

}  // namespace

void seal_batch(const ContentHash& content, std::vector<std::uint8_t>& bytes) {
  const auto seal = seal_of(content, bytes);
  bytes.insert(bytes.end(), seal.begin(), seal.end());
}

Result<std::span<const std::uint8_t>> unseal_batch(const ContentHash& content,
                                                   std::span<const std::uint8_t> bytes) {
  if (bytes.size() < kSealBytes)
    return Status{StatusCode::kCorrupt,
                  "batch: " + std::to_string(bytes.size()) + " bytes are less than a seal"};
  const std::span<const std::uint8_t> inner = bytes.first(bytes.size() - kSealBytes);
  const auto expected = seal_of(content, inner);
  if (!std::equal(expected.begin(), expected.end(), bytes.end() - kSealBytes))
    return Status{StatusCode::kCorrupt, "batch: its seal does not match its " +
                                            std::to_string(inner.size()) + " bytes of content " +
                                            to_hex(content)};
  return inner;
}

Result<SplitBatch> decode_sealed(const SpmHeader& header, std::span<const std::uint8_t> bytes) {
  const auto inner = unseal_batch(header.content, bytes);
  NEARMESH_RETURN_IF_ERROR(inner);
  return decode_batch(header, inner.value());
}

}  // namespace nearmesh
