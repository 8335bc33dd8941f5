// SPDX-License-Identifier: Apache-2.0
#include "scale.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>

#include "core/base/resources.hpp"
#include "core/base/stopwatch.hpp"
#include "meshes.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"
#include "nearmesh_system.hpp"

namespace nearmesh::stability {
namespace {

struct Measured {
  double first_answer_s = 0;
  std::uint64_t memory_bytes = 0;
  bool touches = false;
};

/// The aircraft's grid and the terrain's, and a pose in which they touch: its nose rests in the
/// ground at the origin.
Case ground_contact(std::uint32_t size) {
  const MeshPtr terrain = share(generate_terrain(size, 7));
  const MeshPtr aircraft = share(generate_aircraft(2000, 7));
  double ground_m = 0, nearest = 1e300;
  for (const auto& p : terrain->positions_m) {
    const double square = p[0] * p[0] + p[1] * p[1];
    if (square < nearest) nearest = square, ground_m = p[2];
  }
  return {
      .name = "terrain", .a = {terrain, {}}, .b = {aircraft, at(0, 0, ground_m)}, .touches = true};
}

Measured answer_from_files(const std::string& path_a, const std::string& path_b, const Case& c) {
  const std::uint64_t before = peak_memory_bytes();
  const Stopwatch watch;
  Result<ModelFile> a = ModelFile::open(path_a), b = ModelFile::open(path_b);
  if (!a.is_ok() || !b.is_ok()) return {};
  LocalModel local_a(a.value().store(), a.value().header().grid);
  LocalModel local_b(b.value().store(), b.value().header().grid);
  const Result<PosedPair> posed =
      pose_pair(local_a.grid, c.a.pose, "a", local_b.grid, c.b.pose, "b");
  if (!posed.is_ok()) return {};
  const auto require = [](ModelFile& file) {
    return [&file](NodeSpan node) { return file.require(node); };
  };
  const Result<Answer> answer = certify(local_a, posed.value().a, require(a.value()), local_b,
                                        posed.value().b, require(b.value()), {});
  return {watch.seconds(), peak_memory_bytes() - before,
          answer.is_ok() && answer.value().status == AnswerStatus::kContact};
}

Measured answer_from_triangles(const System& system, const Case& c) {
  const std::uint64_t before = peak_memory_bytes();
  const Stopwatch watch;
  const Verdict verdict = system.answer(c);
  return {watch.seconds(), peak_memory_bytes() - before, verdict.kind == Verdict::Kind::kTouches};
}

template <class Run>
bool in_child(const Run& run, Measured& measured) {
  int ends[2];
  if (pipe(ends) != 0) return false;
  const pid_t child = fork();
  if (child == 0) {
    close(ends[0]);
    Measured m;
    try {
      m = run();
    } catch (const std::exception&) {
      _exit(1);
    }
    _exit(write(ends[1], &m, sizeof m) == sizeof m ? 0 : 1);
  }
  close(ends[1]);
  const bool got = child > 0 && read(ends[0], &measured, sizeof measured) == sizeof measured;
  close(ends[0]);
  int status = 0;
  if (child > 0) waitpid(child, &status, 0);
  return got && measured.touches;
}

bool write_model(const IndexedMesh& mesh, const std::string& path) {
  const auto model = build_model(mesh, SimplifyOptions{}.base_faces);
  return model.is_ok() && write_model_file(model.value()->baked.header, model.value()->baked.store,
                                           model.value()->baked.numbers, path)
                              .is_ok();
}

}  // namespace

std::vector<ScaleRow> measure_scale(const std::vector<std::unique_ptr<System>>& systems,
                                    bool quick) {
  const std::string stem =
      (std::filesystem::temp_directory_path() / ("nearmesh_scale_" + std::to_string(getpid())))
          .string();
  const std::string path_a = stem + "_a.spm", path_b = stem + "_b.spm";
  std::vector<ScaleRow> rows;
  for (const std::uint32_t size : {71U, 224U, 708U}) {
    if (quick && size > 300) continue;
    const Case c = ground_contact(size);
    for (const auto& system : systems) {
      ScaleRow row{.system = system->name(), .faces = c.a.mesh->faces.size()};
      Measured measured;
      bool is_done = false;
      if (system->name() == "nearmesh") {
        // Baked in a child as well, so that this process stays small for the children that follow.
        Measured baked;
        const bool is_baked = in_child(
            [&] {
              const Stopwatch watch;
              const bool written = write_model(*c.a.mesh, path_a) && write_model(*c.b.mesh, path_b);
              return Measured{watch.seconds(), 0, written};
            },
            baked);
        row.prepare_s = baked.first_answer_s;
        is_done =
            is_baked && in_child([&] { return answer_from_files(path_a, path_b, c); }, measured);
      } else {
        is_done = in_child([&] { return answer_from_triangles(*system, c); }, measured);
      }
      if (!is_done) {
        std::fprintf(stderr, "F14: %s gave no right answer for %llu faces\n", row.system.c_str(),
                     static_cast<unsigned long long>(row.faces));
        continue;
      }
      row.first_answer_s = measured.first_answer_s;
      row.memory_bytes = measured.memory_bytes;
      rows.push_back(row);
    }
  }
  std::filesystem::remove(path_a);
  std::filesystem::remove(path_b);
  std::stable_sort(rows.begin(), rows.end(),
                   [](const ScaleRow& x, const ScaleRow& y) { return x.system < y.system; });
  return rows;
}

}  // namespace nearmesh::stability
