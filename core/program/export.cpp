// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "commands.hpp"
#include "core/base/output_file.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"
#include "nearmesh/core/refine/detail/active_mesh.hpp"
#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh::program {
Status run(const ExportOptions& options) {
  NEARMESH_RETURN_IF_ERROR(check_output(options.out, kPlyFile, {options.in}));
  Result<ModelFile> file = ModelFile::open(options.in);
  NEARMESH_RETURN_IF_ERROR(file);
  Result<FaceNumbering> numbering = file.value().face_numbering();
  NEARMESH_RETURN_IF_ERROR(numbering);
  const SplitStore& store = file.value().store();
  ActiveMesh mesh(store);
  RefineDelta delta;
  for (const VertexId u : global_order(store, options.splits))
    if (!mesh.split(u, delta)) return {StatusCode::kCorrupt, options.in + ": a split is missing"};

  // Faces in input order, corners in input rotation; vertices in forest order.
  struct Numbered {
    FaceId face;
    std::array<std::uint32_t, 3> corners;
  };
  std::vector<Numbered> faces;
  for (const ActiveFace& active : extract_faces(mesh)) {
    const FaceNumber number = numbering.value()[active.key];
    Numbered face{number.face, {}};
    for (std::size_t k = 0; k < 3; ++k)
      face.corners[k] = active.corners[(number.first_corner + k) % 3].value;
    faces.push_back(face);
  }
  std::sort(faces.begin(), faces.end(),
            [](const Numbered& a, const Numbered& b) { return a.face < b.face; });
  IndexedMesh out;
  std::vector<std::uint32_t> place(store.vertex_count());
  const Grid& grid = file.value().header().grid;
  for (VertexId v{0}; v.value < store.vertex_count(); v = {mesh.current_node(v).end()}) {
    place[v.value] = static_cast<std::uint32_t>(out.positions_m.size());
    std::array<double, 3> at = grid.origin_m;
    for (int k = 0; k < 3; ++k)
      at[static_cast<std::size_t>(k)] += std::ldexp(store.position(v)[k], grid.exponent);
    out.positions_m.push_back(at);
  }
  for (const Numbered& face : faces)
    out.faces.push_back({place[face.corners[0]], place[face.corners[1]], place[face.corners[2]]});
  NEARMESH_RETURN_IF_ERROR(write_ply(out, options.out));
  std::printf("%s: %zu vertices, %zu triangles after %u of %u splits\n", options.out.c_str(),
              out.positions_m.size(), out.faces.size(), mesh.split_count(), store.known_splits());
  return Status::ok();
}

}  // namespace nearmesh::program
