// SPDX-License-Identifier: Apache-2.0
#pragma once
// The one record codec (core/spm_format.md, "Record"): contexts, and a record described once for counting, writing and
// reading. `Coder` is any of CountingCoder, WritingCoder, ReadingCoder; each member takes the value by reference, uses
// it when counting or writing and sets it when reading, so that the two directions cannot drift apart.
// A reader looks at its bytes once for several fields: refill() makes BitReader::kWindowBits of them ready, of which a
// symbol takes at most kMaxSymbolBits and raw(n) takes n.

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "bits.hpp"
#include "nearmesh/core/spm/codec.hpp"
#include "nearmesh/core/spm/train.hpp"

namespace nearmesh::record {

// ---- contexts -----------------------------------------------------------------------------------

inline constexpr int kShapeSmall = 0;                // node sizes 3..8, one each
inline constexpr int kShapeLarge = kShapeSmall + 6;  // six classes of larger nodes
inline constexpr int kOffset0 = kShapeLarge + 6;     // six levels
inline constexpr int kOffset1 = kOffset0 + 6;        // twelve classes of the previous axis
inline constexpr int kOffset2 = kOffset1 + 12;
inline constexpr int kFaceCount = kOffset2 + 12;
inline constexpr int kInLeft = kFaceCount + 1;  // eight classes of side size
inline constexpr int kInRight = kInLeft + 8;
inline constexpr int kOutside = kInRight + 8;  // 32 kinds of guesses x later face x smallest node
inline constexpr int kDistance = kOutside + 128;  // known neighbour or the node x below or above
inline constexpr int kBox = kDistance + 4;        // six classes of node size x three axes
inline constexpr int kContextCount = kBox + 18;

// Symbols with a meaning of their own.
inline constexpr std::uint32_t kLongShape = 120;  // kShapeLarge: the length stands after it
inline constexpr std::uint32_t kUnusualFaces =
    33;  // kOffset0: added when the faces are not the usual two
inline constexpr std::uint32_t kManyNewFaces = 10;  // kFaceCount: counts stand after it
inline constexpr std::uint32_t kOutsideBelow =
    4;  // kOutside: no guess is right; kOutsideBelow + 1: above

inline int small_class(std::uint32_t size) {  // 2, 3-4, 5-8, 9-16, 17-64, more
  const int bits = bit_length(size - 1);
  return bits <= 4 ? bits - 1 : size <= kSlotSize ? 4 : 5;
}
inline int level_class(std::uint32_t size) {  // 2, 3-4, 5-8, 9-16, 17-32, more
  return std::min(bit_length(size - 1), 6) - 1;
}
inline int large_size_class(std::uint32_t size) {
  return size <= 16 ? 0 : size <= 32 ? 1 : size <= 64 ? 2 : size <= 512 ? 3 : size <= 8192 ? 4 : 5;
}

// ---- coders -------------------------------------------------------------------------------------

inline constexpr int kEscapedBits = 7;
inline constexpr int kMaxSymbolBits = kMaxCodeBits + kEscapedBits;

class CountingCoder {
 public:
  static constexpr bool kReads = false;
  explicit CountingCoder(TrainingCounts& counts) : counts_(counts) {}
  void refill() {}
  void symbol(int context, std::uint32_t& value) { ++counts_[context][std::min(value, 126U)]; }
  void raw(int, std::uint32_t&) {}
  bool good() const { return true; }

 private:
  TrainingCounts& counts_;
};

class WritingCoder {
 public:
  static constexpr bool kReads = false;
  WritingCoder(const CodingTables& tables, BitWriter& out) : tables_(tables), out_(out) {}
  void refill() {}
  void symbol(int context, std::uint32_t& value) {
    const HuffmanTable& table = tables_.contexts[context];
    const HuffmanTable::Code code = table.codes[value];
    if (code.length > 0) {
      out_.put(code.bits, code.length);
    } else {
      out_.put(table.codes[kEscape].bits, table.codes[kEscape].length);
      out_.put(value, kEscapedBits);
    }
  }
  void raw(int bits, std::uint32_t& value) { out_.put(value, bits); }
  bool good() const { return true; }

 private:
  const CodingTables& tables_;
  BitWriter& out_;
};

class ReadingCoder {
 public:
  static constexpr bool kReads = true;
  ReadingCoder(const CodingTables& tables, const BitReader& in)
      : tables_(tables.contexts.data()), in_(in) {}
  void refill() { window_ = in_.window(); }
  void symbol(int context, std::uint32_t& value) {
    const HuffmanTable& table = tables_[context];
    const HuffmanTable::Decoded found = table.fast[window_ >> (64 - kFastCodeBits)];
    value = found.symbol;
    take(found.length);
    if (found.length == 0) [[unlikely]]
      long_symbol(table, value);
  }
  void raw(int bits, std::uint32_t& value) {
    value = static_cast<std::uint32_t>(window_ >> 1 >> (63 - bits));
    take(bits);
  }
  /// Set by a field whose value cannot be; `what` names it.
  void fail(const char* what) {
    if (error_ == nullptr) error_ = what;
  }
  bool good() const { return error_ == nullptr && !in_.overrun(); }
  const char* error() const { return error_ != nullptr ? error_ : "bytes end inside a record"; }
  [[nodiscard]] const BitReader& reader() const { return in_; }

 private:
  void long_symbol(const HuffmanTable& table, std::uint32_t& value) {
    const HuffmanTable::Decoded found = table.decode[window_ >> 1 >> (63 - table.decode_bits)];
    value = found.symbol;
    take(found.length);
    if (found.symbol == kEscape) raw(kEscapedBits, value);
  }
  void take(int bits) {
    window_ <<= bits;
    in_.skip(bits);
  }

  const HuffmanTable* tables_;
  BitReader in_;
  std::uint64_t window_ = 0;
  const char* error_ = nullptr;
};

template <class Coder>
void fail(Coder& coder, const char* what) {
  if constexpr (Coder::kReads) coder.fail(what);
}

// ---- values -------------------------------------------------------------------------------------

/// A number of at most 32 bits: its bit length as a symbol, then the bits below its leading one.
template <class Coder>
void code_number(Coder& coder, int context, std::uint32_t& value) {
  std::uint32_t length = static_cast<std::uint32_t>(bit_length(value));
  coder.refill();
  coder.symbol(context, length);
  if (Coder::kReads && length > 32) {
    value = 0;
    return fail(coder, "length of a number");
  }
  const std::uint64_t leading = std::uint64_t{1} << length >> 1;
  std::uint32_t low = value & static_cast<std::uint32_t>(leading - (leading != 0));
  coder.raw(static_cast<int>(length) - (length > 0), low);
  if (Coder::kReads) value = static_cast<std::uint32_t>(leading) | low;
}

/// A number in [0, limit): nothing when limit is 1.
template <class Coder>
void code_bounded(Coder& coder, int context, std::uint32_t limit, std::uint32_t& value) {
  if (limit <= 1) {
    if (Coder::kReads) value = 0;
    return;
  }
  code_number(coder, context + std::min(bit_length(limit - 1), 8) - 1, value);
  if (Coder::kReads && value >= limit) {
    fail(coder, "corner inside the node");
    value = 0;
  }
}

/// What the codec needs of a record beside SplitRecord.
struct Inclusion {
  bool left = false, right = false;  // the child's split is in the same treelet
};

/// Where the node is divided, as the size of the right child in [1, size), and which children are divided too.
template <class Coder>
void code_shape(Coder& coder, std::uint32_t size, std::uint32_t& right, Inclusion& included) {
  if (size == 2) {
    if (Coder::kReads) {
      right = 1;
      included = {};
    }
    return;
  }
  std::uint32_t flags = (included.left ? 1U : 0U) | (included.right ? 2U : 0U);
  coder.refill();
  if (size <= 8) {
    std::uint32_t symbol = (right - 1) * 4 + flags;
    coder.symbol(kShapeSmall + static_cast<int>(size) - 3, symbol);
    if (Coder::kReads) {
      right = symbol / 4 + 1;
      flags = symbol % 4;
    }
  } else {
    // The smaller side: its bit length, which one it is, and the flags.
    std::uint32_t smaller = std::min(right, size - right);
    const std::uint32_t is_left = right > size - right ? 1 : 0;
    std::uint32_t all = static_cast<std::uint32_t>(bit_length(smaller)) * 8 + is_left * 4 + flags;
    std::uint32_t symbol = std::min(all, kLongShape);
    coder.symbol(kShapeLarge + large_size_class(size), symbol);
    if (symbol >= kLongShape) {
      coder.raw(8, all);
    } else if (Coder::kReads) {
      all = symbol;
    }
    const int length = static_cast<int>(all / 8);
    if (Coder::kReads && length < 1) {
      right = 1;
      return fail(coder, "size of a child");
    }
    const std::uint32_t leading = 1U << (length - 1);
    std::uint32_t low = smaller & (leading - 1);
    coder.raw(length - 1, low);
    if (Coder::kReads) {
      smaller = leading | low;
      right = (all & 4U) != 0 ? size - smaller : smaller;
      flags = all % 4;
    }
  }
  if (!Coder::kReads) return;
  if (right < 1 || right >= size) {
    right = 1;
    fail(coder, "size of a child");
  }
  included = {(flags & 1U) != 0, (flags & 2U) != 0};
  if ((included.left && right == size - 1) || (included.right && right == 1))
    fail(coder, "included children");
}

/// One axis of an offset: bit length of the magnitude as a symbol (plus `bias`, which reading returns), then the bits
/// below its leading one and the sign.
template <class Coder>
int code_offset(Coder& coder, int context, int shift, std::uint32_t max_bias, std::uint32_t& bias,
                std::int32_t& offset) {
  const std::uint32_t negative = offset < 0 ? 1 : 0;
  const auto magnitude =
      static_cast<std::uint32_t>((negative != 0 ? -std::int64_t{offset} : offset) >> shift);
  std::uint32_t length = static_cast<std::uint32_t>(bit_length(magnitude)) + bias;
  coder.refill();
  coder.symbol(context, length);
  if (Coder::kReads) bias = length >= kUnusualFaces ? kUnusualFaces : 0;
  length -= bias;
  if (Coder::kReads && (length > 32 || bias > max_bias)) {
    fail(coder, "length of a number");
    length = 0;
  }
  const std::uint64_t leading = std::uint64_t{1} << length >> 1;
  auto tail = static_cast<std::uint32_t>((magnitude ^ leading) << 1 | negative);
  coder.raw(static_cast<int>(length), tail);
  if (Coder::kReads) {
    const std::uint64_t value = (leading | tail >> 1) << shift;
    if (value > 0x7fffffffU) {
      fail(coder, "offset");
    } else {
      const auto sign = -static_cast<std::int32_t>(tail & 1U);  // all ones when negative
      offset = (static_cast<std::int32_t>(value) ^ sign) - sign;
    }
  }
  return static_cast<int>(length);
}

// ---- outside corners ----------------------------------------------------------------------------

/// Guesses the outside corner of a face from its other two: where an earlier face of the batch lies across one of the
/// new face's edges, its corner there is the one. Holds, for the vertices seen last, the directed edges of faces whose
/// other side has not come; ids near each other fall on different slots.
/// Which of two values is wanted is as good as random here, so nothing branches: masks choose.
class OpenEdges {
 public:
  struct Guesses {
    std::array<std::uint32_t, 4>
        vertex;          // the latest of left's and of right's, then the ones before
    std::uint32_t kind;  // below 32: which of them are outside, and whether left and right agree
  };

  [[nodiscard]] Guesses guess(const SplitFace& face, const NodeSpan& node) const {
    const std::uint32_t begin = node.begin(), size = node.size;
    const Lists l = lists(face.left.value), r = lists(face.right.value);
    const std::size_t out = face.flipped ? 2 : 0, in = 2 - out;
    Guesses guesses{{l[out], r[in], l[out + 1], r[in + 1]}, 0};
    const auto [a0, b0, a1, b1] = guesses.vertex;
    const auto outside = [&](std::uint32_t v) { return v - begin >= size ? 1U : 0U; };
    const std::uint32_t agree = (a0 == b0) | (a0 == b1) | (a1 == b0);
    guesses.kind =
        outside(a0) | outside(b0) << 1 | outside(a1) << 2 | outside(b1) << 3 | agree << 4;
    return guesses;
  }
  /// Some vertex outside of `node` that shares an open edge with the face's left or right corner, or `none`.
  [[nodiscard]] std::uint32_t neighbour(const SplitFace& face, const NodeSpan& node,
                                        std::uint32_t none) const {
    for (const std::uint32_t corner : {face.left.value, face.right.value}) {
      const Lists all = lists(corner);
      for (std::size_t i = 0; i < 4; ++i)
        if (all[i] - node.begin() >= node.size) return all[i];
    }
    return none;
  }
  void add(const SplitFace& face) {
    const std::uint32_t outside = face.outside.value;
    const std::uint32_t a = face.flipped ? face.right.value : face.left.value;
    const std::uint32_t b = face.flipped ? face.left.value : face.right.value;
    add_corner(a, outside, b);
    add_corner(b, a, outside);
    add_corner(outside, b, a);
  }

 private:
  static constexpr std::uint32_t kSlots = 256;
  /// Open edges: from the vertex to the first two, from the last two to the vertex, each the latest first. The vertex
  /// itself stands for none, since it is never outside.
  using Lists = std::uint32_t __attribute__((vector_size(16)));
  struct Slot {
    Lists lists{};
    std::uint32_t vertex = 0xffffffffU;
  };

  static Lists all(std::uint32_t v) { return Lists{v, v, v, v}; }
  static Lists select(Lists mask, Lists a, Lists b) { return b ^ ((a ^ b) & mask); }
  [[nodiscard]] Lists lists(std::uint32_t v) const {
    const Slot& slot = slots_[v % kSlots];
    return select(all(slot.vertex) == all(v), slot.lists, all(v));
  }
  // A face's edges at v, one from `before` and one to `after`. Each closes the edge that runs the other way where the
  // list still has it, and stays open otherwise.
  void add_corner(std::uint32_t v, std::uint32_t before, std::uint32_t after) {
    const Lists old = lists(v), none = all(v);
    const Lists found = Lists(old == Lists{before, before, after, after});
    const Lists gone = found | __builtin_shufflevector(found, found, 0, 0, 2, 2);
    const Lists kept = select(gone, __builtin_shufflevector(old, none, 1, 4, 3, 4), old);
    const Lists added =
        __builtin_shufflevector(kept, Lists{after, before, after, before}, 4, 0, 5, 2);
    Slot& slot = slots_[v % kSlots];
    slot.lists = select(__builtin_shufflevector(gone, gone, 3, 3, 1, 1), kept, added);
    slot.vertex = v;
  }

  std::array<Slot, kSlots> slots_{};
};

// ---- the record ---------------------------------------------------------------------------------

/// One face; left, right and flipped first, then the outside corner. `is_first`: of its record.
template <class Coder>
void code_face(Coder& coder, const SpmHeader& header, OpenEdges& edges, const SplitRecord& record,
               bool is_first, SplitFace& face) {
  const NodeSpan& node = record.node;
  std::uint32_t in_right = face.right.value - record.split.value;
  std::uint32_t in_left = face.left.value - node.begin();
  code_bounded(coder, kInRight, node.end() - record.split.value, in_right);
  code_bounded(coder, kInLeft, record.split.value - node.begin(), in_left);
  if (Coder::kReads) {
    face.right = {record.split.value + in_right};
    face.left = {node.begin() + in_left};
  }

  const OpenEdges::Guesses guesses = edges.guess(face, node);
  std::uint32_t outside = face.outside.value;
  std::uint32_t symbol = 0;
  if (!Coder::kReads) {
    while (symbol < kOutsideBelow && guesses.vertex[symbol] != outside) ++symbol;
    if (symbol == kOutsideBelow && outside >= edges.neighbour(face, node, node.begin())) ++symbol;
  }
  coder.refill();
  coder.symbol(
      kOutside + static_cast<int>(guesses.kind) * 4 + (is_first ? 0 : 2) + (node.size == 2 ? 1 : 0),
      symbol);
  if (symbol < kOutsideBelow) {
    if (Coder::kReads) outside = guesses.vertex[symbol];
  } else {
    if (Coder::kReads && symbol > kOutsideBelow + 1) return fail(coder, "outside corner");
    const bool below = symbol == kOutsideBelow;
    const std::uint32_t none = below ? node.begin() : node.end();
    const std::uint32_t base = edges.neighbour(face, node, none);
    std::uint32_t distance = below ? base - 1 - outside : outside - base;
    code_number(coder, kDistance + (base == none ? 2 : 0) + (below ? 0 : 1), distance);
    if (Coder::kReads) {
      if (distance >= (below ? base : header.vertex_count - base))
        return fail(coder, "outside corner");
      outside = below ? base - 1 - distance : base + distance;
    }
  }
  if (Coder::kReads) {
    if (node.contains({outside})) return fail(coder, "outside corner");
    face.outside = {outside};
  }
  edges.add(face);
}

/// Codes `node`'s split. In: record.node, box_policy, shift; everything else is in when writing and out when reading.
/// `faces` are the record's (reading: appended).
template <class Coder>
void code_record(Coder& coder, const SpmHeader& header, BoxPolicy box_policy, OpenEdges& edges,
                 SplitRecord& record, Inclusion& included, std::vector<SplitFace>& faces,
                 std::uint32_t face_begin) {
  const NodeSpan node = record.node;
  std::uint32_t right_size = Coder::kReads ? 0 : record.right().size;
  code_shape(coder, node.size, right_size, included);
  if (Coder::kReads) record.split = {node.end() - right_size};
  const std::uint32_t left_size = node.size - right_size;

  // Where the new vertex stands, from the old one; and whether the faces that appear are other than two, the second of
  // them flipped.
  std::uint32_t unusual = 0;
  if (!Coder::kReads)
    unusual = record.face_count == 2 && !faces[face_begin].flipped && faces[face_begin + 1].flipped
                  ? 0
                  : kUnusualFaces;
  std::uint32_t none = 0;
  const int length0 = code_offset(coder, kOffset0 + level_class(node.size), header.lattice_shift[0],
                                  kUnusualFaces, unusual, record.offset[0]);
  const int length1 = code_offset(coder, kOffset1 + std::min(length0 / 2, 11),
                                  header.lattice_shift[1], 0, none, record.offset[1]);
  code_offset(coder, kOffset2 + std::min(std::max(length0, length1) / 2, 11),
              header.lattice_shift[2], 0, none, record.offset[2]);

  std::uint32_t flipped = 1;
  if (Coder::kReads) {
    record.face_begin = face_begin;
    record.face_count = 2;
  }
  if (unusual != 0) {
    // How many, and how many of them flipped (those come last).
    if (!Coder::kReads) {
      flipped = 0;
      for (std::uint32_t i = 0; i < record.face_count; ++i)
        flipped += faces[face_begin + i].flipped ? 1 : 0;
    }
    std::uint32_t symbol = record.face_count <= 3
                               ? record.face_count * (record.face_count + 1) / 2 + flipped
                               : kManyNewFaces;
    coder.refill();
    coder.symbol(kFaceCount, symbol);
    if (Coder::kReads) {
      record.face_count = 0;
      if (symbol > kManyNewFaces) return fail(coder, "face count");
      while (symbol < kManyNewFaces &&
             (record.face_count + 1) * (record.face_count + 2) / 2 <= symbol)
        ++record.face_count;
      flipped = symbol - record.face_count * (record.face_count + 1) / 2;
    }
    if (symbol == kManyNewFaces) {
      coder.refill();
      coder.raw(24, record.face_count);
      coder.raw(24, flipped);
      if (Coder::kReads && flipped > record.face_count) return fail(coder, "flipped faces");
    }
  }
  if (unusual == 0) {
    if (Coder::kReads) {
      faces.emplace_back();
      faces.emplace_back().flipped = true;
    }
    code_face(coder, header, edges, record, true, faces[face_begin]);
    code_face(coder, header, edges, record, false, faces[face_begin + 1]);
  } else {
    for (std::uint32_t i = 0; i < record.face_count; ++i) {
      if (Coder::kReads) {
        if (!coder.good()) return;
        faces.emplace_back().flipped = i >= record.face_count - flipped;
      }
      code_face(coder, header, edges, record, i == 0, faces[face_begin + i]);
    }
  }

  // Boxes of the children that stay whole.
  const auto code_box = [&](std::uint32_t size, bool is_included, BoxCode& box) {
    if (size == 1 || (box_policy == BoxPolicy::kCutNodes && is_included)) return;
    const int context = kBox + small_class(size) * 3;
    std::uint32_t greatest = 0;
    for (std::size_t k = 0; k < 6; ++k) {
      if (k % 3 == 0) coder.refill();
      std::uint32_t code = box[k];
      coder.symbol(context + static_cast<int>(k / 2), code);
      if (Coder::kReads) {
        greatest = std::max(greatest, code);
        box[k] = static_cast<std::uint8_t>(code);
      }
    }
    if (greatest > kMaxExtentCode) fail(coder, "box extent");
  };
  code_box(left_size, included.left, record.left_box);
  code_box(right_size, included.right, record.right_box);
}

}  // namespace nearmesh::record
