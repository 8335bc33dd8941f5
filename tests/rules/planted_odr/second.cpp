// SPDX-License-Identifier: Apache-2.0
#include <vector>

namespace nearmesh::planted {

std::size_t length_of_name(const char* name);

struct Scene {
  std::vector<int> bodies;
};

}  // namespace nearmesh::planted

int main(int count, char**) {
  nearmesh::planted::Scene scene;
  scene.bodies.assign(static_cast<std::size_t>(count), 1);
  return static_cast<int>(nearmesh::planted::length_of_name("planted") + scene.bodies.size());
}
