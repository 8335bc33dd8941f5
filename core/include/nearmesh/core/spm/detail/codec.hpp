// SPDX-License-Identifier: Apache-2.0
#pragma once
// One record codec for batches on the wire and blocks in the file: static Huffman symbols with raw
// mantissas, bit-packed, most significant bit first. Layout and figures: core/spm_format.md.

#include <cstdint>
#include <span>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {

/// A split of a treelet, with which of its children are split in the same treelet.
struct TreeletSplit {
  NodeSpan node;
  VertexId split;
  bool left_included = false, right_included = false;
};
/// Splits in preorder (NodeSpan's order); a split's parent is in the treelet or its node is an
/// attach node.
using Treelet = std::vector<TreeletSplit>;

enum class BoxPolicy : std::uint8_t {
  kCutNodes,  ///< wire: a box on every child of size > 1 that is not split in the treelet
  kAllNodes,  ///< file: a box on every child of size > 1
};

/// A batch is stored and sent under a seal that follows it: a hash of its bytes, keyed by the
/// content that it is of.
inline constexpr std::size_t kSealBytes = 4;
/// Largest batch with its seal: with 44 bytes of sample fields and 140 of RTPS it fits one
/// 1,400-byte datagram (Fast DDS 2.9.1 cuts a sample in two from 1,225 bytes on).
inline constexpr std::size_t kMaxSealedBytes = 1180;
inline constexpr std::size_t kMaxBatchBytes = kMaxSealedBytes - kSealBytes;
/// What the first byte is of a piece of an audit, which travels as batches do, where a batch has
/// its box policy.
inline constexpr std::uint8_t kAuditPiece = 2;
/// The same of a batch with half-spaces: its box policy is kCutNodes.
inline constexpr std::uint8_t kWithHalfSpaces = 3;
[[nodiscard]] inline bool is_audit_piece(std::span<const std::uint8_t> batch) {
  return !batch.empty() && batch.front() == kAuditPiece;
}
/// What a sealed batch costs on the wire beyond its own bytes: sample fields, RTPS, UDP and IP.
/// Measured on a capture. Fast DDS 3 adds 60 bytes of statistics, which the door leaves out of what
/// 2.9 sends.
inline constexpr std::size_t kBatchFramingBytes = 144;
/// Where batches of one answer share a sample, each but the first takes so much more, for its
/// content and its size; and the first one's size is told, too.
inline constexpr std::size_t kJoinBytes = 18, kJoinSizeBytes = 2;

/// How the batches of an answer, in their order, share samples.
class SampleRoom {
 public:
  /// The largest sealed batch that has room beside the last one; perhaps 0.
  [[nodiscard]] std::size_t left() const {
    const std::size_t taken = sample_bytes_ + kJoinBytes + (is_joined_ ? 0 : kJoinSizeBytes);
    return sample_bytes_ == 0 || taken >= kMaxSealedBytes ? 0 : kMaxSealedBytes - taken;
  }
  /// Out: what the next batch, sealed, adds to the wire.
  std::size_t add(std::size_t sealed_bytes) {
    if (sealed_bytes > left()) {
      sample_bytes_ = sealed_bytes;
      is_joined_ = false;
      return sealed_bytes + kBatchFramingBytes;
    }
    const std::size_t added = sealed_bytes + kJoinBytes + (is_joined_ ? 0 : kJoinSizeBytes);
    is_joined_ = true;
    sample_bytes_ += added;
    return added;
  }

 private:
  std::size_t sample_bytes_ = 0;
  bool is_joined_ = false;
};

/// Cuts a treelet into batches of at most `max_bytes` each and encodes them; each batch decodes
/// alone. The store must know every split named; it need not hold all of the model: a node that
/// came without a box is given one around its nearest ancestor's.
/// `half_spaces`, ascending, with box policy kCutNodes: of nodes that a split of the treelet makes
/// and none divides, at some 20 bits each, and of nodes that are disjoint from these and from each
/// other, which the receiver holds. At most kMaxHalfSpaces a node, one a direction.
/// `first_max_bytes`: of the first batch; it is not kept to where not even one record has room.
/// Cost: about 200 ns a split.
[[nodiscard]] std::vector<std::vector<std::uint8_t>> encode_batches(
    const SpmHeader& header, const SplitStore& store, const Treelet& treelet, BoxPolicy boxes,
    std::size_t max_bytes = kMaxBatchBytes, std::span<const NodeHalfSpace> half_spaces = {},
    std::size_t first_max_bytes = ~std::size_t{0});

/// What a split takes in a batch, in bits.
struct SplitBits {
  std::uint32_t record = 0;                   ///< without boxes
  std::uint32_t left_box = 0, right_box = 0;  ///< of each child of size > 1, were it sent
};
/// Of each split of a treelet, as encode_batches() codes it where the batch has room for all.
/// Cost: about 200 ns a split.
[[nodiscard]] std::vector<SplitBits> bits_of(const SpmHeader& header, const SplitStore& store,
                                             const Treelet& treelet);

/// Decodes one batch. Needs the header alone: no state of the peer enters.
/// Errors: kCorrupt with the record and field where bytes contradict the header; nothing is
/// allocated beyond what the bytes can hold. Cost: about 110 ns a split.
[[nodiscard]] Result<SplitBatch> decode_batch(const SpmHeader& header,
                                              std::span<const std::uint8_t> bytes);

/// Appends the seal. It finds what went wrong on the way, not what somebody made up: the key is
/// known to all.
void seal_batch(const ContentHash& content, std::vector<std::uint8_t>& bytes);
/// The batch without its seal. Errors: kCorrupt where the seal is not that of these bytes and this
/// content.
[[nodiscard]] Result<std::span<const std::uint8_t>> unseal_batch(
    const ContentHash& content, std::span<const std::uint8_t> bytes);
/// decode_batch() of what is sealed for the header's content. Errors: those of both.
[[nodiscard]] Result<SplitBatch> decode_sealed(const SpmHeader& header,
                                               std::span<const std::uint8_t> bytes);

}  // namespace nearmesh
