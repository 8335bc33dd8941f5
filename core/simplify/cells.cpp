// SPDX-License-Identifier: Apache-2.0
// A large mesh is first simplified cell by cell: runs of vertices along the Morton curve, fixed by
// the mesh alone, each small enough for a core's cache and independent of the others, so that any
// number of threads gives the same result. Vertices with a neighbour outside of their cell stay as
// they are; what is left, with its clusters, normals and depths, is one mesh again. Every cell
// stops at the same cost, which samples of the mesh suggest, so that detail is left where a single
// queue would leave it.
#include <atomic>
#include <numeric>
#include <thread>

#include "core/base/parallel.hpp"
#include "simplifier.hpp"

namespace nearmesh::simplification {
namespace {

/// Of vertices: some 3 MB of state while it is worked on.
constexpr std::uint32_t kCellVertices = 1U << 14;
/// A patch of fewer cells is simplified as a whole.
constexpr std::uint32_t kLeastCells = 4;
/// Samples: so many runs of so many vertices.
constexpr std::uint32_t kSamples = 16, kSampleVertices = 2048;
/// About so large a share of the vertices is left by the cells. The queue of the whole mesh must
/// decide where detail matters: the error at a tenth of the vertices is that without cells (within
/// 0.2 % on terrain, closed terrain, aircraft and sphere).
constexpr double kShareLeft = 0.2;
/// A sample is simplified to this share of its faces, and a cell at most to half of that.
constexpr std::uint32_t kLeastShare = 8;

/// Which faces touch which cell: those whose least corner it holds, and those of a lower cell.
struct CellFaces {
  std::vector<std::uint32_t> begin;  ///< by cell, in the patch: faces stand by their least corner
  std::vector<std::uint32_t> below;  ///< faces of lower cells that touch it, by cell
  std::vector<std::uint32_t> below_begin;  ///< in `below`
};

struct Cell {
  Patch rest;
  std::vector<std::uint32_t> place;  ///< in the whole patch, of each vertex of `rest`
  std::vector<Collapse> collapses;
  std::uint64_t work = 0;
};

std::uint32_t cell_of(std::uint32_t vertex) { return vertex / kCellVertices; }
std::uint32_t least_corner(const Face& f) { return *std::ranges::min_element(f.corner); }

/// Calls visit(cell) for each cell but that of the least corner that the face touches.
template <class Visit>
void visit_cells_above(const Face& f, const Visit& visit) {
  std::array<std::uint32_t, 3> cells{};
  for (std::size_t k = 0; k < 3; ++k) cells[k] = cell_of(f.corner[k]);
  std::ranges::sort(cells);
  for (std::size_t k = 1; k < 3; ++k)
    if (cells[k] != cells[k - 1]) visit(cells[k]);
}

CellFaces sort_faces(const Patch& patch, std::size_t cells) {
  CellFaces faces;
  faces.begin.assign(cells + 1, 0);
  faces.below_begin.assign(cells + 1, 0);
  for (const Face& f : patch.faces) {
    ++faces.begin[cell_of(least_corner(f)) + 1];
    visit_cells_above(f, [&](std::uint32_t cell) { ++faces.below_begin[cell + 1]; });
  }
  std::partial_sum(faces.begin.begin(), faces.begin.end(), faces.begin.begin());
  std::partial_sum(faces.below_begin.begin(), faces.below_begin.end(), faces.below_begin.begin());
  faces.below.resize(faces.below_begin.back());
  std::vector<std::uint32_t> next(faces.below_begin);
  for (std::uint32_t i = 0; i < patch.faces.size(); ++i)
    visit_cells_above(patch.faces[i], [&](std::uint32_t cell) { faces.below[next[cell]++] = i; });
  return faces;
}

/// A cell, or a run of its vertices, cut out with all faces that touch it.
class CutOut {
 public:
  CutOut(const Patch& patch, const CellFaces& faces, std::uint32_t cell, std::uint32_t first,
         std::uint32_t own)
      : first_(first), own_(own) {
    const auto add_own = [&](const Face& f) {
      if (std::ranges::any_of(f.corner, [this](std::uint32_t c) { return is_own(c); })) add(f);
    };
    for (std::uint32_t i = faces.begin[cell]; i < faces.begin[cell + 1]; ++i)
      add_own(patch.faces[i]);
    const std::size_t inner = part_.faces.size();
    for (std::uint32_t i = faces.below_begin[cell]; i < faces.below_begin[cell + 1]; ++i)
      add_own(patch.faces[faces.below[i]]);
    below_ = part_.faces.size() - inner;
    number_corners();
    part_.code_shift = patch.code_shift;
    const std::size_t count = own_ + outside_.size();
    part_.vertices.reserve(count);
    part_.number.reserve(count);
    if (!patch.clusters.empty()) part_.clusters.reserve(count);
    for (std::uint32_t i = 0; i < count; ++i) {
      const std::uint32_t from = place(i);
      part_.vertices.push_back(patch.vertices[from]);
      part_.number.push_back(patch.number[from]);
      if (!patch.clusters.empty()) part_.clusters.push_back(patch.clusters[from]);
    }
    faces_ = part_.faces.size();
  }

  /// Once. A cell stops at `least_share`-th of its faces.
  [[nodiscard]] Simplifier start(std::uint32_t least_share) {
    return {std::move(part_), own_, faces_ / least_share};
  }
  [[nodiscard]] Cell finish(Simplifier& simplifier) const {
    Cell cell;
    cell.collapses = simplifier.collapses();
    cell.work = simplifier.work();
    cell.rest = simplifier.take_rest(own_, cell.place);
    // Faces across the border are locked, so those of lower cells still stand last.
    cell.rest.faces.resize(cell.rest.faces.size() - below_);
    for (Face& f : cell.rest.faces)
      for (std::uint32_t& c : f.corner) c = place(c);
    for (std::uint32_t& v : cell.place) v += first_;
    return cell;
  }

 private:
  [[nodiscard]] bool is_own(std::uint32_t vertex) const { return vertex - first_ < own_; }
  [[nodiscard]] std::uint32_t place(std::uint32_t local) const {
    return local < own_ ? first_ + local : outside_[local - own_];
  }
  void add(const Face& f) {
    part_.faces.push_back(f);
    for (const std::uint32_t c : f.corner)
      if (!is_own(c)) outside_.push_back(c);
  }
  void number_corners() {
    std::ranges::sort(outside_);
    outside_.erase(std::unique(outside_.begin(), outside_.end()), outside_.end());
    for (Face& f : part_.faces)
      for (std::uint32_t& c : f.corner)
        c = is_own(c) ? c - first_
                      : own_ + static_cast<std::uint32_t>(std::ranges::lower_bound(outside_, c) -
                                                          outside_.begin());
  }

  std::uint32_t first_, own_;
  std::size_t below_ = 0;  ///< faces of lower cells, the last ones
  std::size_t faces_ = 0;
  std::vector<std::uint32_t> outside_;  ///< corners of other cells, ascending
  Patch part_;
};

std::uint32_t size_of(const Patch& patch, std::uint32_t cell) {
  return std::min(kCellVertices,
                  static_cast<std::uint32_t>(patch.vertices.size()) - cell * kCellVertices);
}

/// The rank at which about kShareLeft of the vertices would be left.
std::uint32_t find_limit(const Patch& patch, const CellFaces& faces, std::uint32_t cells,
                         unsigned threads, std::uint64_t& work) {
  std::array<std::vector<std::uint32_t>, kSamples> ranks;
  std::array<std::size_t, kSamples> vertices{};
  std::array<std::uint64_t, kSamples> works{};
  for_each_index(kSamples, threads, [&](std::size_t i) {
    const auto cell = static_cast<std::uint32_t>(i * cells / kSamples);
    const std::uint32_t size = size_of(patch, cell), own = std::min(size, kSampleVertices);
    // Here and there in the cells, since few of them hold several.
    const std::uint32_t place = static_cast<std::uint32_t>(i) * 3 % (size / own) * own;
    CutOut cut(patch, faces, cell, cell * kCellVertices + place, own);
    Simplifier simplifier = cut.start(kLeastShare);
    vertices[i] = simplifier.count_free();
    simplifier.collapse_edges(Rule::kAll, kNone, &ranks[i]);
    works[i] = simplifier.work();
    for (std::size_t j = 1; j < ranks[i].size(); ++j)
      ranks[i][j] = std::max(ranks[i][j], ranks[i][j - 1]);
  });
  work = std::accumulate(works.begin(), works.end(), work);
  std::vector<std::uint32_t> all;
  for (const auto& some : ranks) all.insert(all.end(), some.begin(), some.end());
  if (all.empty()) return 0;
  const auto sum =
      static_cast<double>(std::accumulate(vertices.begin(), vertices.end(), std::size_t{0}));
  const auto at = std::min(all.size() - 1, static_cast<std::size_t>(sum * (1 - kShareLeft)));
  std::ranges::nth_element(all, all.begin() + static_cast<std::ptrdiff_t>(at));
  return all[at];
}

/// Cells in their order, their vertices again along the curve and their faces by their least
/// corner.
Patch join(const Patch& whole, std::vector<Cell>& cells) {
  std::vector<std::uint32_t> place(whole.vertices.size(), kNone);
  Patch rest;
  rest.code_shift = whole.code_shift;
  std::uint32_t vertices = 0;
  std::size_t faces = 0;
  for (const Cell& cell : cells) {
    for (const std::uint32_t v : cell.place) place[v] = vertices++;
    faces += cell.rest.faces.size();
  }
  rest.vertices.reserve(vertices);
  rest.number.reserve(vertices);
  rest.clusters.reserve(vertices);
  rest.faces.reserve(faces);
  for (Cell& cell : cells) {
    const Patch& from = cell.rest;
    rest.vertices.insert(rest.vertices.end(), from.vertices.begin(), from.vertices.end());
    rest.number.insert(rest.number.end(), from.number.begin(), from.number.end());
    rest.clusters.insert(rest.clusters.end(), from.clusters.begin(), from.clusters.end());
    const std::size_t first = rest.faces.size();
    for (Face f : from.faces) {
      for (std::uint32_t& c : f.corner) c = place[c];
      rest.faces.push_back(f);
    }
    std::stable_sort(
        rest.faces.begin() + static_cast<std::ptrdiff_t>(first), rest.faces.end(),
        [](const Face& a, const Face& b) { return least_corner(a) < least_corner(b); });
    cell = Cell{};
  }
  return rest;
}

/// Calls the user's function from the user's thread alone, now and then.
class Progress {
 public:
  Progress(const std::function<void(double)>& report, std::size_t pieces)
      : report_(report), pieces_(pieces) {}
  void add_piece() {
    const std::size_t done = ++done_;
    if (!report_ || std::this_thread::get_id() != caller_) return;
    const double share = kShareOfCells * static_cast<double>(done) / static_cast<double>(pieces_);
    if (share < next_) return;
    report_(share);
    next_ = share + 0.01;
  }

 private:
  const std::function<void(double)>& report_;
  const std::thread::id caller_ = std::this_thread::get_id();
  std::size_t pieces_;
  std::atomic<std::size_t> done_ = 0;
  double next_ = 0;
};

}  // namespace

Patch simplify_cells(Patch patch, const SimplifyOptions& options, CollapseLog& log) {
  const std::uint32_t count =
      static_cast<std::uint32_t>((patch.vertices.size() + kCellVertices - 1) / kCellVertices);
  if (count < kLeastCells || patch.faces.size() / (2 * kLeastShare) < options.base_faces)
    return patch;
  const CellFaces faces = sort_faces(patch, count);
  const std::uint32_t limit = find_limit(patch, faces, count, options.threads, log.work);
  std::vector<Cell> cells(count);
  Progress progress(options.on_progress, count);
  for_each_index(count, options.threads, [&](std::size_t i) {
    const auto cell = static_cast<std::uint32_t>(i);
    CutOut cut(patch, faces, cell, cell * kCellVertices, size_of(patch, cell));
    Simplifier simplifier = cut.start(2 * kLeastShare);
    simplifier.collapse_edges(Rule::kAll, limit);
    cells[i] = cut.finish(simplifier);
    progress.add_piece();
  });
  for (const Cell& cell : cells) {
    log.collapses.insert(log.collapses.end(), cell.collapses.begin(), cell.collapses.end());
    log.work += cell.work;
  }
  return join(patch, cells);
}

}  // namespace nearmesh::simplification
