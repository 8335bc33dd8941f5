// SPDX-License-Identifier: Apache-2.0
// Worlds: what info and check say of a folder.
#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/command/json_text.hpp"
#include "core/world/open_tiles.hpp"
#include "core/world/world_folder.hpp"

namespace nearmesh::program {
namespace {

struct WorldFacts {
  std::uint64_t pages = 0, page_bytes = 0, tiles = 0;
  std::map<ContentHash, std::vector<WorldEntry>> places;  ///< by tile
};

/// All pages below one, each of which is read and checked.
Status walk(const WorldFolder& folder, const WorldPage& page, MetPages& met, WorldFacts& facts) {
  ++facts.pages;
  if (facts.tiles > folder.world().tiles)
    return {StatusCode::kCorrupt, "its pages list more than the " +
                                      std::to_string(folder.world().tiles) +
                                      " tiles of its record"};
  facts.page_bytes += encode_page(page).size();
  for (const WorldEntry& entry : page.entries) {
    if (page.level == 0) {
      ++facts.tiles;
      facts.places[entry.content].push_back(entry);
      continue;
    }
    NEARMESH_RETURN_IF_ERROR(met.meet(entry.content));
    const Result<WorldPage> below = folder.page(entry, page.level - 1);
    NEARMESH_RETURN_IF_ERROR(below);
    NEARMESH_RETURN_IF_ERROR(walk(folder, below.value(), met, facts));
  }
  return Status::ok();
}

struct KnownWorld {
  WorldFolder folder;
  CellBox box;
  WorldFacts facts;
};

Result<KnownWorld> read_world(const std::string& path) {
  Result<WorldFolder> folder = WorldFolder::open(path);
  NEARMESH_RETURN_IF_ERROR(folder);
  const Result<WorldPage> root = folder.value().root();
  NEARMESH_RETURN_IF_ERROR(root);
  KnownWorld known{std::move(folder).value(), root.value().box(), {}};
  MetPages met(known.folder.world());
  const Status walked = walk(known.folder, root.value(), met, known.facts);
  if (!walked.is_ok()) return Status(walked.code(), path + ": " + walked.message());
  if (known.facts.tiles != known.folder.world().tiles)
    return Status(StatusCode::kCorrupt,
                  path + ": expected " + std::to_string(known.folder.world().tiles) +
                      " tiles, as its record says, found " + std::to_string(known.facts.tiles));
  for (const auto& [content, places] : known.facts.places)
    if (const Status once = check_each_once(known.folder.world(), places); !once.is_ok())
      return Status(once.code(), path + ": " + once.message());
  return known;
}

/// A tile's file, its grid, and that all its places hold it. Adds its faces, once a place.
Status check_tile(const WorldFolder& folder, const ContentHash& content,
                  const std::vector<WorldEntry>& places, SharedTables& tables,
                  std::uint64_t& faces) {
  Result<ModelFile> file = open_tile(folder, content, &tables);
  NEARMESH_RETURN_IF_ERROR(file);
  const auto wrong = [&folder, &content](StatusCode code, const std::string& what) {
    return Status(code, folder.tile_path(content) + ": " + what);
  };
  const SpmHeader& header = file.value().header();
  NEARMESH_RETURN_IF_ERROR(file.value().check_deep());
  NEARMESH_RETURN_IF_ERROR(file.value().require_all());
  std::array<std::int32_t, 3> reach{};
  for (std::uint32_t v = 0; v < header.vertex_count; ++v) {
    const GridPoint p = file.value().store().position({v});
    for (std::size_t k = 0; k < 3; ++k) reach[k] = std::max(reach[k], p.v[k]);
  }
  for (const WorldEntry& place : places) {
    CellBox box;
    for (std::size_t k = 0; k < 3; ++k) {
      box.lo[k] = place.place[k];
      box.hi[k] = std::int64_t{place.place[k]} + reach[k];
    }
    if (!place.box().contains(box))
      return wrong(StatusCode::kConflict, "its vertices leave the box of a page that lists it");
    if (place.log2_faces != std::bit_width(header.face_count) - 1)
      return wrong(StatusCode::kConflict, "has " + std::to_string(header.face_count) +
                                              " faces, a page says 2^" +
                                              std::to_string(place.log2_faces));
    faces += header.face_count;
  }
  return Status::ok();
}

}  // namespace

Status run(const WorldInfoOptions& options) {
  const Result<KnownWorld> known = read_world(options.path);
  NEARMESH_RETURN_IF_ERROR(known);
  const auto& [folder, box, facts] = known.value();
  const WorldRecord& world = folder.world();
  std::array<double, 3> lo_m{}, hi_m{};
  for (std::size_t k = 0; k < 3; ++k) {
    lo_m[k] = world.lattice.grid_at(box.lo, world.bits).origin_m[k];
    hi_m[k] = world.lattice.grid_at(box.hi, world.bits).origin_m[k];
  }
  std::uint64_t tile_bytes = 0, missing = 0;
  for (const auto& [content, places] : facts.places) {
    std::error_code error;
    const std::uintmax_t bytes = std::filesystem::file_size(folder.tile_path(content), error);
    if (error) {
      ++missing;
    } else {
      tile_bytes += bytes;
    }
  }
  const double cell_m = std::ldexp(1.0, world.lattice.exponent);
  if (options.json) {
    const nlohmann::ordered_json report = {{"path", options.path},
                                           {"world", to_hex(folder.name())},
                                           {"tiles", world.tiles},
                                           {"distinct_tiles", facts.places.size()},
                                           {"tiles_missing", missing},
                                           {"tile_bytes", tile_bytes},
                                           {"faces", world.faces},
                                           {"pages", facts.pages},
                                           {"page_bytes", facts.page_bytes},
                                           {"root_level", world.root_level},
                                           {"cell_m", cell_m},
                                           {"grid_bits", world.bits},
                                           {"origin_m", world.lattice.origin_m},
                                           {"box_min_m", lo_m},
                                           {"box_max_m", hi_m}};
    std::printf("%s\n", text_of(report).c_str());
    return Status::ok();
  }
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf("%s: nearmesh world, pages good\n", options.path.c_str());
  std::printf("  world: %s\n", to_hex(folder.name()).c_str());
  std::printf("  tiles         %llu, %zu distinct, %llu faces in all\n", count(world.tiles),
              facts.places.size(), count(world.faces));
  if (missing > 0)
    std::printf("  missing       the files of %llu distinct tiles\n", count(missing));
  std::printf("  bytes         tiles %llu, %llu pages %llu\n", count(tile_bytes),
              count(facts.pages), count(facts.page_bytes));
  std::printf("  lattice       cell %.9g m, tiles of %d bits, from %.9g, %.9g, %.9g m\n", cell_m,
              world.bits, world.lattice.origin_m[0], world.lattice.origin_m[1],
              world.lattice.origin_m[2]);
  std::printf("  box           from %.9g, %.9g, %.9g to %.9g, %.9g, %.9g m\n", lo_m[0], lo_m[1],
              lo_m[2], hi_m[0], hi_m[1], hi_m[2]);
  return Status::ok();
}

Status run(const WorldCheckOptions& options) {
  const Result<KnownWorld> known = read_world(options.path);
  NEARMESH_RETURN_IF_ERROR(known);
  const auto& [folder, box, facts] = known.value();
  SharedTables tables;
  std::uint64_t faces = 0;
  for (const auto& [content, places] : facts.places)
    NEARMESH_RETURN_IF_ERROR(check_tile(folder, content, places, tables, faces));
  if (faces != folder.world().faces)
    return {StatusCode::kCorrupt, options.path + ": expected " +
                                      std::to_string(folder.world().faces) +
                                      " faces, as its record says, found " + std::to_string(faces)};
  std::printf("%s: %llu pages and %zu distinct tiles are good, in %llu places\n",
              options.path.c_str(), static_cast<unsigned long long>(facts.pages),
              facts.places.size(), static_cast<unsigned long long>(facts.tiles));
  return Status::ok();
}

}  // namespace nearmesh::program
