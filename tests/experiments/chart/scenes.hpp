// SPDX-License-Identifier: Apache-2.0
#pragma once
// The scenes of the chart. Deterministic.

#include <functional>
#include <optional>

#include "methods.hpp"

namespace nearmesh::chart {

struct SceneOptions {
  bool quick = false;  ///< small meshes and few poses
  std::string data;    ///< folder of shared meshes
};
struct SceneInfo {
  std::string name;
  bool full_only = false;  ///< not part of a quick run
  /// Nothing, with a message on standard error, where a file is absent.
  std::optional<Scene> (*make)(const SceneOptions& options);
};
[[nodiscard]] const std::vector<SceneInfo>& scenes();

}  // namespace nearmesh::chart
