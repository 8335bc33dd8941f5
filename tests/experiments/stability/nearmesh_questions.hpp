// SPDX-License-Identifier: Apache-2.0
#pragma once
// The parts of ask_nearmesh, one for each kind of question.

#include "nearmesh_system.hpp"

namespace nearmesh::stability {

[[nodiscard]] NearmeshAnswer ask_solids(const Case& asked, const Model& model_a,
                                        const Model& model_b, const PosedPair& posed);
[[nodiscard]] NearmeshAnswer ask_sweep(const Case& asked, const Model& model_a,
                                       const Model& model_b);
[[nodiscard]] NearmeshAnswer ask_contacts(const Case& asked, const Model& model_a,
                                          const Model& model_b, const PosedPair& posed);
/// Of body a alone.
[[nodiscard]] NearmeshAnswer ask_bounds(const Model& model);
[[nodiscard]] NearmeshAnswer ask_incremental(const Case& asked, const Model& model_a,
                                             const Model& model_b, const PosedPair& posed);

}  // namespace nearmesh::stability
