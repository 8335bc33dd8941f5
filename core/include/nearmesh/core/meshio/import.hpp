// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Reads any mesh file: PLY, STL, OFF and OBJ with readers of our own, every other format through
// assimp; and grids of heights: HGT, ASC, PGM, PNG and raw with our own, others through GDAL, where
// the build has it. The only room that knows assimp and GDAL. Gives the IndexedMesh that clean_mesh
// takes: the file's coordinates as they are written, in metres.

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "nearmesh/core/base/mesh_origin.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"
#include "nearmesh/core/meshio/terrain.hpp"

namespace nearmesh {

struct ImportOptions {
  /// Metres in one unit of a file that does not state its unit. Finite, above 0.
  std::optional<double> unit_m;
  /// kY or kZ: up in the file; the mesh is then turned so that z is up. kUnknown: nothing is
  /// turned.
  UpAxis up = UpAxis::kUnknown;
  /// On top of all units. Finite, above 0.
  double scale = 1;
  /// Only the node (OBJ: the object) of this name and what hangs on it; empty: all.
  std::string node;
  /// For a grid of heights alone.
  std::optional<TerrainOptions> terrain;
  /// Of several files: one that is a mesh does without, instead of an error.
  bool is_terrain_of_some = false;
};

struct ImportedMesh {
  IndexedMesh mesh;
  MeshOrigin origin;
  /// Coordinates are those written in the file. False for formats that mesh_formats() does not
  /// list: assimp's reader may have turned or scaled them.
  bool is_as_written = true;
  /// What the file or its format states, also where options.up says otherwise.
  UpAxis stated_up = UpAxis::kUnknown;
  /// The file was a grid of heights.
  std::optional<ImportedTerrain> terrain;
};

/// One node of a file, in its own frame, and where that stands: x_file = rotation x_node +
/// translation.
struct ImportedNode {
  std::string name;  ///< unique among the nodes of the file, fit for a file's name
  /// With whatever of the node's transform is not a motion (scale, shear, mirror).
  IndexedMesh mesh;
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< row-major
  std::array<double, 3> translation_m{};
};

struct ImportedNodes {
  std::vector<ImportedNode> nodes;  ///< those with faces, in file order
  MeshOrigin origin;
  bool is_as_written = true;               ///< as in ImportedMesh
  UpAxis stated_up = UpAxis::kUnknown;     ///< as in ImportedMesh
  std::optional<ImportedTerrain> terrain;  ///< as in ImportedMesh
};

/// What is known of a format, as docs/import.md has it.
struct MeshFormat {
  std::string_view name, endings, reader, unit, up, nodes;
};

/// The formats whose coordinates are known, by a test of each, to come back as they are written.
[[nodiscard]] std::span<const MeshFormat> mesh_formats();

/// Reads a mesh file into triangles in file order. Polygons are cut into corners - 2 triangles each
/// (a fan where convex, ears where concave); points and edges are left out. PLY, STL, OFF, OBJ:
/// coordinates as the file has them, in double; vertices in file order, nothing merged (STL: three
/// a facet). Others: assimp's scene, node after node, transforms applied, mirrored nodes turned
/// outward again; coordinates pass through its single precision. What assimp's readers turn or
/// scale of their own accord is undone, for the formats of mesh_formats(). A left-handed format has
/// z negated. A unit that the file or its format states is honoured; one that nobody states is a
/// metre, or options.unit_m. Truncated, inconsistent or hostile files are refused, naming file,
/// place, expected, found: kIo (cannot be read or held in memory), kCorrupt (bytes contradict their
/// header or their format; a reader that crashed or took too long), kUnsupported (no reader),
/// kInvalidArgument (no faces; a coordinate not finite, in text any, in binary one that a face
/// uses; a unit for a file that states another; a scale that is not above 0; options of a grid that
/// are missing, contradict the file, or come with a mesh), kNotFound (no such node). A grid of
/// heights gives its posts in file order, those without data left out, and two triangles a cell,
/// counter-clockwise from above, that part it from south-west to north-east. No exception leaves.
/// Assimp or GDAL runs in a forked child process under a limit of memory (200 times the file and
/// 512 MiB, for GDAL 2 GiB; at most 8 GiB) and of time (60 s and 2 s a MiB), so that a crash inside
/// it is an error message here. Cost: linear; the file is held beside the mesh while it is read.
/// Threads: any, also at once.
[[nodiscard]] Result<ImportedMesh> import_mesh(const std::string& path,
                                               const ImportOptions& options);
[[nodiscard]] Result<IndexedMesh> import_mesh(const std::string& path);

/// A grid of heights that is read part by part. Parts that share a row or a column of posts share
/// its bits.
class TerrainFile {
 public:
  /// None where the file is a mesh, or a grid that only GDAL reads. HGT, PGM and raw samples are
  /// not held: read() takes from the file what it needs. ASC and PNG are read as a whole, here.
  /// Errors: as import_mesh.
  [[nodiscard]] static Result<std::optional<TerrainFile>> open(const std::string& path,
                                                               const ImportOptions& options);
  [[nodiscard]] std::uint64_t columns() const;
  [[nodiscard]] std::uint64_t rows() const;
  /// Vertices and faces of the window as import_mesh gives those of the whole; none where all is
  /// without data.
  /// Precondition: the window lies in the grid. Errors: as import_mesh. Cost: linear in the window.
  [[nodiscard]] Result<ImportedMesh> read(const GridWindow& window) const;

 private:
  struct Parts;
  explicit TerrainFile(std::shared_ptr<const Parts> parts) : parts_(std::move(parts)) {}
  std::shared_ptr<const Parts> parts_;
};

/// The same, node by node. A format without nodes gives one, named after the file.
[[nodiscard]] Result<ImportedNodes> import_nodes(const std::string& path,
                                                 const ImportOptions& options);

}  // namespace nearmesh
