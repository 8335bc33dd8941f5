// SPDX-License-Identifier: Apache-2.0
#include "audit.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

namespace nearmesh {
namespace {

static_assert(std::endian::native == std::endian::little);
/// Of a piece: kAuditPiece, and where in the whole it belongs, and how long that is.
constexpr std::size_t kPieceHead = 9, kWord = 4, kDigest = 16;

Status corrupt(const char* what) { return {StatusCode::kCorrupt, std::string("audit: ") + what}; }

template <class T>
void put(std::vector<std::uint8_t>& bytes, const T& value) {
  const auto* at = reinterpret_cast<const std::uint8_t*>(&value);
  bytes.insert(bytes.end(), at, at + sizeof value);
}

std::uint32_t word_at(std::span<const std::uint8_t> bytes, std::size_t at) {
  std::uint32_t word = 0;
  std::memcpy(&word, bytes.data() + at, sizeof word);
  return word;
}

Result<AuditedBlock> read_whole(std::span<const std::uint8_t> bytes) {
  AuditedBlock block;
  if (bytes.size() < 2 * kWord + 1) return corrupt("it ends early");
  block.root = {{word_at(bytes, 0)}, word_at(bytes, kWord)};
  std::size_t at = 2 * kWord;
  for (std::size_t levels = bytes[at++]; levels > 0; --levels) {
    if (at == bytes.size() || bytes[at] < 1 || bytes[at] > kTreeFanOut ||
        bytes[at] * kDigest > bytes.size() - at - 1)
      return corrupt("its path ends early");
    block.path.emplace_back(bytes[at++]);
    for (ContentHash& digest : block.path.back()) {
      std::memcpy(&digest.high, bytes.data() + at, 8);
      std::memcpy(&digest.low, bytes.data() + at + 8, 8);
      at += kDigest;
    }
  }
  block.bytes.assign(bytes.begin() + static_cast<std::ptrdiff_t>(at), bytes.end());
  return block;
}

}  // namespace

Result<std::vector<std::vector<std::uint8_t>>> audit_pieces(const AuditedBlock& block) {
  std::vector<std::uint8_t> whole;
  put(whole, block.root.begin());
  put(whole, block.root.size);
  put(whole, static_cast<std::uint8_t>(block.path.size()));
  for (const std::vector<ContentHash>& children : block.path) {
    put(whole, static_cast<std::uint8_t>(children.size()));
    for (const ContentHash& digest : children) {
      put(whole, digest.high);
      put(whole, digest.low);
    }
  }
  whole.insert(whole.end(), block.bytes.begin(), block.bytes.end());
  if (whole.size() > kMaxAuditBytes)
    return Status{StatusCode::kUnsupported, to_string(block.root) + ": its block is too large"};
  std::vector<std::vector<std::uint8_t>> pieces;
  for (std::size_t at = 0; at < whole.size();) {
    const std::size_t size = std::min(whole.size() - at, kMaxBatchBytes - kPieceHead);
    std::vector<std::uint8_t>& piece = pieces.emplace_back(1, kAuditPiece);
    put(piece, static_cast<std::uint32_t>(at));
    put(piece, static_cast<std::uint32_t>(whole.size()));
    const auto from = whole.begin() + static_cast<std::ptrdiff_t>(at);
    piece.insert(piece.end(), from, from + static_cast<std::ptrdiff_t>(size));
    at += size;
  }
  return pieces;
}

Result<std::optional<AuditedBlock>> AuditReader::take(std::span<const std::uint8_t> piece) {
  if (piece.size() <= kPieceHead) return corrupt("an empty piece");
  const std::uint32_t at = word_at(piece, 1), size = word_at(piece, 1 + kWord);
  piece = piece.subspan(kPieceHead);
  if (size > kMaxAuditBytes || at > size || piece.size() > size - at)
    return corrupt("a piece lies outside the whole");
  if (at == 0) bytes_.clear();
  if (at != bytes_.size()) {  // one before it was lost: the whole is asked for again
    bytes_.clear();
    return std::optional<AuditedBlock>{};
  }
  bytes_.insert(bytes_.end(), piece.begin(), piece.end());
  if (bytes_.size() < size) return std::optional<AuditedBlock>{};
  Result<AuditedBlock> block = read_whole(std::exchange(bytes_, {}));
  NEARMESH_RETURN_IF_ERROR(block);
  return std::optional<AuditedBlock>(std::move(block).value());
}

bool is_proved(const AuditedBlock& block, const SpmHeader& header) {
  return block.root.size >= 2 &&
         leads_to(block.path, leaf_digest(block.root.begin(), block.root.size, block.bytes),
                  header.blocks_root);
}

}  // namespace nearmesh
