// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <span>

#include "commands.hpp"
#include "core/base/hash.hpp"
#include "core/base/output_file.hpp"
#include "core/base/resources.hpp"
#include "core/base/stopwatch.hpp"
#include "core/command/json_text.hpp"
#include "core/spm/check_boxes.hpp"
#include "core/spm/check_surface.hpp"
#include "core/spm/encode_model_file.hpp"
#include "core/spm/file_layout.hpp"
#include "import_options.hpp"
#include "measures.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "terrain.hpp"

namespace nearmesh::program {
namespace {

namespace fs = std::filesystem;

constexpr FileKind kSceneFile{"a scene snippet of nearmesh-model build",
                              "# Written by nearmesh-model build --per-node."};

// One line that is rewritten on a terminal, and a few plain lines elsewhere. Standard error only.
class Progress {
 public:
  void stage(const char* name) {
    name_ = name;
    shown_ = -1;
    show(0);
  }
  void show(double share) {
    const int percent = static_cast<int>(share * 100);
    const int step = terminal_ ? 1 : 50;
    if (percent < shown_ + step && shown_ >= 0) return;
    shown_ = percent;
    std::fprintf(stderr, terminal_ ? "\r%-12s %3d %%  " : "%s %d %%\n", name_, percent);
  }
  void end() const {
    if (terminal_) std::fprintf(stderr, "\r%24s\r", "");
  }

 private:
  const bool terminal_ = ::isatty(STDERR_FILENO) != 0;
  const char* name_ = "";
  int shown_ = -1;
};

struct Outcome {
  std::string in, out;
  Measures measures;
  std::optional<ImportedTerrain> terrain;
  CleanReport clean;
  double seconds = 0, simplify_seconds = 0;
  std::uint64_t base_vertices = 0, base_faces = 0, splits = 0;
  StopReason stop = StopReason::kNothingToDo;
  std::uint64_t clustered = 0;
  double cell_m = 0, rounding_bound_m = 0;
  int grid_bits = 0;
  WrittenModel written;
};

void print_json(const Outcome& o) {
  const CleanReport& c = o.clean;
  nlohmann::ordered_json report = {{"input", o.in},
                                   {"output", o.out},
                                   {"faces_in", c.faces_in},
                                   {"vertices_in", c.vertices_in},
                                   {"welded", c.vertices_welded},
                                   {"dropped_unreferenced", c.vertices_unreferenced},
                                   {"dropped_duplicate", c.faces_duplicate},
                                   {"dropped_degenerate", c.faces_degenerate_dropped},
                                   {"kept_degenerate", c.faces_degenerate_kept},
                                   {"non_manifold_edges", c.edges_non_manifold},
                                   {"components", c.components},
                                   {"boundary_edges", c.edges_boundary},
                                   {"disagreeing_edges", c.edges_disagreeing},
                                   {"grid_bits", o.grid_bits},
                                   {"cell_m", o.cell_m},
                                   {"rounding_error_m", o.rounding_bound_m},
                                   {"base_faces", o.base_faces},
                                   {"base_vertices", o.base_vertices},
                                   {"splits", o.splits},
                                   {"clustered", o.clustered},
                                   {"blocks", o.written.blocks},
                                   {"bytes", o.written.file_bytes},
                                   {"header_bytes", o.written.header_bytes},
                                   {"block_bytes", o.written.block_bytes},
                                   {"content_hash", to_hex(o.written.content_hash)},
                                   {"stop", to_string(o.stop)},
                                   {"seconds", o.seconds},
                                   {"peak_memory_bytes", peak_memory_bytes()}};
  add_json(o.measures, report);
  if (o.terrain) report["terrain"] = terrain_json(*o.terrain);
  std::printf("%s\n", text_of(report).c_str());
}

void print_text(const Outcome& o) {
  const CleanReport& c = o.clean;
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf("%s -> %s\n", o.in.c_str(), o.out.c_str());
  std::printf("  content: %s\n", to_hex(o.written.content_hash).c_str());  // as a scene has it
  std::printf("  in            %llu faces, %llu vertices\n", count(c.faces_in),
              count(c.vertices_in));
  if (o.terrain) print_terrain(*o.terrain);
  std::printf("  welded        %llu vertices\n", count(c.vertices_welded));
  std::printf(
      "  dropped       %llu unreferenced vertices, %llu duplicate faces, %llu degenerate faces\n",
      count(c.vertices_unreferenced), count(c.faces_duplicate), count(c.faces_degenerate_dropped));
  if (c.faces_degenerate_kept > 0)
    std::printf("  kept          %llu degenerate faces as segments or points\n",
                count(c.faces_degenerate_kept));
  std::printf(
      "  topology      %llu components, %llu boundary edges, %llu non-manifold edges, %llu whose "
      "faces disagree\n",
      count(c.components), count(c.edges_boundary), count(c.edges_non_manifold),
      count(c.edges_disagreeing));
  print_text(o.measures);
  std::printf("  grid          %d bits, cell %.3g m, rounding error %s m\n", o.grid_bits, o.cell_m,
              round_up(o.rounding_bound_m).c_str());
  std::printf(
      "  base          %llu faces, %llu vertices (%s%s)\n", count(o.base_faces),
      count(o.base_vertices), to_string(o.stop),
      o.clustered > 0 ? (", " + std::to_string(o.clustered) + " merged by nearness").c_str() : "");
  std::printf("  splits        %llu in %llu blocks, %.2f bytes a split\n", count(o.splits),
              count(o.written.blocks),
              o.splits > 0
                  ? static_cast<double>(o.written.block_bytes) / static_cast<double>(o.splits)
                  : 0.0);
  std::printf("  bytes         %llu in all: header %llu, blocks %llu\n",
              count(o.written.file_bytes), count(o.written.header_bytes),
              count(o.written.block_bytes));
  std::printf("  took          %.2f s (simplification %.2f s), peak memory %.0f MB\n", o.seconds,
              o.simplify_seconds, static_cast<double>(peak_memory_bytes()) / 1e6);
}

struct Built {
  Outcome outcome;
  OutputFile file;  // written, and not yet in its place
};

/// `mesh` is let go of as soon as it is cleaned: the bake needs the memory.
Result<Built> build(IndexedMesh mesh, const MeshOrigin& origin, UpAxis stated_up,
                    const std::optional<ImportedTerrain>& terrain, const std::string& out,
                    const BuildOptions& options, Progress& progress) {
  Stopwatch watch;
  Outcome outcome{.in = options.in, .out = out, .terrain = terrain};
  progress.stage("cleaning");
  Result<CleanResult> clean =
      clean_mesh(mesh, {.grid_bits = options.grid_bits,
                        .lattice = common_lattice(options.cell_m, options.lattice_origin_m)});
  if (!clean.is_ok())
    return Status{clean.status().code(), options.in + ": " + clean.status().message()};
  mesh = {};
  outcome.clean = clean.value().report;
  GridBox box;
  for (const GridPoint& position : clean.value().mesh.positions) box.add(position);
  outcome.measures = measure(clean.value().mesh.grid, box, origin);
  outcome.measures.stated_up = stated_up;
  outcome.measures.is_terrain = terrain.has_value();
  if (terrain) outcome.measures.terrain_doubts = terrain_doubts(*terrain, origin);
  progress.stage("simplifying");
  Stopwatch simplify_watch;
  Result<BakedModel> baked =
      bake(clean.value().mesh, outcome.clean.rounding_error_m,
           {.base_faces = options.base_faces,
            .threads = options.threads,
            .on_progress = [&progress](double share) { progress.show(share); }});
  NEARMESH_RETURN_IF_ERROR(baked);
  outcome.simplify_seconds = simplify_watch.seconds();
  progress.stage("writing");
  const BakedModel& model = baked.value();
  NEARMESH_RETURN_IF_ERROR(check_boxes(model.store));
  NEARMESH_RETURN_IF_ERROR(check_surface(model.store));
  const EncodedModel encoded =
      encode_model_file(model.header, model.store, model.numbers, options.threads, origin);
  Result<OutputFile> file =
      OutputFile::whole(out, file_layout::kModelFile, encoded.bytes, {options.in});
  NEARMESH_RETURN_IF_ERROR(file);
  progress.end();

  outcome.seconds = watch.seconds();
  outcome.base_vertices = model.header.roots.size();
  outcome.base_faces = model.header.base_faces.size();
  outcome.splits = model.header.split_count();
  outcome.stop = model.log.stop;
  outcome.clustered = model.log.clustered;
  outcome.cell_m = std::ldexp(1.0, model.header.grid.exponent);
  outcome.grid_bits = model.header.grid.bits;
  outcome.rounding_bound_m = model.header.rounding_bound_m();
  outcome.written = encoded.written;
  return Built{std::move(outcome), std::move(file).value()};
}

void report(const Outcome& outcome, const BuildOptions& options) {
  options.json ? print_json(outcome) : print_text(outcome);
  for (const std::string& doubt : doubts(outcome.measures))
    std::fprintf(stderr, "%s: warning: %s\n", outcome.out.c_str(), doubt.c_str());
}

double metres(const std::string& unit) {
  struct Unit {
    const char* name;
    double length_m;
  };
  constexpr Unit kUnits[] = {{"mm", 0.001},  {"cm", 0.01},   {"m", 1},
                             {"in", 0.0254}, {"ft", 0.3048}, {"km", 1000}};
  for (const Unit& known : kUnits)
    if (unit == known.name) return known.length_m;
  return 0;  // which import refuses
}

void warn_of_reader(const std::string& path, bool is_as_written) {
  if (is_as_written) return;
  std::fprintf(stderr, "%s: warning: %s\n", path.c_str(), kReaderDoubt);
}

/// Folders that are made to be written into. Those that nothing was put into go again.
class NewFolders {
 public:
  NewFolders() = default;
  NewFolders(const NewFolders&) = delete;
  NewFolders& operator=(const NewFolders&) = delete;
  ~NewFolders() {
    for (const fs::path& folder : made_) ::rmdir(folder.c_str());  // takes none that holds anything
  }
  /// And those above it. Errors: kIo, naming the folder.
  Status make(const std::string& folder) {
    std::error_code error;
    for (fs::path at = folder; !at.empty() && !fs::exists(fs::symlink_status(at, error));
         at = at.parent_path())
      made_.push_back(at);
    fs::create_directories(folder, error);
    if (error) return {StatusCode::kIo, folder + ": cannot create: " + error.message()};
    return Status::ok();
  }

 private:
  std::vector<fs::path> made_;  // each before those above it
};

/// YAML and JSON write a double alike.
std::string list(std::span<const double> numbers) {
  return nlohmann::json(std::vector<double>(numbers.begin(), numbers.end())).dump();
}

std::string scene_of(std::span<const ImportedNode> nodes) {
  std::string scene = std::string(kSceneFile.begins) + "\nbodies:\n";
  for (const ImportedNode& node : nodes) {
    const std::string name = nlohmann::json(node.name).dump();
    scene.append("  - {name: ").append(name).append(", model: ").append(name);
    scene.append(", pose: {rotation: ").append(list(node.rotation));
    scene.append(", translation: ").append(list(node.translation_m)).append("}}\n");
  }
  return scene;
}

Status build_nodes(const BuildOptions& options, const ImportOptions& import_options,
                   Progress& progress) {
  const Result<ImportedNodes> imported = import_nodes(options.in, import_options);
  NEARMESH_RETURN_IF_ERROR(imported);
  const std::vector<ImportedNode>& nodes = imported.value().nodes;
  NewFolders folders;  // before the files: when these go, what came to nothing is no longer in them
  NEARMESH_RETURN_IF_ERROR(folders.make(options.out));
  const auto path_of = [&](const std::string& name) {
    return (fs::path(options.out) / name).string();
  };
  const std::string scene_path = path_of("scene.yaml");
  NEARMESH_RETURN_IF_ERROR(check_output(scene_path, kSceneFile, {options.in}));
  for (const ImportedNode& node : nodes)
    NEARMESH_RETURN_IF_ERROR(
        check_output(path_of(node.name + ".spm"), file_layout::kModelFile, {options.in}));
  // None is put in place before all could be written: a scene places models of one file, not of
  // two.
  std::vector<Built> models;
  for (const ImportedNode& node : nodes) {
    Result<Built> built =
        build(node.mesh, imported.value().origin, imported.value().stated_up,
              imported.value().terrain, path_of(node.name + ".spm"), options, progress);
    if (!built.is_ok())
      return {built.status().code(), "node " + node.name + ": " + built.status().message()};
    models.push_back(std::move(built).value());
  }
  Result<OutputFile> scene =
      OutputFile::whole(scene_path, kSceneFile, scene_of(nodes), {options.in});
  NEARMESH_RETURN_IF_ERROR(scene);
  for (Built& model : models) NEARMESH_RETURN_IF_ERROR(model.file.close());
  NEARMESH_RETURN_IF_ERROR(scene.value().close());
  for (const Built& model : models) report(model.outcome, options);
  if (!options.json) std::printf("%s: places %zu models\n", scene_path.c_str(), nodes.size());
  warn_of_reader(options.in, imported.value().is_as_written);
  return Status::ok();
}

}  // namespace

Result<ImportOptions> import_options(const BuildOptions& options) {
  ImportOptions out{.scale = options.scale, .node = options.node};
  if (!options.unit.empty()) out.unit_m = metres(options.unit);
  if (!options.up.empty()) out.up = options.up == "y" ? UpAxis::kY : UpAxis::kZ;
  const auto terrain = terrain_options(options);
  NEARMESH_RETURN_IF_ERROR(terrain);
  out.terrain = terrain.value();
  return out;
}

std::optional<CommonLattice> common_lattice(double cell_m, const std::array<double, 3>& origin_m) {
  if (cell_m == 0) return std::nullopt;
  CommonLattice lattice;
  std::frexp(cell_m, &lattice.exponent);
  --lattice.exponent;
  for (std::size_t k = 0; k < 3; ++k)
    lattice.origin_m[k] =
        std::ldexp(std::round(std::ldexp(origin_m[k], -lattice.exponent)), lattice.exponent);
  return lattice;
}

Status run(const BuildOptions& options) {
  keep_large_heap();
  Stopwatch watch;
  if (!options.per_node)
    NEARMESH_RETURN_IF_ERROR(check_output(options.out, file_layout::kModelFile, {options.in}));
  const Result<ImportOptions> asked = import_options(options);
  NEARMESH_RETURN_IF_ERROR(asked);
  Progress progress;
  progress.stage("reading");
  if (options.per_node) return build_nodes(options, asked.value(), progress);
  Result<ImportedMesh> imported = import_mesh(options.in, asked.value());
  NEARMESH_RETURN_IF_ERROR(imported);
  Result<Built> built =
      build(std::move(imported.value().mesh), imported.value().origin, imported.value().stated_up,
            imported.value().terrain, options.out, options, progress);
  NEARMESH_RETURN_IF_ERROR(built);
  NEARMESH_RETURN_IF_ERROR(built.value().file.close());
  built.value().outcome.seconds = watch.seconds();
  report(built.value().outcome, options);
  warn_of_reader(options.in, imported.value().is_as_written);
  return Status::ok();
}

}  // namespace nearmesh::program
