// SPDX-License-Identifier: Apache-2.0
#pragma once
// A scene as a file that mesh viewers open (takes RecordedScene, gives bytes). The same scene gives
// the same bytes.

#include <string>

#include "core/base/output_file.hpp"
#include "subscriber/recorded/recorded_scene.hpp"

namespace nearmesh::subscriber::report {

inline constexpr FileKind kGlbFile{"a binary glTF file", "glTF"};

/// Binary little-endian PLY in world coordinates (doubles, z up): the body `looked_at` (0 or 1),
/// then the other one, then slender tetrahedra (four faces) around the segments of contact, then
/// their ends, which are `edge` elements. Vertices are coloured as in mesh_colours.hpp; the
/// property `quality` is eps_m.
[[nodiscard]] std::string to_ply(const RecordedScene& scene, std::size_t looked_at);

/// Binary glTF 2.0: nodes for the two bodies and the contacts (lines, and tetrahedra around them)
/// below one that moves to the origin of the body looked at, so that single precision is enough far
/// out, below one that turns z up into glTF's y up. The attribute `_EPS_M` is eps_m.
/// Errors: kUnsupported above 4 GiB.
[[nodiscard]] Result<std::string> to_glb(const RecordedScene& scene, std::size_t looked_at);

}  // namespace nearmesh::subscriber::report
