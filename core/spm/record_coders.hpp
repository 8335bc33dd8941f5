// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the record codec (record_codec.hpp) codes with: three coders of one shape, that count, write
// and read. A reader looks at its bytes once for several fields: refill() makes
// WindowReader::kReadyBits of them ready, of which a symbol takes at most kMaxCodeBits (an escape
// sees to itself) and raw(n) takes n.

#include <algorithm>
#include <array>
#include <cstdint>

#include "bits.hpp"
#include "contexts.hpp"
#include "nearmesh/core/spm/detail/coding_tables.hpp"
#include "train.hpp"

namespace nearmesh::record {

inline constexpr int kEscapedBits = 7;

class CountingCoder {
 public:
  static constexpr bool kReads = false;
  explicit CountingCoder(TrainingCounts& counts) : counts_(counts) {}
  void refill() {}
  void symbol(int context, std::uint32_t& value) { ++counts_[context][std::min(value, 126U)]; }
  template <class Tail>
  void number(int context, std::uint32_t& value, std::uint32_t&) {
    symbol(context, value);
  }
  void raw(std::uint32_t, std::uint32_t&) {}
  bool good() const { return true; }

 private:
  TrainingCounts& counts_;
};

class WritingCoder {
 public:
  static constexpr bool kReads = false;
  WritingCoder(const CodingTables& tables, BitWriter& out)
      : contexts_(tables.contexts().data()), out_(out) {}
  void refill() {}
  void symbol(int context, std::uint32_t& value) {
    const HuffmanTable& table = contexts_[context];
    const HuffmanTable::Code code = table.codes[value];
    if (code.length > 0) {
      out_.put(code.bits, code.length);
    } else {
      out_.put(table.codes[kEscape].bits, table.codes[kEscape].length);
      out_.put(value, kEscapedBits);
    }
  }
  template <class Tail>
  void number(int context, std::uint32_t& value, std::uint32_t& tail) {
    symbol(context, value);
    raw(Tail::bits(value), tail);
  }
  void raw(std::uint32_t bits, std::uint32_t& value) { out_.put(value, static_cast<int>(bits)); }
  bool good() const { return true; }

 private:
  const HuffmanTable* contexts_;
  BitWriter& out_;
};

class ReadingCoder {
 public:
  static constexpr bool kReads = true;
  /// Reads on where `in` stands, of bytes that end after `bits`.
  ReadingCoder(const CodingTables& tables, const WindowReader& in, std::size_t bits)
      : fast_(tables.fast()), contexts_(tables.contexts().data()), in_(in), bits_(bits) {}
  void refill() { in_.refill(); }
  void symbol(int context, std::uint32_t& value) {
    const HuffmanTable::Decoded found = look_up(context);
    value = found.symbol;
    in_.take(found.length);
    if (found.symbol == kEscape) [[unlikely]]
      value = long_symbol(contexts_[context]);
  }
  /// A symbol and the Tail::bits(symbol) bits after it: the look-up says how many bits they take
  /// together.
  template <class Tail>
  void number(int context, std::uint32_t& value, std::uint32_t& tail) {
    const HuffmanTable::Decoded found = look_up(context);
    value = found.symbol;
    if (found.symbol == kEscape) [[unlikely]] {
      value = long_symbol(contexts_[context]);
      raw(Tail::bits(value), tail);
      return;
    }
    const std::uint64_t both = in_.window() >> 1 >> (63 - found.length);
    tail = static_cast<std::uint32_t>(both & ((std::uint64_t{1} << Tail::bits(value)) - 1));
    in_.take(found.length);
  }
  void raw(std::uint32_t bits, std::uint32_t& value) {
    value = static_cast<std::uint32_t>(in_.window() >> 1 >> (63 - bits));
    in_.take(bits);
  }
  /// Set by a field whose value cannot be; `what` names it.
  void fail(const char* what) {
    if (error_ == nullptr) error_ = what;
  }
  /// Asked after every few fields: they are all there, and their values can be.
  [[nodiscard]] bool good() const { return error_ == nullptr && in_.used_bits() <= bits_; }
  [[nodiscard]] const char* error() const {
    return error_ != nullptr ? error_ : "bytes end inside a record";
  }
  [[nodiscard]] std::size_t bits_left() const { return bits_ - in_.used_bits(); }

 private:
  [[nodiscard]] HuffmanTable::Decoded look_up(int context) const {
    return fast_[(static_cast<std::size_t>(context) << kFastCodeBits) +
                 (in_.window() >> (64 - kFastCodeBits))];
  }
  std::uint32_t long_symbol(const HuffmanTable& table) {
    const HuffmanTable::Decoded found = table.decode[in_.window() >> 1 >> (63 - table.decode_bits)];
    std::uint32_t value = found.symbol;
    in_.take(found.length);
    in_.refill();
    if (found.symbol == kEscape) {
      raw(kEscapedBits, value);
      in_.refill();
    }
    return value;
  }

  const HuffmanTable::Decoded* fast_;
  const HuffmanTable* contexts_;
  WindowReader in_;
  std::size_t bits_;
  const char* error_ = nullptr;
};

template <class Coder>
void fail(Coder& coder, const char* what) {
  if constexpr (Coder::kReads) coder.fail(what);
}

}  // namespace nearmesh::record
