// SPDX-License-Identifier: Apache-2.0
// A mesh file of one of the four formats that our own readers take, then its clean-up and, where it
// is small, the baking of a model. The first byte names the format.

#include "core/meshio/plain_formats.hpp"
#include "fuzz_input.hpp"
#include "nearmesh/core/bake/bake.hpp"

using namespace nearmesh;

namespace {

void check_bake(const GridMesh& mesh, const CleanReport& report) {
  const Result<BakedModel> baked = bake(mesh, report.rounding_error_m, {.base_faces = 1});
  if (!baked.is_ok()) return;
  const BakedModel& model = baked.value();
  FUZZ_CHECK(model.header.vertex_count == mesh.positions.size());
  FUZZ_CHECK(model.header.face_count == mesh.faces.size());
  FUZZ_CHECK(model.numbers.size() == mesh.faces.size());
  FUZZ_CHECK(model.store.known_splits() == model.header.split_count());
  FUZZ_CHECK(decode_header(encode_header(model.header)).is_ok());
}

void check_clean(const IndexedMesh& mesh, int grid_bits) {
  const Result<CleanResult> cleaned = clean_mesh(mesh, {.grid_bits = grid_bits});
  if (!cleaned.is_ok()) return;
  const GridMesh& grid = cleaned.value().mesh;
  const CleanReport& report = cleaned.value().report;
  FUZZ_CHECK(report.faces_in == mesh.faces.size());
  FUZZ_CHECK(report.vertices_in == mesh.positions_m.size());
  FUZZ_CHECK(report.faces_in ==
             grid.faces.size() + report.faces_duplicate + report.faces_degenerate_dropped);
  FUZZ_CHECK(report.faces_degenerate_kept <= grid.faces.size() && !grid.faces.empty());
  FUZZ_CHECK(report.rounding_error_m >= 0);
  FUZZ_CHECK(grid.face_ids.size() == grid.faces.size());
  std::vector<bool> is_corner(grid.positions.size());
  for (std::size_t f = 0; f < grid.faces.size(); ++f) {
    const auto [a, b, c] = grid.faces[f];
    FUZZ_CHECK(a != b && b != c && c != a);
    for (const std::uint32_t v : grid.faces[f]) {
      FUZZ_CHECK(v < grid.positions.size());
      is_corner[v] = true;
    }
    FUZZ_CHECK(f == 0 || grid.face_ids[f - 1].value < grid.face_ids[f].value);
    FUZZ_CHECK(grid.face_ids[f].value < mesh.faces.size());
  }
  const std::int64_t last = (std::int64_t{1} << grid_bits) - 1;
  for (std::size_t v = 0; v < grid.positions.size(); ++v) {
    FUZZ_CHECK(is_corner[v]);
    for (const std::int32_t x : grid.positions[v].v) FUZZ_CHECK(x >= 0 && x <= last);
  }
  // A bake takes as long as a hundred imports: one number of bits in seven is worth it.
  if (grid_bits % 7 == 0 && grid.faces.size() <= 64) check_bake(grid, report);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::FuzzInput in(data, size);
  const std::uint8_t choice = in.byte();
  const std::string_view text(reinterpret_cast<const char*>(in.rest().data()), in.rest().size());
  const Result<IndexedMesh> mesh =
      meshio::read_plain(static_cast<meshio::PlainFormat>(choice % 4), text);
  if (!mesh.is_ok()) {
    FUZZ_CHECK(!mesh.status().message().empty());
    return 0;
  }
  for (const auto& face : mesh.value().faces)
    for (const std::uint32_t v : face) FUZZ_CHECK(v < mesh.value().positions_m.size());
  check_clean(mesh.value(), 4 + choice / 4 % 28);
  return 0;
}
