// SPDX-License-Identifier: Apache-2.0
#include "tile_notes.hpp"

#include <cstdio>
#include <filesystem>
#include <fstream>

#include "core/base/output_file.hpp"
#include "core/spm/open_sharing.hpp"
#include "nearmesh/core/base/parse_content_hash.hpp"

namespace nearmesh::program {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr FileKind kTileNote{"a note of build-world", "{\"nearmesh_tile\":"};

std::optional<TileNote> parse(std::ifstream& in) {
  try {
    const json stored = json::parse(in);
    TileNote note;
    note.tile.place = stored.at("place").get<std::array<std::int64_t, 3>>();
    note.tile.extent = stored.at("extent").get<std::array<std::int64_t, 3>>();
    note.tile.faces = stored.at("faces").get<std::uint64_t>();
    note.bytes = stored.at("bytes").get<std::uint64_t>();
    note.seconds = stored.at("seconds").get<double>();
    if (note.tile.faces == 0) return note;
    const auto content = parse_content_hash(stored.at("content").get<std::string>());
    if (!content.is_ok()) return std::nullopt;
    note.tile.content = content.value();
    return note;
  } catch (const json::exception&) {
    return std::nullopt;  // made anew
  }
}

}  // namespace

nlohmann::ordered_json as_json(const TileNote& note) {
  return {{"nearmesh_tile", 1},       {"content", to_hex(note.tile.content)},
          {"place", note.tile.place}, {"extent", note.tile.extent},
          {"faces", note.tile.faces}, {"bytes", note.bytes},
          {"seconds", note.seconds}};
}

std::optional<TileNote> TileNotes::read(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return std::nullopt;
  const std::optional<TileNote> note = parse(in);
  if (!note || note->tile.faces == 0 || whole_.contains(note->tile.content)) return note;
  const std::string tile = WorldFolder::tile_path(world_, note->tile.content);
  std::error_code error;
  if (!fs::exists(tile, error)) return std::nullopt;
  if (is_whole(*note)) {
    whole_.insert(note->tile.content);
    return note;
  }
  std::fprintf(stderr, "%s: is damaged, and baked anew\n", tile.c_str());
  return std::nullopt;
}

/// All of its bytes are those that its content's name stands for.
bool TileNotes::is_whole(const TileNote& note) {
  const std::string tile = WorldFolder::tile_path(world_, note.tile.content);
  std::error_code error;
  if (fs::file_size(tile, error) != note.bytes || error) return false;
  const Result<ModelFile> file = open_sharing(tile, &tables_);
  return file.is_ok() && file.value().content_hash() == note.tile.content &&
         file.value().header().face_count == note.tile.faces && file.value().verify().is_ok();
}

Status TileNotes::write(const std::string& path, const TileNote& note) {
  whole_.insert(note.tile.content);
  return write_file(path, kTileNote, as_json(note).dump());
}

}  // namespace nearmesh::program
