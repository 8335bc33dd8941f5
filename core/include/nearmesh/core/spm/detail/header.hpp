// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer must hold before the first batch: grid, base mesh, boxes of the roots, coding tables.
// The same bytes lead the .spm file and travel as the mesh header; their size does not depend on n.

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/spm/detail/coding_tables.hpp"
#include "nearmesh/core/spm/detail/types.hpp"

namespace nearmesh {

struct BaseRoot {
  NodeSpan node;
  GridPoint position;
  BoxCode box = kNoBox;
  bool operator==(const BaseRoot&) const = default;
};

/// Seeds of more parts than this are not listed.
inline constexpr std::uint32_t kMaxComponentSeeds = 256;

/// What a peer must know of the full mesh's surface to tell inside from outside (query.hpp), and
/// cannot see in a part.
struct SurfaceFacts {
  std::uint32_t boundary_edges = 0;     ///< with one face
  std::uint32_t disagreeing_edges = 0;  ///< with more, not passed equally often both ways
  std::uint32_t component_count = 1;    ///< connected parts, through shared vertices
  /// The place of the lowest vertex of each part, in that order; none when there are more than
  /// kMaxComponentSeeds.
  std::vector<GridPoint> component_seeds;

  [[nodiscard]] bool is_closed() const { return boundary_edges == 0 && disagreeing_edges == 0; }
  [[nodiscard]] bool has_seeds() const { return component_seeds.size() == component_count; }
  bool operator==(const SurfaceFacts&) const = default;
};

struct SpmHeader {
  ContentHash blocks_root;  ///< of the tree over the stored blocks and the table of face numbers
  /// Of the header's bytes, and so of the whole model; decode_header() sets it.
  ContentHash content;
  Grid grid;
  double rounding_error_m = 0;  ///< as it was computed: rounding_bound_m() is what to state
  /// Every coordinate is a multiple of 2^shift, per axis.
  std::array<std::uint8_t, 3> lattice_shift{};
  std::uint32_t vertex_count = 0;
  std::uint32_t face_count = 0;
  std::vector<BaseRoot> roots;        ///< ascending, covering [0, vertex_count)
  std::vector<SplitFace> base_faces;  ///< corners in three different roots
  SurfaceFacts surface;
  CodingTables tables;

  /// No vertex of the input is farther from its grid point. Three squares, their sum and its root
  /// round by less than 2^-51.
  [[nodiscard]] double rounding_bound_m() const { return rounding_error_m * (1 + 0x1p-50); }
  [[nodiscard]] std::uint32_t split_count() const {
    return vertex_count - static_cast<std::uint32_t>(roots.size());
  }
};

/// A model has fewer vertices than this (node sizes share a word with two flag bits).
inline constexpr std::uint32_t kMaxVertices = 1U << 30;
/// Largest header this build reads or sends.
inline constexpr std::size_t kMaxHeaderBytes = 1 << 20;

[[nodiscard]] std::vector<std::uint8_t> encode_header(const SpmHeader& header);

class SharedTables;  // coding_sets.hpp
/// Trusts no count. Cost: O(bytes), and two milliseconds for coding tables that are not in `shared`
/// already.
/// Errors: kCorrupt with the field, expected and found.
[[nodiscard]] Result<SpmHeader> decode_header(std::span<const std::uint8_t> bytes,
                                              SharedTables* shared = nullptr);

/// Whether a body with a model of this surface may be taken as solid: only a closed surface has an
/// inside.
/// Errors: kInvalidArgument naming the body, with the counts of edges at which the surface does not
/// close.
[[nodiscard]] Status check_solid(const SurfaceFacts& surface, std::string_view body);

}  // namespace nearmesh
