// SPDX-License-Identifier: Apache-2.0
#include "world_plan.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "core/base/digest.hpp"
#include "core/base/output_file.hpp"
#include "core/meshio/gdal_reader.hpp"
#include "core/world/world_folder.hpp"
#include "import_options.hpp"
#include "world_bounds.hpp"

namespace nearmesh::program {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr FileKind kPlanFile{"a plan of a world", "{\"nearmesh_world_plan\":"};

/// Of the world that is there, but for what is asked for: then tiles join it.
Result<std::optional<CommonLattice>> lattice_there(const BuildWorldOptions& options) {
  const BuildOptions& build = options.build;
  const Result<WorldFolder> there = WorldFolder::open(build.out);
  if (!there.is_ok() && there.status().code() != StatusCode::kNotFound) return there.status();
  if (!there.is_ok() || there.value().world().bits != build.grid_bits)
    return std::optional<CommonLattice>();
  const CommonLattice& lattice = there.value().world().lattice;
  return common_lattice(build.cell_m > 0 ? build.cell_m : std::ldexp(1.0, lattice.exponent),
                        options.has_lattice_origin ? build.lattice_origin_m : lattice.origin_m);
}

/// Files that the reader of an input takes for parts of it, if they are there.
std::vector<fs::path> parts_beside(const std::string& in) {
  fs::path stem = in;
  if (stem.extension() == ".gltf") return {stem.replace_extension("bin")};
  if (!meshio::is_for_gdal(in, {})) return {};
  std::vector<fs::path> files{in + ".aux.xml", in + ".msk"};
  for (const char* ending : {"hdr", "prj", "tfw", "blw", "wld", "ige"})
    files.push_back(stem.replace_extension(ending));
  return files;
}

/// What tells an input from another state of it: a digest of its path, and of its parts' sizes and
/// times. Errors: kIo.
Result<std::string> stamp_of(const std::string& in) {
  std::string text = fs::absolute(in).lexically_normal().string();  // in any encoding
  const auto add = [&text](const fs::path& file) {
    std::error_code error;
    const auto size = fs::file_size(file, error);
    const auto time = error ? fs::file_time_type() : fs::last_write_time(file, error);
    text += '\n';  // one line each, also where there is none
    if (!error)
      text += std::to_string(size) + ' ' + std::to_string(time.time_since_epoch().count());
    return error;
  };
  if (const std::error_code error = add(in); error)
    return Status(StatusCode::kIo, in + ": cannot be read: " + error.message());
  for (const fs::path& file : parts_beside(in)) add(file);
  return to_hex(digest_of({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}));
}

Result<std::vector<std::string>> stamps_of(const std::vector<std::string>& inputs) {
  std::vector<std::string> stamps;
  for (const std::string& in : inputs) {
    Result<std::string> stamp = stamp_of(in);
    NEARMESH_RETURN_IF_ERROR(stamp);
    stamps.push_back(std::move(stamp).value());
  }
  return stamps;
}

/// Where a plan is kept, by what it depends on.
fs::path folder_of(const BuildWorldOptions& options, const std::vector<std::string>& inputs,
                   const std::optional<CommonLattice>& there) {
  // Another first number where the same plan gives other tiles: its notes say what became of them.
  const BuildOptions& build = options.build;
  json parts = {3,
                options.tile_faces,
                build.grid_bits,
                build.base_faces,
                build.cell_m,
                build.unit,
                build.up,
                build.node,
                build.scale,
                build.crs,
                build.spacing,
                build.corner,
                build.nodata,
                build.fill,
                build.heights,
                build.raw};
  if (options.has_lattice_origin) parts.push_back(build.lattice_origin_m);
  if (there) parts.push_back({"joins", there->exponent, there->origin_m});
  parts.push_back(inputs);
  const std::string text = parts.dump();
  const ContentHash name =
      digest_of({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  return fs::path(build.out) / "plans" / to_hex(name);
}

std::uint64_t most_cells(std::uint32_t faces) {
  return std::max<std::uint64_t>(
      1, static_cast<std::uint64_t>(std::sqrt(static_cast<double>(faces) / 2)));
}

/// Windows of about the same size, row by row.
void add_windows(const TerrainFile& grid, std::uint32_t input, std::uint32_t faces,
                 std::vector<TileJob>& tiles) {
  const std::uint64_t side = most_cells(faces);
  const auto parts = [side](std::uint64_t cells) { return (cells + side - 1) / side; };
  const std::uint64_t columns = grid.columns() - 1, rows = grid.rows() - 1;
  const std::uint64_t across = parts(columns), down = parts(rows);
  for (std::uint64_t j = 0; j < down; ++j)
    for (std::uint64_t i = 0; i < across; ++i) {
      const std::uint64_t west = i * columns / across, east = (i + 1) * columns / across;
      const std::uint64_t north = j * rows / down, south = (j + 1) * rows / down;
      tiles.push_back(
          {.input = input, .window = GridWindow{west, north, east - west + 1, south - north + 1}});
    }
}

/// What there is to choose a lattice from.
struct Sizes {
  Bounds all;
  double longest_tile = 0;

  void add(const Bounds& tile) {
    if (tile.is_empty) return;
    all.add(tile.lo);
    all.add(tile.hi);
    longest_tile = std::max(longest_tile, tile.longest());
  }
};

Result<CommonLattice> choose_lattice(const BuildWorldOptions& options, const Sizes& sizes) {
  const BuildOptions& build = options.build;
  if (sizes.all.is_empty)
    return Status(StatusCode::kInvalidArgument,
                  "expected at least one face in all inputs, found none");
  int exponent = 0;
  if (build.cell_m > 0) {
    exponent = common_lattice(build.cell_m, {})->exponent;
  } else {
    // One cell for rounding at either end.
    const double cells = std::ldexp(1.0, build.grid_bits) - 2;
    std::frexp(std::max(sizes.longest_tile / cells, 0x1p-100), &exponent);
  }
  const double cell_m = std::ldexp(1.0, exponent);
  std::array<double, 3> origin_m = build.lattice_origin_m;
  for (std::size_t k = 0; k < 3 && !options.has_lattice_origin; ++k)
    origin_m[k] = (sizes.all.lo[k] + sizes.all.hi[k]) / 2;
  return *common_lattice(cell_m, origin_m);
}

Result<CommonLattice> find_lattice(const BuildWorldOptions& options, const Sizes& sizes) {
  const BuildOptions& build = options.build;
  const Result<std::optional<CommonLattice>> there = lattice_there(options);
  NEARMESH_RETURN_IF_ERROR(there);
  if (there.value()) return *there.value();
  if (build.cell_m > 0 && options.has_lattice_origin)
    return *common_lattice(build.cell_m, build.lattice_origin_m);
  return choose_lattice(options, sizes);
}

nlohmann::ordered_json as_json(const WorldPlan& plan) {
  json tiles = json::array();
  for (const TileJob& tile : plan.tiles)
    tiles.push_back(tile.window ? json{tile.input, tile.window->column, tile.window->row,
                                       tile.window->columns, tile.window->rows}
                                : json{tile.input, tile.part});
  return {{"nearmesh_world_plan", 1},
          {"exponent", plan.lattice.exponent},
          {"origin_m", plan.lattice.origin_m},
          {"tiles", tiles}};
}

/// None where none is kept.
std::optional<WorldPlan> read_plan(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return std::nullopt;
  try {
    const json stored = json::parse(in);
    WorldPlan plan;
    plan.lattice.exponent = stored.at("exponent").get<int>();
    plan.lattice.origin_m = stored.at("origin_m").get<std::array<double, 3>>();
    for (const json& tile : stored.at("tiles")) {
      TileJob job{.input = tile.at(0).get<std::uint32_t>()};
      if (tile.size() == 2) {
        job.part = tile.at(1).get<std::uint32_t>();
      } else {
        job.window = GridWindow{tile.at(1).get<std::uint64_t>(), tile.at(2).get<std::uint64_t>(),
                                tile.at(3).get<std::uint64_t>(), tile.at(4).get<std::uint64_t>()};
      }
      plan.tiles.push_back(job);
    }
    return plan;
  } catch (const json::exception&) {
    return std::nullopt;  // made anew
  }
}

Result<WorldPlan> make_plan(const BuildWorldOptions& options) {
  const Result<ImportOptions> import = world_import_options(options);
  NEARMESH_RETURN_IF_ERROR(import);
  const bool is_lattice_known = find_lattice(options, {}).is_ok();
  WorldPlan plan;
  Sizes sizes;
  std::vector<std::uint32_t> meshes;
  for (std::uint32_t i = 0; i < options.in.size(); ++i) {
    const Result<std::optional<TerrainFile>> grid =
        TerrainFile::open(options.in[i], import.value());
    NEARMESH_RETURN_IF_ERROR(grid);
    if (!grid.value()) {
      meshes.push_back(i);
      if (is_lattice_known) continue;
      const Result<ImportedMesh> mesh = import_mesh(options.in[i], import.value());
      NEARMESH_RETURN_IF_ERROR(mesh);
      sizes.add(bounds_of(mesh.value().mesh));
      continue;
    }
    const std::size_t first = plan.tiles.size();
    add_windows(*grid.value(), i, options.tile_faces, plan.tiles);
    for (std::size_t t = first; t < plan.tiles.size() && !is_lattice_known; ++t) {
      const Result<ImportedMesh> window = grid.value()->read(*plan.tiles[t].window);
      NEARMESH_RETURN_IF_ERROR(window);
      sizes.add(bounds_of(window.value().mesh));
    }
  }
  const Result<CommonLattice> lattice = find_lattice(options, sizes);
  NEARMESH_RETURN_IF_ERROR(lattice);
  plan.lattice = lattice.value();
  for (const std::uint32_t i : meshes) {
    const Result<ImportedMesh> mesh = import_mesh(options.in[i], import.value());
    NEARMESH_RETURN_IF_ERROR(mesh);
    const std::size_t parts =
        cut_mesh(mesh.value().mesh, plan.lattice.exponent, options.tile_faces).size();
    for (std::uint32_t part = 0; part < parts; ++part)
      plan.tiles.push_back({.input = i, .part = part});
  }
  return plan;
}

/// A face's place: twice the middle of its box, in cells.
using Middle = std::array<double, 3>;

void cut(const std::vector<Middle>& middles, std::span<std::uint32_t> faces,
         std::uint32_t most_faces, std::vector<std::vector<std::uint32_t>>& parts) {
  if (faces.size() > most_faces) {
    Bounds bounds;
    for (const std::uint32_t face : faces) bounds.add(middles[face]);
    std::array<std::size_t, 3> axes{0, 1, 2};
    std::ranges::stable_sort(axes, std::ranges::greater(),
                             [&](std::size_t k) { return bounds.hi[k] - bounds.lo[k]; });
    for (const std::size_t k : axes) {
      const auto at = [&](std::uint32_t face) { return middles[face][k]; };
      const auto half = faces.begin() + static_cast<std::ptrdiff_t>(faces.size() / 2);
      std::ranges::nth_element(faces, half, {}, at);
      const double border = at(*half);
      auto middle = std::partition(faces.begin(), faces.end(),
                                   [&](std::uint32_t f) { return at(f) < border; });
      if (middle == faces.begin())  // half of them begin there
        middle = std::partition(faces.begin(), faces.end(),
                                [&](std::uint32_t f) { return at(f) <= border; });
      const auto left = static_cast<std::size_t>(middle - faces.begin());
      if (left == 0 || left == faces.size()) continue;
      cut(middles, faces.first(left), most_faces, parts);
      cut(middles, faces.subspan(left), most_faces, parts);
      return;
    }
  }
  parts.emplace_back(faces.begin(), faces.end());
  std::ranges::sort(parts.back());
}

}  // namespace

std::vector<std::vector<std::uint32_t>> cut_mesh(const IndexedMesh& mesh, int exponent,
                                                 std::uint32_t most_faces) {
  std::vector<Middle> middles(mesh.faces.size());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    Bounds bounds;
    for (const std::uint32_t v : mesh.faces[f]) bounds.add(mesh.positions_m[v]);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto cell = [&](double x) {  // as clean_mesh rounds, halves up
        const double cells = std::ldexp(x, -exponent), below = std::floor(cells);
        return cells - below >= 0.5 ? below + 1 : below;
      };
      middles[f][k] = cell(bounds.lo[k]) + cell(bounds.hi[k]);
    }
  }
  std::vector<std::uint32_t> faces(mesh.faces.size());
  std::iota(faces.begin(), faces.end(), 0U);
  std::vector<std::vector<std::uint32_t>> parts;
  cut(middles, faces, most_faces, parts);
  return parts;
}

Result<ImportOptions> world_import_options(const BuildWorldOptions& options) {
  Result<ImportOptions> import = import_options(options.build);
  if (import.is_ok()) import.value().is_terrain_of_some = true;
  return import;
}

Result<WorldPlan> plan_world(const BuildWorldOptions& options) {
  const Result<std::optional<CommonLattice>> there = lattice_there(options);
  NEARMESH_RETURN_IF_ERROR(there);
  Result<std::vector<std::string>> inputs = stamps_of(options.in);
  NEARMESH_RETURN_IF_ERROR(inputs);
  // First the plan that chose a lattice: as long as the world has that one, this is the plan that
  // joins it, too.
  fs::path folder;
  for (const std::optional<CommonLattice>& joins :
       {std::optional<CommonLattice>(), there.value()}) {
    folder = folder_of(options, inputs.value(), joins);
    std::optional<WorldPlan> kept = read_plan((folder / "plan.json").string());
    if (!kept || (there.value() && kept->lattice != *there.value())) continue;
    kept->folder = folder.string();
    kept->inputs = std::move(inputs).value();
    return *std::move(kept);
  }
  const std::string path = (folder / "plan.json").string();
  Result<WorldPlan> plan = make_plan(options);
  NEARMESH_RETURN_IF_ERROR(plan);
  plan.value().folder = folder.string();
  plan.value().inputs = std::move(inputs).value();
  for (std::uint32_t i = 0; i < options.in.size(); ++i)
    NEARMESH_RETURN_IF_ERROR(check_input(options, plan.value(), i));
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    return Status(StatusCode::kIo, folder.string() + ": cannot create: " + error.message());
  NEARMESH_RETURN_IF_ERROR(write_file(path, kPlanFile, as_json(plan.value()).dump(), options.in));
  return plan;
}

Status check_input(const BuildWorldOptions& options, const WorldPlan& plan, std::uint32_t input) {
  const Result<std::string> now = stamp_of(options.in[input]);
  NEARMESH_RETURN_IF_ERROR(now);
  if (now.value() == plan.inputs[input]) return Status::ok();
  return {StatusCode::kConflict,
          options.in[input] + ": has changed while it was read; run the command again"};
}

std::string describe(const TileJob& job, const BuildWorldOptions& options) {
  const std::string& path = options.in[job.input];
  if (!job.window) return path + ", part " + std::to_string(job.part);
  const GridWindow& w = *job.window;
  return path + ", columns " + std::to_string(w.column) + " to " +
         std::to_string(w.column + w.columns - 1) + ", rows " + std::to_string(w.row) + " to " +
         std::to_string(w.row + w.rows - 1);
}

}  // namespace nearmesh::program
