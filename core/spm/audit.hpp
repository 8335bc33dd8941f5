// SPDX-License-Identifier: Apache-2.0
#pragma once
// A stored block with what shows that it is of a content, in pieces that travel as batches do,
// under a seal (core/spm_format.md, "Audit"). Takes a block and its path, gives pieces; and back.

#include <optional>

#include "core/base/digest.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh {

struct AuditedBlock {
  NodeSpan root;                    ///< of the block
  TreePath path;                    ///< from its digest to SpmHeader::blocks_root
  std::vector<std::uint8_t> bytes;  ///< without a seal
};

/// A block and its path take no more: what is larger is not audited.
inline constexpr std::size_t kMaxAuditBytes = 1 << 20;

/// Without seals. Errors: kUnsupported where it is too large.
[[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> audit_pieces(
    const AuditedBlock& block);

/// Puts pieces together; a first piece, and one that does not follow, starts anew. Trusts no count.
class AuditReader {
 public:
  /// In: a piece without its seal. Out: the block once it is whole. Errors: kCorrupt.
  [[nodiscard]] Result<std::optional<AuditedBlock>> take(std::span<const std::uint8_t> piece);

 private:
  std::vector<std::uint8_t> bytes_;
};

/// Whether the block is one of the content with this header.
[[nodiscard]] bool is_proved(const AuditedBlock& block, const SpmHeader& header);

}  // namespace nearmesh
