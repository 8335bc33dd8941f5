// SPDX-License-Identifier: Apache-2.0
#include <meshoptimizer.h>

#include <cfloat>
#include <ctime>

#include "simplify_peer.hpp"

namespace nearmesh {

std::vector<std::array<std::uint32_t, 3>> simplify_by_meshoptimizer(const GridMesh& mesh,
                                                                    std::size_t faces,
                                                                    double& seconds) {
  GridBox box;
  for (const GridPoint& p : mesh.positions) box.add(p);
  std::vector<std::array<float, 3>> positions;
  positions.reserve(mesh.positions.size());
  for (const GridPoint& p : mesh.positions)
    positions.push_back({static_cast<float>(p[0] - box.lo[0]), static_cast<float>(p[1] - box.lo[1]),
                         static_cast<float>(p[2] - box.lo[2])});
  std::vector<unsigned int> corners, left(mesh.faces.size() * 3);
  corners.reserve(left.size());
  for (const auto& face : mesh.faces) corners.insert(corners.end(), face.begin(), face.end());
  const std::clock_t start = std::clock();
  left.resize(meshopt_simplify(left.data(), corners.data(), corners.size(), positions[0].data(),
                               positions.size(), sizeof positions[0], faces * 3, FLT_MAX, 0,
                               nullptr));
  seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  std::vector<std::array<std::uint32_t, 3>> result(left.size() / 3);
  for (std::size_t i = 0; i < left.size(); ++i) result[i / 3][i % 3] = left[i];
  return result;
}

std::string meshoptimizer_version() {
  return std::to_string(MESHOPTIMIZER_VERSION / 1000) + "." +
         std::to_string(MESHOPTIMIZER_VERSION % 1000 / 10);
}

}  // namespace nearmesh
