// SPDX-License-Identifier: Apache-2.0
// Every step sorts (by a key, then by input number): the result depends on the input alone.
#include "nearmesh/core/mesh/clean.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <optional>
#include <span>

#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "core/geometry/surface.hpp"

namespace nearmesh {
namespace {

using Triple = std::array<std::uint32_t, 3>;

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

// --- input checks ---

std::string describe(const std::array<double, 3>& p) {
  char text[96];
  std::snprintf(text, sizeof text, "(%.17g, %.17g, %.17g)", p[0], p[1], p[2]);
  return text;
}

std::string number(double x) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", x);
  return text;
}

Status invalid(std::string message) { return {StatusCode::kInvalidArgument, std::move(message)}; }

/// One flag a vertex: is it a corner of some face?
Result<std::vector<std::uint8_t>> find_referenced(const IndexedMesh& mesh) {
  std::vector<std::uint8_t> referenced(mesh.positions_m.size(), 0);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::uint32_t v : mesh.faces[f]) {
      if (v >= referenced.size())
        return invalid("face " + std::to_string(f) + ": expected vertex indices below " +
                       std::to_string(referenced.size()) + ", found " + std::to_string(v));
      referenced[v] = 1;
    }
  }
  return referenced;
}

Status check_sizes(const IndexedMesh& mesh, int grid_bits) {
  if (grid_bits < kMinGridBits || grid_bits > kMaxGridBits)
    return invalid("grid_bits: expected " + std::to_string(kMinGridBits) + " to " +
                   std::to_string(kMaxGridBits) + ", found " + std::to_string(grid_bits));
  if (mesh.faces.empty()) return invalid("mesh: expected at least one face, found none");
  // A kept degenerate face may add two vertices.
  if (mesh.positions_m.size() >= kNone / 2 || mesh.faces.size() >= kNone / 4)
    return invalid("mesh: expected fewer than 2^31 vertices and 2^30 faces, found " +
                   std::to_string(mesh.positions_m.size()) + " and " +
                   std::to_string(mesh.faces.size()));
  return Status::ok();
}

struct Bounds {
  std::array<double, 3> lo{}, hi{};
};

Result<Bounds> find_bounds(const IndexedMesh& mesh, const std::vector<std::uint8_t>& referenced) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Bounds bounds{{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}};
  for (std::size_t v = 0; v < referenced.size(); ++v) {
    if (referenced[v] == 0) continue;
    const auto& p = mesh.positions_m[v];
    for (std::size_t k = 0; k < 3; ++k) {
      if (!(std::fabs(p[k]) <= kMaxCoordinate_m))
        return invalid("vertex " + std::to_string(v) +
                       ": expected finite coordinates within 1e150 m, found " + describe(p));
      bounds.lo[k] = std::min(bounds.lo[k], p[k]);
      bounds.hi[k] = std::max(bounds.hi[k], p[k]);
    }
  }
  return bounds;
}

// --- the grid ---

/// x in cells, to the nearest whole cell. Halves go up everywhere, so that a translation by whole
/// cells changes no rounding (F6); adding 0.5 before the floor would round twice.
double nearest_cell(double cells) {
  const double below = std::floor(cells);
  return cells - below >= 0.5 ? below + 1 : below;
}
double nearest_cell(double x, int exponent) { return nearest_cell(std::ldexp(x, -exponent)); }

double first_cell(double lowest, int exponent) { return std::floor(std::ldexp(lowest, -exponent)); }

bool box_fits(const Bounds& bounds, int exponent, int bits) {
  const double last = std::ldexp(1.0, bits) - 1;
  for (std::size_t k = 0; k < 3; ++k)
    if (nearest_cell(bounds.hi[k], exponent) - first_cell(bounds.lo[k], exponent) > last)
      return false;
  return true;
}

int choose_exponent(const Bounds& bounds, int bits) {
  double extent = 0, magnitude = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    extent = std::max(extent, bounds.hi[k] - bounds.lo[k]);
    magnitude = std::max({magnitude, std::fabs(bounds.lo[k]), std::fabs(bounds.hi[k])});
  }
  int scale = 0;
  if (extent == 0) {  // a single point: a cell that holds it exactly
    if (magnitude == 0) return kPointCellExponent;
    std::frexp(magnitude, &scale);
    return std::max(scale - std::numeric_limits<double>::digits, kMinCellExponent);
  }
  // extent lies in [2^(scale-1), 2^scale): the cell 2^(scale-1-bits) is surely too small, and two
  // doublings later the box surely fits.
  std::frexp(extent, &scale);
  int exponent = std::max(scale - bits, kMinCellExponent);
  while (!box_fits(bounds, exponent, bits)) ++exponent;
  return exponent;
}

Grid choose_grid(const Bounds& bounds, int bits) {
  Grid grid;
  grid.exponent = choose_exponent(bounds, bits);
  // A single point needs no room: a grid of metres about it would coarsen the lattice of a small
  // partner.
  grid.bits = bounds.lo == bounds.hi ? kMinGridBits : bits;
  for (std::size_t k = 0; k < 3; ++k)
    grid.origin_m[k] = std::ldexp(first_cell(bounds.lo[k], grid.exponent), grid.exponent);
  return grid;
}

/// The grid on a lattice that other models share.
Result<Grid> grid_on(const CommonLattice& lattice, const Bounds& bounds, int bits) {
  constexpr std::array<const char*, 3> kAxes{"x", "y", "z"};
  if (std::abs(lattice.exponent) > kMaxGridExponent)
    return invalid("lattice: expected a cell of 2^-" + std::to_string(kMaxGridExponent) + " to 2^" +
                   std::to_string(kMaxGridExponent) + " m, found 2^" +
                   std::to_string(lattice.exponent));
  const std::string cell = "cells of 2^" + std::to_string(lattice.exponent) + " m";
  Grid grid{.exponent = lattice.exponent, .bits = bits};
  for (std::size_t k = 0; k < 3; ++k) {
    const double origin = std::ldexp(lattice.origin_m[k], -lattice.exponent);
    if (!is_lattice_place(origin, 0))
      return invalid(std::string("lattice: expected an origin of whole ") + cell +
                     ", within 2^52 of them, found " + number(lattice.origin_m[k]) + " m on " +
                     kAxes[k]);
    const double first = first_cell(bounds.lo[k], lattice.exponent),
                 last = nearest_cell(bounds.hi[k], lattice.exponent);
    if (!(std::fabs(first) <= 0x1p52 &&
          std::fabs(first - origin) <= static_cast<double>(kMaxLatticeCells)))
      return invalid("mesh: expected to begin within 2^31 " + cell +
                     " of the lattice's origin, found " + number(bounds.lo[k]) + " m on " +
                     kAxes[k]);
    if (!(last - first <= std::ldexp(1.0, bits) - 1))
      return invalid("mesh: expected at most 2^" + std::to_string(bits) + " " + cell +
                     " along each axis, found " + number(last - first + 1) + " along " + kAxes[k] +
                     ": take a larger cell, more bits, or smaller parts");
    grid.origin_m[k] = std::ldexp(first, lattice.exponent) + 0.0;  // no -0
    grid.lattice_cells[k] = static_cast<std::int64_t>(first - origin);
  }
  return grid;
}

/// Rounds points to the grid and remembers the greatest rounding error.
class GridRounder {
 public:
  GridRounder(const Grid& grid, const Bounds& bounds)
      : exponent_(grid.exponent), cells_per_m_(std::ldexp(1.0, -grid.exponent)) {
    for (std::size_t k = 0; k < 3; ++k) first_[k] = first_cell(bounds.lo[k], exponent_);
  }

  GridPoint round(const std::array<double, 3>& p) {
    GridPoint point;
    double error = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      // Beyond 2^53 cells from zero every double is whole and the difference of two that lie within
      // 2^31 cells is exact, so that even there nothing depends on rounding.
      const double cells = p[k] * cells_per_m_;  // what ldexp gives: a power of two
      const double cell = nearest_cell(cells);
      const double off = cells - cell;
      error += off * off;
      point.v[k] = static_cast<std::int32_t>(cell - first_[k]);
    }
    greatest_error_ = std::max(greatest_error_, error);
    return point;
  }
  [[nodiscard]] double greatest_error_m() const {
    return std::ldexp(std::sqrt(greatest_error_), exponent_);
  }

 private:
  int exponent_;
  double cells_per_m_;
  std::array<double, 3> first_{};
  double greatest_error_ = 0;  // squared, in cells
};

// --- grouping ---

/// Items grouped by a vertex: those of vertex v are items[start[v] .. start[v+1]).
template <class Item>
struct Grouped {
  std::vector<std::uint32_t> start;
  std::vector<Item> items;

  [[nodiscard]] std::span<Item> of(std::uint32_t v) {
    return std::span<Item>(items).subspan(start[v], start[v + 1] - start[v]);
  }
  [[nodiscard]] std::span<const Item> of(std::uint32_t v) const {
    return std::span<const Item>(items).subspan(start[v], start[v + 1] - start[v]);
  }
};

/// Counting sort by vertex, then each (short) group by its items. `visit(emit)` must call
/// emit(vertex, item) for the same items in the same order each time it is called.
template <class Item, class Visit>
Grouped<Item> group_by_vertex(std::size_t vertex_count, const Visit& visit) {
  Grouped<Item> grouped;
  grouped.start.assign(vertex_count + 1, 0);
  visit([&](std::uint32_t v, const Item&) { ++grouped.start[v + 1]; });
  std::partial_sum(grouped.start.begin(), grouped.start.end(), grouped.start.begin());
  grouped.items.resize(grouped.start.back());
  std::vector<std::uint32_t> next(grouped.start.begin(), grouped.start.end() - 1);
  visit([&](std::uint32_t v, const Item& item) { grouped.items[next[v]++] = item; });
  for (std::uint32_t v = 0; v < vertex_count; ++v) std::ranges::sort(grouped.of(v));
  return grouped;
}

// --- welding ---

/// Fills `mesh.positions` with the distinct grid points of the referenced vertices, in the order of
/// their first appearance, and returns for each input vertex its number there.
std::vector<std::uint32_t> weld(const IndexedMesh& input,
                                const std::vector<std::uint8_t>& referenced, const Bounds& bounds,
                                GridMesh& mesh, CleanReport& report) {
  GridRounder rounder(mesh.grid, bounds);
  std::vector<GridPoint> point_of(referenced.size());
  std::size_t rounded = 0;
  for (std::uint32_t v = 0; v < referenced.size(); ++v) {
    if (referenced[v] == 0) continue;
    point_of[v] = rounder.round(input.positions_m[v]);
    ++rounded;
  }
  report.rounding_error_m = rounder.greatest_error_m();
  report.vertices_unreferenced = referenced.size() - rounded;

  // First each vertex points to the first one at its place, then those are numbered in input order.
  // Groups of a few scattered places are cheaper to sort than all of them; which places share a
  // group decides nothing.
  const std::size_t group_count = std::bit_ceil(rounded);
  auto groups = group_by_vertex<std::uint32_t>(group_count, [&](const auto& emit) {
    for (std::uint32_t v = 0; v < referenced.size(); ++v) {
      if (referenced[v] == 0) continue;
      const GridPoint& p = point_of[v];
      const std::uint64_t xy = static_cast<std::uint32_t>(p[0]) |
                               static_cast<std::uint64_t>(static_cast<std::uint32_t>(p[1])) << 32;
      const std::uint64_t scattered = mix(mix(xy) ^ static_cast<std::uint32_t>(p[2]));
      emit(static_cast<std::uint32_t>(scattered & (group_count - 1)), v);
    }
  });
  std::vector<std::uint32_t> number(referenced.size(), kNone);
  for (std::uint32_t g = 0; g < group_count; ++g) {
    const auto group = groups.of(g);
    std::ranges::sort(group, [&](std::uint32_t a, std::uint32_t b) {
      return point_of[a] != point_of[b] ? point_of[a] < point_of[b] : a < b;
    });
    for (std::size_t i = 0, first = 0; i < group.size(); ++i) {
      if (point_of[group[i]] != point_of[group[first]]) first = i;
      number[group[i]] = group[first];
    }
  }
  for (std::uint32_t v = 0; v < number.size(); ++v) {
    if (number[v] == kNone) continue;
    if (number[v] == v) {
      number[v] = static_cast<std::uint32_t>(mesh.positions.size());
      mesh.positions.push_back(point_of[v]);
    } else {
      number[v] = number[number[v]];  // an earlier vertex, already numbered
    }
  }
  report.vertices_welded = rounded - mesh.positions.size();
  return number;
}

// --- faces and edges ---

enum class FaceFate : std::uint8_t { kKept, kDropped, kSegment, kPoint };

std::size_t distinct_corners(const Triple& f) {
  if (f[0] == f[1] && f[1] == f[2]) return 1;
  return f[0] == f[1] || f[1] == f[2] || f[2] == f[0] ? 2 : 3;
}

Triple ascending(Triple f) {
  std::ranges::sort(f);
  return f;
}

std::vector<FaceFate> sort_out_faces(const std::vector<Triple>& faces) {
  std::vector<FaceFate> fates(faces.size(), FaceFate::kKept);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const std::size_t corners = distinct_corners(faces[f]);
    if (corners < 3) fates[f] = corners == 2 ? FaceFate::kSegment : FaceFate::kPoint;
  }
  return fates;
}

void drop_duplicates(const std::vector<Triple>& faces, std::size_t vertex_count,
                     std::vector<FaceFate>& fates, CleanReport& report) {
  // Item: the two greater corners, then the face number, so that the first of equals comes first.
  const auto groups = group_by_vertex<Triple>(vertex_count, [&](const auto& emit) {
    for (std::uint32_t f = 0; f < faces.size(); ++f) {
      if (fates[f] != FaceFate::kKept) continue;
      const Triple corners = ascending(faces[f]);
      emit(corners[0], Triple{corners[1], corners[2], f});
    }
  });
  for (std::uint32_t v = 0; v < vertex_count; ++v) {
    const auto group = groups.of(v);
    for (std::size_t i = 1; i < group.size(); ++i) {
      if (group[i][0] != group[i - 1][0] || group[i][1] != group[i - 1][1]) continue;
      fates[group[i][2]] = FaceFate::kDropped;
      ++report.faces_duplicate;
    }
  }
}

/// The greater ends of the edges of kept faces, by the lesser end; once a face.
Grouped<std::uint32_t> collect_edges(const std::vector<Triple>& faces, std::size_t vertex_count,
                                     const std::vector<FaceFate>& fates) {
  return group_by_vertex<std::uint32_t>(vertex_count, [&](const auto& emit) {
    for (std::size_t f = 0; f < faces.size(); ++f) {
      if (fates[f] != FaceFate::kKept) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = faces[f][k], b = faces[f][(k + 1) % 3];
        emit(std::min(a, b), std::max(a, b));
      }
    }
  });
}

void count_non_manifold(const Grouped<std::uint32_t>& edges, CleanReport& report) {
  for (std::uint32_t v = 0; v + 1 < edges.start.size(); ++v) {
    const auto group = edges.of(v);
    for (std::size_t i = 0; i < group.size();) {
      std::size_t next = i + 1;
      while (next < group.size() && group[next] == group[i]) ++next;
      if (next - i > 2) ++report.edges_non_manifold;
      i = next;
    }
  }
}

/// Decides which segments and points stay: those no kept face covers, each once, segments before
/// points (a kept segment covers its ends).
void cover_degenerate(const std::vector<Triple>& faces, const Grouped<std::uint32_t>& edges,
                      std::vector<FaceFate>& fates, CleanReport& report) {
  std::vector<std::uint8_t> covered(edges.start.size() - 1, 0);
  std::vector<Triple> segments;  // lesser end, greater end, face
  for (std::uint32_t f = 0; f < faces.size(); ++f) {
    if (fates[f] == FaceFate::kKept)
      for (const std::uint32_t v : faces[f]) covered[v] = 1;
    if (fates[f] == FaceFate::kSegment) {
      const auto [lo, hi] = std::ranges::minmax(faces[f]);
      segments.push_back({lo, hi, f});
    }
  }
  std::ranges::sort(segments);
  const auto settle = [&](std::uint32_t f, bool is_covered) {
    if (is_covered) fates[f] = FaceFate::kDropped;
    ++(is_covered ? report.faces_degenerate_dropped : report.faces_degenerate_kept);
  };
  for (std::size_t i = 0; i < segments.size(); ++i) {
    const auto [lo, hi, f] = segments[i];
    const bool repeats = i > 0 && segments[i - 1][0] == lo && segments[i - 1][1] == hi;
    settle(f, repeats || std::ranges::binary_search(edges.of(lo), hi));
    covered[lo] = covered[hi] = 1;
  }
  for (std::uint32_t f = 0; f < faces.size(); ++f) {
    if (fates[f] != FaceFate::kPoint) continue;
    std::uint8_t& point = covered[faces[f][0]];
    settle(f, point != 0);
    point = 1;
  }
}

void append_kept(const std::vector<Triple>& faces, const std::vector<FaceFate>& fates,
                 GridMesh& mesh) {
  const auto duplicate = [&mesh](std::uint32_t v) {
    mesh.positions.push_back(GridPoint(mesh.positions[v]));
    return static_cast<std::uint32_t>(mesh.positions.size() - 1);
  };
  for (std::uint32_t f = 0; f < faces.size(); ++f) {
    if (fates[f] == FaceFate::kDropped) continue;
    Triple corners = faces[f];
    if (corners[1] == faces[f][0]) corners[1] = duplicate(faces[f][1]);
    if (corners[2] == faces[f][0] || corners[2] == faces[f][1]) corners[2] = duplicate(faces[f][2]);
    mesh.faces.push_back(corners);
    mesh.face_ids.push_back(FaceId{f});
  }
}

}  // namespace

Result<CleanResult> clean_mesh(const IndexedMesh& mesh, const CleanOptions& options) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(check_sizes(mesh, options.grid_bits));
  const auto referenced = find_referenced(mesh);
  NEARMESH_RETURN_IF_ERROR(referenced);
  const auto bounds = find_bounds(mesh, referenced.value());
  NEARMESH_RETURN_IF_ERROR(bounds);

  CleanResult result;
  CleanReport& report = result.report;
  report.vertices_in = mesh.positions_m.size();
  report.faces_in = mesh.faces.size();
  if (options.lattice) {
    const Result<Grid> grid = grid_on(*options.lattice, bounds.value(), options.grid_bits);
    NEARMESH_RETURN_IF_ERROR(grid);
    result.mesh.grid = grid.value();
  } else {
    result.mesh.grid = choose_grid(bounds.value(), options.grid_bits);
  }

  const auto number = weld(mesh, referenced.value(), bounds.value(), result.mesh, report);
  std::vector<Triple> faces(mesh.faces);
  for (Triple& f : faces)
    for (std::uint32_t& v : f) v = number[v];

  const std::size_t vertex_count = result.mesh.positions.size();
  std::vector<FaceFate> fates = sort_out_faces(faces);
  drop_duplicates(faces, vertex_count, fates, report);
  const auto edges = collect_edges(faces, vertex_count, fates);
  count_non_manifold(edges, report);
  cover_degenerate(faces, edges, fates, report);
  append_kept(faces, fates, result.mesh);
  const UnclosedEdges open = count_unclosed_edges(result.mesh.positions, result.mesh.faces);
  report.edges_boundary = open.boundary;
  report.edges_disagreeing = open.disagreeing;
  const std::vector<std::uint32_t> component =
      find_components(result.mesh.positions.size(), result.mesh.faces);
  for (std::uint32_t v = 0; v < component.size(); ++v)
    if (component[v] == v) ++report.components;
  return result;
}

}  // namespace nearmesh
