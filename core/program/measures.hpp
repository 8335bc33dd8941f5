// SPDX-License-Identifier: Apache-2.0
#pragma once
// How large a model is and where its metres and axes come from, as build and info say it.

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "nearmesh/core/base/mesh_origin.hpp"
#include "nearmesh/core/geometry/detail/grid.hpp"

namespace nearmesh::program {

struct Measures {
  std::array<double, 3> lo_m{}, hi_m{};  ///< of the vertices
  MeshOrigin origin;
  UpAxis stated_up = UpAxis::kUnknown;  ///< by the file or its format, where that is at hand
  bool is_terrain = false;  ///< a grid of heights, which may well be ten kilometres long
  std::vector<std::string> terrain_doubts;  ///< of the grid itself
};

/// `box` holds exactly the vertices.
[[nodiscard]] Measures measure(const Grid& grid, const GridBox& box, const MeshOrigin& origin);

/// Sizes that hint at a wrong unit: below a centimetre, above ten kilometres; --up against what the
/// file states; those of the grid.
[[nodiscard]] std::vector<std::string> doubts(const Measures& measures);
/// Of a model of which only a part is known.
[[nodiscard]] std::vector<std::string> doubts_but_of_size(const Measures& measures);
/// Of a file whose reader gives no word (ImportedMesh::is_as_written).
inline constexpr const char* kReaderDoubt =
    "what the reader of this format does to units and axes is not known; nearmesh-model formats "
    "lists those of which it is";

/// To three digits, never to less than it is: of what is a bound.
[[nodiscard]] std::string round_up(double bound);

void add_json(const Measures& measures, nlohmann::ordered_json& report);
void print_text(const Measures& measures);

}  // namespace nearmesh::program
