// SPDX-License-Identifier: Apache-2.0
#pragma once
// The one record codec (core/spm_format.md, "Record"): contexts, and a record described once for counting, writing and
// reading. `Coder` is any of CountingCoder, WritingCoder, ReadingCoder; each member takes the value by reference, uses
// it when counting or writing and sets it when reading, so that the two directions cannot drift apart.

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "bits.hpp"
#include "nearmesh/core/spm/codec.hpp"
#include "nearmesh/core/spm/train.hpp"

namespace nearmesh::record {

// ---- contexts -----------------------------------------------------------------------------------

inline constexpr int kSizeSmall = 0;               // node sizes 3..8, one each
inline constexpr int kSizeLarge = kSizeSmall + 6;  // six classes of larger nodes
inline constexpr int kInclude = kSizeLarge + 6;    // three kinds x five classes
inline constexpr int kOffset0 = kInclude + 15;     // six levels
inline constexpr int kOffset1 = kOffset0 + 6;      // twelve classes of the previous axis
inline constexpr int kOffset2 = kOffset1 + 12;
inline constexpr int kFaceCount = kOffset2 + 12;  // three classes of node size
inline constexpr int kInLeft = kFaceCount + 3;    // eight classes of side size
inline constexpr int kInRight = kInLeft + 8;
inline constexpr int kOutside = kInRight + 8;  // first face of the split, later ones
inline constexpr int kBelow = kOutside + 2;    // distance below the node
inline constexpr int kAbove = kBelow + 1;
inline constexpr int kBox = kAbove + 1;  // six classes of node size x three axes
inline constexpr int kContextCount = kBox + 18;

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

class CountingCoder {
 public:
  static constexpr bool kReads = false;
  explicit CountingCoder(TrainingCounts& counts) : counts_(counts) {}
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
  void symbol(int context, std::uint32_t& value) {
    const HuffmanTable& table = tables_.contexts[context];
    const HuffmanTable::Code code = table.codes[value];
    if (code.length > 0) {
      out_.put(code.bits, code.length);
    } else {
      out_.put(table.codes[kEscape].bits, table.codes[kEscape].length);
      out_.put(value, 7);
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
  ReadingCoder(const CodingTables& tables, BitReader& in) : tables_(tables), in_(in) {}
  void symbol(int context, std::uint32_t& value) {
    const HuffmanTable& table = tables_.contexts[context];
    const HuffmanTable::Decoded found = table.decode[in_.peek(table.decode_bits)];
    in_.skip(found.length);
    value = found.symbol == kEscape ? in_.get(7) : found.symbol;
  }
  void raw(int bits, std::uint32_t& value) { value = in_.get(bits); }
  /// Set by a field whose value cannot be; `what` names it.
  void fail(const char* what) {
    if (error_ == nullptr) error_ = what;
  }
  bool good() const { return error_ == nullptr && !in_.overrun(); }
  const char* error() const { return error_ != nullptr ? error_ : "bytes end inside a record"; }

 private:
  const CodingTables& tables_;
  BitReader& in_;
  const char* error_ = nullptr;
};

template <class Coder>
void fail(Coder& coder, const char* what) {
  if constexpr (Coder::kReads) coder.fail(what);
}

// ---- values -------------------------------------------------------------------------------------

/// A number of at most 32 bits: its bit length as a symbol (plus `bias`), then the bits below its leading one.
template <class Coder>
void code_length_prefixed(Coder& coder, int context, std::uint32_t& value) {
  std::uint32_t length = static_cast<std::uint32_t>(bit_length(value));
  coder.symbol(context, length);
  if (Coder::kReads && length > 32) return fail(coder, "length of a number");
  if (length > 1) {
    std::uint32_t low = value & ((1U << (length - 1)) - 1);
    coder.raw(static_cast<int>(length) - 1, low);
    if (Coder::kReads) value = 1U << (length - 1) | low;
  } else if (Coder::kReads) {
    value = length;
  }
}

/// A number in [0, limit): nothing when limit is 1.
template <class Coder>
void code_bounded(Coder& coder, int context, std::uint32_t limit, std::uint32_t& value) {
  if (limit <= 1) {
    if (Coder::kReads) value = 0;
    return;
  }
  code_length_prefixed(coder, context + std::min(bit_length(limit - 1), 8) - 1, value);
  if (Coder::kReads && value >= limit) {
    fail(coder, "corner inside the node");
    value = 0;
  }
}

/// Size of the right child, in [1, size).
template <class Coder>
void code_right_size(Coder& coder, std::uint32_t size, std::uint32_t& right) {
  if (size == 2) {
    if (Coder::kReads) right = 1;
    return;
  }
  if (size <= 8) {
    std::uint32_t symbol = right - 1;
    coder.symbol(kSizeSmall + static_cast<int>(size) - 3, symbol);
    if (Coder::kReads) right = symbol + 1;
  } else {
    // The smaller side: which one, and its bit length, as one symbol.
    std::uint32_t smaller = std::min(right, size - right);
    const std::uint32_t is_left = right > size - right ? 1 : 0;
    std::uint32_t symbol = static_cast<std::uint32_t>(bit_length(smaller)) * 2 + is_left;
    coder.symbol(kSizeLarge + large_size_class(size), symbol);
    const std::uint32_t length = symbol / 2;
    if (Coder::kReads && (length < 1 || length > 32)) {
      right = 1;
      return fail(coder, "size of a child");
    }
    std::uint32_t low = smaller & ((1U << (length - 1)) - 1);
    coder.raw(static_cast<int>(length) - 1, low);
    if (Coder::kReads) {
      smaller = 1U << (length - 1) | low;
      right = symbol % 2 != 0 ? size - smaller : smaller;
    }
  }
  if (Coder::kReads && (right < 1 || right >= size)) {
    right = 1;
    fail(coder, "size of a child");
  }
}

/// The last corners seen, most recent first: neighbouring splits share their outer corners.
class RecentCorners {
 public:
  static constexpr std::uint32_t kCount = 32;

  /// Place of v, or kCount.
  [[nodiscard]] std::uint32_t find(std::uint32_t v) const {
    for (std::uint32_t i = 0; i < used_; ++i)
      if (items_[i] == v) return i;
    return kCount;
  }
  [[nodiscard]] std::uint32_t at(std::uint32_t i) const { return items_[i]; }
  [[nodiscard]] std::uint32_t used() const { return used_; }
  void touch(std::uint32_t v) { touch(v, find(v)); }
  void touch(std::uint32_t v, std::uint32_t place) {
    if (place == kCount) {
      if (used_ < kCount) ++used_;
      place = used_ - 1;
    }
    for (; place > 0; --place) items_[place] = items_[place - 1];
    items_[0] = v;
  }
  void clear() { used_ = 0; }

 private:
  std::array<std::uint32_t, kCount> items_{};
  std::uint32_t used_ = 0;
};

// ---- the record ---------------------------------------------------------------------------------

/// What the codec needs of a record beside SplitRecord.
struct Inclusion {
  bool left = false, right = false;  // the child's split is in the same treelet
};

/// Codes `node`'s split. In: record.node, box_policy, shift; everything else is in when writing and out when reading.
/// `faces` are the record's (reading: appended).
template <class Coder>
void code_record(Coder& coder, const SpmHeader& header, BoxPolicy box_policy, RecentCorners& recent,
                 SplitRecord& record, Inclusion& included, std::vector<SplitFace>& faces,
                 std::uint32_t face_begin) {
  const NodeSpan node = record.node;

  // Where the node is divided.
  std::uint32_t right_size = Coder::kReads ? 0 : record.right().size;
  code_right_size(coder, node.size, right_size);
  if (Coder::kReads) record.split = {node.end() - right_size};
  const std::uint32_t left_size = node.size - right_size;

  // Which children are divided too.
  const int kind = left_size > 1 ? (right_size > 1 ? 0 : 1) : 2;
  if (left_size > 1 || right_size > 1) {
    const int klass = std::min(small_class(std::max(left_size, right_size)), 4);
    std::uint32_t symbol = (included.left ? 1U : 0U) | (included.right ? 2U : 0U);
    coder.symbol(kInclude + kind * 5 + klass, symbol);
    if (Coder::kReads) {
      included = {(symbol & 1U) != 0, (symbol & 2U) != 0};
      if (symbol > 3 || (included.left && left_size == 1) || (included.right && right_size == 1))
        fail(coder, "included children");
    }
  } else if (Coder::kReads) {
    included = {};
  }

  // Where the new vertex stands, from the old one.
  int previous = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int shift = header.lattice_shift[axis];
    const int context = axis == 0 ? kOffset0 + level_class(node.size)
                                  : (axis == 1 ? kOffset1 : kOffset2) + std::min(previous / 2, 11);
    const std::int64_t offset = record.offset[axis];
    std::uint32_t magnitude = static_cast<std::uint32_t>((offset < 0 ? -offset : offset) >> shift);
    code_length_prefixed(coder, context, magnitude);
    std::uint32_t negative = offset < 0 ? 1 : 0;
    if (magnitude != 0) coder.raw(1, negative);
    if (Coder::kReads) {
      const std::int64_t value = static_cast<std::int64_t>(magnitude) << shift;
      if (value > std::int64_t{0x7fffffff}) {
        fail(coder, "offset");
      } else {
        record.offset[axis] =
            static_cast<std::int32_t>(magnitude != 0 && negative != 0 ? -value : value);
      }
    }
    previous = std::max(previous, bit_length(magnitude));
  }

  // The faces that appear: how many, how many of them flipped (those come last).
  const std::uint32_t count_in = record.face_count;
  std::uint32_t flipped = 0;
  if (!Coder::kReads) {
    for (std::uint32_t i = 0; i < count_in; ++i) flipped += faces[face_begin + i].flipped ? 1 : 0;
  }
  std::uint32_t symbol = count_in <= 3 ? count_in * (count_in + 1) / 2 + flipped : 10;
  coder.symbol(kFaceCount + std::min(bit_length(node.size - 1), 3) - 1, symbol);
  if (Coder::kReads) {
    record.face_begin = face_begin;
    record.face_count = 0;
    if (symbol > 10) return fail(coder, "face count");
    while (symbol < 10 && (record.face_count + 1) * (record.face_count + 2) / 2 <= symbol)
      ++record.face_count;
    flipped = symbol - record.face_count * (record.face_count + 1) / 2;
  }
  if (symbol == 10) {
    coder.raw(24, record.face_count);
    coder.raw(24, flipped);
    if (Coder::kReads && flipped > record.face_count) return fail(coder, "flipped faces");
  }
  for (std::uint32_t i = 0; i < record.face_count; ++i) {
    if (Coder::kReads) {
      if (!coder.good()) return;
      faces.push_back({{}, {}, {}, i >= record.face_count - flipped});
    }
    SplitFace& face = faces[face_begin + i];
    std::uint32_t in_right = face.right.value - record.split.value;
    std::uint32_t in_left = face.left.value - node.begin();
    code_bounded(coder, kInRight, right_size, in_right);
    code_bounded(coder, kInLeft, left_size, in_left);
    if (Coder::kReads) {
      face.right = {record.split.value + in_right};
      face.left = {node.begin() + in_left};
    }
    std::uint32_t outside = face.outside.value;
    const std::uint32_t place_in = Coder::kReads ? 0 : recent.find(outside);
    std::uint32_t place = place_in < RecentCorners::kCount ? place_in
                          : outside < node.begin()         ? RecentCorners::kCount
                                                           : RecentCorners::kCount + 1;
    coder.symbol(kOutside + (i > 0 ? 1 : 0), place);
    if (place < RecentCorners::kCount) {
      if (Coder::kReads) {
        if (place >= recent.used()) return fail(coder, "recent corner");
        outside = recent.at(place);
        if (node.contains({outside})) return fail(coder, "recent corner");
      }
    } else if (place == RecentCorners::kCount) {
      std::uint32_t distance = node.begin() - 1 - outside;
      code_length_prefixed(coder, kBelow, distance);
      if (Coder::kReads && distance >= node.begin()) return fail(coder, "corner below the node");
      outside = node.begin() - 1 - distance;
    } else {
      std::uint32_t distance = outside - node.end();
      code_length_prefixed(coder, kAbove, distance);
      if (Coder::kReads &&
          (place != RecentCorners::kCount + 1 || distance >= header.vertex_count - node.end()))
        return fail(coder, "corner above the node");
      outside = node.end() + distance;
    }
    if (Coder::kReads) face.outside = {outside};
    recent.touch(outside, place < RecentCorners::kCount ? place : RecentCorners::kCount);
    recent.touch(face.left.value);
    recent.touch(face.right.value);
  }

  // Boxes of the children that stay whole.
  const auto code_box = [&](std::uint32_t size, bool is_included, BoxCode& box) {
    if (Coder::kReads) box = kNoBox;
    if (size == 1 || (box_policy == BoxPolicy::kCutNodes && is_included)) return;
    for (std::size_t k = 0; k < 6; ++k) {
      std::uint32_t code = box[k];
      coder.symbol(kBox + small_class(size) * 3 + static_cast<int>(k / 2), code);
      if (Coder::kReads) {
        if (code > kMaxExtentCode) return fail(coder, "box extent");
        box[k] = static_cast<std::uint8_t>(code);
      }
    }
  };
  code_box(left_size, included.left, record.left_box);
  code_box(right_size, included.right, record.right_box);
}

}  // namespace nearmesh::record
