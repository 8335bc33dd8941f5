// SPDX-License-Identifier: Apache-2.0
#pragma once
// Opens a model to be served, after a look at all of it: what a publisher serves its peers take for
// true.

#include <string>

#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh::publisher {

/// Checks every block and that boxes enclose all faces (ModelFile::check_deep) the first time, and
/// leaves the content hash in `path`.checked: where that is the file's, nothing is checked again.
/// Where nothing can be written beside the file it is checked each time. Errors: those of
/// ModelFile::open() and check_deep(). Cost, the first time: O(model), also in memory, which is
/// given back.
[[nodiscard]] Result<ModelFile> open_checked(const std::string& path);

}  // namespace nearmesh::publisher
