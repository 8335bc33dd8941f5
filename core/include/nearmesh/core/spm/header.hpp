// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer must hold before the first batch: grid, base mesh, boxes of the roots, coding tables.
// The same bytes lead the .spm file and travel as the mesh header; their size does not depend on n.

#include <cstdint>
#include <span>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/spm/coding_tables.hpp"
#include "nearmesh/core/spm/types.hpp"

namespace nearmesh {

struct BaseRoot {
  NodeSpan node;
  GridPoint position;
  BoxCode box = kNoBox;
  bool operator==(const BaseRoot&) const = default;
};

struct SpmHeader {
  Grid grid;
  double rounding_error_m = 0;
  std::array<std::uint8_t, 3>
      lattice_shift{};  ///< every coordinate is a multiple of 2^shift, per axis
  std::uint32_t vertex_count = 0;
  std::uint32_t face_count = 0;
  std::vector<BaseRoot> roots;        ///< ascending, covering [0, vertex_count)
  std::vector<SplitFace> base_faces;  ///< corners in three different roots
  CodingTables tables;

  [[nodiscard]] std::uint32_t split_count() const {
    return vertex_count - static_cast<std::uint32_t>(roots.size());
  }
};

/// A model has fewer vertices than this (node sizes share a word with two flag bits).
inline constexpr std::uint32_t kMaxVertices = 1U << 30;
/// Largest header this build reads or sends.
inline constexpr std::size_t kMaxHeaderBytes = 1 << 20;

[[nodiscard]] std::vector<std::uint8_t> encode_header(const SpmHeader& header);

/// Errors: kCorrupt with the field, expected and found; kUnsupported for another version.
/// Trusts no count. Cost: O(bytes).
[[nodiscard]] Result<SpmHeader> decode_header(std::span<const std::uint8_t> bytes);

}  // namespace nearmesh
