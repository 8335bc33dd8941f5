// SPDX-License-Identifier: Apache-2.0
// How each family is made. Most start from a contact that is known, or from the nearest thing to
// one that the lattice allows, and let chance choose on which side of it the pair stands.
#include "overlap_families.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>

#include "lattice_tools.hpp"
#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "random_rotation.hpp"

namespace nearmesh::soak {
namespace {

constexpr std::int64_t kOne = 1;

/// From tiny to the limit, most often about the thresholds between triangles_overlap's paths.
std::int64_t pick_top(Random& random) {
  constexpr int kThresholds[] = {16, 20, 30};
  switch (random.below(4)) {
    case 0:
      return whole(random, 2, 12);
    case 1: {
      const std::int64_t beside = whole(random, -2, 2);
      return (kOne << kThresholds[random.below(3)]) + beside;
    }
    case 2:
      return kMaxExtent - whole(random, 0, 3);
    default:
      return kOne << whole(random, 3, 39);
  }
}

/// Not on a line.
LatticeTriangle proper(Random& random, std::int64_t top) {
  LatticeTriangle t;
  do t = {point(random, top), point(random, top), point(random, top)};
  while (parallel(t[1] - t[0], t[2] - t[0]));
  return t;
}

/// A lattice point of t: corners are moved so that one exists inside, on an edge or at a corner.
LatticePoint point_on(Random& random, LatticeTriangle& t) {
  const std::int64_t parts = whole(random, 1, 5);
  std::int64_t weight[3] = {0, 0, 0};
  for (std::int64_t i = 0; i < parts; ++i) ++weight[random.below(3)];
  LatticePoint at = t[0];
  for (std::size_t i = 1; i < 3; ++i) {
    LatticePoint step = t[i] - t[0];
    for (int k = 0; k < 3; ++k) step[k] /= parts;
    t[i] = t[0] + parts * step;
    at = at + weight[i] * step;
  }
  return at;
}

void shift(LatticeTriangle& t, const LatticePoint& by) {
  for (LatticePoint& p : t) p = p + by;
}

/// Corners onto their line: a segment, whose third corner may be any of its lattice points.
void flatten(Random& random, LatticeTriangle& t) {
  const Primitive p = primitive(t[1] - t[0]);
  t[2] = t[0] + whole(random, 0, p.count) * p.step;
}

// ---- two proper triangles -----------------------------------------------------------------------

/// A corner of b on a's face, or on the lattice plane next to it; b's others to the same side, to
/// the other, or anywhere.
TrianglePair vertex_face_at(Random& random, std::int64_t top) {
  LatticeTriangle a = proper(random, top);
  const LatticePoint u = a[1] - a[0], v = a[2] - a[0];
  LatticePoint w = above_plane(u, v);
  int above = 1;
  if (side(v - u, v, w - u) < 0 || random.below(2)) {
    w = u + v - w;  // the other half of the parallelogram, and below
    above = -1;
  }
  LatticePoint at = a[0] + w;
  if (random.below(3) == 0) {
    at = point_on(random, a);
    above = random.below(2) ? 1 : -1;
  }
  const int wanted = std::array{above, -above, 0}[random.below(3)];
  LatticeTriangle b{at};
  for (std::size_t i = 1; i < 3; ++i)
    for (int tries = 0; tries < 8; ++tries) {
      b[i] = point(random, top);
      if (wanted == 0 || side(u, v, b[i] - a[0]) == wanted) break;
    }
  return {a, b};
}

/// An edge of b across one of a's, at no distance or at the least that the lattice allows; the
/// third corners to both sides, so that nothing else can touch, or swapped.
TrianglePair edge_edge_at(Random& random, std::int64_t top) {
  const std::int64_t reach = std::max<std::int64_t>(1, top / 6);
  LatticePoint u, v;
  do {
    u = offset(random, reach);
    v = offset(random, reach);
  } while (parallel(u, v));
  const LatticePoint w = above_plane(u, v);
  LatticePoint p{}, q = w - v;
  if (random.below(3) == 0) {  // crossing at a lattice point of both
    const std::int64_t m = whole(random, 1, 4), n = whole(random, 1, 4);
    for (int k = 0; k < 3; ++k) {
      u[k] /= m;
      v[k] /= n;
    }
    p = -whole(random, 0, m) * u;
    q = -whole(random, 0, n) * v;
    u = m * u;
    v = n * v;
  }
  const auto third = [&](int wanted) {
    const LatticePoint d = offset(random, reach);
    return side(u, v, d) * wanted < 0 ? LatticePoint{} - d : d;
  };
  const int up = random.below(2) ? 1 : -1;
  return {{p, p + u, p + third(-up)}, {q, q + v, q + third(random.below(8) ? up : -up)}};
}

/// Faces in one plane, or with corners on the two lattice planes beside it.
TrianglePair face_face_at(Random& random, std::int64_t top, bool tilted) {
  const std::int64_t steps = std::min<std::int64_t>(top / 2, whole(random, 1, 6));
  const LatticeTriangle base = proper(random, std::max<std::int64_t>(1, top / steps / 2));
  const LatticePoint u = base[1] - base[0], v = base[2] - base[0], w = above_plane(u, v);
  const auto corner = [&](std::int64_t height) {
    return combination(random, 0, steps, u, v) + height * w;
  };
  const std::int64_t height = random.below(2) ? whole(random, -1, 1) : 0;
  TrianglePair pair;
  for (LatticePoint& p : pair.a) p = corner(0);
  for (LatticePoint& p : pair.b) p = corner(tilted ? whole(random, -1, 1) : height);
  return pair;
}

/// In one plane, b's first corner on a's first edge line, or on the lattice line beside it.
TrianglePair planar_at(Random& random, std::int64_t top) {
  // Few steps of any size along two directions, or many small ones.
  const std::int64_t steps =
      random.below(2) ? std::min<std::int64_t>(top, whole(random, 1, 12)) : top;
  const auto flat = [&] {
    return LatticePoint{{whole(random, 0, steps), whole(random, 0, steps), 0}};
  };
  LatticeTriangle a{flat(), flat(), flat()};
  const LatticePoint edge = a[1] - a[0];
  const Primitive p = primitive(edge);
  TrianglePair pair{a, {flat(), flat(), flat()}};
  if (p.count > 0) {
    const LatticePoint left = left_of_line(edge);
    const std::int64_t gap = whole(random, -1, 1);
    pair.b[0] = a[0] + (gap > 0   ? left
                        : gap < 0 ? p.step - left
                                  : whole(random, -1, p.count + 1) * p.step);
    // The rest mostly across the line from a.
    const LatticePoint up{{0, 0, 1}};
    const int outside = -side(edge, a[2] - a[0], up);
    for (std::size_t i = 1; i < 3; ++i)
      for (int tries = 0; tries < 8 && side(edge, pair.b[i] - a[0], up) != outside; ++tries)
        pair.b[i] = flat();
  }
  // The plane's directions.
  const std::int64_t reach = top / steps / 3;
  LatticePoint u{{1, 0, 0}}, v{{0, 1, 0}};
  if (reach > 0) {
    u = offset(random, reach);
    v = offset(random, reach);
  }
  const int turn = static_cast<int>(random.below(3));
  for (LatticeTriangle* t : {&pair.a, &pair.b})
    for (LatticePoint& q : *t) {
      const LatticePoint placed = q[0] * u + q[1] * v;
      for (int k = 0; k < 3; ++k) q[(k + turn) % 3] = placed[k];
    }
  if (random.below(8) == 0) shift(pair.b, unit_step(random));
  return pair;
}

/// Two lattice points of the triangles meet; then b is moved by up to two units.
TrianglePair near_miss_at(Random& random, std::int64_t top) {
  LatticeTriangle a = proper(random, top / 2), b = proper(random, top / 2);
  const LatticePoint on_a = point_on(random, a);
  shift(b, on_a - (random.below(2) ? point_on(random, b) : b[random.below(3)]));
  shift(b, offset(random, whole(random, 0, 2)));
  return {a, b};
}

/// A small face a, and b with two or three corners far from it, all on a's lattice plane or on
/// those beside it.
TrianglePair small_and_large(Random& random) {
  const std::int64_t top = pick_top(random);
  const std::int64_t size = kOne << random.below(12);
  const LatticeTriangle a = proper(random, std::min(size, top));
  const LatticePoint u = a[1] - a[0], v = a[2] - a[0], w = above_plane(u, v);
  const auto corner = [&](std::int64_t steps) {
    const std::int64_t height = whole(random, -1, 1);
    return a[0] + combination(random, -steps, steps, u, v) + height * w;
  };
  const std::int64_t far = std::max<std::int64_t>(1, top / size / 8);
  return {a, {corner(random.below(2) ? 1 : far), corner(far), corner(far)}};
}

TrianglePair coplanar(Random& random) { return planar_at(random, pick_top(random)); }
TrianglePair nearly_coplanar(Random& random) {
  return face_face_at(random, pick_top(random), true);
}
TrianglePair face_face(Random& random) { return face_face_at(random, pick_top(random), false); }
TrianglePair vertex_face(Random& random) { return vertex_face_at(random, pick_top(random)); }
TrianglePair edge_edge(Random& random) { return edge_edge_at(random, pick_top(random)); }
TrianglePair near_miss(Random& random) { return near_miss_at(random, pick_top(random)); }

/// `count` common corners; half the time b is moved off them by a unit.
TrianglePair shared(Random& random, std::size_t count) {
  const std::int64_t top = pick_top(random);
  TrianglePair pair{proper(random, top), proper(random, top)};
  for (std::size_t i = 0; i < count; ++i) pair.b[i] = pair.a[i];
  if (random.below(2)) shift(pair.b, unit_step(random));
  return pair;
}
TrianglePair shared_vertex(Random& random) { return shared(random, 1); }
TrianglePair shared_edge(Random& random) { return shared(random, 2); }

/// About a unit wide, whatever the length.
LatticeTriangle sliver(Random& random, std::int64_t top, LatticePoint& on_edge) {
  Primitive p{};
  LatticePoint far;
  while (p.count == 0) {
    far = point(random, top);
    const std::int64_t parts = whole(random, 1, 4);
    for (int k = 0; k < 3; ++k) far[k] = far[k] / parts * parts;
    p = primitive(far);
  }
  on_edge = whole(random, 0, p.count) * p.step;
  const LatticePoint third = whole(random, 0, p.count) * p.step;
  return {LatticePoint{}, far, third + offset(random, 1)};
}
TrianglePair slivers(Random& random) {
  const std::int64_t top = pick_top(random) / 2;
  LatticePoint on_a, on_b;
  LatticeTriangle a = sliver(random, top, on_a), b = sliver(random, top, on_b);
  if (random.below(2)) {
    b = proper(random, top);
    on_b = point_on(random, b);
  }
  shift(b, on_a - on_b);
  if (random.below(2)) shift(b, unit_step(random));
  return {a, b};
}

/// Corners of a box, and their neighbours: the largest determinants.
TrianglePair box_corners(Random& random) {
  const std::int64_t top = pick_top(random);
  TrianglePair pair;
  for (LatticeTriangle* t : {&pair.a, &pair.b})
    for (LatticePoint& p : *t)
      for (int k = 0; k < 3; ++k) {
        const std::int64_t from_end = random.below(4) == 0;
        p[k] = random.below(2) ? from_end : top - from_end;
      }
  return pair;
}

// ---- extents at the thresholds ------------------------------------------------------------------

/// The joint extent is, exactly, the threshold or one of its neighbours, or within the 16 times
/// beyond it where a path taken too far would fail.
TrianglePair at_threshold(Random& random, int bits) {
  const std::int64_t threshold = kOne << bits;
  const std::int64_t extent = bits == 40        ? kMaxExtent - whole(random, 0, 3)
                              : random.below(2) ? threshold + whole(random, -2, 2)
                                                : whole(random, threshold, 16 * threshold);
  const std::int64_t top = extent - 2 - (random.below(2) ? whole(random, 0, extent / 2) : 0);
  TrianglePair pair;
  do {
    switch (random.below(4)) {
      case 0:
        pair = vertex_face_at(random, top);
        break;
      case 1:
        pair = edge_edge_at(random, top);
        break;
      case 2:
        pair = planar_at(random, top);
        break;
      default:
        pair = near_miss_at(random, top);
    }
  } while (joint_extent(pair) > extent);
  // The last corner decides nothing by itself in most of these.
  const int axis = static_cast<int>(random.below(3));
  std::int64_t lo = pair.a[0][axis], hi = lo;
  for (const LatticePoint& p : {pair.a[1], pair.a[2], pair.b[0], pair.b[1]}) {
    lo = std::min(lo, p[axis]);
    hi = std::max(hi, p[axis]);
  }
  pair.b[2][axis] = random.below(2) ? lo + extent : hi - extent;
  return pair;
}
TrianglePair extent_16(Random& random) { return at_threshold(random, 16); }
TrianglePair extent_20(Random& random) { return at_threshold(random, 20); }
TrianglePair extent_30(Random& random) { return at_threshold(random, 30); }
TrianglePair extent_40(Random& random) { return at_threshold(random, 40); }

// ---- segments and points ------------------------------------------------------------------------

TrianglePair segment_face(Random& random) {
  TrianglePair pair = random.below(2) ? vertex_face(random) : edge_edge(random);
  if (random.below(6) == 0) pair = coplanar(random);
  flatten(random, pair.b);
  return pair;
}
TrianglePair point_face(Random& random) {
  TrianglePair pair = random.below(4) ? vertex_face(random) : coplanar(random);
  pair.b[1] = pair.b[2] = pair.b[0];
  return pair;
}
TrianglePair segment_segment(Random& random) {
  TrianglePair pair = random.below(3) ? edge_edge(random) : coplanar(random);
  flatten(random, pair.a);
  flatten(random, pair.b);
  return pair;
}
/// On one line or on a parallel beside it.
TrianglePair segments_on_a_line(Random& random) {
  const std::int64_t steps = whole(random, 1, 6);
  const LatticePoint step = point(random, pick_top(random) / steps);
  TrianglePair pair;
  for (LatticeTriangle* t : {&pair.a, &pair.b})
    for (LatticePoint& p : *t) p = whole(random, 0, steps) * step;
  if (random.below(4) == 0) shift(pair.b, unit_step(random));
  return pair;
}
TrianglePair point_segment(Random& random) {
  LatticePoint on;
  TrianglePair pair{sliver(random, pick_top(random), on), {}};
  flatten(random, pair.a);
  if (random.below(4) == 0) {  // a step beyond an end, or the end
    const Primitive p = primitive(pair.a[1]);
    on = random.below(2) ? whole(random, -1, 0) * p.step : pair.a[1] + whole(random, 0, 1) * p.step;
  }
  if (random.below(3) == 0) on = on + unit_step(random);
  pair.b = {on, on, on};
  return pair;
}
TrianglePair point_point(Random& random) {
  const LatticePoint p = point(random, pick_top(random));
  const LatticePoint q = random.below(2) ? p : p + offset(random, 1);
  return {{p, p, p}, {q, q, q}};
}

// ---- posed models -------------------------------------------------------------------------------

GridMesh cleaned(const IndexedMesh& mesh, int bits) {
  Result<CleanResult> clean = clean_mesh(mesh, {.grid_bits = bits});
  if (!clean.is_ok()) {
    std::fprintf(stderr, "%s\n", clean.status().message().c_str());
    std::abort();
  }
  return std::move(clean.value().mesh);
}

PosedFrame random_frame(Random& random, const Grid& grid, int lattice_exp) {
  Pose pose;
  if (random.below(4)) pose.rotation = test::random_rotation(random);
  for (double& x : pose.translation_m) x = random.between(-1e3, 1e3);
  Result<PosedFrame> frame = make_posed_frame(grid, pose, lattice_exp);
  if (!frame.is_ok()) std::abort();
  return frame.value();
}

LatticeTriangle posed_face(const PosedFrame& frame, const GridMesh& mesh, std::uint32_t face) {
  LatticeTriangle t;
  for (std::size_t i = 0; i < 3; ++i) t[i] = pose_point(frame, mesh.positions[mesh.faces[face][i]]);
  return t;
}

/// A face of each under random poses; one body is moved so that a corner of its face, or a place
/// within it, lies within two cells of a place of the other face.
TrianglePair posed(Random& random, const GridMesh& a, const GridMesh& b) {
  const int lattice_exp = lattice_exponent(a.grid, b.grid);
  const PosedFrame frame_a = random_frame(random, a.grid, lattice_exp);
  PosedFrame frame_b = random_frame(random, b.grid, lattice_exp);
  const std::uint32_t face_b = random.below(static_cast<std::uint32_t>(b.faces.size()));
  const LatticeTriangle on_a =
      posed_face(frame_a, a, random.below(static_cast<std::uint32_t>(a.faces.size())));
  LatticeTriangle copy = on_a, at_b = posed_face(frame_b, b, face_b);
  const LatticePoint place_a = point_on(random, copy);
  const LatticePoint place_b = random.below(4) ? at_b[0] : point_on(random, at_b);
  const LatticePoint move = place_a - place_b + offset(random, 2);
  for (std::size_t k = 0; k < 3; ++k) frame_b.translation[k] += move.v[k];
  return {on_a, posed_face(frame_b, b, face_b)};
}

TrianglePair sphere_on_terrain(Random& random) {
  static const GridMesh sphere = cleaned(generate_sphere(32, 0), 21);
  static const GridMesh terrain = cleaned(generate_terrain(32, 7), 21);
  return random.below(2) ? posed(random, sphere, terrain) : posed(random, terrain, sphere);
}
TrianglePair sphere_on_sphere(Random& random) {
  static const GridMesh coarse = cleaned(generate_sphere(16, 0), 12);
  static const GridMesh fine = cleaned(generate_sphere(48, 0), 21);
  return random.below(2) ? posed(random, fine, coarse) : posed(random, fine, fine);
}

constexpr Family kFamilies[] = {
    {"coplanar", coplanar},
    {"nearly coplanar", nearly_coplanar},
    {"shared vertex", shared_vertex},
    {"shared edge", shared_edge},
    {"face-face, least gap", face_face},
    {"edge-edge, least gap", edge_edge},
    {"vertex-face, least gap", vertex_face},
    {"small and large", small_and_large},
    {"slivers", slivers},
    {"box corners", box_corners},
    {"random near misses", near_miss},
    {"extent about 2^16", extent_16},
    {"extent about 2^20", extent_20},
    {"extent about 2^30", extent_30},
    {"extent up to 2^40", extent_40},
    {"segment and face", segment_face},
    {"point and face", point_face},
    {"segments crossing", segment_segment},
    {"segments on a line", segments_on_a_line},
    {"point and segment", point_segment},
    {"points", point_point},
    {"posed: sphere, terrain", sphere_on_terrain},
    {"posed: sphere, sphere", sphere_on_sphere},
};

}  // namespace

std::span<const Family> overlap_families() { return kFamilies; }

TrianglePair make_pair(const Family& family, Random& random) {
  TrianglePair pair;
  do pair = family.make(random);
  while (joint_extent(pair) > kMaxExtent);
  for (LatticeTriangle* t : {&pair.a, &pair.b})
    for (std::uint32_t i = 2; i > 0; --i) std::swap((*t)[i], (*t)[random.below(i + 1)]);
  if (random.below(2)) std::swap(pair.a, pair.b);
  return pair;
}

std::int64_t joint_extent(const TrianglePair& pair) {
  std::int64_t extent = 0;
  for (int k = 0; k < 3; ++k) {
    std::int64_t lo = pair.a[0][k], hi = lo;
    for (const LatticeTriangle* t : {&pair.a, &pair.b})
      for (const LatticePoint& p : *t) {
        lo = std::min(lo, p[k]);
        hi = std::max(hi, p[k]);
      }
    extent = std::max(extent, hi - lo);
  }
  return extent;
}

}  // namespace nearmesh::soak
