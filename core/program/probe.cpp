// SPDX-License-Identifier: Apache-2.0
// Rays against a model, or a world, in its own frame.
#include <filesystem>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/base/csv.hpp"
#include "core/command/json_text.hpp"
#include "nearmesh/core/query/probe.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "nearmesh/core/world/world_probe.hpp"

namespace nearmesh::program {
namespace {

using nlohmann::ordered_json;

/// Columns x,y,z; with dx,dy,dz their direction, down without; with range how far.
Result<std::vector<RayProbe>> read_rays(const std::string& path) {
  const Result<CsvTable> table = CsvTable::read(path);
  NEARMESH_RETURN_IF_ERROR(table);
  std::vector<std::string> names{"x", "y", "z"};
  const bool has_direction = table.value().column("dx") != CsvTable::npos,
             has_range = table.value().column("range") != CsvTable::npos;
  if (has_direction) names.insert(names.end(), {"dx", "dy", "dz"});
  if (has_range) names.emplace_back("range");
  const auto columns = table.value().columns(names);
  NEARMESH_RETURN_IF_ERROR(columns);
  std::vector<RayProbe> rays(table.value().row_count());
  for (std::size_t row = 0; row < rays.size(); ++row)
    for (std::size_t i = 0; i < names.size(); ++i) {
      const Result<double> x = table.value().number(row, columns.value()[i]);
      NEARMESH_RETURN_IF_ERROR(x);
      (i < 3                    ? rays[row].origin_m[i]
       : has_direction && i < 6 ? rays[row].direction[i - 3]
                                : rays[row].range_m) = x.value();
    }
  return rays;
}

ordered_json to_json(const RayAnswer& answer) {
  ordered_json line = {{"status", to_string(answer.status)}};
  if (!answer.has_face) return line;
  line["distance_m"] = answer.distance_m();
  line["point_m"] = answer.point_m;
  line["normal"] = answer.normal;
  return line;
}

Status print(const std::vector<ordered_json>& lines) {
  for (const ordered_json& line : lines) std::printf("%s\n", text_of(line).c_str());
  return Status::ok();  // main says where that failed
}

Status probe_world(const std::string& folder, const std::vector<RayProbe>& rays) {
  Result<WorldProbe> world = WorldProbe::open(folder);
  NEARMESH_RETURN_IF_ERROR(world);
  std::vector<WorldRayAnswer> answers(rays.size());
  NEARMESH_RETURN_IF_ERROR(world.value().probe({}, rays, answers));
  std::vector<ordered_json> lines;
  for (const WorldRayAnswer& answer : answers) {
    ordered_json& line = lines.emplace_back(to_json(answer.ray));
    if (!answer.ray.has_face) continue;
    line["tile"] = to_hex(answer.tile.content);
    line["place"] = answer.tile.place;
  }
  return print(lines);
}

}  // namespace

Status run(const ProbeOptions& options) {
  const Result<std::vector<RayProbe>> rays = read_rays(options.rays);
  NEARMESH_RETURN_IF_ERROR(rays);
  if (std::filesystem::is_directory(options.path)) return probe_world(options.path, rays.value());
  Result<ModelFile> file = ModelFile::open(options.path);
  NEARMESH_RETURN_IF_ERROR(file);
  ModelFile& model = file.value();
  LocalModel held(model.store(), model.header().grid);
  std::vector<RayAnswer> answers(rays.value().size());
  NEARMESH_RETURN_IF_ERROR(certify_probes(
      held, {}, [&model](NodeSpan node) { return model.require(node); },
      std::span<const RayProbe>(rays.value()), std::span<RayAnswer>(answers)));
  const Result<FaceNumbering> numbers = model.face_numbering();
  NEARMESH_RETURN_IF_ERROR(numbers);
  std::vector<ordered_json> lines;
  for (const RayAnswer& answer : answers) {
    ordered_json& line = lines.emplace_back(to_json(answer));
    if (answer.has_face) line["face"] = numbers.value()[answer.face].face.value;
  }
  return print(lines);
}

}  // namespace nearmesh::program
