// SPDX-License-Identifier: Apache-2.0
#pragma once
// The one record codec (core/spm_format.md, "Record"): contexts, and a record described once for counting, writing and
// reading. `Coder` is any of CountingCoder, WritingCoder, ReadingCoder; each member takes the value by reference, uses
// it when counting or writing and sets it when reading, so that the two directions cannot drift apart.
// A reader looks at its bytes once for several fields: refill() makes WindowReader::kReadyBits of them ready, of which a
// symbol takes at most kMaxCodeBits (an escape sees to itself) and raw(n) takes n.

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <vector>

#include "bits.hpp"
#include "nearmesh/core/spm/codec.hpp"
#include "nearmesh/core/spm/train.hpp"
#include "open_edges.hpp"

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

// Classes of a node's size, by how many bits size - 1 has.
inline constexpr std::array<std::int8_t, 33> classes_of(const std::array<int, 5>& last_bits) {
  std::array<std::int8_t, 33> classes{};
  for (int bits = 0; bits < 33; ++bits)
    for (const int last : last_bits)
      if (bits > last) ++classes[static_cast<std::size_t>(bits)];
  return classes;
}
inline constexpr auto kSmallClasses =
    classes_of({1, 2, 3, 4, 6});  // 2, 3-4, 5-8, 9-16, 17-64, more
inline constexpr auto kLevelClasses =
    classes_of({1, 2, 3, 4, 5});  // 2, 3-4, 5-8, 9-16, 17-32, more
inline constexpr auto kLargeClasses =
    classes_of({4, 5, 6, 9, 13});  // 9-16, 17-32, 33-64, 65-512, 513-8192, more
inline int class_of(std::uint32_t size, const std::array<std::int8_t, 33>& classes) {
  return classes[static_cast<std::size_t>(bit_length(size - 1))];
}

// ---- coders -------------------------------------------------------------------------------------

inline constexpr int kEscapedBits = 7;

class CountingCoder {
 public:
  static constexpr bool kReads = false;
  explicit CountingCoder(TrainingCounts& counts) : counts_(counts) {}
  void refill() {}
  template <int kBits = kFastCodeBits>
  void symbol(int context, std::uint32_t& value) {
    ++counts_[context][std::min(value, 126U)];
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
  template <int kBits = kFastCodeBits>
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
  void raw(std::uint32_t bits, std::uint32_t& value) { out_.put(value, static_cast<int>(bits)); }
  bool good() const { return true; }

 private:
  const HuffmanTable* contexts_;
  BitWriter& out_;
};

class ReadingCoder {
 public:
  static constexpr bool kReads = true;
  /// Reads on where `in` stands.
  ReadingCoder(const CodingTables& tables, const BitReader& in)
      : few_(tables.fast<kFewCodeBits>()),
        fast_(tables.fast<kFastCodeBits>()),
        contexts_(tables.contexts().data()),
        in_(in) {}
  void refill() { in_.refill(); }
  template <int kBits = kFastCodeBits>
  void symbol(int context, std::uint32_t& value) {
    const HuffmanTable::Decoded* const fast = kBits == kFewCodeBits ? few_ : fast_;
    const HuffmanTable::Decoded found =
        fast[(static_cast<std::size_t>(context) << kBits) + (in_.window() >> (64 - kBits))];
    value = found.symbol;
    in_.take(found.length);
    if (found.length == 0) [[unlikely]]
      value = long_symbol(contexts_[context]);
  }
  void raw(std::uint32_t bits, std::uint32_t& value) {
    value = static_cast<std::uint32_t>(in_.window() >> 1 >> (63 - bits));
    in_.take(bits);
  }
  /// Set by a field whose value cannot be; `what` names it.
  void fail(const char* what) {
    if (error_ == nullptr) error_ = what;
  }
  bool good() const { return error_ == nullptr && !in_.overrun(); }
  const char* error() const { return error_ != nullptr ? error_ : "bytes end inside a record"; }
  [[nodiscard]] std::size_t bits_left() const { return in_.bits_left(); }

 private:
  std::uint32_t long_symbol(const HuffmanTable& table) {
    const HuffmanTable::Decoded found = table.decode[in_.window() >> 1 >> (63 - table.decode_bits)];
    std::uint32_t value = found.symbol;
    in_.take(found.length);
    if (found.symbol == kEscape) {
      in_.refill();  // a long number and the code of the escape may have left fewer bits
      raw(kEscapedBits, value);
    }
    in_.refill();
    return value;
  }

  const HuffmanTable::Decoded *few_, *fast_;
  const HuffmanTable* contexts_;
  WindowReader in_;
  const char* error_ = nullptr;
};

template <class Coder>
void fail(Coder& coder, const char* what) {
  if constexpr (Coder::kReads) coder.fail(what);
}

// ---- values -------------------------------------------------------------------------------------

/// A number of at most 32 bits: its bit length as a symbol, then the bits below its leading one. Takes at most
/// kMaxCodeBits + 31 of what is ready.
template <class Coder>
void code_number(Coder& coder, int context, std::uint32_t& value) {
  std::uint32_t length = static_cast<std::uint32_t>(bit_length(value));
  coder.symbol(context, length);
  if (Coder::kReads && length > 32) {
    value = 0;
    return fail(coder, "length of a number");
  }
  const std::uint64_t leading = std::uint64_t{1} << length >> 1;
  std::uint32_t low = value & static_cast<std::uint32_t>(leading - (leading != 0));
  coder.raw(length - (length > 0 ? 1 : 0), low);
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
    coder.symbol(kShapeLarge + class_of(size, kLargeClasses), symbol);
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
    coder.raw(static_cast<std::uint32_t>(length - 1), low);
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
  if (((flags & 1U) & (right == size - 1 ? 1U : 0U)) | ((flags >> 1) & (right == 1 ? 1U : 0U)))
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
  coder.raw(length, tail);
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

/// Which children of a node are known to be leaves when its faces are coded: then the node says which vertex a corner is.
template <bool kLeft, bool kRight>
struct Leaves {
  static constexpr bool kLeftIsLeaf = kLeft, kRightIsLeaf = kRight;
};

// ---- the record ---------------------------------------------------------------------------------

/// One face; left, right and flipped first, then the outside corner. `is_first`: of its record.
template <bool kFlipped, class Leaf, class Coder>
void code_face(Coder& coder, const SpmHeader& header, OpenEdges& edges, const NodeSpan& node,
               std::uint32_t split, bool is_first, SplitFace& face) {
  std::uint32_t left = Leaf::kLeftIsLeaf ? node.begin() : face.left.value;
  std::uint32_t right = Leaf::kRightIsLeaf ? split : face.right.value;
  coder.refill();
  if (!Leaf::kRightIsLeaf) {
    std::uint32_t in_right = right - split;
    code_bounded(coder, kInRight, node.end() - split, in_right);
    if (Coder::kReads) right = split + in_right;
    if (!Leaf::kLeftIsLeaf) coder.refill();
  }
  if (!Leaf::kLeftIsLeaf) {
    std::uint32_t in_left = left - node.begin();
    code_bounded(coder, kInLeft, split - node.begin(), in_left);
    if (Coder::kReads) left = node.begin() + in_left;
  }

  const OpenEdges::Around around = edges.around<kFlipped>(left, right, node);
  std::array<std::uint32_t, 4> guesses;
  std::memcpy(guesses.data(), &around.guesses, sizeof guesses);
  std::uint32_t outside = face.outside.value;
  std::uint32_t symbol = 0;
  if (!Coder::kReads) {
    while (symbol < kOutsideBelow && guesses[symbol] != outside) ++symbol;
    if (symbol == kOutsideBelow && outside >= OpenEdges::neighbour(around, node, node.begin()))
      ++symbol;
  }
  coder.template symbol<kFewCodeBits>(kOutside + static_cast<int>(around.kind) * 4 +
                                          (is_first ? 0 : 2) +
                                          (Leaf::kLeftIsLeaf && Leaf::kRightIsLeaf ? 1 : 0),
                                      symbol);
  if (symbol < kOutsideBelow) {
    if (Coder::kReads) outside = guesses[symbol];
  } else {
    if (Coder::kReads && symbol > kOutsideBelow + 1) return fail(coder, "outside corner");
    const bool below = symbol == kOutsideBelow;
    const std::uint32_t none = below ? node.begin() : node.end();
    const std::uint32_t base = OpenEdges::neighbour(around, node, none);
    std::uint32_t distance = below ? base - 1 - outside : outside - base;
    coder.refill();
    code_number(coder, kDistance + (base == none ? 2 : 0) + (below ? 0 : 1), distance);
    if (Coder::kReads) {
      // Below and above are as likely as each other: masks again. base - 1 - x is base + ~x.
      const std::uint32_t down = below ? 0xffffffffU : 0;
      if (distance >= ((base & down) | ((header.vertex_count - base) & ~down)))
        return fail(coder, "outside corner");
      outside = base + (distance ^ down);
    }
  }
  if (Coder::kReads) {
    if (node.contains({outside})) return fail(coder, "outside corner");
    face = {{left}, {right}, {outside}, kFlipped};
  }
  edges.add<kFlipped>(around, left, right, outside);
}

/// The usual two faces.
template <class Leaf, class Coder>
void code_two_faces(Coder& coder, const SpmHeader& header, OpenEdges& edges, const NodeSpan& node,
                    std::uint32_t split, SplitFace* faces) {
  code_face<false, Leaf>(coder, header, edges, node, split, true, faces[0]);
  code_face<true, Leaf>(coder, header, edges, node, split, false, faces[1]);
}

/// Faces of any number; the last `flipped` of them are.
template <class Coder>
void code_any_faces(Coder& coder, const SpmHeader& header, OpenEdges& edges, const NodeSpan& node,
                    std::uint32_t split, std::uint32_t flipped, std::uint32_t count,
                    std::vector<SplitFace>& faces, std::uint32_t face_begin) {
  for (std::uint32_t i = 0; i < count; ++i) {
    if (Coder::kReads) {
      if (!coder.good()) return;
      if (faces.size() == face_begin + i) faces.emplace_back();
    }
    SplitFace& face = faces[face_begin + i];
    const bool is_first = i == 0, is_flipped = i >= count - flipped;
    if (node.size > 2) {
      using Leaf = Leaves<false, false>;
      if (is_flipped) {
        code_face<true, Leaf>(coder, header, edges, node, split, is_first, face);
      } else {
        code_face<false, Leaf>(coder, header, edges, node, split, is_first, face);
      }
    } else {
      using Leaf = Leaves<true, true>;
      if (is_flipped) {
        code_face<true, Leaf>(coder, header, edges, node, split, is_first, face);
      } else {
        code_face<false, Leaf>(coder, header, edges, node, split, is_first, face);
      }
    }
  }
}

/// Codes `node`'s split. In: record.node, box_policy, shift; everything else is in when writing and out when reading.
/// `faces` are the record's from `face_begin` on (reading: appended there, over what stands there).
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
  const int length0 =
      code_offset(coder, kOffset0 + class_of(node.size, kLevelClasses), header.lattice_shift[0],
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
    if (Coder::kReads && faces.size() < face_begin + std::size_t{2})
      faces.resize(face_begin + std::size_t{2});
    SplitFace* const two = faces.data() + face_begin;
    const std::uint32_t split = node.end() - right_size;
    if (node.size == 2) {
      code_two_faces<Leaves<true, true>>(coder, header, edges, node, split, two);
    } else if (right_size == 1) {
      code_two_faces<Leaves<false, true>>(coder, header, edges, node, split, two);
    } else if (left_size == 1) {
      code_two_faces<Leaves<true, false>>(coder, header, edges, node, split, two);
    } else {
      code_two_faces<Leaves<false, false>>(coder, header, edges, node, split, two);
    }
  } else {
    code_any_faces(coder, header, edges, node, node.end() - right_size, flipped, record.face_count,
                   faces, face_begin);
  }

  // Boxes of the children that stay whole.
  const auto code_box = [&](std::uint32_t size, bool is_included, BoxCode& box) {
    if (size == 1 || (box_policy == BoxPolicy::kCutNodes && is_included)) return;
    const int context = kBox + class_of(size, kSmallClasses) * 3;
    std::uint32_t greatest = 0;
#pragma GCC unroll 6
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
