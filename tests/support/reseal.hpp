// SPDX-License-Identifier: Apache-2.0
#pragma once
// Makes every hash and seal of a model file right again after its bytes were changed, as its writer
// would have set them: what lies behind them is then tested. Sections that leave the file are left
// alone.

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

#include "core/base/digest.hpp"
#include "core/base/hash.hpp"
#include "core/spm/file_layout.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh::test {

/// In: at least as long as a preamble.
inline void reseal(std::vector<std::uint8_t>& bytes) {
  using file_layout::DirectoryEntry;
  using file_layout::OriginEntry;
  using file_layout::Preamble;
  constexpr std::size_t kRootAt = 4, kRootBytes = 16;  // in the header, behind its magic number
  Preamble preamble;
  std::memcpy(&preamble, bytes.data(), sizeof preamble);
  const auto section = [&](std::uint64_t offset, std::uint64_t count) -> std::span<std::uint8_t> {
    if (offset > bytes.size() || count > bytes.size() - offset) return {};
    return std::span(bytes).subspan(offset, count);
  };
  const std::span<std::uint8_t> directory =
      section(preamble.directory_offset, preamble.block_count * sizeof(DirectoryEntry));
  std::vector<DirectoryEntry> entries(directory.size() / sizeof(DirectoryEntry));
  if (!entries.empty()) std::memcpy(entries.data(), directory.data(), directory.size());
  const auto block = [&](const DirectoryEntry& entry) {
    return entry.bytes < kSealBytes ? std::span<std::uint8_t>{}
                                    : section(entry.offset, entry.bytes);
  };
  std::vector<ContentHash> leaves;
  for (DirectoryEntry& entry : entries) {
    if (const auto sealed = block(entry); !sealed.empty())
      entry.digest = leaf_digest(entry.first, entry.size, sealed.first(sealed.size() - kSealBytes));
    leaves.push_back(entry.digest);
  }
  if (preamble.face_table_offset <= bytes.size())
    preamble.face_table_digest =
        leaf_digest(0, 0, std::span(bytes).subspan(preamble.face_table_offset));
  leaves.push_back(preamble.face_table_digest);
  const std::span<std::uint8_t> header = section(sizeof(Preamble), preamble.header_bytes);
  if (header.size() >= kRootAt + kRootBytes) {
    const ContentHash root = tree_root(std::move(leaves));
    std::size_t at = kRootAt;
    for (const std::uint64_t word : {root.high, root.low})
      for (int shift = 56; shift >= 0; shift -= 8)
        header[at++] = static_cast<std::uint8_t>(word >> shift);
  }
  preamble.content_hash = digest_of(header);
  for (const DirectoryEntry& entry : entries) {
    const auto sealed = block(entry);
    if (sealed.empty()) continue;
    std::vector<std::uint8_t> again(sealed.begin(), sealed.end() - kSealBytes);
    seal_batch(preamble.content_hash, again);
    std::memcpy(sealed.data(), again.data(), again.size());
  }
  if (!entries.empty()) std::memcpy(directory.data(), entries.data(), directory.size());
  preamble.directory_checksum = hash_bytes(directory);
  if (preamble.directory_offset >= sizeof(OriginEntry)) {
    const auto origin =
        section(preamble.directory_offset - sizeof(OriginEntry), sizeof(OriginEntry));
    const auto checksum = static_cast<std::uint32_t>(
        hash_bytes(origin.first(origin.empty() ? 0 : offsetof(OriginEntry, checksum))));
    if (!origin.empty())
      std::memcpy(&origin[offsetof(OriginEntry, checksum)], &checksum, sizeof checksum);
  }
  std::memcpy(bytes.data(), &preamble, sizeof preamble);
  preamble.checksum = hash_bytes(std::span(bytes).first(sizeof(Preamble) - 8));
  std::memcpy(bytes.data(), &preamble, sizeof preamble);
}

}  // namespace nearmesh::test
