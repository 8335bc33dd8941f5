// SPDX-License-Identifier: Apache-2.0
#include "content_bytes.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "core/base/digest.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh {
namespace {

constexpr std::size_t kHeadBytes = 8, kPieceBytes = kMaxBatchBytes - kHeadBytes;

void put_word(std::vector<std::uint8_t>& out, std::size_t word) {
  for (int i = 0; i < 4; ++i) out.push_back(static_cast<std::uint8_t>(word >> (8 * i)));
}

std::size_t get_word(std::span<const std::uint8_t> bytes) {
  std::size_t word = 0;
  for (std::size_t i = 0; i < 4; ++i) word |= std::size_t{bytes[i]} << (8 * i);
  return word;
}

}  // namespace

RegionRequest content_bytes_request() {
  return {.attach = {kContentBytes}, .region = {}, .max_splits = 0};
}

bool asks_for_content_bytes(const RegionRequest& request) {
  return request.is_audit() && request.attach.size() == 1 &&
         request.attach.front() == kContentBytes;
}

std::vector<std::vector<std::uint8_t>> content_pieces(std::span<const std::uint8_t> bytes) {
  NEARMESH_ASSERT(!bytes.empty() && bytes.size() <= kMaxContentBytes);
  std::vector<std::vector<std::uint8_t>> pieces;
  for (std::size_t begin = 0; begin < bytes.size(); begin += kPieceBytes) {
    std::vector<std::uint8_t>& piece = pieces.emplace_back();
    put_word(piece, begin);
    put_word(piece, bytes.size());
    const auto part = bytes.subspan(begin, std::min(kPieceBytes, bytes.size() - begin));
    piece.insert(piece.end(), part.begin(), part.end());
  }
  return pieces;
}

Result<std::optional<std::vector<std::uint8_t>>> ContentReader::take(
    std::span<const std::uint8_t> piece) {
  const auto start_anew = [this](const std::string& what) {
    bytes_.clear();
    return Status(StatusCode::kCorrupt, "bytes of content " + to_hex(content_) + ": " + what);
  };
  if (piece.size() <= kHeadBytes) return start_anew("a piece without any");
  const std::size_t begin = get_word(piece), size = get_word(piece.subspan(4));
  piece = piece.subspan(kHeadBytes);
  if (size == 0 || size > kMaxContentBytes || begin % kPieceBytes != 0 || begin >= size ||
      piece.size() != std::min(kPieceBytes, size - begin))
    return start_anew(std::to_string(piece.size()) + " from " + std::to_string(begin) + " of " +
                      std::to_string(size));
  if (bytes_.size() != size) {
    bytes_.assign(size, 0);
    missing_ = (size + kPieceBytes - 1) / kPieceBytes;
    is_here_.assign(missing_, false);
  }
  if (const std::size_t place = begin / kPieceBytes; !is_here_[place]) {
    is_here_[place] = true;
    --missing_;
  }
  std::copy(piece.begin(), piece.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(begin));
  if (missing_ > 0) return std::optional<std::vector<std::uint8_t>>();
  if (const ContentHash found = digest_of(bytes_); found != content_)
    return start_anew("have the digest " + to_hex(found));
  return std::optional(std::exchange(bytes_, {}));
}

}  // namespace nearmesh
