// SPDX-License-Identifier: Apache-2.0
// nearmesh-model: makes, inspects and queries progressive model files, without a network. Its
// verbs, their flags and their help.

#include <CLI/CLI.hpp>
#include <memory>

#include "commands.hpp"
#include "core/command/run_program.hpp"

namespace nearmesh::program {
namespace {

void add_generate(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("generate", "Write a deterministic test model as PLY.");
  const auto options = std::make_shared<GenerateOptions>();
  command->add_option("kind", options->kind, "What to generate")
      ->required()
      ->check(CLI::IsMember({"terrain", "aircraft", "sphere"}));
  command->add_option("-o,--output", options->out, "PLY file to write")->required();
  command->add_option("--size", options->size,
                      "terrain: cells a side (default 708: 1,002,528 triangles of 32 m); "
                      "aircraft: triangles, about (default 4000); sphere: slices (default 64)");
  command->add_option("--seed", options->seed, "Seed; equal seeds give equal files")
      ->capture_default_str();
  command->add_option(
      "--floor-m", options->floor_m,
      "terrain: close it by walls and a floor at this height, so that what is below "
      "the ground is inside; metres");
  end_help(*command, {"nearmesh-model generate terrain -o terrain.ply",
                      "nearmesh-model generate aircraft --size 8000 -o aircraft.ply"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

/// How files are read, of build and build-world.
void add_import_flags(CLI::App* command, BuildOptions& options) {
  command
      ->add_option("--unit", options.unit,
                   "Length of a unit of a file that does not state it (default: m)")
      ->check(CLI::IsMember({"mm", "cm", "m", "in", "ft", "km"}));
  command
      ->add_option("--up", options.up,
                   "Which axis is up in the file; the model is turned so that z is (default: "
                   "nothing is turned)")
      ->check(CLI::IsMember({"y", "z"}));
  command->add_option("--scale", options.scale, "Multiply all lengths")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  const auto add_for_grids = [command](const char* name, std::string& value, const char* help) {
    command->add_option(name, value, help)->group("For grids of heights (docs/terrain.md)");
  };
  add_for_grids(
      "--crs", options.crs,
      "The model's frame. file: the file's own coordinates, in metres. enu:LAT,LON: east, north, "
      "up in the plane that touches the WGS 84 ellipsoid there. ecef: geocentric");
  add_for_grids(
      "--spacing", options.spacing,
      "EAST,NORTH between posts, of a file that does not state it: metres, or degrees with enu "
      "and ecef");
  add_for_grids("--corner", options.corner,
                "X,Y of the south-western post, of a file that does not state it (default: 0,0)");
  add_for_grids("--nodata", options.nodata,
                "The sample that means no data, beside the one that the file states; may be nan");
  add_for_grids("--fill", options.fill,
                "Height of posts without data, in the unit of the file's heights; no sample "
                "(default: none, they leave holes)");
  add_for_grids(
      "--heights", options.heights,
      "OFFSET,STEP: a height is OFFSET + STEP x sample; of colours, a sample is 65536 red + 256 "
      "green + blue");
  add_for_grids(
      "--raw", options.raw,
      "COLUMNSxROWS,TYPE: nothing but samples, the northern row first; u8, i8, or u, i, f, then "
      "16, 32 or 64, then le or be, as i16be");
}

void add_build(CLI::App& app, Action& chosen) {
  CLI::App* command =
      app.add_subcommand("build", "Turn a mesh file into a progressive model (.spm).");
  const auto options = std::make_shared<BuildOptions>();
  command->add_option("input", options->in, "Mesh file; nearmesh-model formats lists what is read")
      ->required();
  command->add_option("-o,--output", options->out, ".spm file to write; with --per-node, a folder")
      ->required();
  add_import_flags(command, *options);
  CLI::Option* node = command->add_option(
      "--node", options->node,
      "Only the node or object of this name and what hangs on it, where the file has it");
  command
      ->add_flag("--per-node", options->per_node,
                 "A model for each node, named by it, in the node's frame, and scene.yaml, which "
                 "places them")
      ->excludes(node);
  command
      ->add_option("--grid-bits", options->grid_bits,
                   "Bits per axis of the integer grid to which vertices are rounded")
      ->capture_default_str()
      ->check(CLI::Range(kMinGridBits, kMaxGridBits));
  CLI::Option* cell = command
                          ->add_option("--cell", options->cell_m,
                                       "Grid cell in metres: the greatest power of two up to this. "
                                       "Give models that border on "
                                       "each other one cell, and vertices that they share stay "
                                       "equal in every pose (default: "
                                       "the smallest that --grid-bits allow)")
                          ->check(CLI::PositiveNumber);
  command
      ->add_option("--lattice-origin", options->lattice_origin_m,
                   "With --cell: origin of the grid, X,Y,Z in metres, near the models and one for "
                   "all of them "
                   "(default: 0,0,0)")
      ->delimiter(',')
      ->needs(cell);
  command->add_option("--base-faces", options->base_faces, "Stop simplifying at this many faces")
      ->capture_default_str()
      ->check(CLI::Range(1U, 1000U));
  command
      ->add_option(
          "--threads", options->threads,
          "Threads to use (default: one for each core); the file is the same for any number")
      ->check(CLI::Range(1U, 256U));
  command->add_flag("--json", options->json, "Print the report as one JSON object");
  end_help(*command, {"nearmesh-model build hull.stl --unit mm -o hull.spm",
                      "nearmesh-model build plant.dae --per-node -o plant",
                      "nearmesh-model build N00E010.hgt --crs enu:0.5,10.5 -o tile.spm"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

void add_build_world(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("build-world",
                                         "Turn grids of heights and meshes into a world: tiles of "
                                         "one lattice, baked one by one, and the "
                                         "pages that list them (docs/worlds.md).");
  const auto options = std::make_shared<BuildWorldOptions>();
  BuildOptions& build = options->build;
  command
      ->add_option("inputs", options->in,
                   "Files whose frames agree; nearmesh-model formats lists what is read")
      ->required();
  command->add_option("-o,--output", build.out, "Folder of the world; what it has stays")
      ->required();
  command->add_option("--faces", options->tile_faces, "Faces of a tile, about")
      ->capture_default_str()
      ->check(CLI::Range(2U, 100'000'000U));
  command
      ->add_option(
          "--cell", build.cell_m,
          "Grid cell of all tiles, in metres: the greatest power of two up to this (default: the "
          "world's that is there, or the smallest that the largest tile allows, for which all "
          "inputs are read once)")
      ->check(CLI::PositiveNumber);
  CLI::Option* origin = command
                            ->add_option("--lattice-origin", build.lattice_origin_m,
                                         "Origin of that grid: X,Y,Z in metres, near the tiles "
                                         "(default: the world's that is there, or the "
                                         "middle of all inputs)")
                            ->delimiter(',');
  add_import_flags(command, build);
  command->add_option("--grid-bits", build.grid_bits, "Bits per axis of each tile's grid")
      ->capture_default_str()
      ->check(CLI::Range(kMinGridBits, kMaxGridBits));
  command->add_option("--base-faces", build.base_faces, "Stop simplifying at this many faces")
      ->capture_default_str()
      ->check(CLI::Range(1U, 1000U));
  command->add_option("--threads", build.threads, "Threads to use (default: one for each core)")
      ->check(CLI::Range(1U, 256U));
  command->add_option(
      "--repeat", options->repeat,
      "COLUMNSxROWS: all tiles stand again so many times along x and y, each time moved "
      "by the size of all of them; for worlds that are made to try how large they may be");
  CLI::Option* only =
      command->add_option("--only", options->only, "Bake this tile alone, as a plan has it");
  command
      ->add_option(
          "--plan", options->plan,
          "Bake nothing, and write the commands that do: a ninja file where the name ends in "
          ".ninja, else one command a line, of which the last comes after all others")
      ->excludes(only);
  command->add_flag("--json", build.json, "Print the report as one JSON object");
  end_help(*command,
           {"nearmesh-model build-world N00E010.hgt N00E011.hgt --crs enu:0.5,11 -o WORLD",
            "nearmesh-model build-world N00E010.hgt --crs ecef -o WORLD --plan world.ninja && "
            "ninja -f world.ninja"});
  command->callback([options, origin, &chosen] {
    options->has_lattice_origin = origin->count() > 0;
    chosen = [options] { return run(*options); };
  });
}

void add_formats(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "formats", "List the mesh formats that build reads, and their conventions.");
  const auto options = std::make_shared<FormatsOptions>();
  command->add_flag("--json", options->json, "Print one JSON array");
  end_help(*command, {"nearmesh-model formats"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

void add_info(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "info", "Check every checksum of a model or of a world's pages and describe it.");
  const auto options = std::make_shared<InfoOptions>();
  command->add_option("model", options->path, ".spm file, or the folder of a world")->required();
  command->add_flag("--deep", options->deep,
                    "Also check that boxes enclose all faces, as serve does the first time");
  command->add_flag("--json", options->json, "Print one JSON object");
  end_help(*command,
           {"nearmesh-model info terrain.spm", "nearmesh-model info terrain.spm --deep --json"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

void add_export(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("export", "Write a level of detail of a model as PLY.");
  const auto options = std::make_shared<ExportOptions>();
  command->add_option("model", options->in, ".spm file")->required();
  command->add_option("-o,--output", options->out, "PLY file to write")->required();
  command->add_option("--splits", options->splits,
                      "After the first N splits, largest parts first (default: the full mesh, in "
                      "input face order)");
  end_help(*command, {"nearmesh-model export terrain.spm -o full.ply",
                      "nearmesh-model export terrain.spm --splits 5000 -o coarse.ply"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

void add_query(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "query", "Test two models for contact in given poses; prints one JSON line per pose.");
  const auto options = std::make_shared<PoseQueryOptions>();
  command->add_option("A", options->a, ".spm file of model A, or the folder of a world")
      ->required();
  command->add_option("B", options->b, ".spm file of model B")->required();
  command
      ->add_option(
          "--poses", options->poses,
          "CSV with a header: id, A_R00..A_R22 (row-major), A_T0..A_T2 (metres), the same for "
          "B; other columns are ignored")
      ->required();
  command
      ->add_option(
          "--method", options->method,
          "full: the full meshes. base: the base meshes. global: both refined everywhere, "
          "largest parts first. grid: the 2006 paper's 8x8x8 contact cells and their "
          "neighbours. certified: from the base mesh, only what the answer needs. Only full "
          "and certified answers are proofs")
      ->capture_default_str()
      ->check(CLI::IsMember({"full", "base", "global", "grid", "certified"}));
  command
      ->add_option("--splits", options->method_options.global_splits,
                   "Splits of each model for --method global")
      ->capture_default_str();
  CLI::Option* any =
      command->add_flag("--any", options->method_options.query.any,
                        "Stop at the first touching pair: contact or not, without the whole set");
  CLI::Option* max_pairs =
      command
          ->add_option("--max-pairs", options->method_options.query.max_pairs,
                       "List at most this many touching pairs, the first in the order of face "
                       "names; adds pair_total, how many there are, and truncated")
          ->check(CLI::Range(std::uint64_t{0}, std::uint64_t{0xffffffff}));
  command
      ->add_option("--max-tests", options->method_options.query.max_tests,
                   "End the search of a pose after so many tests, of 2 to 25 ns: partial or "
                   "uncertain then, with what was found, and exhausted")
      ->check(CLI::Range(std::uint64_t{0}, kAllTests));
  command
      ->add_flag("--contacts", options->method_options.contacts,
                 "Add where the bodies touch: patches with centre, normal from A to B, length, and "
                 "bounds of their errors, of the listed pairs")
      ->excludes(any);
  command->add_flag("--solid-a", options->method_options.query.solid_a,
                    "A has an inside: is B in it? For full and certified; A must be closed");
  command->add_flag("--solid-b", options->method_options.query.solid_b,
                    "B has an inside: is A in it?");
  command->add_flag("--list-pairs", options->list_pairs,
                    "Add the touching faces as pairs of input face numbers, sorted");
  command->add_flag("--json", options->json, "JSON lines only: no summary on standard error");
  end_help(*command, {"nearmesh-model query terrain.spm aircraft.spm --poses poses.csv",
                      "nearmesh-model query tank.spm buoy.spm --poses poses.csv --solid-a --method "
                      "full --list-pairs"});
  command->callback([options, max_pairs, &chosen] {
    options->limited = max_pairs->count() > 0;
    chosen = [options] { return run(*options); };
  });
}

void add_probe(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "probe",
      "Tell what rays meet first, or how high points are above a model or a world; "
      "prints one JSON line per ray.");
  const auto options = std::make_shared<ProbeOptions>();
  command->add_option("MODEL", options->path, ".spm file, or the folder of a world")->required();
  command
      ->add_option(
          "--rays", options->rays,
          "CSV with a header, metres in the model's frame: x, y, z; dx, dy, dz, where rays "
          "do not go straight down; range, where they end; other columns are ignored")
      ->required();
  end_help(*command, {"nearmesh-model probe terrain.spm --rays rays.csv"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

void add_check(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand("check",
                                         "Check a peer's recorded answers against the full meshes, "
                                         "or a world against its tiles; fails if "
                                         "anything is wrong.");
  const auto options = std::make_shared<CheckOptions>();
  command
      ->add_option("models", options->models,
                   ".spm files of all models that occur, and folders of worlds; without --answers, "
                   "folders of worlds")
      ->required();
  command->add_option("--answers", options->answers,
                      "Files written by nearmesh-subscriber run --answers (or its --json output)");
  end_help(*command, {"nearmesh-model check terrain.spm aircraft.spm --answers answers.jsonl",
                      "nearmesh-model check WORLD"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

}  // namespace
}  // namespace nearmesh::program

int main(int argc, char** argv) {
  using namespace nearmesh::program;
  CLI::App app{"Makes, inspects and queries nearmesh model files (.spm).", "nearmesh-model"};
  app.require_subcommand(1);
  app.fallthrough(false);
  nearmesh::Action action;
  add_generate(app, action);
  add_build(app, action);
  add_build_world(app, action);
  add_formats(app, action);
  add_info(app, action);
  add_export(app, action);
  add_query(app, action);
  add_probe(app, action);
  add_check(app, action);
  return nearmesh::run_program(app, argc, argv, action);
}
