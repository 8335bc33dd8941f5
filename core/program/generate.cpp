// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/mesh/generate.hpp"
#include "commands.hpp"
#include "core/base/output_file.hpp"

namespace nearmesh::program {
namespace {

struct Kind {
  const char* name;
  IndexedMesh (*generate)(std::uint32_t size, std::uint64_t seed);
  std::uint32_t default_size, min_size, max_size;
};
constexpr Kind kKinds[] = {{"terrain", generate_terrain, 708, 2, 4096},
                           {"aircraft", generate_aircraft, 4000, 200, 200000},
                           {"sphere", generate_sphere, 64, 4, 4096}};

}  // namespace

Status run(const GenerateOptions& options) {
  NEARMESH_RETURN_IF_ERROR(check_output(options.out, kPlyFile));
  for (const Kind& kind : kKinds) {
    if (options.kind != kind.name) continue;
    const std::uint32_t size = options.size == 0 ? kind.default_size : options.size;
    if (size < kind.min_size || size > kind.max_size)
      return {StatusCode::kInvalidArgument,
              "--size of a " + options.kind + ": expected " + std::to_string(kind.min_size) +
                  " to " + std::to_string(kind.max_size) + ", found " + std::to_string(size)};
    if (options.kind == "sphere" && size % 2 != 0)
      return {
          StatusCode::kInvalidArgument,
          "--size of a sphere: expected an even number of slices, found " + std::to_string(size)};
    if (options.floor_m && options.kind != "terrain")
      return {StatusCode::kInvalidArgument,
              "--floor-m is for terrain; a " + options.kind + " is closed"};
    IndexedMesh mesh = kind.generate(size, options.seed);
    if (options.floor_m) NEARMESH_RETURN_IF_ERROR(close_terrain(mesh, size, *options.floor_m));
    NEARMESH_RETURN_IF_ERROR(write_ply(mesh, options.out));
    std::printf("%s: %zu vertices, %zu triangles\n", options.out.c_str(), mesh.positions_m.size(),
                mesh.faces.size());
    return Status::ok();
  }
  return {StatusCode::kInvalidArgument, "unknown kind " + options.kind};
}

}  // namespace nearmesh::program
