// SPDX-License-Identifier: Apache-2.0
#pragma once
// Our own readers of the four plain formats: PLY, STL, OFF, OBJ. Assimp 5.2.5 reads them too, but
// it loses what a collision test must not lose, without a word: OFF faces where comments stand
// between the lines or a face has more than nine corners, digits beyond single precision; it takes
// counts and indices on trust, stops the process on a PLY with an unknown list, and stumbles over
// an OBJ's byte order mark. All other formats go to assimp (assimp_reader.hpp).

#include <optional>
#include <string>
#include <string_view>

#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh::meshio {

enum class PlainFormat : std::uint8_t { kPly, kStl, kOff, kObj };

/// By the path's ending, or by the first bytes where they are telling.
[[nodiscard]] std::optional<PlainFormat> find_plain_format(const std::string& path,
                                                           std::string_view bytes);

/// Reads all polygons, in file order, cut into triangles; edges and points are left out.
/// In: all bytes of the file. Out: indices in range; coordinates of text files finite; memory in
/// proportion to the file, whatever its counts announce.
/// Errors, the message without the path: kCorrupt (place, expected, found), kUnsupported (UTF-16,
/// binary OFF, coordinates other than x, y, z, triangle strips, see polygon.hpp), kInvalidArgument
/// (a coordinate in text that is not finite).
[[nodiscard]] Result<IndexedMesh> read_plain(PlainFormat format, std::string_view bytes);

[[nodiscard]] Result<IndexedMesh> read_ply(std::string_view bytes);
[[nodiscard]] Result<IndexedMesh> read_stl(std::string_view bytes);
[[nodiscard]] Result<IndexedMesh> read_off(std::string_view bytes);

/// What follows an "o" line (a "g" line in a file without any "o") up to the next.
struct ObjObject {
  std::string name;
  std::size_t first_face = 0;  ///< triangle
};
/// `objects`, if given, gets the file's in their order; a name may come more than once.
[[nodiscard]] Result<IndexedMesh> read_obj(std::string_view bytes,
                                           std::vector<ObjObject>* objects = nullptr);

}  // namespace nearmesh::meshio
