// SPDX-License-Identifier: Apache-2.0
#pragma once
// The meshes of a world's tiles, out of its inputs (takes a plan, gives meshes and what is to be
// doubted of them).

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "measures.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "world_plan.hpp"

namespace nearmesh::program {

/// What may not be as it was meant, of an input.
struct Doubt {
  std::string input, text;
};

/// Hands out the meshes of tiles. Holds one input at a time: of a grid a window, of a mesh all.
class TileSource {
 public:
  TileSource(const BuildWorldOptions& options, const WorldPlan& plan)
      : options_(options), plan_(plan) {}
  /// May be without faces. Errors: those of reading, naming the file.
  [[nodiscard]] Result<ImportedMesh> read(const TileJob& job);
  /// Of what was read, as `build` has them. What only all of a grid tells, as its size, is not
  /// doubted where some of its windows were not read.
  [[nodiscard]] std::vector<Doubt> doubts() const;

 private:
  /// What is known of an input.
  struct Seen {
    Measures measures;
    std::optional<ImportedTerrain> terrain;
    bool is_as_written = true, is_empty = true;
    std::size_t windows = 0;  ///< of a grid, that were read
  };
  void note(const TileJob& job, const ImportedMesh& mesh);

  const BuildWorldOptions& options_;
  const WorldPlan& plan_;
  std::optional<std::uint32_t> open_;  // the input that is held
  std::optional<TerrainFile> grid_;
  ImportedMesh mesh_;
  std::vector<std::vector<std::uint32_t>> parts_;
  std::map<std::uint32_t, Seen> seen_;  // by input
};

}  // namespace nearmesh::program
