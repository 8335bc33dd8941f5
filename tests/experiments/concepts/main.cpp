// SPDX-License-Identifier: Apache-2.0
// nearmesh-draw-concepts FOLDER: writes the pictures of docs/concepts.md there, of structures that
// it makes for them. The same bytes each time.
#include <cstdio>
#include <fstream>

#include "pictures.hpp"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: nearmesh-draw-concepts FOLDER\n");
    return 2;
  }
  const auto pictures = nearmesh::concepts::draw_all();
  if (!pictures.is_ok()) {
    std::fprintf(stderr, "nearmesh-draw-concepts: %s\n", pictures.status().message().c_str());
    return 1;
  }
  for (const auto& picture : pictures.value()) {
    std::ofstream file(std::string(argv[1]) + '/' + picture.name + ".svg", std::ios::binary);
    file << picture.svg;
    file.close();
    if (!file) {
      std::fprintf(stderr, "nearmesh-draw-concepts: %s: cannot be written\n", argv[1]);
      return 1;
    }
  }
  return 0;
}
