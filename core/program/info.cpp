// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/base/hash.hpp"
#include "core/command/json_text.hpp"
#include "core/spm/coding_sets.hpp"
#include "measures.hpp"
#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh::program {

Status run(const InfoOptions& options) {
  if (std::filesystem::is_directory(options.path))
    return options.deep ? run(WorldCheckOptions{options.path})
                        : run(WorldInfoOptions{options.path, options.json});
  Result<ModelFile> file = ModelFile::open(options.path);
  NEARMESH_RETURN_IF_ERROR(file);
  NEARMESH_RETURN_IF_ERROR(options.deep ? file.value().check_deep() : file.value().verify());
  const SpmHeader& header = file.value().header();
  // Boxes of nodes are rounded outward; only the vertices themselves say how large the mesh is.
  NEARMESH_RETURN_IF_ERROR(file.value().require_all());
  GridBox box;
  for (std::uint32_t v = 0; v < header.vertex_count; ++v)
    box.add(file.value().store().position({v}));
  const Measures measures = measure(header.grid, box, file.value().origin());
  const double cell = std::ldexp(1.0, header.grid.exponent);
  for (const std::string& doubt : doubts(measures))
    std::fprintf(stderr, "%s: warning: %s\n", options.path.c_str(), doubt.c_str());
  const std::string hash = to_hex(file.value().content_hash());
  const std::uint32_t set = header.tables.set().number;
  const std::string tables = set == 0 ? "own" : coding_sets_data()[set - 1].name;
  if (options.json) {
    nlohmann::ordered_json report = {{"path", options.path},
                                     {"content_hash", hash},
                                     {"faces", header.face_count},
                                     {"vertices", header.vertex_count},
                                     {"base_faces", header.base_faces.size()},
                                     {"base_vertices", header.roots.size()},
                                     {"splits", header.split_count()},
                                     {"blocks", file.value().block_count()},
                                     {"bytes", file.value().file_bytes()},
                                     {"header_bytes", file.value().header_bytes().size()},
                                     {"coding_tables", tables},
                                     {"grid_bits", header.grid.bits},
                                     {"cell_m", cell},
                                     {"origin_m", header.grid.origin_m},
                                     {"closed", header.surface.is_closed()},
                                     {"boundary_edges", header.surface.boundary_edges},
                                     {"disagreeing_edges", header.surface.disagreeing_edges},
                                     {"components", header.surface.component_count},
                                     {"rounding_error_m", header.rounding_bound_m()}};
    if (header.grid.shares_lattice()) {
      report["lattice_cells"] = header.grid.lattice_cells;
      report["lattice_origin_m"] = header.grid.lattice_origin_m();
    }
    add_json(measures, report);
    std::printf("%s\n", text_of(report).c_str());
    return Status::ok();
  }
  std::printf("%s: nearmesh model, checksums good%s\n", options.path.c_str(),
              options.deep ? ", boxes enclose all faces" : "");
  std::printf("  content: %s\n", hash.c_str());  // as a scene has it
  std::printf("  full          %u faces, %u vertices\n", header.face_count, header.vertex_count);
  std::printf("  base          %zu faces, %zu vertices\n", header.base_faces.size(),
              header.roots.size());
  if (header.surface.is_closed()) {
    std::printf("  surface       closed: may be solid; ");
  } else {
    std::printf("  surface       open: %u boundary edges, %u edges whose faces disagree; ",
                header.surface.boundary_edges, header.surface.disagreeing_edges);
  }
  std::printf("%u parts%s\n", header.surface.component_count,
              header.surface.has_seeds() ? "" : ", too many to be proved outside a solid");
  std::printf("  splits        %u in %llu blocks\n", header.split_count(),
              static_cast<unsigned long long>(file.value().block_count()));
  std::printf("  bytes         %llu in all, header %zu, coding tables: %s\n",
              static_cast<unsigned long long>(file.value().file_bytes()),
              file.value().header_bytes().size(), tables.c_str());
  std::printf("  grid          %d bits, cell %.3g m, rounding error %s m\n", header.grid.bits, cell,
              round_up(header.rounding_bound_m()).c_str());
  if (header.grid.shares_lattice()) {
    const auto origin_m = header.grid.lattice_origin_m();
    std::printf("  lattice       shared, from %.9g, %.9g, %.9g m\n", origin_m[0], origin_m[1],
                origin_m[2]);
  }
  print_text(measures);
  return Status::ok();
}

}  // namespace nearmesh::program
