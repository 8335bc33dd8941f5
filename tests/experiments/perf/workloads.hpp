// SPDX-License-Identifier: Apache-2.0
#pragma once
// The scenes that are timed: two meshes on their grids, and poses by name.

#include <string>
#include <vector>

#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/geometry/pose.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"
#include "nearmesh/core/query/certify.hpp"

namespace nearmesh::perf {

struct Model {
  BakedModel baked;
  IndexedMesh mesh;   ///< the grid mesh in metres, for the other libraries
  TriangleTree tree;  ///< over all faces, for references
};
/// Cleaned on a grid of 21 bits and baked. Ends the program with a message where the mesh is
/// refused.
[[nodiscard]] Model make_model(const IndexedMesh& mesh,
                               std::uint32_t base_faces = SimplifyOptions{}.base_faces);

/// All of a model, held as a peer holds it. The model must outlive it.
struct WholeModel : LocalModel {
  explicit WholeModel(const Model& model);
};

struct PosePair {
  Pose a, b;
};
struct PoseSet {
  std::string name;  ///< e.g. near_miss
  std::vector<PosePair> poses;
};

/// For each of `draws` random directions and turns of b: the distance at which b, coming along that
/// direction, first touches a (by bisection, to 2^-36 of it), times each of eight factors from
/// clearly apart to deep.
[[nodiscard]] std::vector<PoseSet> distances(const Model& a, const Model& b, int draws);

/// b flown low over a, a terrain centred on the origin: grazing the ground here and there.
[[nodiscard]] PoseSet flight(const Model& terrain, const Model& aircraft, int frames);

}  // namespace nearmesh::perf
