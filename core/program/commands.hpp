// SPDX-License-Identifier: Apache-2.0
#pragma once
// The commands of nearmesh-model: what each is told, and what it then does. A Status that is not ok
// becomes one line on standard error and exit code 1 (wrong usage: 2). Flags and help stand in
// main.cpp alone, so that no command compiles CLI11.

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/base/status.hpp"
#include "query_methods.hpp"

namespace nearmesh::program {

struct GenerateOptions {
  std::string kind, out;
  std::uint32_t size = 0;
  std::uint64_t seed = 1;
  std::optional<double> floor_m;
};
Status run(const GenerateOptions& options);

struct BuildOptions {
  std::string in, out;
  int grid_bits = 21;
  std::uint32_t base_faces = SimplifyOptions{}.base_faces;
  unsigned threads = 0;
  std::string unit, up, node;  ///< empty: what the file says; nothing turned; all nodes
  double scale = 1;
  /// Of a grid of heights, as they were typed; empty: not said.
  std::string crs, spacing, corner, nodata, fill, heights, raw;
  double cell_m = 0;  ///< of a lattice that several models share; 0: of its own
  std::array<double, 3> lattice_origin_m{};
  bool per_node = false, json = false;
};
Status run(const BuildOptions& options);

struct BuildWorldOptions {
  std::vector<std::string> in;
  /// How to read and bake each; its `in` is not used, `out` is the world's folder.
  BuildOptions build;
  bool has_lattice_origin = false;
  std::uint32_t tile_faces = 1'000'000;
  std::string repeat;                 ///< as it was typed; empty: once
  std::optional<std::uint32_t> only;  ///< this tile alone, without pages
  std::string plan;                   ///< write commands to this file instead
};
Status run(const BuildWorldOptions& options);

struct FormatsOptions {
  bool json = false;
};
Status run(const FormatsOptions& options);

/// Of a folder.
struct WorldInfoOptions {
  std::string path;
  bool json = false;
};
Status run(const WorldInfoOptions& options);
struct WorldCheckOptions {
  std::string path;
};
Status run(const WorldCheckOptions& options);

struct InfoOptions {
  std::string path;
  bool json = false, deep = false;
};
Status run(const InfoOptions& options);

struct ExportOptions {
  std::string in, out;
  std::uint32_t splits = 0xffffffffU;
};
Status run(const ExportOptions& options);

struct PoseQueryOptions {
  std::string a, b, poses, method = "certified";
  QueryMethodOptions method_options;
  bool list_pairs = false, json = false, limited = false;
};
Status run(const PoseQueryOptions& options);

/// Of a file or a world's folder.
struct ProbeOptions {
  std::string path, rays;
};
Status run(const ProbeOptions& options);

struct CheckOptions {
  std::vector<std::string> models, answers;
};
Status run(const CheckOptions& options);

}  // namespace nearmesh::program
