// SPDX-License-Identifier: Apache-2.0
#pragma once
// Opens one model file of many, as the tiles of a world are.

#include <string>

#include "coding_sets.hpp"
#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh {

/// ModelFile::open(), with the coding tables that another model of `shared` has already, if there
/// is one; nullptr: with its own.
[[nodiscard]] Result<ModelFile> open_sharing(const std::string& path, SharedTables* shared);

}  // namespace nearmesh
