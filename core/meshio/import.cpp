// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/meshio/import.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>
#include <memory>

#include "assimp_reader.hpp"
#include "child.hpp"
#include "core/base/float_guard.hpp"
#include "gdal_reader.hpp"
#include "grid_formats.hpp"
#include "nearmesh/core/base/detail/assert.hpp"
#include "nodes.hpp"
#include "plain_formats.hpp"

namespace nearmesh {
namespace {

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

Result<std::string> read_file(const std::string& path) {
  const auto failed = [] {
    return Status(StatusCode::kIo, std::string("cannot be read: ") + std::strerror(errno));
  };
  // Looked at before it is opened: opening a fifo would wait for its writer.
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return failed();
  if (!S_ISREG(info.st_mode)) return Status(StatusCode::kIo, "expected a regular file");
  const std::unique_ptr<std::FILE, FileCloser> file(std::fopen(path.c_str(), "rb"));
  if (!file) return failed();
  std::string bytes(static_cast<std::size_t>(info.st_size), '\0');
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), file.get()));
  if (std::ferror(file.get()) != 0) return failed();
  return bytes;
}

/// A grid may be packed to next to nothing: a sea, say.
meshio::ChildLimits limits_for(std::uint64_t file_bytes, bool is_grid) {
  constexpr std::uint64_t kMiB = 1 << 20;
  return {.memory_bytes = std::min(8192 * kMiB, (is_grid ? 2048 : 512) * kMiB + 200 * file_bytes),
          .wall_time = std::chrono::seconds(60 + 2 * (file_bytes / kMiB))};
}

using meshio::SceneMesh;
using meshio::ScenePart;
using meshio::Transform;

Result<SceneMesh> read_plain_scene(meshio::PlainFormat format, std::string_view bytes,
                                   const std::string& node, bool by_node) {
  if (format == meshio::PlainFormat::kObj && (by_node || !node.empty()))
    return meshio::read_obj_objects(bytes, node);
  if (!node.empty())
    return Status(StatusCode::kNotFound, "no node is named " + node + ": the format has none");
  Result<IndexedMesh> mesh = meshio::read_plain(format, bytes);
  NEARMESH_RETURN_IF_ERROR(mesh);
  return SceneMesh{.mesh = std::move(mesh).value()};
}

Status check_grid_options(const ImportOptions& options) {
  if (!options.node.empty())
    return {StatusCode::kNotFound, "no node is named " + options.node + ": a grid has none"};
  if (options.up == UpAxis::kY)
    return {StatusCode::kInvalidArgument, "expected z as the axis that is up in a grid, found y"};
  return Status::ok();
}

Result<SceneMesh> read_any(const std::string& path, const ImportOptions& options, bool by_node) {
  const TerrainOptions terrain = options.terrain.value_or(TerrainOptions{});
  std::uint64_t file_bytes = 0;
  bool is_grid = false;
  {
    Result<std::string> read = read_file(path);
    NEARMESH_RETURN_IF_ERROR(read);
    std::string& bytes = read.value();
    if (bytes.empty()) return Status(StatusCode::kCorrupt, "the file is empty");
    if (const auto format = meshio::find_grid_format(path, bytes, terrain)) {
      NEARMESH_RETURN_IF_ERROR(check_grid_options(options));
      Result<meshio::HeightGrid> grid = meshio::read_grid(*format, path, bytes, terrain);
      NEARMESH_RETURN_IF_ERROR(grid);
      bytes = {};
      return meshio::to_scene(std::move(grid.value()), terrain);
    }
    if (const auto format = meshio::find_plain_format(path, bytes)) {
      if (options.terrain && !options.is_terrain_of_some)
        return Status(StatusCode::kInvalidArgument,
                      "expected a grid of heights, as the options have it, found a mesh");
      return read_plain_scene(*format, bytes, options.node, by_node);
    }
    is_grid = (options.terrain && !options.is_terrain_of_some) || meshio::is_for_gdal(path, bytes);
    file_bytes = bytes.size();
  }
  if (is_grid) {
    NEARMESH_RETURN_IF_ERROR(check_grid_options(options));
    return meshio::run_in_child([&] { return meshio::read_with_gdal(path, terrain); },
                                limits_for(file_bytes, is_grid));
  }
  return meshio::run_in_child([&] { return meshio::read_with_assimp(path, options.node); },
                              limits_for(file_bytes, is_grid));
}

Status check_faces(const IndexedMesh& mesh) {
  if (mesh.faces.empty())
    return {StatusCode::kInvalidArgument, "expected at least one face, found none"};
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::uint32_t v : mesh.faces[f]) {
      if (v >= mesh.positions_m.size())
        return {StatusCode::kCorrupt,
                "face " + std::to_string(f) + ": expected vertex indices below " +
                    std::to_string(mesh.positions_m.size()) + ", found " + std::to_string(v)};
      for (const double x : mesh.positions_m[v])
        if (!std::isfinite(x))
          return {StatusCode::kInvalidArgument,
                  "vertex " + std::to_string(v) + ": expected finite coordinates, found " +
                      std::to_string(x) + " (face " + std::to_string(f) + ")"};
    }
  }
  return Status::ok();
}

Status check_options(const ImportOptions& options) {
  for (const double factor : {options.unit_m.value_or(1), options.scale})
    if (!std::isfinite(factor) || factor <= 0)
      return {StatusCode::kInvalidArgument,
              "expected a unit and a scale above 0, found " + std::to_string(factor)};
  if (options.up == UpAxis::kX)
    return {StatusCode::kInvalidArgument, "expected y or z as the axis that is up, found x"};
  return Status::ok();
}

Result<MeshOrigin> find_origin(const meshio::FileConvention& file, const ImportOptions& options) {
  MeshOrigin origin{.unit_m = file.unit_m,
                    .scale = options.scale,
                    .unit_source = file.unit_source,
                    .up = file.up,
                    .up_source = file.up_source};
  if (options.unit_m && file.unit_is_fixed) {
    char text[96];
    std::snprintf(text, sizeof text,
                  "%s states its unit, %.9g m; to change lengths, ask for a scale",
                  file.unit_source == OriginSource::kFile ? "the file" : "the format", file.unit_m);
    return Status(StatusCode::kInvalidArgument, text);
  }
  if (options.unit_m) {
    origin.unit_m = *options.unit_m;
    origin.unit_source = OriginSource::kOption;
  }
  if (options.up != UpAxis::kUnknown) {
    origin.up = options.up;
    origin.up_source = OriginSource::kOption;
    origin.z_up = true;
  }
  return origin;
}

/// All parts in the model's frame, in file order.
IndexedMesh assemble(SceneMesh scene, const Transform& to_model) {
  IndexedMesh& mesh = scene.mesh;
  if (scene.parts.empty())
    scene.parts.push_back(
        {.position_count = mesh.positions_m.size(), .face_count = mesh.faces.size()});
  std::size_t position = 0, face = 0;
  for (const ScenePart& part : scene.parts) {
    meshio::transform_part(mesh, position, part.position_count, face, part.face_count,
                           compose(to_model, part.to_file));
    position += part.position_count;
    face += part.face_count;
  }
  return std::move(mesh);
}

struct Read {
  SceneMesh scene;
  MeshOrigin origin;
};

Result<Read> read_checked(const std::string& path, const ImportOptions& options, bool by_node) {
  NEARMESH_RETURN_IF_ERROR(check_options(options));
  Result<SceneMesh> scene = read_any(path, options, by_node);
  NEARMESH_RETURN_IF_ERROR(scene);
  NEARMESH_RETURN_IF_ERROR(check_faces(scene.value().mesh));
  const Result<MeshOrigin> origin = find_origin(scene.value().convention, options);
  NEARMESH_RETURN_IF_ERROR(origin);
  return Read{std::move(scene).value(), origin.value()};
}

/// What `read` throws for want of memory becomes an error; every error names the file.
template <class T>
Result<T> naming(const std::string& path, const std::function<Result<T>()>& read) {
  const FloatGuard guard;
  Status status;
  try {
    Result<T> result = read();
    if (result.is_ok()) return result;
    status = result.status();
  } catch (const std::exception& e) {
    status = Status(StatusCode::kIo, std::string("cannot be held: ") + e.what());
  }
  return Status(status.code(), path + ": " + status.message());
}

}  // namespace

Result<ImportedMesh> import_mesh(const std::string& path, const ImportOptions& options) {
  return naming<ImportedMesh>(path, [&]() -> Result<ImportedMesh> {
    Result<Read> read = read_checked(path, options, false);
    NEARMESH_RETURN_IF_ERROR(read);
    auto& [scene, origin] = read.value();
    const bool is_as_written = scene.convention.is_known;
    const UpAxis stated_up = scene.convention.up;
    std::optional<ImportedTerrain> terrain = std::move(scene.terrain);
    IndexedMesh mesh = assemble(std::move(scene), meshio::to_model(origin));
    NEARMESH_RETURN_IF_ERROR(check_faces(mesh));  // a product may have left the doubles
    return ImportedMesh{std::move(mesh), origin, is_as_written, stated_up, std::move(terrain)};
  });
}

Result<IndexedMesh> import_mesh(const std::string& path) {
  Result<ImportedMesh> imported = import_mesh(path, ImportOptions{});
  NEARMESH_RETURN_IF_ERROR(imported);
  return std::move(imported.value().mesh);
}

struct TerrainFile::Parts {
  std::string path;
  ImportOptions options;
  TerrainOptions terrain;
  TerrainFrame frame = TerrainFrame::kUnstated;
  // Its grid is settled; with all samples where they cannot be read apart.
  meshio::SampleLayout layout;
};

namespace {

Result<std::string> read_start(const std::string& path, std::uint64_t& file_bytes) {
  const std::unique_ptr<std::FILE, FileCloser> file(std::fopen(path.c_str(), "rb"));
  struct stat info {};
  if (!file || fstat(fileno(file.get()), &info) != 0)
    return Status(StatusCode::kIo, std::string("cannot be read: ") + std::strerror(errno));
  if (!S_ISREG(info.st_mode)) return Status(StatusCode::kIo, "expected a regular file");
  file_bytes = static_cast<std::uint64_t>(info.st_size);
  std::string bytes(std::min<std::uint64_t>(file_bytes, meshio::kLayoutBytes), '\0');
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), file.get()));
  return bytes;
}

/// The window's samples, row by row from the file.
Status read_window(const std::string& path, const meshio::SampleLayout& layout,
                   const GridWindow& window, std::vector<double>& samples) {
  const std::unique_ptr<std::FILE, FileCloser> file(std::fopen(path.c_str(), "rb"));
  if (!file) return {StatusCode::kIo, std::string("cannot be read: ") + std::strerror(errno)};
  std::string row(window.columns * layout.type.sample_bytes, '\0');
  samples.reserve(window.columns * window.rows);
  for (std::uint64_t r = window.row; r < window.row + window.rows; ++r) {
    const std::uint64_t at =
        layout.offset + (r * layout.grid.columns + window.column) * layout.type.sample_bytes;
    if (fseeko(file.get(), static_cast<off_t>(at), SEEK_SET) != 0 ||
        std::fread(row.data(), 1, row.size(), file.get()) != row.size())
      return {StatusCode::kCorrupt, "row " + std::to_string(r) + " is no longer there"};
    NEARMESH_RETURN_IF_ERROR(meshio::decode_samples(layout, row, r, window.column, samples));
  }
  return Status::ok();
}

}  // namespace

Result<std::optional<TerrainFile>> TerrainFile::open(const std::string& path,
                                                     const ImportOptions& options) {
  using Found = std::optional<TerrainFile>;
  return naming<Found>(path, [&]() -> Result<Found> {
    NEARMESH_RETURN_IF_ERROR(check_options(options));
    auto parts = std::make_shared<Parts>(Parts{
        .path = path, .options = options, .terrain = options.terrain.value_or(TerrainOptions{})});
    std::uint64_t file_bytes = 0;
    Result<std::string> begins = read_start(path, file_bytes);
    NEARMESH_RETURN_IF_ERROR(begins);
    const auto format = meshio::find_grid_format(path, begins.value(), parts->terrain);
    if (!format) return Found();
    NEARMESH_RETURN_IF_ERROR(check_grid_options(options));
    if (meshio::has_layout(*format)) {
      Result<meshio::SampleLayout> layout =
          meshio::find_layout(*format, path, begins.value(), file_bytes, parts->terrain);
      NEARMESH_RETURN_IF_ERROR(layout);
      parts->layout = std::move(layout).value();
    } else {
      Result<std::string> bytes = read_file(path);
      NEARMESH_RETURN_IF_ERROR(bytes);
      Result<meshio::HeightGrid> grid =
          meshio::read_grid(*format, path, bytes.value(), parts->terrain);
      NEARMESH_RETURN_IF_ERROR(grid);
      parts->layout.grid = std::move(grid).value();
    }
    const Result<TerrainFrame> frame = meshio::settle_grid(parts->layout.grid, parts->terrain);
    NEARMESH_RETURN_IF_ERROR(frame);
    parts->frame = frame.value();
    return Found(TerrainFile(std::move(parts)));
  });
}

std::uint64_t TerrainFile::columns() const { return parts_->layout.grid.columns; }
std::uint64_t TerrainFile::rows() const { return parts_->layout.grid.rows; }

Result<ImportedMesh> TerrainFile::read(const GridWindow& window) const {
  return naming<ImportedMesh>(parts_->path, [&]() -> Result<ImportedMesh> {
    const meshio::HeightGrid& whole = parts_->layout.grid;
    NEARMESH_ASSERT(window.columns >= 2 && window.column + window.columns <= whole.columns &&
                    window.rows >= 2 && window.row + window.rows <= whole.rows);
    meshio::HeightGrid grid = meshio::window_of(whole, window);
    if (whole.samples.empty()) {
      NEARMESH_RETURN_IF_ERROR(read_window(parts_->path, parts_->layout, window, grid.samples));
    } else {
      for (std::uint64_t r = window.row; r < window.row + window.rows; ++r) {
        const auto row =
            whole.samples.begin() + static_cast<std::ptrdiff_t>(r * whole.columns + window.column);
        grid.samples.insert(grid.samples.end(), row,
                            row + static_cast<std::ptrdiff_t>(window.columns));
      }
    }
    Result<SceneMesh> scene = meshio::to_scene(std::move(grid), parts_->frame, parts_->terrain);
    NEARMESH_RETURN_IF_ERROR(scene);
    const meshio::FileConvention convention = scene.value().convention;
    const Result<MeshOrigin> origin = find_origin(convention, parts_->options);
    NEARMESH_RETURN_IF_ERROR(origin);
    const std::optional<ImportedTerrain> terrain = scene.value().terrain;
    IndexedMesh mesh = assemble(std::move(scene).value(), meshio::to_model(origin.value()));
    if (!mesh.faces.empty()) NEARMESH_RETURN_IF_ERROR(check_faces(mesh));
    return ImportedMesh{std::move(mesh), origin.value(), true, convention.up, terrain};
  });
}

Result<ImportedNodes> import_nodes(const std::string& path, const ImportOptions& options) {
  return naming<ImportedNodes>(path, [&]() -> Result<ImportedNodes> {
    Result<Read> read = read_checked(path, options, true);
    NEARMESH_RETURN_IF_ERROR(read);
    auto& [scene, origin] = read.value();
    ImportedNodes out{
        meshio::take_apart(scene, meshio::to_model(origin), std::filesystem::path(path).stem()),
        origin, scene.convention.is_known, scene.convention.up, scene.terrain};
    for (const ImportedNode& node : out.nodes) NEARMESH_RETURN_IF_ERROR(check_faces(node.mesh));
    return out;
  });
}

}  // namespace nearmesh
