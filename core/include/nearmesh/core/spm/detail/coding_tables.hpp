// SPDX-License-Identifier: Apache-2.0
#pragma once
// Static Huffman tables of one model: for each context of the record codec the code length of each symbol.
// They are part of the header, so that every batch decodes alone.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace nearmesh {

inline constexpr int kMaxCodeBits = 12;
/// Codes of so many bits are decoded by one look-up. What a batch uses of this table stays in a processor's first cache.
inline constexpr int kFastCodeBits = 7;
inline constexpr int kSymbolLimit = 127;  ///< symbols are 0..126
inline constexpr std::uint8_t kEscape =
    127;  ///< stands for a symbol never seen in training; 7 raw bits follow

/// One context. Every context can code every symbol, by escape if need be.
struct HuffmanTable {
  struct Code {
    std::uint16_t bits = 0;
    std::uint8_t length = 0;  ///< 0: not in the table, use the escape
  };
  struct Decoded {
    std::uint8_t symbol = kEscape;
    std::uint8_t length = 0;
  };
  std::array<std::uint8_t, kSymbolLimit + 1> lengths{};  ///< what is stored
  std::array<Code, kSymbolLimit + 1> codes{};            ///< derived, by symbol
  std::vector<Decoded> decode;                           ///< derived, by the next decode_bits bits
  int decode_bits = 0;

  /// From how often each symbol occurred, and how often none of them.
  [[nodiscard]] static HuffmanTable from_counts(std::span<const std::uint64_t> counts,
                                                std::uint64_t escapes = 0);
  /// Fills the derived members; false when the lengths are not a prefix code of at most kMaxCodeBits.
  [[nodiscard]] bool derive();
};

/// The tables of all contexts.
class CodingTables {
 public:
  CodingTables() = default;
  explicit CodingTables(std::vector<HuffmanTable> contexts);

  [[nodiscard]] const std::vector<HuffmanTable>& contexts() const { return contexts_; }
  /// By context and, within, the next kFastCodeBits bits: the symbol, and how many bits it and what follows it in any case take.
  /// kEscape for longer codes and the escape, which HuffmanTable::decode gives.
  [[nodiscard]] const HuffmanTable::Decoded* fast() const { return fast_.data(); }

 private:
  std::vector<HuffmanTable> contexts_;
  std::vector<HuffmanTable::Decoded> fast_;
};

}  // namespace nearmesh
