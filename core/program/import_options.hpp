// SPDX-License-Identifier: Apache-2.0
#pragma once
// What build and build-world make of their options.

#include <array>
#include <optional>

#include "commands.hpp"
#include "nearmesh/core/meshio/import.hpp"

namespace nearmesh::program {

/// Errors: kInvalidArgument naming the option.
[[nodiscard]] Result<ImportOptions> import_options(const BuildOptions& options);

/// None for a cell of 0. The cell is the greatest power of two that is no larger, and the origin
/// lies on it.
[[nodiscard]] std::optional<CommonLattice> common_lattice(double cell_m,
                                                          const std::array<double, 3>& origin_m);

}  // namespace nearmesh::program
