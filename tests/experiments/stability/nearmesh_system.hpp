// SPDX-License-Identifier: Apache-2.0
#pragma once
// nearmesh under test: an IndexedMesh is cleaned, baked and queried in every way that there is, and
// all ways must agree.

#include <optional>

#include "case.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "oracle.hpp"

namespace nearmesh::stability {

struct Model {
  GridMesh clean;
  BakedModel baked;
};
/// At 21 bits. Errors: those of clean_mesh and bake.
[[nodiscard]] Result<std::shared_ptr<const Model>> build_model(const IndexedMesh& mesh,
                                                               std::uint32_t base_faces);

/// Does splits, each with what it rests on. The store is complete.
void refine(LocalModel& model, const std::vector<VertexId>& splits);
[[nodiscard]] std::vector<VertexId> every_split(const SplitStore& store);

/// The mesh of a client that holds these splits, as triangles: what it would give to another
/// library.
[[nodiscard]] IndexedMesh held_mesh(const Model& model, const std::vector<VertexId>& held);

/// How nearmesh answered one case. `trouble` names what contradicts what; empty where nothing does.
struct NearmeshAnswer {
  Verdict verdict;
  PairList pairs;  ///< places in the input's faces, ascending
  std::string trouble;
};
/// Full meshes; from the base by certify; from a random state with losses, then by certify; first
/// pair only.
[[nodiscard]] NearmeshAnswer ask_nearmesh(const Case& asked);

}  // namespace nearmesh::stability
