// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "commands.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"

namespace nearmesh::subscriber::program {

/// What is said before a recorder listens is not in its recording. Out: ok also when the program is
/// to end.
[[nodiscard]] Status wait_for_recorder(const DdsChannel& channel, const RunOptions& options);

}  // namespace nearmesh::subscriber::program
