// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/base/hash.hpp"
#include "core/base/resources.hpp"
#include "core/base/stopwatch.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"

namespace nearmesh::program {
namespace {

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
  CleanReport clean;
  double seconds = 0, simplify_seconds = 0;
  std::uint64_t base_vertices = 0, base_faces = 0, splits = 0;
  StopReason stop = StopReason::kNothingToDo;
  std::uint64_t clustered = 0;
  double cell_m = 0;
  int grid_bits = 0;
  WrittenModel written;
};

void print_json(const BuildOptions& options, const Outcome& o) {
  const CleanReport& c = o.clean;
  const nlohmann::ordered_json report = {{"input", options.in},
                                         {"output", options.out},
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
                                         {"rounding_error_m", c.rounding_error_m},
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
  std::printf("%s\n", report.dump().c_str());
}

void print_text(const BuildOptions& options, const Outcome& o) {
  const CleanReport& c = o.clean;
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf("%s -> %s\n", options.in.c_str(), options.out.c_str());
  std::printf("  in            %llu faces, %llu vertices\n", count(c.faces_in),
              count(c.vertices_in));
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
  std::printf("  grid          %d bits, cell %.3g m, rounding error %.3g m\n", o.grid_bits,
              o.cell_m, c.rounding_error_m);
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

}  // namespace

Status run(const BuildOptions& options) {
  Stopwatch watch;
  Progress progress;
  Outcome outcome;
  progress.stage("reading");
  Result<IndexedMesh> mesh = import_mesh(options.in);
  if (!mesh.is_ok()) return mesh.status();
  progress.stage("cleaning");
  Result<CleanResult> clean = clean_mesh(mesh.value(), options.grid_bits);
  if (!clean.is_ok()) return {clean.status().code(), options.in + ": " + clean.status().message()};
  mesh.value() = {};
  outcome.clean = clean.value().report;
  progress.stage("simplifying");
  Stopwatch simplify_watch;
  Result<BakedModel> baked =
      bake(clean.value().mesh, outcome.clean.rounding_error_m,
           {.base_faces = options.base_faces,
            .threads = options.threads,
            .on_progress = [&progress](double share) { progress.show(share); }});
  if (!baked.is_ok()) return baked.status();
  outcome.simplify_seconds = simplify_watch.seconds();
  progress.stage("writing");
  const BakedModel& model = baked.value();
  const auto written =
      write_model_file(model.header, model.store, model.numbers, options.out, options.threads);
  if (!written.is_ok()) return written.status();
  progress.end();

  outcome.seconds = watch.seconds();
  outcome.base_vertices = model.header.roots.size();
  outcome.base_faces = model.header.base_faces.size();
  outcome.splits = model.header.split_count();
  outcome.stop = model.log.stop;
  outcome.clustered = model.log.clustered;
  outcome.cell_m = std::ldexp(1.0, model.header.grid.exponent);
  outcome.grid_bits = model.header.grid.bits;
  outcome.written = written.value();
  options.json ? print_json(options, outcome) : print_text(options, outcome);
  return Status::ok();
}

}  // namespace nearmesh::program
