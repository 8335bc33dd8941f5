// SPDX-License-Identifier: Apache-2.0
#include "tile_source.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "terrain.hpp"
#include "world_bounds.hpp"

namespace nearmesh::program {

Result<ImportedMesh> TileSource::read(const TileJob& job) {
  const std::string& path = options_.in[job.input];
  if (open_ != job.input) {
    const Result<ImportOptions> import = world_import_options(options_);
    NEARMESH_RETURN_IF_ERROR(import);
    open_.reset();
    grid_.reset();
    mesh_ = {};
    if (job.window) {
      Result<std::optional<TerrainFile>> grid = TerrainFile::open(path, import.value());
      NEARMESH_RETURN_IF_ERROR(grid);
      if (!grid.value())
        return Status(StatusCode::kConflict,
                      path +
                          ": expected the grid of heights that was there when its tiles were "
                          "planned, found another file: run the command again");
      grid_ = std::move(grid).value();
    } else {
      Result<ImportedMesh> mesh = import_mesh(path, import.value());
      NEARMESH_RETURN_IF_ERROR(mesh);
      mesh_ = std::move(mesh).value();
      note(job, mesh_);
      parts_ = cut_mesh(mesh_.mesh, plan_.lattice.exponent, options_.tile_faces);
    }
    open_ = job.input;
  }
  if (job.window) {
    Result<ImportedMesh> window = grid_->read(*job.window);
    if (window.is_ok()) note(job, window.value());
    return window;
  }
  if (job.part >= parts_.size())
    return Status(StatusCode::kConflict,
                  path + ": expected the mesh that was there when its tiles were planned, found " +
                      std::to_string(parts_.size()) + " parts and none with the number " +
                      std::to_string(job.part) + ": run the command again");
  // Only the part's own vertices, in the mesh's order.
  constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  ImportedMesh out{.origin = mesh_.origin,
                   .is_as_written = mesh_.is_as_written,
                   .stated_up = mesh_.stated_up,
                   .terrain = mesh_.terrain};
  std::vector<std::uint32_t> number(mesh_.mesh.positions_m.size(), kNone);
  for (const std::uint32_t f : parts_[job.part])
    for (const std::uint32_t v : mesh_.mesh.faces[f]) number[v] = 0;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == kNone) continue;
    number[v] = static_cast<std::uint32_t>(out.mesh.positions_m.size());
    out.mesh.positions_m.push_back(mesh_.mesh.positions_m[v]);
  }
  for (const std::uint32_t f : parts_[job.part]) {
    auto face = mesh_.mesh.faces[f];
    for (std::uint32_t& v : face) v = number[v];
    out.mesh.faces.push_back(face);
  }
  return out;
}

void TileSource::note(const TileJob& job, const ImportedMesh& mesh) {
  const auto [at, is_new] = seen_.try_emplace(job.input);
  Seen& seen = at->second;
  if (job.window) ++seen.windows;
  Measures& measures = seen.measures;
  measures.origin = mesh.origin;
  measures.stated_up = mesh.stated_up;
  measures.is_terrain = mesh.terrain.has_value();
  seen.is_as_written = mesh.is_as_written;
  // A sample that one window has is no wrong one, and a unit that was taken for granted is so of
  // all.
  const bool has_nodata = !is_new && seen.terrain && !seen.terrain->unmatched_nodata;
  seen.terrain = mesh.terrain;
  if (has_nodata && seen.terrain) seen.terrain->unmatched_nodata.reset();
  const Bounds bounds = bounds_of(mesh.mesh);
  if (bounds.is_empty) return;
  for (std::size_t k = 0; k < 3; ++k) {
    measures.lo_m[k] = seen.is_empty ? bounds.lo[k] : std::min(measures.lo_m[k], bounds.lo[k]);
    measures.hi_m[k] = seen.is_empty ? bounds.hi[k] : std::max(measures.hi_m[k], bounds.hi[k]);
  }
  seen.is_empty = false;
}

std::vector<Doubt> TileSource::doubts() const {
  std::vector<Doubt> found;
  for (const auto& [input, seen] : seen_) {
    const auto is_window = [at = input](const TileJob& job) {
      return job.input == at && job.window;
    };
    const auto windows = std::count_if(plan_.tiles.begin(), plan_.tiles.end(), is_window);
    const bool is_all = std::cmp_equal(seen.windows, windows);
    Measures measures = seen.measures;
    if (seen.terrain) {
      ImportedTerrain terrain = *seen.terrain;
      if (!is_all) terrain.unmatched_nodata.reset();
      measures.terrain_doubts = terrain_doubts(terrain, measures.origin);
    }
    const bool is_size_known = is_all && !seen.is_empty;
    for (std::string& text :
         is_size_known ? nearmesh::program::doubts(measures) : doubts_but_of_size(measures))
      found.push_back({options_.in[input], std::move(text)});
    if (!seen.is_as_written) found.push_back({options_.in[input], kReaderDoubt});
  }
  return found;
}

}  // namespace nearmesh::program
