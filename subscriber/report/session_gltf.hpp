// SPDX-License-Identifier: Apache-2.0
#pragma once
// A whole recorded session as a moving picture for programs that open glTF (takes a recording,
// gives bytes).

#include <string>

#include "nearmesh/core/recording/recording.hpp"
#include "subscriber/recorded/detail_folder.hpp"

namespace nearmesh::subscriber::report {

struct SessionGltf {
  std::string bytes;
  std::size_t peers = 0, bodies = 0, meshes = 0;  ///< bodies: of all peers together
  double seconds = 0;
};

/// Binary glTF 2.0 with one animation, z turned up into glTF's y. Below a node for each peer, one
/// for each body moves as the peer had it; below that, one for each mesh that it held, of which one
/// at a time has the scale 1 and all others 0: meshes change at most once a second. Colours, and
/// `_EPS_M`, are those of to_glb(). Contacts are lines. The same recording gives the same bytes.
/// Errors: those of the reader; kUnsupported above 4 GiB and for another wire version; kNotFound
/// where no answer can be rebuilt; kIo where there is no memory for replicas.
[[nodiscard]] Result<SessionGltf> session_to_glb(RecordingReader& recording,
                                                 DetailFolder* models = nullptr);

}  // namespace nearmesh::subscriber::report
