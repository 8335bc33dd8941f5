// SPDX-License-Identifier: Apache-2.0
#pragma once
// A recording inside an MCAP file, whole: its samples on a channel for each writer, in their order,
// and what the recorder knew beside (session, gaps, models, keys) as metadata and an attachment.
// Other channels may stand between them: they are no part of it.

#include <cstdint>
#include <string>
#include <vector>

#include "mcap.hpp"
#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh {

/// Writes what comes before the samples. Out: the channels, by writer. Errors: those of both sides.
[[nodiscard]] Result<std::vector<std::uint16_t>> begin_mcap_recording(RecordingReader& recording,
                                                                      mcap::Writer& file);

/// Makes a recording of one part at `path`, which must not exist, from an MCAP file.
/// Errors: those of mcap::read; kCorrupt where it holds no recording or a damaged one; kUnsupported
/// for a later version; those of RecordingWriter. What was begun is removed then.
[[nodiscard]] Status unpack_mcap_recording(const std::string& mcap_path, const std::string& path);

}  // namespace nearmesh
