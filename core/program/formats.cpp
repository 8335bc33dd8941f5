// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/command/json_text.hpp"
#include "nearmesh/core/meshio/import.hpp"

namespace nearmesh::program {

Status run(const FormatsOptions& options) {
  if (options.json) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    for (const MeshFormat& format : mesh_formats())
      list.push_back({{"name", format.name},
                      {"endings", format.endings},
                      {"reader", format.reader},
                      {"unit", format.unit},
                      {"up", format.up},
                      {"nodes", format.nodes}});
    std::printf("%s\n", text_of(list).c_str());
    return Status::ok();
  }
  const auto row = [](const MeshFormat& format) {
    const auto width = [](std::string_view text) { return static_cast<int>(text.size()); };
    std::printf("%-19.*s %-12.*s %-7.*s %-28.*s %-17.*s %.*s\n", width(format.name),
                format.name.data(), width(format.endings), format.endings.data(),
                width(format.reader), format.reader.data(), width(format.unit), format.unit.data(),
                width(format.up), format.up.data(), width(format.nodes), format.nodes.data());
  };
  row({"format", "endings", "reader", "length of a unit", "up", "nodes"});
  for (const MeshFormat& format : mesh_formats()) row(format);
  std::printf(
      "\nCoordinates are the file's as written, in metres. No unit stated: a metre, or --unit. "
      "Nothing is\n"
      "turned without --up. Assimp reads more formats, which it may turn or scale; build warns of "
      "that.\n\n"
      "Grids of heights, with options that docs/terrain.md tells: HGT, ESRI ASCII (asc), PGM, PNG, "
      "raw "
      "samples.\nGeoTIFF, DTED and others are read by GDAL, which this build %s.\n",
      has_gdal() ? "has" : "has not (libgdal-dev)");
  return Status::ok();
}

}  // namespace nearmesh::program
