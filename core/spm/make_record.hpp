// SPDX-License-Identifier: Apache-2.0
#pragma once
// Records of splits, as batches have them.

#include <vector>

#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh {

/// The record of a treelet split, as the store knows it; faces are appended.
inline SplitRecord make_record(const SplitStore& store, const TreeletSplit& split,
                               std::vector<SplitFace>& faces) {
  SplitRecord record{.node = split.node, .split = split.split};
  const GridPoint& from = store.position(split.node.first);
  const GridPoint& to = store.position(split.split);
  for (int k = 0; k < 3; ++k) record.offset[k] = to[k] - from[k];
  const SplitFaces own = store.faces(split.split);
  record.face_begin = static_cast<std::uint32_t>(faces.size());
  record.face_count = static_cast<std::uint32_t>(own.size());
  faces.insert(faces.end(), own.begin(), own.end());
  // Who holds a part has no box of its own for a node that came split: it lies within the nearest
  // ancestor's.
  const auto box_of = [&store](const NodeSpan& child) {
    const BoxCode code = store.box_code(child);
    return code[0] != kNoBoxCode ? code : encode_box(store.position(child.first), store.box(child));
  };
  if (record.left().size > 1) record.left_box = box_of(record.left());
  if (record.right().size > 1) record.right_box = box_of(record.right());
  return record;
}

}  // namespace nearmesh
