// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer held at a moment of a recorded session: the meshes of the two bodies of one of its
// reports, as refined as they were then, placed in the world, with what is exact and how far the
// rest may be off (takes a recording, gives RecordedScene). Rebuilt by the same code that verify
// runs, and held against the recorded digests.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/replica/replica.hpp"
#include "nearmesh/core/query/contacts.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// A body's mesh. Triangles in the order of the model, corners counter-clockwise seen from outside.
struct RecordedBody {
  std::string name;
  std::vector<std::array<double, 3>> positions_world_m;
  /// Of each vertex: 0 where it is a vertex of the full mesh in its final place; else every
  /// original face with a corner that this vertex stands for lies within this of it, metres. A face
  /// is exact when its three corners have 0.
  std::vector<double> eps_m;
  std::vector<std::array<std::uint32_t, 3>> faces;
  double size_m = 0;  ///< longest side of the model's box, in its own frame: a scale for eps_m
};

/// What a replica holds, under a pose; under none in the model's own frame.
[[nodiscard]] RecordedBody recorded_body(const std::string& name, const Replica& replica,
                                         const Pose& pose = {});

struct RecordedScene {
  std::int64_t message = 0;      ///< the report's id in the recording
  std::int64_t received_ns = 0;  ///< of the report
  wire::ContactReport report;
  std::array<RecordedBody, 2> bodies;  ///< body_a, body_b
  Contacts contacts;                   ///< of the pairs that the answer has
};

/// Which report to look at.
struct SceneChoice {
  std::int64_t received_ns = 0;  ///< the last one until then (inclusive)
  std::string peer;              ///< its partition; empty: any
  std::string body, other;       ///< the two bodies, either way round; empty: any
  /// One in contact goes before others that are at most so much later.
  std::int64_t contact_first_ns = 0;
};

/// The id of the last report chosen that was asked, of bodies that are no worlds.
/// Errors: kUnsupported for another wire version; kNotFound, saying what there is; those of the
/// reader.
/// Cost: reads backwards until it is found.
[[nodiscard]] Result<std::int64_t> find_report(RecordingReader& recording,
                                               const SceneChoice& choice);

/// The scenes of some reports, in their order, in one run through the recording. Each has a status
/// of its own: kNotFound where the recording lacks batches or a header that the peer had, or the id
/// is no report that was asked; kUnsupported of a world, and after give-ups that are not recorded;
/// kConflict where what comes out is not what was recorded.
/// Errors: those of the reader; kUnsupported for another wire version; kIo where there is no memory
/// for replicas.
[[nodiscard]] Result<std::vector<Result<RecordedScene>>> rebuild_scenes(
    RecordingReader& recording, const std::vector<std::int64_t>& reports);

}  // namespace nearmesh::subscriber
