// SPDX-License-Identifier: Apache-2.0
#pragma once
// The one record codec (core/spm_format.md, "Record"): a record described once for counting,
// writing and reading. `Coder` is any of CountingCoder, WritingCoder, ReadingCoder; each member
// takes the value by reference, uses it when counting or writing and sets it when reading, so that
// the two directions cannot drift apart.
//
// A record is the split of one node. Say node [40..44] is split at 42: vertex 42 appears beside 40,
// with two faces:
//
//          a                  a             left child [40..41], right child [42..44]
//         / \                /|\            face 1: left 40, right 42, outside a
//        /   \              / | \           face 2: left 40, right 42, outside b, flipped (runs
//       40    .    ->      40--42  .                the other way round)
//        \   /              \ | /
//         \ /                \|/
//          b                  b
//
// a and b are vertices outside of the node; a face's left corner is any vertex of the left child,
// and its right one any of the right child: in the full mesh the face may join 41 and 44.
//
// On the wire it is, symbol by symbol, each by the Huffman code of a context that follows from what
// is in [ ]:
//
//      shape          [node size 5]        right child has 3 vertices; its split is in this batch,
//                                          the left child's is not
//      x offset       [node size]          bit length of |42.x - 40.x|, then its bits below the
//                                          leading one, and the sign
//      y offset       [length of x]        the same
//      z offset       [longer of x and y]  the same
//      inner corners  [sizes of children]  all four of the two faces, as places in their children:
//                                          here 0, 0 and 0, 0
//      outside pair   [kinds of guesses]   both outside corners: "a is guess 0, b is none of the
//                                          guesses and above"
//      distance       [...]                how far b lies above: only for a corner that was not
//                                          guessed
//      box of left    [size of left child] six extents. The right child's is not sent: it is split
//                                          in this batch as well
//
// The node itself is not on the wire: it follows from the record before (codec.cpp, ExpectedNodes).
// Five things keep it short:
//   - The first vertex stands for the node, so an offset from it is small, and the smaller the node
//     the smaller.
//   - A number is coded as its bit length and its bits: what is predictable is its size.
//   - What is usual costs nothing. Nearly every record has two faces, the second flipped, so a
//     record says only when it has not: by 33 added to the first offset's length (kUnusualFaces).
//   - Outside corners are guessed. Next to a face there mostly is a face of this batch already,
//     which has an edge that waits for its other side (open_edges.hpp): the corner across it is the
//     guess.
//   - Symbols that go together are one: a Huffman code spends a whole bit at least on each.
//
// Whoever reads must not believe a field. Each value is checked where it is read, and set to
// something harmless where it is wrong, so that reading can go on to the end of the record without
// a look at an error after each field; the first one is kept in the coder, and good() asks for it.

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "contexts.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "open_edges.hpp"
#include "record_coders.hpp"

namespace nearmesh::record {

// ---- values -------------------------------------------------------------------------------------

/// A number of at most 32 bits: its bit length as a symbol, then the bits below its leading one.
/// Takes at most kMaxCodeBits + 31 of what is ready.
template <class Coder>
void code_number(Coder& coder, int context, std::uint32_t& value) {
  auto length = static_cast<std::uint32_t>(bit_length(value));
  // By a shift in 64 bits: a length of 32 is allowed, and one of 0 must give 0.
  std::uint32_t low = value & ~static_cast<std::uint32_t>(std::uint64_t{1} << length >> 1);
  coder.template number<NumberTail>(context, length, low);
  if (!Coder::kReads) return;
  if (length > 32) {
    length = 0;
    fail(coder, "length of a number");
  }
  value = static_cast<std::uint32_t>(std::uint64_t{1} << length >> 1) | low;
}

/// A number in [0, limit): nothing when limit is 1.
template <class Coder>
void code_bounded(Coder& coder, int context, std::uint32_t limit, std::uint32_t& value) {
  if (limit <= 1) {
    if (Coder::kReads) value = 0;
    return;
  }
  code_number(coder, context + std::min(index_bits(limit), 8) - 1, value);
  if (Coder::kReads && value >= limit) {
    fail(coder, "corner inside the node");
    value = 0;
  }
}

// ---- node and place -----------------------------------------------------------------------------

/// What the codec needs of a record beside SplitRecord.
struct Inclusion {
  bool left = false, right = false;  // the child's split is in the same treelet
};

/// Where the node is divided, as the size of the right child in [1, size), and which children are
/// divided too.
template <class Coder>
void code_shape(Coder& coder, std::uint32_t size, std::uint32_t& right, Inclusion& included) {
  // Two vertices can be parted one way, and neither child can be divided: no symbol.
  if (size == 2) {
    if (Coder::kReads) {
      right = 1;
      included = {};
    }
    return;
  }
  std::uint32_t flags = (included.left ? 1U : 0U) | (included.right ? 2U : 0U);
  coder.refill();
  // Small nodes: place and flags in one symbol, with a code for each size.
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
  // A leaf cannot be divided. Sizes are below 2^31: the highest bit of one less two says that it is
  // 1, and nothing branches.
  if ((flags & ((size - right - 2) >> 31)) | (flags >> 1 & ((right - 2) >> 31)))
    fail(coder, "included children");
}

/// One axis of an offset: bit length of the magnitude as a symbol (plus `bias`, which reading
/// returns), then the bits below its leading one and the sign.
template <class Coder>
int code_offset(Coder& coder, int context, int shift, std::uint32_t max_bias, std::uint32_t& bias,
                std::int32_t& offset) {
  const std::uint32_t negative = offset < 0 ? 1 : 0;
  const auto magnitude =
      static_cast<std::uint32_t>((negative != 0 ? -std::int64_t{offset} : offset) >> shift);
  std::uint32_t length = static_cast<std::uint32_t>(bit_length(magnitude));
  auto tail =
      static_cast<std::uint32_t>((magnitude ^ (std::uint64_t{1} << length >> 1)) << 1 | negative);
  length += bias;
  coder.refill();
  coder.template number<OffsetTail>(context, length, tail);
  if (Coder::kReads) bias = length >= kUnusualFaces ? kUnusualFaces : 0;
  length -= bias;
  if (!Coder::kReads) return static_cast<int>(length);
  if (length > 32 || bias > max_bias) {
    fail(coder, "length of a number");
    length = 0;
  }
  const std::uint64_t value = ((std::uint64_t{1} << length >> 1) | tail >> 1) << shift;
  if (value > 0x7fffffffU) {
    fail(coder, "offset");
  } else {
    const auto sign = -static_cast<std::int32_t>(tail & 1U);  // all ones when negative
    offset = (static_cast<std::int32_t>(value) ^ sign) - sign;
  }
  return static_cast<int>(length);
}

// ---- faces --------------------------------------------------------------------------------------

/// The usual two faces of a record: their corners in the node's children, given as places there.
struct InnerCorners {
  std::array<std::uint32_t, 2> left{}, right{};
};

/// One symbol for all four where the sides are small, else a number each; nothing where both are
/// leaves.
template <class Coder>
void code_inner_corners(Coder& coder, std::uint32_t left_size, std::uint32_t right_size,
                        InnerCorners& corners) {
  auto& [left, right] = corners;
  if (left_size + right_size == 2) return;
  const int left_bits = index_bits(left_size), right_bits = index_bits(right_size);
  coder.refill();
  // As digits of one number, each as wide as its side needs: at most 2 * kMaxCornerBits bits in
  // all.
  if (left_bits + right_bits <= kMaxCornerBits) {
    const int right_at = 2 * left_bits;
    std::uint32_t symbol =
        left[0] | left[1] << left_bits | right[0] << right_at | right[1] << (right_at + right_bits);
    coder.symbol(kCornerContexts[left_size][right_size], symbol);
    if (!Coder::kReads) return;
    const std::uint32_t left_mask = (1U << left_bits) - 1, right_mask = (1U << right_bits) - 1;
    left = {symbol & left_mask, symbol >> left_bits & left_mask};
    right = {symbol >> right_at & right_mask, symbol >> (right_at + right_bits)};
    if (std::max(left[0], left[1]) >= left_size || std::max(right[0], right[1]) >= right_size) {
      corners = {};
      fail(coder, "corner inside the node");
    }
    return;
  }
  for (std::size_t i = 0; i < 2; ++i) {
    if (i > 0) coder.refill();
    code_bounded(coder, kInRight, right_size, right[i]);
    if (left_size > 1 && right_size > 1) coder.refill();
    code_bounded(coder, kInLeft, left_size, left[i]);
  }
}

using Guesses = std::array<std::uint32_t, 4>;
inline Guesses guesses_of(const OpenEdges::Around& around) {
  return std::bit_cast<Guesses>(around.guesses);
}

/// The symbol of an outside corner: which guess is right, or on which side of the neighbour it
/// lies.
inline std::uint32_t outside_symbol(const OpenEdges::Around& around, const NodeSpan& node,
                                    std::uint32_t outside) {
  const Guesses guesses = guesses_of(around);
  const auto found = std::find(guesses.begin(), guesses.end(), outside);
  if (found != guesses.end()) return static_cast<std::uint32_t>(found - guesses.begin());
  return kOutsideBelow + (outside < OpenEdges::neighbour(around, node, node.begin()) ? 0 : 1);
}

/// The outside corner that `symbol` stands for. If it is not among the guesses it is likely to be
/// near some vertex that the face's own corners share an edge with; without one, near the node.
template <class Coder>
void code_outside(Coder& coder, const SpmHeader& header, const OpenEdges::Around& around,
                  const NodeSpan& node, std::uint32_t symbol, std::uint32_t& outside) {
  if (symbol < kOutsideBelow) {
    outside = guesses_of(around)[symbol];
  } else {
    const bool below = symbol == kOutsideBelow;
    const std::uint32_t none = below ? node.begin() : node.end();
    const std::uint32_t base = OpenEdges::neighbour(around, node, none);
    std::uint32_t distance = below ? base - 1 - outside : outside - base;
    coder.refill();
    code_number(coder, distance_context(base != none, below, node.size), distance);
    if (Coder::kReads) {
      // Below and above are as likely as each other: masks choose. base - 1 - x is base + ~x.
      const std::uint32_t down = below ? 0xffffffffU : 0;
      if (distance >= ((base & down) | ((header.vertex_count - base) & ~down)))
        return fail(coder, "outside corner");
      outside = base + (distance ^ down);
    }
  }
  if (Coder::kReads && node.contains({outside})) fail(coder, "outside corner");
}

/// The usual two faces. Both corners' guesses are of what is known before either: all but the
/// symbols can then be had at once.
template <class Coder>
void code_two_faces(Coder& coder, const SpmHeader& header, OpenEdges& edges, const NodeSpan& node,
                    std::uint32_t split, SplitFace* faces) {
  InnerCorners corners;
  if (!Coder::kReads)
    corners = {{faces[0].left.value - node.begin(), faces[1].left.value - node.begin()},
               {faces[0].right.value - split, faces[1].right.value - split}};
  code_inner_corners(coder, split - node.begin(), node.end() - split, corners);
  const std::array left{node.begin() + corners.left[0], node.begin() + corners.left[1]};
  const std::array right{split + corners.right[0], split + corners.right[1]};

  const OpenEdges::Around first = edges.around<false>(left[0], right[0], node);
  const OpenEdges::Around second = edges.around<true>(left[1], right[1], node);
  std::array outside{faces[0].outside.value, faces[1].outside.value};
  std::array<std::uint32_t, 2> symbols{};
  if (!Coder::kReads)
    symbols = {outside_symbol(first, node, outside[0]), outside_symbol(second, node, outside[1])};
  std::uint32_t both = symbols[0] * 8 + symbols[1];
  coder.symbol(kOutsidePair + kPairKinds[first.kind] * 13 + kPairKinds[second.kind], both);
  if (Coder::kReads) {
    if (both / 8 >= kOutsideSymbols || both % 8 >= kOutsideSymbols) {
      both = 0;
      fail(coder, "outside corner");
    }
    symbols = {both / 8, both % 8};
  }
  code_outside(coder, header, first, node, symbols[0], outside[0]);
  code_outside(coder, header, second, node, symbols[1], outside[1]);
  if (Coder::kReads) {
    faces[0] = {{left[0]}, {right[0]}, {outside[0]}, false};
    faces[1] = {{left[1]}, {right[1]}, {outside[1]}, true};
  }
  edges.add<false>(left[0], right[0], outside[0]);
  edges.add<true>(left[1], right[1], outside[1]);
}

/// One of any number of faces.
template <bool kFlipped, class Coder>
void code_any_face(Coder& coder, const SpmHeader& header, OpenEdges& edges, const NodeSpan& node,
                   std::uint32_t split, SplitFace& face) {
  std::uint32_t in_right = face.right.value - split, in_left = face.left.value - node.begin();
  coder.refill();
  code_bounded(coder, kInRight, node.end() - split, in_right);
  coder.refill();
  code_bounded(coder, kInLeft, split - node.begin(), in_left);
  const std::uint32_t left = node.begin() + in_left, right = split + in_right;
  const OpenEdges::Around around = edges.around<kFlipped>(left, right, node);
  std::uint32_t outside = face.outside.value;
  std::uint32_t symbol = Coder::kReads ? 0 : outside_symbol(around, node, outside);
  coder.symbol(kOutside + static_cast<int>(around.kind), symbol);
  if (Coder::kReads && symbol >= kOutsideSymbols) return fail(coder, "outside corner");
  code_outside(coder, header, around, node, symbol, outside);
  face = {{left}, {right}, {outside}, kFlipped};
  edges.add<kFlipped>(left, right, outside);
}

/// How many faces, and how many of them flipped, where they are not the usual two.
template <class Coder>
void code_face_count(Coder& coder, std::uint32_t& count, std::uint32_t& flipped) {
  std::uint32_t symbol = count <= 3 ? count * (count + 1) / 2 + flipped : kManyNewFaces;
  coder.refill();
  coder.symbol(kFaceCount, symbol);
  if (Coder::kReads) {
    count = 0;
    while (symbol < kManyNewFaces && (count + 1) * (count + 2) / 2 <= symbol) ++count;
    flipped = symbol < kManyNewFaces ? symbol - count * (count + 1) / 2 : 0;
    if (symbol > kManyNewFaces) return fail(coder, "face count");
  }
  if (symbol == kManyNewFaces) {
    coder.refill();
    coder.raw(24, count);
    coder.raw(24, flipped);
    if (Coder::kReads && flipped > count) fail(coder, "flipped faces");
  }
}

/// Faces of any number but the usual two, the flipped ones last. In: node and split of the record;
/// reading: faces are appended from record.face_begin on, over what stands there.
template <class Coder>
[[gnu::noinline]] void code_any_faces(Coder& coder, const SpmHeader& header, OpenEdges& edges,
                                      SplitRecord& record, std::vector<SplitFace>& faces) {
  std::uint32_t count = record.face_count, flipped = 0;
  if (!Coder::kReads)
    for (std::uint32_t i = 0; i < count; ++i)
      flipped += faces[record.face_begin + i].flipped ? 1 : 0;
  code_face_count(coder, count, flipped);
  for (std::uint32_t i = 0; i < count && coder.good(); ++i) {
    if (Coder::kReads && faces.size() == record.face_begin + i) faces.emplace_back();
    SplitFace& face = faces[record.face_begin + i];
    if (i >= count - flipped) {
      code_any_face<true>(coder, header, edges, record.node, record.split.value, face);
    } else {
      code_any_face<false>(coder, header, edges, record.node, record.split.value, face);
    }
  }
  record.face_count = count;
}

// ---- boxes --------------------------------------------------------------------------------------

/// The box of a node of this size.
template <class Coder>
void code_box(Coder& coder, std::uint32_t size, BoxCode& box) {
  const int context = kBox + class_of(size, kBoxClasses) * 3;
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
}

// ---- the record ---------------------------------------------------------------------------------

/// Codes `node`'s split. In: record.node and face_begin, box_policy; everything else is in when
/// writing and out when reading. `faces` are the record's from face_begin on (reading: appended
/// there, over what stands there).
template <class Coder>
void code_record(Coder& coder, const SpmHeader& header, BoxPolicy box_policy, OpenEdges& edges,
                 SplitRecord& record, Inclusion& included, std::vector<SplitFace>& faces) {
  const NodeSpan node = record.node;
  std::uint32_t right_size = Coder::kReads ? 0 : record.right().size;
  code_shape(coder, node.size, right_size, included);
  const std::uint32_t split = node.end() - right_size, left_size = node.size - right_size;
  if (Coder::kReads) record.split = {split};

  // Where the new vertex stands, from the old one; and whether the faces that appear are other than
  // two, the second of them flipped.
  std::uint32_t unusual = 0, none = 0;
  if (!Coder::kReads) {
    const SplitFace* const own = faces.data() + record.face_begin;
    unusual = record.face_count == 2 && !own[0].flipped && own[1].flipped ? 0 : kUnusualFaces;
  }
  const int length0 =
      code_offset(coder, kOffset0 + class_of(node.size, kLevelClasses), header.lattice_shift[0],
                  kUnusualFaces, unusual, record.offset[0]);
  const int length1 = code_offset(coder, kOffset1 + std::min(length0, kLengthClasses - 1),
                                  header.lattice_shift[1], 0, none, record.offset[1]);
  code_offset(coder, kOffset2 + std::min(std::max(length0, length1), kLengthClasses - 1),
              header.lattice_shift[2], 0, none, record.offset[2]);

  if (unusual == 0) [[likely]] {
    if (Coder::kReads && faces.size() < record.face_begin + std::size_t{2})
      faces.resize(record.face_begin + std::size_t{2});
    code_two_faces(coder, header, edges, node, split, faces.data() + record.face_begin);
    if (Coder::kReads) record.face_count = 2;
  } else {
    // By way of a copy: an object that others know the place of is not kept in registers.
    Coder copy = coder;
    code_any_faces(copy, header, edges, record, faces);
    if constexpr (Coder::kReads) coder = copy;
  }

  // Boxes of the children that stay whole.
  const auto has_box = [box_policy](std::uint32_t size, bool is_included) {
    return size > 1 && (box_policy == BoxPolicy::kAllNodes || !is_included);
  };
  if (has_box(left_size, included.left)) code_box(coder, left_size, record.left_box);
  if (has_box(right_size, included.right)) code_box(coder, right_size, record.right_box);
}

}  // namespace nearmesh::record
