// SPDX-License-Identifier: Apache-2.0
#include "grid_formats.hpp"

#include <bit>
#include <cmath>

#include "text.hpp"

namespace nearmesh::meshio {
namespace {

using Kind = RawGrid::Kind;

std::string_view file_name(std::string_view path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string_view::npos ? path : path.substr(slash + 1);
}

bool ends(std::string_view path, std::string_view ending) {
  return path.size() > ending.size() && path[path.size() - ending.size() - 1] == '.' &&
         equal_ignoring_case(path.substr(path.size() - ending.size()), ending);
}

/// Samples without anything between them, as many as the grid has.
Result<SampleLayout> lay_out(const std::string& format, std::uint64_t bytes, std::uint64_t offset,
                             const RawGrid& type) {
  const std::uint64_t found = bytes - offset;
  if (type.columns < 2 || type.rows < 2 ||
      std::uint64_t{type.columns} * type.rows > found / type.sample_bytes)
    return check_grid_size(format, type.columns, type.rows, found, 1.0 / type.sample_bytes);
  SampleLayout layout{
      .grid = {.columns = type.columns,
               .rows = type.rows,
               .has_float_samples = type.kind == Kind::kFloat && type.sample_bytes == 4},
      .type = type,
      .offset = offset,
      .format = format};
  const std::uint64_t posts = layout.grid.columns * layout.grid.rows,
                      expected = posts * type.sample_bytes;
  if (found != expected)
    return corrupt(format + ": " + std::to_string(type.columns) + " x " +
                   std::to_string(type.rows) + " posts of " + std::to_string(type.sample_bytes) +
                   " bytes make " + std::to_string(expected) + " bytes, found " +
                   std::to_string(found));
  return layout;
}

Result<SampleLayout> lay_out_raw(std::uint64_t bytes, const RawGrid& type) {
  const int size = type.sample_bytes;
  const bool is_known =
      size == 4 || size == 8 || (type.kind != Kind::kFloat && (size == 1 || size == 2));
  if (!is_known || type.kind > Kind::kFloat)
    return Status(StatusCode::kInvalidArgument,
                  "raw samples: expected whole numbers of 1, 2, 4 or 8 bytes, or floats of 4 or 8, "
                  "found " +
                      std::to_string(size) + " bytes");
  return lay_out("raw samples", bytes, 0, type);
}

// --- HGT ---

std::optional<int> digits(std::string_view text) {
  int value = 0;
  for (const char c : text) {
    if (c < '0' || c > '9') return std::nullopt;
    value = 10 * value + (c - '0');
  }
  return value;
}

/// Longitude and latitude of the south-western post, by a word of the name: N47E011.SRTMGL1.hgt.
std::optional<std::array<double, 2>> find_tile(std::string_view path) {
  const std::string_view name = file_name(path);
  const auto is_in_word = [name](std::size_t at) {
    const char c = at < name.size() ? to_lower(name[at]) : '.';
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
  };
  for (std::size_t at = 0; at + 7 <= name.size(); ++at) {
    if ((at > 0 && is_in_word(at - 1)) || is_in_word(at + 7)) continue;
    const std::string_view tile = name.substr(at, 7);
    const char ns = to_lower(tile[0]), ew = to_lower(tile[3]);
    const auto latitude = digits(tile.substr(1, 2)), longitude = digits(tile.substr(4));
    if ((ns != 'n' && ns != 's') || (ew != 'e' && ew != 'w') || !latitude || !longitude) continue;
    const double east = *longitude, north = *latitude;
    return {{ew == 'e' ? east : -east, ns == 'n' ? north : -north}};
  }
  return std::nullopt;
}

Result<SampleLayout> lay_out_hgt(const std::string& path, std::uint64_t bytes,
                                 const TerrainOptions& options) {
  const auto side =
      static_cast<std::uint32_t>(std::lround(std::sqrt(static_cast<double>(bytes) / 2)));
  if (std::uint64_t{2} * side * side != bytes)
    return corrupt(
        "HGT: expected a square of samples of two bytes, such as 1201 x 1201 (2884802 "
        "bytes) or 3601 x 3601 (25934402 bytes), found " +
        std::to_string(bytes) + " bytes");
  auto layout =
      lay_out("HGT", bytes, 0,
              {.columns = side, .rows = side, .kind = Kind::kSigned, .is_big_endian = true});
  NEARMESH_RETURN_IF_ERROR(layout);
  const auto corner = options.corner ? options.corner : find_tile(path);
  if (!corner)
    return Status(StatusCode::kInvalidArgument,
                  "HGT: expected a name that says which tile it is, as N47E011.hgt, or --corner "
                  "LONGITUDE,LATITUDE of its south-western post");
  HeightGrid& out = layout.value().grid;
  const double step = 1.0 / (side - 1);
  out.x = make_axis((*corner)[0], step, side);
  out.y = make_axis((*corner)[1] + 1, -step, side);
  out.states_place = out.takes_corner = true;
  out.unit = GridUnit::kDegrees;
  out.nodata = -32768;
  out.crs = "WGS 84, heights above the EGM96 geoid";
  return layout;
}

// --- ESRI ASCII grid ---

struct AscHeader {
  std::optional<std::int64_t> columns, rows;
  std::optional<double> x, y, dx, dy, nodata;
  bool x_is_centre = false, y_is_centre = false;
};

bool is_number(std::string_view word) {
  return !word.empty() &&
         (word[0] == '-' || word[0] == '+' || word[0] == '.' || (word[0] >= '0' && word[0] <= '9'));
}

/// A number, of which NaN is one.
Status parse_sample(std::string_view word, const std::string& place, double& value) {
  if (equal_ignoring_case(word, "nan")) {
    value = std::numeric_limits<double>::quiet_NaN();
    return Status::ok();
  }
  return parse_coordinate(word, place, value);
}

/// Takes the lines of the header off the front.
Result<AscHeader> take_asc_header(std::string_view& text) {
  AscHeader header;
  for (int line = 1;; ++line) {
    std::string_view rest = text;
    const std::string_view key = take_word(rest);
    if (key.empty() || is_number(key) || equal_ignoring_case(key, "nan")) return header;
    const std::string_view word = take_word(rest);
    const std::string place = "ASC line " + std::to_string(line);
    const auto is = [key](std::string_view name) { return equal_ignoring_case(key, name); };
    if (is("ncols") || is("nrows")) {
      const auto count = parse_integer(word);
      if (!count || *count < 0) return corrupt(place + ": expected a count, found " + quote(word));
      (is("ncols") ? header.columns : header.rows) = count;
    } else {
      double value = 0;
      NEARMESH_RETURN_IF_ERROR(parse_sample(word, place, value));
      if (is("cellsize")) {
        header.dx = header.dy = value;
      } else if (is("xllcorner") || is("xllcenter")) {
        header.x = value;
        header.x_is_centre = is("xllcenter");
      } else if (is("yllcorner") || is("yllcenter")) {
        header.y = value;
        header.y_is_centre = is("yllcenter");
      } else if (is("dx") || is("dy")) {
        (is("dx") ? header.dx : header.dy) = value;
      } else if (is("nodata_value")) {
        header.nodata = value;
      } else {
        return corrupt(place +
                       ": expected ncols, nrows, xllcorner or xllcenter, yllcorner or yllcenter, "
                       "cellsize, NODATA_value or a height, found " +
                       quote(key));
      }
    }
    text = rest;
  }
}

Status check_asc_header(const AscHeader& header) {
  const auto missing = [](const char* key) {
    return corrupt(std::string("ASC: expected a line of ") + key + ", found none");
  };
  if (!header.columns) return missing("ncols");
  if (!header.rows) return missing("nrows");
  if (!header.x) return missing("xllcorner or xllcenter");
  if (!header.y) return missing("yllcorner or yllcenter");
  if (!header.dx || !header.dy) return missing("cellsize");
  for (const double step : {*header.dx, *header.dy})
    if (!(step > 0))
      return corrupt("ASC: expected a cellsize above 0, found " + quote_number(step));
  for (const double place : {*header.x, *header.y})
    if (!std::isfinite(place)) return corrupt("ASC: expected a corner of finite coordinates");
  return Status::ok();
}

Result<HeightGrid> read_asc(std::string_view bytes) {
  std::string_view text = bytes;
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
  const auto read = take_asc_header(text);
  NEARMESH_RETURN_IF_ERROR(read);
  const AscHeader& header = read.value();
  NEARMESH_RETURN_IF_ERROR(check_asc_header(header));
  HeightGrid grid{.columns = static_cast<std::uint64_t>(*header.columns),
                  .rows = static_cast<std::uint64_t>(*header.rows)};
  // A sample takes a digit and what parts it from the next.
  NEARMESH_RETURN_IF_ERROR(check_grid_size("ASC", grid.columns, grid.rows, text.size() + 1, 0.5));
  const std::uint64_t posts = grid.columns * grid.rows;
  grid.samples.reserve(posts);
  for (std::uint64_t i = 0; i < posts; ++i) {
    const std::string_view word = take_word(text);
    double value = 0;
    if (word.empty() || !parse_sample(word, {}, value).is_ok())
      return corrupt("ASC: row " + std::to_string(i / grid.columns) + ", column " +
                     std::to_string(i % grid.columns) + ": expected a height, found " +
                     (word.empty() ? std::string("the end of the file") : quote(word)));
    grid.samples.push_back(value);
  }
  if (const std::string_view word = take_word(text); !word.empty())
    return corrupt("ASC: expected the end of the file behind " + std::to_string(posts) +
                   " heights, found " + quote(word));
  const double x = *header.x + (header.x_is_centre ? 0 : *header.dx / 2),
               y = *header.y + (header.y_is_centre ? 0 : *header.dy / 2);
  grid.x = make_axis(x, *header.dx, grid.columns);
  grid.y = make_axis(y + *header.dy * static_cast<double>(grid.rows - 1), -*header.dy, grid.rows);
  grid.states_place = true;
  grid.nodata = header.nodata.value_or(-9999);  // ESRI's default
  return grid;
}

// --- PGM ---

/// The next number of a header, in which a comment runs from # to the end of its line.
std::optional<std::int64_t> take_pgm_number(std::string_view& text) {
  while (!text.empty() && (is_blank(text.front()) || text.front() == '#')) {
    if (text.front() == '#') {
      take_line(text);
    } else {
      text.remove_prefix(1);
    }
  }
  std::size_t end = 0;
  while (end < text.size() && text[end] >= '0' && text[end] <= '9') ++end;
  const auto number = parse_integer(text.substr(0, end));
  text.remove_prefix(end);
  return number;
}

Result<SampleLayout> lay_out_pgm(std::string_view begins, std::uint64_t bytes) {
  if (!begins.starts_with("P5"))
    return Status(StatusCode::kUnsupported,
                  "PGM: expected a binary one, P5, found " + quote(begins.substr(0, 2)));
  std::string_view text = begins.substr(2);
  constexpr std::int64_t kMostSide = 0xffffffff;
  const auto columns = take_pgm_number(text), rows = take_pgm_number(text),
             greatest = take_pgm_number(text);
  if (!columns || !rows || *columns > kMostSide || *rows > kMostSide)
    return corrupt("PGM: expected a width and a height in its header");
  if (!greatest || *greatest < 1 || *greatest > 65535)
    return corrupt("PGM: expected a greatest sample from 1 to 65535 in its header");
  if (text.empty() || !is_blank(text.front()))
    return corrupt("PGM: expected a blank behind its header");
  text.remove_prefix(1);
  auto layout = lay_out("PGM", bytes, begins.size() - text.size(),
                        {.columns = static_cast<std::uint32_t>(*columns),
                         .rows = static_cast<std::uint32_t>(*rows),
                         .kind = Kind::kUnsigned,
                         .sample_bytes = static_cast<std::uint8_t>(*greatest > 255 ? 2 : 1),
                         .is_big_endian = true});
  NEARMESH_RETURN_IF_ERROR(layout);
  layout.value().greatest = static_cast<double>(*greatest);
  return layout;
}

}  // namespace

double decode_sample(std::string_view bytes, const RawGrid& type) {
  std::uint64_t bits = 0;
  for (std::size_t k = 0; k < type.sample_bytes; ++k) {
    const std::size_t at = type.is_big_endian ? k : type.sample_bytes - 1U - k;
    bits = bits << 8 | static_cast<unsigned char>(bytes[at]);
  }
  if (type.kind == Kind::kFloat)
    return type.sample_bytes == 4 ? std::bit_cast<float>(static_cast<std::uint32_t>(bits))
                                  : std::bit_cast<double>(bits);
  if (type.kind == Kind::kUnsigned) return static_cast<double>(bits);
  const int unused = 64 - 8 * type.sample_bytes;
  return static_cast<double>(static_cast<std::int64_t>(bits << unused) >> unused);
}

std::optional<GridFormat> find_grid_format(const std::string& path, std::string_view bytes,
                                           const TerrainOptions& options) {
  if (options.raw) return GridFormat::kRaw;
  if (ends(path, "hgt")) return GridFormat::kHgt;
  if (ends(path, "asc")) return GridFormat::kAsc;
  if (ends(path, "pgm")) return GridFormat::kPgm;
  if (ends(path, "png") || bytes.starts_with("\x89PNG\r\n")) return GridFormat::kPng;
  return std::nullopt;
}

bool has_layout(GridFormat format) {
  return format == GridFormat::kHgt || format == GridFormat::kPgm || format == GridFormat::kRaw;
}

Result<SampleLayout> find_layout(GridFormat format, const std::string& path,
                                 std::string_view begins, std::uint64_t file_bytes,
                                 const TerrainOptions& options) {
  if (format == GridFormat::kHgt) return lay_out_hgt(path, file_bytes, options);
  if (format == GridFormat::kPgm) return lay_out_pgm(begins, file_bytes);
  return lay_out_raw(file_bytes, options.raw.value_or(RawGrid{}));
}

Status decode_samples(const SampleLayout& layout, std::string_view bytes, std::uint64_t row,
                      std::uint64_t column, std::vector<double>& samples) {
  for (std::size_t at = 0; at < bytes.size(); at += layout.type.sample_bytes, ++column) {
    const double sample = decode_sample(bytes.substr(at), layout.type);
    if (layout.greatest > 0 && sample > layout.greatest)
      return corrupt(layout.format + ": row " + std::to_string(row + column / layout.grid.columns) +
                     ", column " + std::to_string(column % layout.grid.columns) +
                     ": expected at most " + quote_number(layout.greatest) + ", found " +
                     quote_number(sample));
    samples.push_back(sample);
  }
  return Status::ok();
}

Result<HeightGrid> read_grid(GridFormat format, const std::string& path, std::string_view bytes,
                             const TerrainOptions& options) {
  if (format == GridFormat::kAsc) return read_asc(bytes);
  if (format == GridFormat::kPng) return read_png(bytes);
  Result<SampleLayout> found = find_layout(format, path, bytes, bytes.size(), options);
  NEARMESH_RETURN_IF_ERROR(found);
  SampleLayout& layout = found.value();
  NEARMESH_RETURN_IF_ERROR(check_grid_size(layout.format, layout.grid.columns, layout.grid.rows,
                                           bytes.size(), 1.0 / layout.type.sample_bytes));
  std::vector<double> samples;
  samples.reserve(layout.grid.columns * layout.grid.rows);
  NEARMESH_RETURN_IF_ERROR(decode_samples(layout, bytes.substr(layout.offset), 0, 0, samples));
  layout.grid.samples = std::move(samples);
  return std::move(layout.grid);
}

}  // namespace nearmesh::meshio
