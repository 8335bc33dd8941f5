// SPDX-License-Identifier: Apache-2.0
#include "compare_block.hpp"

#include <algorithm>
#include <vector>

namespace nearmesh {
namespace {

/// Of a record, as words: node, split, offset, faces, boxes.
ContentHash hash_of(const SplitRecord& record, std::span<const SplitFace> faces) {
  std::vector<std::uint32_t> words{record.node.begin(), record.node.size, record.split.value};
  for (const std::int32_t x : record.offset) words.push_back(static_cast<std::uint32_t>(x));
  for (const SplitFace& face : faces)
    words.insert(words.end(),
                 {face.left.value, face.right.value, face.outside.value, face.flipped ? 1U : 0U});
  for (const BoxCode& box : {record.left_box, record.right_box})
    words.insert(words.end(), box.begin(), box.end());
  return digest_of({reinterpret_cast<const std::uint8_t*>(words.data()), words.size() * 4});
}

/// As it is held; what is held no box of, and boxes that are wider, as the block has it.
BoxCode held_box(const SplitStore& held, NodeSpan node, const BoxCode& proved) {
  const BoxCode code = node.size < 2 ? kNoBox : held.box_code(node);
  const bool encloses = code == kNoBox || std::equal(code.begin(), code.end(), proved.begin(),
                                                     [](auto own, auto its) { return own >= its; });
  return encloses ? proved : code;
}

/// As it is held, without boxes.
SplitRecord held_record(const SplitStore& held, VertexId split) {
  SplitRecord record{.node = held.node_of(split), .split = split};
  for (std::size_t k = 0; k < 3; ++k)
    record.offset[k] = held.position(split)[static_cast<int>(k)] -
                       held.position(record.node.first)[static_cast<int>(k)];
  return record;
}

/// The split of the smallest held node around `inner`, where that cuts it in two.
VertexId cut(const SplitStore& held, NodeSpan inner) {
  const auto& roots = held.roots();
  const auto root = std::find_if(roots.begin(), roots.end(), [&](const BaseRoot& one) {
    return one.node.begin() <= inner.begin() && inner.end() <= one.node.end();
  });
  if (root == roots.end()) return {};
  for (NodeSpan node = root->node; node != inner;) {
    const VertexId split = node.size < 2 ? VertexId{} : held.split_of(node);
    if (!split.is_valid()) break;
    if (inner.begin() < split.value && split.value < inner.end()) return split;
    node = inner.begin() < split.value ? node.left_of(split) : node.right_of(split);
  }
  return {};
}

}  // namespace

std::optional<Difference> difference(const SplitStore& held, NodeSpan root,
                                     const SplitBatch& block) {
  if (const VertexId split = cut(held, root); split.is_valid())
    return Difference{split, hash_of(held_record(held, split), held.faces(split).span()),
                      std::nullopt};
  for (const SplitRecord& proved : block.splits) {
    if (proved.node.size > held.vertex_count() || !proved.right().contains(proved.split) ||
        proved.split.value >= held.vertex_count())
      continue;
    // Of the node's split, where that is another; of the split's node else.
    VertexId split = held.is_node(proved.node) ? held.split_of(proved.node) : VertexId{};
    if (!split.is_valid() && held.is_known(proved.split)) split = proved.split;
    if (!split.is_valid()) continue;
    SplitRecord told{.node = {}, .split = split};
    std::vector<SplitFace> faces;
    if (!held.is_root(split)) {
      told = held_record(held, split);
      const SplitFaces own = held.faces(split);
      faces.assign(own.begin(), own.end());
      told.left_box = held_box(held, told.left(), proved.left_box);
      told.right_box = held_box(held, told.right(), proved.right_box);
    }
    const std::span<const SplitFace> true_faces{block.faces.data() + proved.face_begin,
                                                proved.face_count};
    const ContentHash told_hash = hash_of(told, faces), true_hash = hash_of(proved, true_faces);
    if (told_hash != true_hash) return Difference{split, told_hash, true_hash};
  }
  return std::nullopt;
}

}  // namespace nearmesh
