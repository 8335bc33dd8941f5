// SPDX-License-Identifier: Apache-2.0
#pragma once
// A patch of contact as JSON, for whoever has nlohmann's library, which calls this by itself; the
// fields are described in docs/answers.md.

#include <vector>

#include "nearmesh/core/query/contacts.hpp"

namespace nearmesh {

/// `Json` is one of nlohmann's types: `json["patches"] = contacts.patches` suffices.
template <class Json>
void to_json(Json& json, const ContactPatch& patch) {
  json = Json{{"centroid_m", patch.centroid_m},
              {"normal", patch.normal},
              {"normal_of", patch.normal_is_of_a ? "a" : "b"},
              {"normal_error_rad", patch.normal_error_rad},
              {"segments", patch.count},
              {"length_m", patch.length_m},
              {"manifold_m", std::vector(patch.manifold_m.begin(),
                                         patch.manifold_m.begin() + patch.manifold_count)},
              {"manifold_error_m", patch.manifold_error_m},
              {"approximate", patch.approximate},
              {"uncertainty_m", patch.uncertainty_m}};
  if (patch.normal_error_rad == kNoNormal_rad) json["normal_error_rad"] = nullptr;
}

}  // namespace nearmesh
