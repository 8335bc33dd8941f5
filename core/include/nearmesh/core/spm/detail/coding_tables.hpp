// SPDX-License-Identifier: Apache-2.0
#pragma once
// Static Huffman tables of one model: for each context of the record codec the code length of each
// symbol. The header carries them or names a set that is built in, so that every batch decodes
// alone.

#include <array>
#include <compare>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace nearmesh {

inline constexpr int kMaxCodeBits = 12;
/// Codes of so many bits are decoded by one look-up. What a batch uses of this table stays in a
/// processor's first cache.
inline constexpr int kFastCodeBits = 7;
inline constexpr int kSymbolLimit = 127;  ///< symbols are 0..126
/// Stands for a symbol never seen in training; 7 raw bits follow.
inline constexpr std::uint8_t kEscape = 127;

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
  /// Fills the derived members; false when the lengths are not a prefix code of at most
  /// kMaxCodeBits.
  [[nodiscard]] bool derive();
};

/// Tables that are built in, as a header names them.
struct CodingSet {
  static constexpr int kMinScale = -16, kMaxScale = 15;
  std::uint32_t number = 0;  ///< 0: none; the header carries the model's own tables
  int scale = 0;             ///< so many bits longer are offsets than where the set is at home
  auto operator<=>(const CodingSet&) const = default;
};

/// The tables of all contexts. Copies share them.
class CodingTables {
 public:
  CodingTables() = default;
  /// `set`: which these are of those built in.
  explicit CodingTables(std::vector<HuffmanTable> contexts, CodingSet set = {});

  [[nodiscard]] std::span<const HuffmanTable> contexts() const { return tables_->contexts; }
  /// By context and, within, the next kFastCodeBits bits: the symbol, and how many bits it and what
  /// follows it in any case take. kEscape for longer codes and the escape, which
  /// HuffmanTable::decode gives.
  [[nodiscard]] const HuffmanTable::Decoded* fast() const { return tables_->fast.data(); }
  [[nodiscard]] CodingSet set() const { return tables_->set; }
  /// Another copy shares them.
  [[nodiscard]] bool is_shared() const { return tables_.use_count() > 1; }

 private:
  struct Tables {
    std::vector<HuffmanTable> contexts;
    std::vector<HuffmanTable::Decoded> fast;
    CodingSet set;
  };
  std::shared_ptr<const Tables> tables_ = std::make_shared<const Tables>();
};

}  // namespace nearmesh
