// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/mesh/generate.hpp"
#include "commands.hpp"

namespace nearmesh::program {
namespace {

struct Options {
  std::string kind, out;
  std::uint32_t size = 0;
  std::uint64_t seed = 1;
  std::optional<double> floor_m;
};

struct Kind {
  const char* name;
  IndexedMesh (*generate)(std::uint32_t size, std::uint64_t seed);
  std::uint32_t default_size, min_size, max_size;
};
constexpr Kind kKinds[] = {{"terrain", generate_terrain, 708, 2, 4096},
                           {"aircraft", generate_aircraft, 4000, 200, 200000},
                           {"sphere", generate_sphere, 64, 4, 4096}};

Status run(const Options& options) {
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

}  // namespace

void add_generate(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("generate", "Write a deterministic test model as PLY.");
  const auto options = std::make_shared<Options>();
  command->add_option("kind", options->kind, "What to generate")
      ->required()
      ->check(CLI::IsMember({"terrain", "aircraft", "sphere"}));
  command->add_option("-o,--output", options->out, "PLY file to write")->required();
  command->add_option("--size", options->size,
                      "terrain: cells a side (default 708: 1,002,528 triangles of 32 m); "
                      "aircraft: triangles, about (default 4000); sphere: slices (default 64)");
  command->add_option("--seed", options->seed, "Seed; equal seeds give equal files")
      ->capture_default_str();
  command->add_option(
      "--floor-m", options->floor_m,
      "terrain: close it by walls and a floor at this height, so that what is below "
      "the ground is inside; metres");
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

}  // namespace nearmesh::program
