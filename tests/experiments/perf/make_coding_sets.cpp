// SPDX-License-Identifier: Apache-2.0
// The coding tables that are built in, made anew, and what they cost:
//   nearmesh-make-coding-sets DATA source > core/spm/coding_sets_data.cpp
//   nearmesh-make-coding-sets DATA costs   CSV: by model and set, how much larger answers are than
//                                          with the model's own tables
// DATA is the folder of test meshes. To be run when the codec's contexts change, or what is
// counted: the sets are then of no use, or not the best. A set's tables are those of its meshes'
// counts, each mesh weighing the same, moved to one length of offsets (core/spm/set_places.hpp). In
// `costs` each mesh is left out of its own set, so that the figure is that of a mesh that nobody
// has seen.

#include <algorithm>
#include <array>
#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/bake/count_typical.hpp"
#include "core/spm/coding_sets.hpp"
#include "core/spm/set_places.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "shapes.hpp"

using namespace nearmesh;

namespace {

struct SetOfMeshes {
  const char* name;
  /// Files below DATA; "terrain 708 1" and the like are generated, of that size and seed; "plane
  /// 48": that many squares a side.
  std::vector<const char*> meshes;
};

// Meshes are alike where the same symbols are frequent, but for how long offsets are: by how
// regular their faces are, and how they lie.
const std::vector<SetOfMeshes>& sets() {
  static const std::vector<SetOfMeshes> all{
      {"terrain",
       {"terrain 70 42", "terrain 100 3", "terrain 180 5", "terrain 224 42", "terrain 256 42",
        "terrain 300 7", "terrain 600 3", "terrain 708 1", "terrain 1000 2", "terrain 1024 42",
        "terrain 1600 9", "terrain 2236 1"}},
      {"elevation", {"terrain/jacksboro_fault_dem.pgm", "terrain/srtm3_N00E010.pgm"}},
      {"scan",
       {"scans/armadillo_86k.obj", "scans/camelhead.off", "scans/dragon_vrip_res3.ply",
        "scans/dragon_vrip_res4.ply", "scans/fertility.off", "scans/lucy_20k.ply",
        "scans/stanford_bunny.obj", "tools/screwdriver.off", "tools/wingnut.obj",
        "scans/armadillo_346k_loop.ply", "cad/counter.unitsmm.STL", "tools/hammer.obj",
        "tools/sword.obj", "vehicles/beetle_alt.obj", "vehicles/boat.obj", "vehicles/plane.obj"}},
      {"cad",
       {"cad/cycloidal.ply", "cad/octagonal_pocket.ply", "cad/round.stl",
        "cad/1002_tray_bottom.STL", "cad/ADIS16480.STL", "cad/angle_block.STL",
        "cad/featuretype.STL", "assembly/factory_rectangular_hole_8mm_subdiv_3x.obj",
        "assembly/factory_rectangular_peg_8mm_loose_subdiv_3x.obj",
        "assembly/factory_round_hole_8mm_subdiv_3x.obj", "assembly/factory_round_peg_8mm_loose.obj",
        "vehicles/boeing.off"}},
      {"small",
       {"cad/ballA.off", "cad/quadknot.obj", "cad/torus.STL", "vehicles/truck.obj",
        "assembly/factory_nut_m16_loose_subdiv_3x.obj", "robot/ur5/collision/base.stl",
        "robot/ur5/collision/forearm.stl", "robot/ur5/collision/shoulder.stl",
        "robot/ur5/collision/wrist1.stl", "robot/ur5/collision/wrist3.stl"}},
      {"regular", {"sphere 64 0", "sphere 200 0", "aircraft 4000 1", "aircraft 20000 3"}},
      {"flat grid", {"plane 48", "plane 100", "plane 200"}},
      {"thread",
       {"assembly/factory_bolt_m16_loose.obj", "assembly/factory_nut_m16_loose_subdiv_3x.obj"}}};
  return all;
}

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "%s\n", what.c_str());
  std::exit(1);
}

// A grid of heights, at most 500 points a side, 90 m apart: PGM with 16 bits a point, comments
// before the numbers.
IndexedMesh read_heights(const std::string& path) {
  constexpr std::uint32_t kMost = 500;
  constexpr double kSpacing_m = 90;
  std::ifstream file(path, std::ios::binary);
  std::string word;
  const auto next = [&] {
    while (file >> word && word.front() == '#') std::getline(file, word);
    return word;
  };
  if (next() != "P5") fail(path + ": not a PGM file");
  const auto width = static_cast<std::uint32_t>(std::stoul(next()));
  const auto height = static_cast<std::uint32_t>(std::stoul(next()));
  if (std::stoul(next()) < 256) fail(path + ": 16 bits a point expected");
  file.get();
  const std::uint32_t columns = std::min(width, kMost), rows = std::min(height, kMost);
  IndexedMesh mesh;
  for (std::uint32_t y = 0; y < rows; ++y)
    for (std::uint32_t x = 0; x < width; ++x) {
      const int high = file.get();
      const int z = high << 8 | file.get();
      if (x < columns) mesh.positions_m.push_back({x * kSpacing_m, y * kSpacing_m, double(z)});
    }
  if (!file) fail(path + ": too short");
  for (std::uint32_t y = 0; y + 1 < rows; ++y)
    for (std::uint32_t x = 0; x + 1 < columns; ++x) {
      const std::uint32_t a = y * columns + x;
      mesh.faces.push_back({a, a + 1, a + columns});
      mesh.faces.push_back({a + 1, a + columns + 1, a + columns});
    }
  return mesh;
}

IndexedMesh mesh_of(const std::string& data, const std::string& name) {
  unsigned size = 0, seed = 0;
  if (std::sscanf(name.c_str(), "terrain %u %u", &size, &seed) == 2)
    return generate_terrain(size, seed);
  if (std::sscanf(name.c_str(), "sphere %u %u", &size, &seed) == 2)
    return generate_sphere(size, seed);
  if (std::sscanf(name.c_str(), "aircraft %u %u", &size, &seed) == 2)
    return generate_aircraft(size, seed);
  if (std::sscanf(name.c_str(), "plane %u", &size) == 1) return test::make_plane(4, size);
  if (name.ends_with(".pgm")) return read_heights(data + "/" + name);
  Result<IndexedMesh> mesh = import_mesh(data + "/" + name);
  if (!mesh.is_ok()) fail(mesh.status().message());
  return std::move(mesh).value();
}

struct Counted {
  std::string name;
  std::size_t set = 0;
  TrainingCounts counts;
  std::array<std::uint8_t, 3> lattice_shift{};
  int scale = 0;
};

/// Where sets are at home: there offsets have so many bits in the mean.
constexpr double kHomeBits = 8;

// A first estimate; fit_scale() knows better once there is a set.
int scale_by_mean(const TrainingCounts& counts) {
  double sum = 0, count = 0;
  for (std::size_t i = record::kOffset0; i < record::kFaceCount; ++i)
    for (std::uint32_t symbol = 0; symbol < kSymbolLimit; ++symbol)
      if (const std::uint32_t bits = record::tail_bits(static_cast<int>(i), symbol); bits > 0) {
        sum += static_cast<double>(counts[i][symbol]) * bits;
        count += static_cast<double>(counts[i][symbol]);
      }
  const double mean = count > 0 ? sum / count : kHomeBits;
  return static_cast<int>(std::lround(mean - kHomeBits));
}

Counted count_mesh(const std::string& data, const std::string& name, std::size_t set) {
  const Result<CleanResult> clean = clean_mesh(mesh_of(data, name));
  if (!clean.is_ok()) fail(name + ": " + clean.status().message());
  const Result<BakedModel> baked =
      bake(clean.value().mesh, clean.value().report.rounding_error_m, {});
  if (!baked.is_ok()) fail(name + ": " + baked.status().message());
  Counted counted{name, set, count_typical(baked.value().header, baked.value().store),
                  baked.value().header.lattice_shift};
  counted.scale = scale_by_mean(counted.counts);
  return counted;
}

// What is home to no mesh may be home to another one: it is as its neighbours are.
void fill_gaps(TrainingCounts& counts) {
  const auto is_empty = [&](int context) {
    const auto& symbols = counts[static_cast<std::size_t>(context)];
    return std::all_of(symbols.begin(), symbols.end(), [](std::uint64_t n) { return n == 0; });
  };
  for (const int first : {record::kOffset1 + 1, record::kOffset2 + 1}) {
    const int end = first - 1 + record::kLengthClasses;
    for (int at = first + 1; at < end; ++at)
      if (is_empty(at))
        counts[static_cast<std::size_t>(at)] = counts[static_cast<std::size_t>(at) - 1];
    for (int at = end - 2; at >= first; --at)
      if (is_empty(at))
        counts[static_cast<std::size_t>(at)] = counts[static_cast<std::size_t>(at) + 1];
  }
}

CodingTables pooled(const std::vector<Counted>& all, std::size_t set, const Counted* left_out) {
  constexpr std::uint64_t kWeight = 1'000'000;
  TrainingCounts sum(static_cast<std::size_t>(coding_context_count()));
  for (const Counted& one : all) {
    if (one.set != set || &one == left_out) continue;
    const std::uint64_t records = count_records(one.counts);
    const record::SetPlaces places(one.scale, one.lattice_shift);
    for (int i = 0; i < coding_context_count(); ++i)
      for (std::uint32_t symbol = 0; symbol < kSymbolLimit; ++symbol)
        sum[static_cast<std::size_t>(places.context(i))][places.symbol(i, symbol)] +=
            (one.counts[static_cast<std::size_t>(i)][symbol] * kWeight + records / 2) / records;
  }
  fill_gaps(sum);
  // Nobody receives these tables, so that rare symbols have codes too.
  return make_tables(sum, 10 * kTableSplits);
}

// Each mesh to the scale at which the others of its set code it best.
void align(std::vector<Counted>& all) {
  constexpr int kRounds = 3;
  for (int round = 0; round < kRounds; ++round)
    for (Counted& one : all)
      if (sets()[one.set].meshes.size() > 1)
        one.scale =
            fit_scale(one.counts, one.lattice_shift, lengths_of(pooled(all, one.set, &one))).scale;
}

std::uint64_t written_bits(const CodingTables& tables) {
  BitWriter out;
  write_tables(out, tables);
  return out.bit_count();
}

void print_source(const std::vector<Counted>& all) {
  std::printf(
      "// SPDX-License-Identifier: Apache-2.0\n"
      "// Made by nearmesh-make-coding-sets; not to be edited.\n"
      "// clang-format off\n"
      "#include <array>\n\n"
      "#include \"coding_sets.hpp\"\n\n"
      "namespace nearmesh {\n"
      "namespace {\n\n");
  for (std::size_t set = 0; set < sets().size(); ++set) {
    BitWriter out;
    write_tables(out, pooled(all, set, nullptr));
    std::vector<std::uint8_t> bytes = std::move(out).finish();
    bytes.resize((bytes.size() + 7) / 8 * 8);
    std::printf("constexpr std::array<std::uint64_t, %zu> kSet%zu{", bytes.size() / 8, set + 1);
    for (std::size_t i = 0; i < bytes.size(); i += 8) {
      std::uint64_t word = 0;
      for (std::size_t k = 0; k < 8; ++k) word = word << 8 | bytes[i + k];
      std::printf("%s0x%" PRIx64, i == 0 ? "\n" : i % 40 == 0 ? ",\n" : ",", word);
    }
    std::printf("};\n\n");
  }
  std::printf(
      "}  // namespace\n\n"
      "std::span<const CodingSetData> coding_sets_data() {\n"
      "  static constexpr CodingSetData kSets[] = {\n");
  for (std::size_t set = 0; set < sets().size(); ++set)
    std::printf("      {\"%s\", kSet%zu},\n", sets()[set].name, set + 1);
  std::printf(
      "  };\n"
      "  return kSets;\n"
      "}\n\n"
      "}  // namespace nearmesh\n");
}

void print_costs(const std::vector<Counted>& all) {
  std::printf("mesh,set,own tables B");
  for (const SetOfMeshes& set : sets()) std::printf(",%s %%", set.name);
  std::printf("\n");
  for (const Counted& one : all) {
    const CodingTables own = make_tables(one.counts);
    const auto least = static_cast<double>(coded_bits(one.counts, own));
    std::printf("%s,%s,%" PRIu64, one.name.c_str(), sets()[one.set].name,
                (written_bits(own) + 7) / 8);
    for (std::size_t set = 0; set < sets().size(); ++set)
      std::printf(",%.1f", 100 * (static_cast<double>(fit_scale(one.counts, one.lattice_shift,
                                                                lengths_of(pooled(all, set, &one)))
                                                          .bits) /
                                      least -
                                  1));
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool source = argc == 3 && std::strcmp(argv[2], "source") == 0;
  if (!source && (argc != 3 || std::strcmp(argv[2], "costs") != 0)) {
    std::fprintf(stderr, "usage: nearmesh-make-coding-sets DATA source|costs\n");
    return 2;
  }
  std::vector<Counted> all;
  for (std::size_t set = 0; set < sets().size(); ++set)
    for (const char* mesh : sets()[set].meshes) all.push_back(count_mesh(argv[1], mesh, set));
  align(all);
  source ? print_source(all) : print_costs(all);
  return 0;
}
