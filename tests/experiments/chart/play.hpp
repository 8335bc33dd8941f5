// SPDX-License-Identifier: Apache-2.0
#pragma once
// Plays scenes through methods and writes what happened.
//
// rows.csv, one row a scene, method, pose or frame, and point of the byte budget:
//   scene, method, proof (whose word a certified answer is: client, server, none), kind (pose: each
//   starts afresh, with an answer at each point of the budget; whole: the same without a budget,
//   one answer at the end; frame: one after the other, 6,250 bytes each, 1 Mbit/s at 20 frames a
//   second), index (of the pose or frame), budget_bytes, bytes (received so far: payload, framing,
//   headers), header_bytes (of these), requests (each a round trip; joining is one more),
//   request_bytes, splits, t_r_us, t_b_us, t_q_us, t_l_us (refinement, tree, query, loading: so
//   far; of a frame: in it), status (free, contact, partial, uncertain; none: the method is never
//   sure, or has no answer yet), truth (0, 1: touching), answers (1: something to answer with),
//   correct (answers, and touching or not is right), certified, false_certificate (certified, and
//   the set of touching pairs is not that of the full meshes), recall (of truly touching faces of
//   A, share found), false_faces (of those found, share wrong), position_error_m, normal_error_rad
//   (mean over true contacts, against the nearest found), faces_held, tree_bytes (of streamed
//   bodies, in what is queried), needed_faces (that no exact answer could do without), finished (1:
//   nothing more would come).
// A pose's rows end with the one that is finished; all later budgets are as that one.
// Empty cells: recall and errors where nothing touches, or is found to touch.
//
// models.csv, one row a scene and body: scene, body, streamed, faces (of a world's tile: of the
// world), vertices, base_faces, base_vertices, splits,
//   tree_height, header_bytes, mesh_bytes (all splits in largest batches, with framing, and the
//   header).
//
// Everything but the columns t_* is the same in every run.

#include <cstdio>

#include "methods.hpp"

namespace nearmesh::chart {

inline constexpr std::uint64_t kFrameBytes = 6250;

struct PlayTotals {
  std::uint64_t rows = 0, false_certificates = 0;
};

void write_row_names(std::FILE* rows, std::FILE* models);
void write_models(const Scene& scene, std::FILE* models);
/// Plays the scene through a method, or through all of them and the neighbouring libraries where
/// `only` is empty.
PlayTotals play(const Scene& scene, const std::vector<std::string>& only, std::FILE* rows);

}  // namespace nearmesh::chart
