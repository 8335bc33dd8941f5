// SPDX-License-Identifier: Apache-2.0
#pragma once
// Embree's rays, the yardstick for ours: in single precision, on a mesh at rest.

#include <memory>
#include <span>

#include "nearmesh/core/mesh/indexed_mesh.hpp"
#include "nearmesh/core/query/probe.hpp"

namespace nearmesh::peers {

class EmbreeRays {
 public:
  explicit EmbreeRays(const IndexedMesh& mesh);
  ~EmbreeRays();
  EmbreeRays(const EmbreeRays&) = delete;
  EmbreeRays& operator=(const EmbreeRays&) = delete;

  /// The distance of the first hit of each, infinite where there is none; one by one, or in packets
  /// of eight.
  void trace(std::span<const RayProbe> rays, std::span<float> distances_m, bool packets) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::peers
