// SPDX-License-Identifier: Apache-2.0
#pragma once
// Of what tiles a world is made: windows of grids and parts of meshes, on one lattice. The plan
// follows from options and inputs, and is kept in the world's folder: whoever bakes one tile of it
// need not look at the others.

#include <optional>
#include <string>
#include <vector>

#include "commands.hpp"
#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/meshio/import.hpp"

namespace nearmesh::program {

struct TileJob {
  std::uint32_t input = 0;
  std::optional<GridWindow> window;  ///< of a grid
  std::uint32_t part = 0;            ///< of a mesh
};

struct WorldPlan {
  std::string folder;  ///< of its own, for what becomes of its tiles
  /// What they were before they were read: digests of paths, sizes and times.
  std::vector<std::string> inputs;
  CommonLattice lattice;
  std::vector<TileJob> tiles;
};

/// How inputs are read. Errors: as import_options().
[[nodiscard]] Result<ImportOptions> world_import_options(const BuildWorldOptions& options);

/// The plan that is kept, or a new one, which is then kept. Errors: those of reading an input,
/// naming it.
[[nodiscard]] Result<WorldPlan> plan_world(const BuildWorldOptions& options);

/// After something was read of an input: is it still that of the plan? Else tiles of one world
/// would come from two states of a file. Errors: kConflict, naming it.
[[nodiscard]] Status check_input(const BuildWorldOptions& options, const WorldPlan& plan,
                                 std::uint32_t input);

/// The faces of each part, ascending: by halves across the longest side until a part has at most so
/// many. Which part a face goes to depends on its place on the lattice alone, so faces that fall
/// together there stay together.
[[nodiscard]] std::vector<std::vector<std::uint32_t>> cut_mesh(const IndexedMesh& mesh,
                                                               int exponent,
                                                               std::uint32_t most_faces);

/// For people.
[[nodiscard]] std::string describe(const TileJob& job, const BuildWorldOptions& options);

}  // namespace nearmesh::program
