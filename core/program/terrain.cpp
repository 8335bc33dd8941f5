// SPDX-License-Identifier: Apache-2.0
#include "terrain.hpp"

#include <charconv>
#include <cmath>
#include <cstdio>

namespace nearmesh::program {
namespace {

Status wrong(const char* option, const char* expected, const std::string& found) {
  return {StatusCode::kInvalidArgument,
          std::string(option) + ": expected " + expected + ", found \"" + found + "\""};
}

/// The whole text as a number.
template <class T>
std::optional<T> parse(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

std::optional<std::array<double, 2>> parse_two(std::string_view text) {
  const std::size_t comma = text.find(',');
  if (comma == std::string_view::npos) return std::nullopt;
  const auto a = parse<double>(text.substr(0, comma)), b = parse<double>(text.substr(comma + 1));
  if (!a || !b || !std::isfinite(*a) || !std::isfinite(*b)) return std::nullopt;
  return {{*a, *b}};
}

Status set_two(const char* option, const std::string& text, const char* expected,
               std::optional<std::array<double, 2>>& out) {
  if (text.empty()) return Status::ok();
  out = parse_two(text);
  return out ? Status::ok() : wrong(option, expected, text);
}

Status set_one(const char* option, const std::string& text, const char* expected,
               std::optional<double>& out) {
  if (text.empty()) return Status::ok();
  out = parse<double>(text);
  return out ? Status::ok() : wrong(option, expected, text);
}

Status set_frame(const std::string& text, TerrainOptions& out) {
  constexpr std::string_view kEnu = "enu:";
  if (text.empty()) return Status::ok();
  if (text == "file") {
    out.frame = TerrainFrame::kFile;
  } else if (text == "ecef") {
    out.frame = TerrainFrame::kEcef;
  } else {
    const auto origin = text.starts_with(kEnu)
                            ? parse_two(std::string_view(text).substr(kEnu.size()))
                            : std::nullopt;
    if (!origin) return wrong("--crs", "file, ecef or enu:LAT,LON in degrees", text);
    out.frame = TerrainFrame::kEnu;
    out.enu_origin_deg = *origin;
  }
  return Status::ok();
}

std::optional<RawGrid> parse_raw(std::string_view text) {
  const std::size_t x = text.find('x'), comma = text.find(',');
  if (comma == std::string_view::npos || x >= comma || comma + 2 >= text.size())
    return std::nullopt;
  const auto columns = parse<std::uint32_t>(text.substr(0, x)),
             rows = parse<std::uint32_t>(text.substr(x + 1, comma - x - 1));
  std::string_view type = text.substr(comma + 1);
  RawGrid raw{.columns = columns.value_or(0), .rows = rows.value_or(0)};
  const char kind = type.front();
  raw.kind = kind == 'u'   ? RawGrid::Kind::kUnsigned
             : kind == 'i' ? RawGrid::Kind::kSigned
                           : RawGrid::Kind::kFloat;
  type.remove_prefix(1);
  raw.is_big_endian = type.ends_with("be");
  const bool has_order = raw.is_big_endian || type.ends_with("le");
  if (has_order) type.remove_suffix(2);
  const int bits = parse<int>(type).value_or(0);
  raw.sample_bytes = static_cast<std::uint8_t>(bits / 8);
  const bool is_number = kind == 'u' || kind == 'i' || kind == 'f';
  const bool is_size =
      kind == 'f' ? bits == 32 || bits == 64 : bits == 8 || bits == 16 || bits == 32 || bits == 64;
  if (!columns || !rows || !is_number || !is_size || has_order != (bits > 8)) return std::nullopt;
  return raw;
}

std::string frame_text(const ImportedTerrain& terrain) {
  const std::string file = terrain.stated_crs.empty() ? "" : "; in the file " + terrain.stated_crs;
  if (terrain.frame == TerrainFrame::kFile) return "the file's own coordinates" + file;
  char text[96] = "geocentric";
  if (terrain.frame == TerrainFrame::kEnu)
    std::snprintf(text, sizeof text, "east, north, up of the plane that touches at %.9g, %.9g",
                  terrain.enu_origin_deg[0], terrain.enu_origin_deg[1]);
  return text + (", WGS 84; heights taken as above its ellipsoid" + file);
}

}  // namespace

Result<std::optional<TerrainOptions>> terrain_options(const BuildOptions& options) {
  bool is_given = false;
  for (const std::string* text : {&options.crs, &options.spacing, &options.corner, &options.nodata,
                                  &options.fill, &options.heights, &options.raw})
    is_given = is_given || !text->empty();
  if (!is_given) return std::optional<TerrainOptions>();
  TerrainOptions out;
  NEARMESH_RETURN_IF_ERROR(set_frame(options.crs, out));
  NEARMESH_RETURN_IF_ERROR(set_two("--spacing", options.spacing, "EAST,NORTH", out.spacing));
  NEARMESH_RETURN_IF_ERROR(set_two("--corner", options.corner, "X,Y", out.corner));
  NEARMESH_RETURN_IF_ERROR(set_two("--heights", options.heights, "OFFSET,STEP", out.heights));
  NEARMESH_RETURN_IF_ERROR(set_one("--nodata", options.nodata, "a number or nan", out.nodata));
  NEARMESH_RETURN_IF_ERROR(
      set_one("--fill", options.fill, "a height in the unit of the file's heights", out.fill));
  if (!options.raw.empty()) {
    out.raw = parse_raw(options.raw);
    if (!out.raw)
      return wrong(
          "--raw",
          "COLUMNSxROWS,TYPE with a type of u8, i8, or u, i, f, then 16 (not f), 32 or 64, "
          "then le or be",
          options.raw);
  }
  return std::optional(out);
}

nlohmann::ordered_json terrain_json(const ImportedTerrain& terrain) {
  constexpr const char* kFrames[] = {"", "file", "enu", "ecef"};
  nlohmann::ordered_json out = {{"columns", terrain.columns},
                                {"rows", terrain.rows},
                                {"posts_without_data", terrain.posts_without_data},
                                {"fill", nullptr},
                                {"crs", kFrames[static_cast<int>(terrain.frame)]},
                                {"crs_of_file", terrain.stated_crs}};
  if (terrain.fill) out["fill"] = *terrain.fill;
  if (terrain.frame == TerrainFrame::kEnu) out["enu_origin_deg"] = terrain.enu_origin_deg;
  return out;
}

void print_terrain(const ImportedTerrain& terrain) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf("  terrain       %llu x %llu posts, %llu without data", count(terrain.columns),
              count(terrain.rows), count(terrain.posts_without_data));
  if (terrain.posts_without_data > 0 && terrain.fill)
    std::printf(": filled with a height of %.9g, in the unit of the file's heights", *terrain.fill);
  if (terrain.posts_without_data > 0 && !terrain.fill) std::printf(": holes");
  std::printf("\n  frame         %s\n", frame_text(terrain).c_str());
}

std::vector<std::string> terrain_doubts(const ImportedTerrain& terrain, const MeshOrigin& origin) {
  std::vector<std::string> found;
  char text[160];
  if (terrain.unmatched_nodata) {
    std::snprintf(text, sizeof text, "--nodata: no post has the sample %.9g: is it right?",
                  *terrain.unmatched_nodata);
    found.emplace_back(text);
  }
  if (terrain.height_unit_is_assumed) {
    std::snprintf(
        text, sizeof text,
        "the file states no unit of its heights: taken as that of its coordinates, %.9g m; "
        "--heights 0,STEP says otherwise",
        origin.unit_m);
    found.emplace_back(text);
  }
  return found;
}

}  // namespace nearmesh::program
