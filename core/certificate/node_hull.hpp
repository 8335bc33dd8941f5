// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where the faces lie that a node stands for: what a true half-space of it has to hold. Takes a model's file and a node, gives
// points. Reads what is near the node, never all of the model.

#include <vector>

#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh {

/// Points whose hull holds every face of the full mesh that has a vertex in the node: corners of these faces where parts of the
/// node are small, corners of boxes where they are large. Ascending, each once.
/// In: a node that file.store() knows (SplitStore::is_node). Errors: those of ModelFile::require(). Deterministic.
/// Cost: some microseconds a vertex up to 256 vertices, then no more.
[[nodiscard]] Result<std::vector<GridPoint>> hull_of_node(ModelFile& file, NodeSpan node);

}  // namespace nearmesh
