// SPDX-License-Identifier: Apache-2.0
#pragma once
// A recorded session as an MCAP file, for viewers of others (takes a recording, writes a file). It
// holds the recording itself, whole, under nearmesh's IDL, so that it can be read back; and what
// ROS 2's tools draw, derived from it:
//
//   /tf                              tf2_msgs/TFMessage: where bodies are, in the frame "world", as
//                                    their movers told it
//   /tf_static                       the same, of bodies in place
//   /nearmesh/PEER/contacts          visualization_msgs/MarkerArray: where bodies touch, in "world"
//   /nearmesh/PEER/mesh              the same: a body as a peer held it, exact faces apart from
//                                    coarse ones, in the body's frame; of one peer, when it
//                                    changed, at most once in kMeshStep_s and body
//   /nearmesh/PEER/A/B/clearance_m   std_msgs/Float64: what each answer says
//   /nearmesh/PEER/A/B/uncertainty_m the same; infinite where nothing is known
//
// PEER, A and B are names made of letters, digits and lines. Times are those at which the recorder
// received what it is about.

#include <cstdint>
#include <string>
#include <vector>

#include "detail_folder.hpp"
#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh::subscriber {

inline constexpr double kMeshStep_s = 1;

struct McapExport {
  std::uint64_t samples = 0;  ///< of the recording
  std::uint64_t derived = 0;  ///< messages for ROS 2's tools
  std::uint64_t bytes = 0;
  std::string mesh_peer;  ///< whose meshes are in it; empty: nobody's could be rebuilt
  std::vector<std::string> complaints;
};

/// In: `peer`, a partition: whose meshes; empty: of the first that touched something, else of the
/// first. `inputs` and errors of the file: as OutputFile::create(). Errors beside: those of the
/// reader; kUnsupported for another wire version; kIo where there is no memory for replicas, or no
/// room for temporary files.
/// Cost: as verify. Derived messages wait in a temporary file until it is known between which
/// samples they belong.
[[nodiscard]] Result<McapExport> export_mcap(RecordingReader& recording, const std::string& path,
                                             const std::vector<std::string>& inputs,
                                             const std::string& peer,
                                             DetailFolder* models = nullptr);

}  // namespace nearmesh::subscriber
