// SPDX-License-Identifier: Apache-2.0
#include <string>

namespace nearmesh::planted {

struct Scene {
  std::string name;
  double time_s = 0;
};

std::size_t length_of_name(const char* name) {
  const Scene scene{name, 1};
  return scene.name.size();
}

}  // namespace nearmesh::planted
