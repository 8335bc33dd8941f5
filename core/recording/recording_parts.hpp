// SPDX-License-Identifier: Apache-2.0
#pragma once
// The files of a recording: found by their names, told from what else has such a name, opened.

#include <string>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "sqlite.hpp"

namespace nearmesh {

struct OpenedPart {
  sqlite::Database database;
  std::string path;
};
struct OpenedRecording {
  RecordingFacts facts;
  std::vector<OpenedPart> parts;  ///< all, in order
};

/// In: the first file of a recording, or an MCAP file, which is unpacked to a temporary one that
/// goes when it is closed. A database may be written to, as what a killed process has left in the
/// log must be taken in. Errors: kNotFound; kCorrupt, it is no recording or a part is missing;
/// kUnsupported, of another version; kInvalidArgument, it is a later part; kIo.
[[nodiscard]] Result<OpenedRecording> open_recording(const std::string& path);

}  // namespace nearmesh
