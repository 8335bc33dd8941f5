// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/base/digest.hpp"
#include "core/base/output_file.hpp"
#include "core/base/resources.hpp"
#include "core/base/stopwatch.hpp"
#include "core/command/json_text.hpp"
#include "core/spm/check_boxes.hpp"
#include "core/spm/check_surface.hpp"
#include "core/spm/encode_model_file.hpp"
#include "core/spm/file_layout.hpp"
#include "core/world/world_folder.hpp"
#include "import_options.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/base/parse_content_hash.hpp"
#include "tile_notes.hpp"
#include "tile_source.hpp"
#include "world_plan.hpp"

namespace nearmesh::program {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

Status make_folders(const std::string& world) {
  for (const char* name : {"tiles", "baked"}) {
    std::error_code error;
    fs::create_directories(fs::path(world) / name, error);
    if (error) return {StatusCode::kIo, world + ": cannot create: " + error.message()};
  }
  return Status::ok();
}

/// What a tile's content follows from: all of it, as else the world's name would follow from which
/// tile was baked first.
std::string digest_of_bake(const GridMesh& mesh, double rounding_error_m,
                           const BuildOptions& options) {
  // Another one where bake makes other files of the same mesh.
  constexpr std::uint64_t kBakeVersion = 2;
  std::vector<std::uint8_t> bytes;
  const auto add = [&bytes](const void* data, std::size_t size) {
    const auto* from = static_cast<const std::uint8_t*>(data);
    bytes.insert(bytes.end(), from, from + size);
  };
  const std::array<std::int64_t, 6> numbers{kBakeVersion,
                                            mesh.grid.exponent,
                                            mesh.grid.bits,
                                            options.base_faces,
                                            static_cast<std::int64_t>(mesh.positions.size()),
                                            std::bit_cast<std::int64_t>(rounding_error_m)};
  add(numbers.data(), sizeof numbers);
  add(mesh.positions.data(), mesh.positions.size() * sizeof(GridPoint));
  add(mesh.faces.data(), mesh.faces.size() * sizeof mesh.faces[0]);
  add(mesh.face_ids.data(), mesh.face_ids.size() * sizeof mesh.face_ids[0]);
  return to_hex(digest_of(bytes));
}

/// Bakes a mesh that begins at zero, and puts it under its content's name.
Result<TileNote> bake_tile(const GridMesh& mesh, double rounding_error_m, const MeshOrigin& origin,
                           const BuildOptions& options) {
  const Stopwatch watch;
  const Result<BakedModel> baked =
      bake(mesh, rounding_error_m, {.base_faces = options.base_faces, .threads = options.threads},
           TableChoice::kBuiltIn);
  NEARMESH_RETURN_IF_ERROR(baked);
  const BakedModel& model = baked.value();
  NEARMESH_RETURN_IF_ERROR(check_boxes(model.store));
  NEARMESH_RETURN_IF_ERROR(check_surface(model.store));
  const EncodedModel encoded =
      encode_model_file(model.header, model.store, model.numbers, options.threads, origin);
  const WrittenModel& written = encoded.written;
  NEARMESH_RETURN_IF_ERROR(write_file(WorldFolder::tile_path(options.out, written.content_hash),
                                      file_layout::kModelFile, encoded.bytes));
  TileNote note{.bytes = written.file_bytes, .seconds = watch.seconds()};
  note.tile.content = written.content_hash;
  note.tile.faces = model.header.face_count;
  return note;
}

struct Made {
  TileNote note;
  bool is_new = false;
};

Result<Made> make_tile(const TileJob& job, const WorldPlan& plan, const BuildOptions& options,
                       TileSource& source, TileNotes& notes) {
  Result<ImportedMesh> mesh = source.read(job);
  NEARMESH_RETURN_IF_ERROR(mesh);
  if (mesh.value().mesh.faces.empty()) return Made{};
  Result<CleanResult> clean =
      clean_mesh(mesh.value().mesh, {.grid_bits = options.grid_bits, .lattice = plan.lattice});
  NEARMESH_RETURN_IF_ERROR(clean);
  mesh.value().mesh = {};
  GridMesh& tile = clean.value().mesh;
  const std::array<std::int64_t, 3> place = tile.grid.lattice_cells;
  tile.grid = {.exponent = plan.lattice.exponent, .bits = options.grid_bits};
  std::array<std::int64_t, 3> extent{};
  for (const GridPoint& p : tile.positions)
    for (std::size_t k = 0; k < 3; ++k) extent[k] = std::max<std::int64_t>(extent[k], p.v[k]);

  // The same tile may stand elsewhere, or have been there before.
  const double rounding_error_m = clean.value().report.rounding_error_m;
  const std::string digest = digest_of_bake(tile, rounding_error_m, options);
  const std::string known = (fs::path(options.out) / "baked" / (digest + ".json")).string();
  Made made;
  if (const std::optional<TileNote> note = notes.read(known)) {
    made.note = *note;
  } else {
    const Result<TileNote> baked = bake_tile(tile, rounding_error_m, mesh.value().origin, options);
    NEARMESH_RETURN_IF_ERROR(baked);
    made = {baked.value(), true};
    NEARMESH_RETURN_IF_ERROR(notes.write(known, made.note));
  }
  made.note.tile.place = place;
  made.note.tile.extent = extent;
  return made;
}

std::string note_path(const WorldPlan& plan, std::size_t tile) {
  return (fs::path(plan.folder) / (std::to_string(tile) + ".json")).string();
}

// ---- plans for others to run ------------------------------------------------------------------

std::string quoted(const std::string& word) {
  constexpr const char* kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789/._-+=:,@%";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

std::string exact_number(double x) { return json(x).dump(); }

/// The command that makes the same plan.
std::string command_of(const BuildWorldOptions& options) {
  const BuildOptions& build = options.build;
  std::error_code error;
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  std::string out = quoted(error ? "nearmesh-model" : self.string()) + " build-world";
  const auto absolute = [](const std::string& path) {
    return quoted(fs::absolute(path).lexically_normal().string());
  };
  for (const std::string& in : options.in) out += " " + absolute(in);
  out += " -o " + absolute(build.out) + " --faces " + std::to_string(options.tile_faces) +
         " --grid-bits " + std::to_string(build.grid_bits) + " --base-faces " +
         std::to_string(build.base_faces);
  if (build.cell_m > 0) out += " --cell " + exact_number(build.cell_m);
  if (options.has_lattice_origin)
    out += " --lattice-origin=" + exact_number(build.lattice_origin_m[0]) + "," +
           exact_number(build.lattice_origin_m[1]) + "," + exact_number(build.lattice_origin_m[2]);
  if (build.scale != 1) out += " --scale " + exact_number(build.scale);
  if (!options.repeat.empty()) out += " --repeat " + quoted(options.repeat);
  for (const auto& [flag, value] : {std::pair("--unit", &build.unit),
                                    {"--up", &build.up},
                                    {"--crs", &build.crs},
                                    {"--spacing", &build.spacing},
                                    {"--corner", &build.corner},
                                    {"--nodata", &build.nodata},
                                    {"--fill", &build.fill},
                                    {"--heights", &build.heights},
                                    {"--raw", &build.raw}})
    if (!value->empty()) out += std::string(" ") + flag + "=" + quoted(*value);
  return out;
}

/// As ninja wants names of files: with $ before blanks, colons and $. It has nothing for a bar but
/// a variable that holds one.
std::string for_ninja(const std::string& path) {
  std::string out;
  for (const char c : fs::absolute(path).lexically_normal().string())
    out += c == '|'                           ? std::string("${bar}")
           : c == ' ' || c == ':' || c == '$' ? std::string("$") + c
                                              : std::string(1, c);
  return out;
}
std::string command_for_ninja(const std::string& command) {
  std::string out;
  for (const char c : command) out += c == '$' ? std::string("$$") : std::string(1, c);
  return out;
}

Status write_plan(const BuildWorldOptions& options, const WorldPlan& plan) {
  const std::string command = command_of(options);
  if (command.find('\n') != std::string::npos)
    return {StatusCode::kInvalidArgument,
            "--plan: expected names without line breaks, as a line of a plan is a command"};
  const std::string threads =
      " --threads " + std::to_string(options.build.threads == 0 ? 1 : options.build.threads);
  std::string text;
  if (!options.plan.ends_with(".ninja")) {
    for (std::size_t t = 0; t < plan.tiles.size(); ++t)
      text += command + threads + " --only " + std::to_string(t) + "\n";
    text += command + threads + "\n";
    // Nothing but commands, since array jobs go by the number of the line.
    const std::string_view begins = std::string_view(text).substr(
        0, text.find("build-world") + std::string_view("build-world").size());
    return write_file(options.plan, {"commands of nearmesh-model build-world", begins}, text,
                      options.in);
  }
  constexpr FileKind kNinja{"a ninja file of nearmesh-model",
                            "# Written by nearmesh-model build-world"};
  text = std::string(kNinja.begins) +
         "\nbar = |\nrule tile\n  command = " + command_for_ninja(command + threads) +
         " --only $tile\n  description = tile $tile of " + std::to_string(plan.tiles.size()) +
         "\nrule pages\n  command = " + command_for_ninja(command + threads) +
         "\n  description = pages\n";
  std::string notes;
  for (std::size_t t = 0; t < plan.tiles.size(); ++t) {
    const std::string note = for_ninja(note_path(plan, t));
    text += "build " + note + ": tile " + for_ninja(options.in[plan.tiles[t].input]) +
            "\n  tile = " + std::to_string(t) + "\n";
    notes += " " + note;
  }
  text +=
      "build " + for_ninja(WorldFolder::record_path(options.build.out)) + ": pages" + notes + "\n";
  return write_file(options.plan, kNinja, text, options.in);
}

// ---- repeated tiles ---------------------------------------------------------------------------

/// Columns and rows. Errors: kInvalidArgument.
Result<std::array<std::uint32_t, 2>> parse_repeat(const std::string& text) {
  constexpr std::uint64_t kMost = 100'000'000;
  std::array<std::uint32_t, 2> out{1, 1};
  if (text.empty()) return out;
  const char *from = text.data(), *const end = from + text.size();
  const auto columns = std::from_chars(from, end, out[0]);
  if (columns.ec == std::errc() && columns.ptr != end && *columns.ptr == 'x') {
    const auto rows = std::from_chars(columns.ptr + 1, end, out[1]);
    if (rows.ec == std::errc() && rows.ptr == end && out[0] > 0 && out[1] > 0 &&
        std::uint64_t{out[0]} * out[1] <= kMost)
      return out;
  }
  return Status(StatusCode::kInvalidArgument,
                "--repeat: expected COLUMNSxROWS, as 10x10, found \"" + text + "\"");
}

/// All tiles, so often along x and y, each time moved by the size of all of them: then borders that
/// match meet.
void repeat_tiles(const std::array<std::uint32_t, 2>& times, std::vector<PlacedTile>& tiles) {
  std::array<std::int64_t, 2> step{};
  for (std::size_t k = 0; k < 2 && !tiles.empty(); ++k) {
    std::int64_t lo = tiles.front().place[k], hi = lo;
    for (const PlacedTile& tile : tiles) {
      lo = std::min(lo, tile.place[k]);
      hi = std::max(hi, tile.place[k] + tile.extent[k]);
    }
    step[k] = hi - lo;
  }
  const std::size_t count = tiles.size();
  for (std::uint32_t row = 0; row < times[1]; ++row)
    for (std::uint32_t column = 0; column < times[0]; ++column)
      for (std::size_t i = 0; i < count && (row > 0 || column > 0); ++i) {
        PlacedTile tile = tiles[i];
        tile.place[0] += column * step[0];
        tile.place[1] += row * step[1];
        tiles.push_back(tile);
      }
}

// ---- the command ------------------------------------------------------------------------------

struct Sum {
  std::uint64_t baked = 0, kept = 0, empty = 0, tile_bytes = 0;
  double bake_seconds = 0;
  std::vector<PlacedTile> tiles;

  void add(const Made& made) {
    if (made.note.tile.faces == 0) {
      ++empty;
      return;
    }
    ++(made.is_new ? baked : kept);
    if (made.is_new) bake_seconds += made.note.seconds;
    tile_bytes += made.note.bytes;
    tiles.push_back(made.note.tile);
  }
};

void report(const BuildWorldOptions& options, const WorldPlan& plan, const Sum& sum,
            const WorldPages& pages, const std::vector<Doubt>& doubts, double seconds) {
  std::uint64_t page_bytes = 0;
  for (const auto& page : pages.pages) page_bytes += page.second.size();
  std::vector<ContentHash> contents;
  for (const PlacedTile& tile : sum.tiles) contents.push_back(tile.content);
  std::ranges::sort(contents);
  contents.erase(std::unique(contents.begin(), contents.end()), contents.end());
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  if (options.build.json) {
    nlohmann::ordered_json warnings = nlohmann::ordered_json::array();
    for (const Doubt& doubt : doubts)
      warnings.push_back({{"input", doubt.input}, {"text", doubt.text}});
    const nlohmann::ordered_json out = {{"output", options.build.out},
                                        {"world", to_hex(pages.name)},
                                        {"tiles", pages.world.tiles},
                                        {"distinct_tiles", contents.size()},
                                        {"faces", pages.world.faces},
                                        {"baked", sum.baked},
                                        {"kept", sum.kept},
                                        {"without_faces", sum.empty},
                                        {"pages", pages.pages.size()},
                                        {"page_bytes", page_bytes},
                                        {"cell_m", std::ldexp(1.0, plan.lattice.exponent)},
                                        {"grid_bits", options.build.grid_bits},
                                        {"origin_m", plan.lattice.origin_m},
                                        {"bake_seconds", sum.bake_seconds},
                                        {"seconds", seconds},
                                        {"peak_memory_bytes", peak_memory_bytes()},
                                        {"warnings", warnings}};
    std::printf("%s\n", text_of(out).c_str());
    return;
  }
  std::printf("%s\n  world: %s\n", options.build.out.c_str(), to_hex(pages.name).c_str());
  std::printf(
      "  tiles         %llu of %llu faces in all; %llu baked, %llu were there, %llu without "
      "faces\n",
      count(pages.world.tiles), count(pages.world.faces), count(sum.baked), count(sum.kept),
      count(sum.empty));
  std::printf("  pages         %zu, %llu bytes\n", pages.pages.size(), count(page_bytes));
  std::printf("  lattice       cell %.9g m, tiles of %d bits, from %.9g, %.9g, %.9g m\n",
              std::ldexp(1.0, plan.lattice.exponent), options.build.grid_bits,
              plan.lattice.origin_m[0], plan.lattice.origin_m[1], plan.lattice.origin_m[2]);
  std::printf("  took          %.2f s, peak memory %.0f MB\n", seconds,
              static_cast<double>(peak_memory_bytes()) / 1e6);
}

void warn(const std::vector<Doubt>& doubts) {
  for (const Doubt& doubt : doubts)
    std::fprintf(stderr, "%s: warning: %s\n", doubt.input.c_str(), doubt.text.c_str());
}

}  // namespace

Status run(const BuildWorldOptions& options) {
  keep_large_heap();
  const Stopwatch watch;
  const std::string& world = options.build.out;
  const auto repeat = parse_repeat(options.repeat);
  NEARMESH_RETURN_IF_ERROR(repeat);
  const Result<WorldPlan> planned = plan_world(options);
  NEARMESH_RETURN_IF_ERROR(planned);
  const WorldPlan& plan = planned.value();
  NEARMESH_RETURN_IF_ERROR(make_folders(world));
  if (!options.plan.empty()) {
    NEARMESH_RETURN_IF_ERROR(write_plan(options, plan));
    if (!options.build.json)
      std::printf("%s: %zu tiles\n", options.plan.c_str(), plan.tiles.size());
    return Status::ok();
  }
  if (options.only && *options.only >= plan.tiles.size())
    return {StatusCode::kInvalidArgument, "--only: expected a tile below " +
                                              std::to_string(plan.tiles.size()) + ", found " +
                                              std::to_string(*options.only)};
  TileSource source(options, plan);
  TileNotes notes(world);
  Sum sum;
  for (std::size_t t = options.only.value_or(0); t < plan.tiles.size(); ++t) {
    Made made;
    if (const auto note = notes.read(note_path(plan, t))) {
      made.note = *note;
    } else {
      const Stopwatch tile_watch;
      Result<Made> result = make_tile(plan.tiles[t], plan, options.build, source, notes);
      const std::string name = describe(plan.tiles[t], options);
      if (!result.is_ok()) {
        const Status& status = result.status();
        return {status.code(),
                "tile " + std::to_string(t) + " (" + name + "): " + status.message()};
      }
      // Pages list no tiles of two states of a file: what is noted is of this plan's.
      NEARMESH_RETURN_IF_ERROR(check_input(options, plan, plan.tiles[t].input));
      made = result.value();
      NEARMESH_RETURN_IF_ERROR(notes.write(note_path(plan, t), made.note));
      std::fprintf(stderr, "tile %zu of %zu: %s: %s %llu faces, %.2f s\n", t + 1, plan.tiles.size(),
                   name.c_str(), made.is_new ? "baked" : "was there,",
                   static_cast<unsigned long long>(made.note.tile.faces), tile_watch.seconds());
    }
    sum.add(made);
    if (options.only) {
      warn(source.doubts());
      if (options.build.json) std::printf("%s\n", text_of(as_json(made.note)).c_str());
      return Status::ok();
    }
  }
  repeat_tiles(repeat.value(), sum.tiles);
  const Result<WorldPages> pages = make_pages(plan.lattice, options.build.grid_bits, sum.tiles);
  NEARMESH_RETURN_IF_ERROR(pages);
  NEARMESH_RETURN_IF_ERROR(write_world(pages.value(), world));
  const std::vector<Doubt> doubts = source.doubts();
  report(options, plan, sum, pages.value(), doubts, watch.seconds());
  warn(doubts);
  return Status::ok();
}

}  // namespace nearmesh::program
