// SPDX-License-Identifier: Apache-2.0
#include "report.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <sstream>

namespace nearmesh::stability {
namespace {

const char* const kHeadings = "right,undecided,wrong,crash,hang,not_applicable,cases";

Status write_file(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (!file) return {StatusCode::kIo, path + ": cannot be written"};
  return Status::ok();
}

std::string results_csv(const Report& report) {
  std::ostringstream csv;
  csv << "scene,system," << kHeadings << '\n';
  for (const Tally& t : report.tallies)
    csv << t.scene << ',' << t.system << ',' << t.count(Mark::kRight) << ','
        << t.count(Mark::kUndecided) << ',' << t.count(Mark::kWrong) << ',' << t.count(Mark::kCrash)
        << ',' << t.count(Mark::kHang) << ',' << t.count(Mark::kNotApplicable) << ',' << t.cases()
        << '\n';
  return csv.str();
}

std::string failures_csv(const Report& report) {
  std::ostringstream csv;
  csv << "scene,system,case,expected,found\n";
  for (const Failure& f : report.failures)
    csv << f.scene << ',' << f.system << ",\"" << f.name << "\",\"" << f.expected << "\",\""
        << f.found << "\"\n";
  return csv.str();
}

std::string scale_csv(const Report& report) {
  std::ostringstream csv;
  csv << "system,faces,prepare_s,first_answer_s,memory_bytes\n";
  for (const ScaleRow& row : report.scale)
    csv << row.system << ',' << row.faces << ',' << row.prepare_s << ',' << row.first_answer_s
        << ',' << row.memory_bytes << '\n';
  return csv.str();
}

/// "812/812", with what went worse than wrong.
std::string cell(const Tally& t) {
  if (!t.is_applicable()) return "n/a";
  const std::uint64_t asked = t.cases() - t.count(Mark::kNotApplicable);
  std::string text = std::to_string(t.right()) + "/" + std::to_string(asked);
  if (t.right() == asked) text = "**" + text + "**";
  if (t.count(Mark::kCrash) > 0) text += ", " + std::to_string(t.count(Mark::kCrash)) + " crash";
  if (t.count(Mark::kHang) > 0) text += ", " + std::to_string(t.count(Mark::kHang)) + " hang";
  if (t.count(Mark::kUndecided) > 0)
    text += " (" + std::to_string(t.count(Mark::kUndecided)) + " undecided)";
  return text;
}

void write_table(std::ostream& page, const Report& report) {
  page << "| scene | |";
  for (const SystemNote& s : report.systems) page << ' ' << s.name << ' ' << s.version << " |";
  page << "\n|---|---|";
  for (std::size_t i = 0; i < report.systems.size(); ++i) page << "---|";
  std::string scene;
  for (const Tally& t : report.tallies) {
    if (t.scene != scene) page << "\n| " << t.scene << " | " << t.title << " |";
    scene = t.scene;
    page << ' ' << cell(t) << " |";
  }
  page << '\n';
}

void write_scale(std::ostream& page, const Report& report) {
  if (report.scale.empty()) return;
  page << "\n## F14: time to the first answer, and memory\n\n"
          "Terrain against an aircraft of 2,000 faces that touches it; one run, so times are good "
          "to some tens of "
          "per cent.\nnearmesh opens an `.spm` file that was baked once (and is in the page "
          "cache); the others are given the "
          "triangles in "
          "memory and build their tree.\nMemory is how much the process grew (peak).\n\n"
          "| system | faces | offline, s | first answer, s | memory, MB |\n|---|---|---|---|---|\n";
  for (const ScaleRow& row : report.scale) {
    char text[160];
    std::snprintf(text, sizeof text, "| %s | %llu | %s | %.3f | %.1f |\n", row.system.c_str(),
                  static_cast<unsigned long long>(row.faces),
                  row.prepare_s > 0 ? std::to_string(row.prepare_s).substr(0, 5).c_str() : "-",
                  row.first_answer_s, static_cast<double>(row.memory_bytes) / 1e6);
    page << text;
  }
}

void write_failures(std::ostream& page, const Report& report) {
  page << "\n## The first failure of each cell\n\n"
          "`stability/failures.csv` has a few more.\n\n| scene | system | case | expected | found "
          "|\n|---|---|---|---|---|\n";
  std::string last;
  for (const Failure& f : report.failures) {
    if (f.scene + f.system == last) continue;
    last = f.scene + f.system;
    page << "| " << f.scene << " | " << f.system << " | " << f.name << " | " << f.expected << " | "
         << f.found << " |\n";
  }
}

std::string page_of(const Report& report) {
  std::ostringstream page;
  page << "# Stability: scenes in which methods fail\n\n"
          "For whoever asks when a collision method gives a wrong answer. Each row is a kind of "
          "scene that is known to be hard, each cell says how\n"
          "many answers were right. Written by `nearmesh-stability`; no cell is typed in.\n\n"
          "![Share of right answers by scene and system](stability.svg)\n\n"
          "Right answers / cases asked. Bold: all right.\n\n";
  write_table(page, report);
  page << R"(
## What counts as right

The truth of a case is computed from the very doubles that every system is given, in exact rational arithmetic over all pairs of
triangles. Touching is contact.

* **Nothing hangs on rounding.** Coordinates are multiples of a power of two within 21 bits of the mesh, and rotations are quarter
  turns. Variants are exact in doubles too: 24 quarter turns, swapped bodies, renumbered vertices and faces, both bodies sheared
  by one random integer matrix. F6 also moves both bodies or their vertices by 2^0 to 2^23 m, and scales by 2^-20 to 2^20.
* **Left out** is what nearmesh cannot resolve: translations off the pair's lattice (a quarter of the finer cell, not below 2^-38 of the
  larger model), turns by other angles where exact touching is asked for, single points closer than 2^-22 m.
* **nearmesh is asked three times** in every case: over the full meshes, from the base by `certify`, and from a random partial state. Two
  answers that differ make the case wrong.
* **"Uncertain" counts as right** and is shown as undecided: it claims nothing. Once the nodes that it names have come, the answer must be
  the truth; that is part of the case.
* **An error instead of an answer is wrong** where there is an answer. CGAL documents that its triangles must not be degenerate and throws
  when one is: "refused".
* **A crash or a hang is a cell**, not the end of the run. Every case runs in a child process of its own, with 10 s of CPU time (60 s
  for large meshes) and 8 GiB of memory.
* **n/a**: the system has no such function at all (no file reader, no limit, no pairs).

| scene | what is asked, and what is right |
|---|---|
| pairs | rows "pairs" ask for the number of touching pairs of triangles, the rows beside them only for contact or not |
| F1 | the others are given the triangles that a client of the stream would hold at that moment; "free" on these is wrong when the full meshes touch |
| F2 | bodies with their insides. FCL and Bullet are asked by their default calls, which know surfaces only; CGAL by the call that it offers for bounded sides |
| F5 | NaN and infinities: only a refusal (an error, an exception) is right. Finite but useless poses (1e308 m, matrices that are no rotations, taken as the affine maps they are), and a mesh of denormal size beside one of metres: refused or answered truly. Translations of denormals or negative zeros: answered. A crash is never right |
| F7 | does b's path, one second of constant velocity (and half a turn), touch a at any time? "Free" is wrong when it hits; "uncertain" as in F1 |
| F8 | every contact point within 2^-16 m of both surfaces, or between them where one is sunk into the other; every normal within 0.15 rad of the true one, the plane's (the facets next to a ball's pole tilt by 0.1) |
| F9 | as F8, normals within 1e-6 rad. The plate is flat at every level, so coarse triangles are as good as fine ones; each system gets those that have come |
| F10 | as F1: a ball stands on a vertex of terrain, which refines and coarsens; "free" on the way is a contact lost |
| F11, F12 | only nearmesh stores bounds, and only it refines |
| F13 | the same case once alone and four times in each of two threads: all answers the same and right |
| F16 | a file must load or be refused as its table says; either is right where the table leaves it open |
| F18 | at most so many pairs are asked for; right when the answer itself tells whether there are more |

## How each system is called

)";
  for (const SystemNote& s : report.systems)
    page << "* **" << s.name << ' ' << s.version << "**: " << s.call << ".\n";
#ifdef __VERSION__
  page << "\nCompiler: " << __VERSION__ << ".\n";
#endif
  write_scale(page, report);
  write_failures(page, report);
  page << R"(
## To make it again

    cmake --build --preset dev --target experiments
    build/dev/bin/nearmesh-stability --out docs
    python3 tests/experiments/stability/plot_stability.py docs/stability/results.csv docs/stability
)";
  return page.str();
}

}  // namespace

std::uint64_t Tally::cases() const {
  return std::accumulate(marks.begin(), marks.end(), std::uint64_t{0});
}

Status write_report(const Report& report, const std::string& folder) {
  const std::string tables = folder + "/stability";
  std::error_code error;
  std::filesystem::create_directories(tables, error);  // a failure shows when files are written
  NEARMESH_RETURN_IF_ERROR(write_file(tables + "/results.csv", results_csv(report)));
  NEARMESH_RETURN_IF_ERROR(write_file(tables + "/failures.csv", failures_csv(report)));
  if (!report.scale.empty())
    NEARMESH_RETURN_IF_ERROR(write_file(tables + "/scale.csv", scale_csv(report)));
  return write_file(folder + "/stability.md", page_of(report));
}

}  // namespace nearmesh::stability
