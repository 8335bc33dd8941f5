// SPDX-License-Identifier: Apache-2.0
// A grid of heights of one of the formats that our own readers take, and the mesh that it becomes.
// The first byte names the format and the frame, the second what the options say.

#include <cmath>

#include "core/meshio/grid_formats.hpp"
#include "fuzz_input.hpp"

using namespace nearmesh;

namespace {

TerrainOptions options_of(std::uint8_t frame, std::uint8_t said) {
  TerrainOptions options{.frame = static_cast<TerrainFrame>(frame % 4)};
  options.enu_origin_deg = {frame - 25.0, said - 128.0};
  if ((said & 1) != 0) options.spacing = {{0.25, 0.1}};
  if ((said & 2) != 0) options.corner = {{10, -4}};
  if ((said & 4) != 0) options.nodata = 0;
  if ((said & 8) != 0) options.fill = -1.5;
  if ((said & 16) != 0) options.heights = {{-10, 0.1}};
  return options;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::FuzzInput in(data, size);
  const std::uint8_t choice = in.byte(), said = in.byte();
  const auto format = static_cast<meshio::GridFormat>(choice % 5);
  TerrainOptions options = options_of(choice / 5, said);
  if (format == meshio::GridFormat::kRaw)
    options.raw = RawGrid{in.byte(), in.byte(), static_cast<RawGrid::Kind>(in.below(4)), in.byte(),
                          in.byte() % 2 != 0};
  const std::string_view bytes(reinterpret_cast<const char*>(in.rest().data()), in.rest().size());
  const auto grid = meshio::read_grid(format, "tiles/S02W071.hgt", bytes, options);
  if (!grid.is_ok()) {
    FUZZ_CHECK(!grid.status().message().empty());
    return 0;
  }
  const std::uint64_t posts = grid.value().columns * grid.value().rows;
  FUZZ_CHECK(grid.value().samples.size() == posts);
  const auto scene = meshio::to_scene(grid.value(), options);
  if (!scene.is_ok()) {
    FUZZ_CHECK(!scene.status().message().empty());
    return 0;
  }
  const IndexedMesh& mesh = scene.value().mesh;
  FUZZ_CHECK(scene.value().terrain.has_value());
  const std::uint64_t missing = options.fill ? 0 : scene.value().terrain->posts_without_data;
  FUZZ_CHECK(mesh.positions_m.size() == posts - missing);
  FUZZ_CHECK(mesh.faces.size() <= 2 * (grid.value().columns - 1) * (grid.value().rows - 1));
  for (const auto& position : mesh.positions_m)
    for (const double x : position) FUZZ_CHECK(!std::isnan(x));
  for (const auto& face : mesh.faces)
    for (const std::uint32_t v : face) FUZZ_CHECK(v < mesh.positions_m.size());
  return 0;
}
