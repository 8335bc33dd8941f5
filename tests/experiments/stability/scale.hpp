// SPDX-License-Identifier: Apache-2.0
#pragma once
// F14: what it takes to get from a mesh at hand to the first answer, by size of the mesh.

#include "report.hpp"
#include "system.hpp"

namespace nearmesh::stability {

/// Terrains of about 10^4, 10^5 and 10^6 faces (`quick`: the first two) against an aircraft that
/// touches them. Each run in a child process; nothing else of this program is timed. A run that
/// fails is left out, with a word on stderr.
[[nodiscard]] std::vector<ScaleRow> measure_scale(
    const std::vector<std::unique_ptr<System>>& systems, bool quick);

}  // namespace nearmesh::stability
