// SPDX-License-Identifier: Apache-2.0
// What a bake takes and gives, as CSV (metric,value,unit): time by phase, memory, errors and faults
// of the mesh at a tenth of the vertices, beside those of as many faces by meshoptimizer where that
// is installed, size of the file and its header, opening.
//   nearmesh-bench-bake [FACES or MESH FILE] [THREADS]
// Default: a terrain of 1,000,000 faces, on every core.
// A terrain goes through a PLY file, as a user's mesh would. Phases are wall-clock; on a machine
// with other work compare bake_processor_time. What is opened is opened by a process that has done
// nothing else.

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>

#include "core/base/hash.hpp"
#include "core/base/parallel.hpp"
#include "core/base/resources.hpp"
#include "core/base/stopwatch.hpp"
#include "core/demand/collect.hpp"
#include "core/geometry/triangle_overlap.hpp"
#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"
#ifdef NEARMESH_PEER_MESHOPTIMIZER
#include "simplify_peer.hpp"
#endif

using namespace nearmesh;

namespace {

void print(const char* metric, double value, const char* unit) {
  std::printf("%s,%.10g,%s\n", metric, value, unit);
  std::fflush(stdout);
}

template <class T>
T must(Result<T> result) {
  if (!result.is_ok()) {
    std::fprintf(stderr, "%s\n", result.status().message().c_str());
    std::exit(1);
  }
  return std::move(result).value();
}

// ---- the mesh at a tenth of the vertices ----

using Faces = std::vector<std::array<std::uint32_t, 3>>;

/// Faces of some vertices of a mesh, as a tree; a face's key holds its place in `corners`.
struct CoarseMesh {
  CoarseMesh(const GridMesh& mesh, Faces faces) : corners(std::move(faces)) {
    std::vector<TreeFace> placed;
    placed.reserve(corners.size());
    for (const auto& c : corners) {
      TreeFace face{{}, {{}, static_cast<std::uint32_t>(placed.size())}};
      for (std::size_t k = 0; k < 3; ++k) face.corners[k] = mesh.positions[c[k]];
      placed.push_back(face);
    }
    tree = build_triangle_tree(mesh.grid, placed);
  }
  Faces corners;
  TriangleTree tree;
};

/// That the first collapses leave.
Faces coarse_faces(const GridMesh& mesh, const CollapseLog& log, std::size_t vertices_left) {
  const std::size_t n = mesh.positions.size();
  std::vector<std::uint32_t> stands_for(n);
  for (std::uint32_t v = 0; v < n; ++v) stands_for[v] = v;
  std::vector<std::uint32_t> into(stands_for);
  const std::size_t count = std::min(log.collapses.size(), n - std::min(n, vertices_left));
  for (std::size_t i = 0; i < count; ++i) into[log.collapses[i].removed] = log.collapses[i].kept;
  for (std::size_t i = count; i-- > 0;) {
    const std::uint32_t v = log.collapses[i].removed;
    stands_for[v] = stands_for[into[v]];
  }
  Faces faces;
  for (const auto& f : mesh.faces) {
    const std::array<std::uint32_t, 3> c = {stands_for[f[0]], stands_for[f[1]], stands_for[f[2]]};
    if (c[0] != c[1] && c[1] != c[2] && c[2] != c[0]) faces.push_back(c);
  }
  return faces;
}

using Vec = std::array<double, 3>;
Vec minus(const Vec& a, const Vec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
double dot(const Vec& a, const Vec& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vec to_vec(const GridPoint& p) {
  return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
}

double segment_distance2(const Vec& p, const Vec& a, const Vec& b) {
  const Vec d = minus(b, a), w = minus(p, a);
  const double square = dot(d, d);
  const double t = square > 0 ? std::clamp(dot(w, d) / square, 0.0, 1.0) : 0;
  const Vec off = {w[0] - t * d[0], w[1] - t * d[1], w[2] - t * d[2]};
  return dot(off, off);
}

/// Of a point and a triangle: through the plane where the foot lies inside, else through the
/// nearest side.
double face_distance2(const Vec& p, const TreeFace& face) {
  const Vec a = to_vec(face.corners[0]), b = to_vec(face.corners[1]), c = to_vec(face.corners[2]);
  const Vec u = minus(b, a), v = minus(c, a), w = minus(p, a);
  const double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), wu = dot(w, u), wv = dot(w, v);
  const double area2 = uu * vv - uv * uv;
  const double s = vv * wu - uv * wv, t = uu * wv - uv * wu;
  if (area2 > 0 && s >= 0 && t >= 0 && s + t <= area2) {
    const double x = s / area2, y = t / area2;
    const Vec off = {w[0] - x * u[0] - y * v[0], w[1] - x * u[1] - y * v[1],
                     w[2] - x * u[2] - y * v[2]};
    return dot(off, off);
  }
  return std::min(
      {segment_distance2(p, a, b), segment_distance2(p, b, c), segment_distance2(p, c, a)});
}

double box_distance2(const Vec& p, const GridBox& box) {
  double sum = 0;
  for (int k = 0; k < 3; ++k) {
    const double x = p[static_cast<std::size_t>(k)];
    const double off = std::max({box.lo[k] - x, x - box.hi[k], 0.0});
    sum += off * off;
  }
  return sum;
}

/// Distance to the nearest face, at most sqrt(least).
double distance(const TreeView& tree, const Vec& p, double least) {
  struct Open {
    double bound;
    TreeEntry part;
  };
  std::vector<Open> stack{{0, tree.root()}};
  while (!stack.empty()) {
    const Open top = stack.back();
    stack.pop_back();
    if (top.bound >= least) continue;
    if (top.part.kind() == TreeEntry::Kind::kInner) {
      const auto first = static_cast<std::ptrdiff_t>(stack.size());
      tree.for_each_child(top.part, [&](const TreeEntry& child) {
        stack.push_back({box_distance2(p, child.box), child});
      });
      std::sort(stack.begin() + first, stack.end(),
                [](const Open& x, const Open& y) { return x.bound > y.bound; });
    } else {
      tree.for_each_face(top.part, [&](const TreeFace& face) {
        least = std::min(least, face_distance2(p, face));
      });
    }
  }
  return std::sqrt(least);
}

struct Errors {
  double mean = 0, rms = 0, greatest = 0;  // of the diagonal
};

/// From the centre of every face of the full mesh, weighted by its area, to the coarse mesh.
Errors measure_error(const GridMesh& mesh, const CoarseMesh& coarse, unsigned threads) {
  GridBox box;
  for (const GridPoint& p : mesh.positions) box.add(p);
  const Vec extent = minus(to_vec(box.hi), to_vec(box.lo));
  const double diagonal2 = dot(extent, extent);
  constexpr std::size_t kChunk = 4096;
  struct Sum {
    double weight = 0, first = 0, second = 0, greatest = 0;
  };
  std::vector<Sum> sums((mesh.faces.size() + kChunk - 1) / kChunk);
  const TreeView view = coarse.tree.view();
  for_each_index(sums.size(), threads, [&](std::size_t chunk) {
    Sum& sum = sums[chunk];
    const std::size_t end = std::min(mesh.faces.size(), (chunk + 1) * kChunk);
    for (std::size_t f = chunk * kChunk; f < end; ++f) {
      Vec p[3];
      for (std::size_t k = 0; k < 3; ++k) p[k] = to_vec(mesh.positions[mesh.faces[f][k]]);
      const Vec u = minus(p[1], p[0]), v = minus(p[2], p[0]);
      const double area = std::sqrt(std::max(0.0, dot(u, u) * dot(v, v) - dot(u, v) * dot(u, v)));
      const Vec centre = {(p[0][0] + p[1][0] + p[2][0]) / 3, (p[0][1] + p[1][1] + p[2][1]) / 3,
                          (p[0][2] + p[1][2] + p[2][2]) / 3};
      const double d = distance(view, centre, diagonal2);
      sum.weight += area;
      sum.first += area * d;
      sum.second += area * d * d;
      sum.greatest = std::max(sum.greatest, d);
    }
  });
  Sum all;
  for (const Sum& sum : sums) {
    all.weight += sum.weight;
    all.first += sum.first;
    all.second += sum.second;
    all.greatest = std::max(all.greatest, sum.greatest);
  }
  const double diagonal = std::sqrt(diagonal2);
  return {all.first / all.weight / diagonal, std::sqrt(all.second / all.weight) / diagonal,
          all.greatest / diagonal};
}

/// Do the faces share more than their common corners and edges? Exact: each test is one of
/// triangles_overlap, some of them with triangles that are segments or points.
bool cross_each_other(const CoarseMesh& mesh, const TreeFace& x, const TreeFace& y) {
  const auto& cx = mesh.corners[x.key.index];
  const auto& cy = mesh.corners[y.key.index];
  const auto lattice = [](const GridPoint& p, const GridPoint& q, const GridPoint& r) {
    LatticeTriangle t;
    const GridPoint* corners[3] = {&p, &q, &r};
    for (std::size_t k = 0; k < 3; ++k)
      for (int axis = 0; axis < 3; ++axis) t[k][axis] = (*corners[k])[axis];
    return t;
  };
  std::size_t shared = 0, at_x = 0, at_y = 0;  // one that they share; or, of two, the other
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      if (cx[i] == cy[j]) ++shared, at_x = i, at_y = j;
  if (shared == 2) {
    for (std::size_t i = 0; i < 3; ++i) {
      if (std::find(cy.begin(), cy.end(), cx[i]) == cy.end()) at_x = i;
      if (std::find(cx.begin(), cx.end(), cy[i]) == cx.end()) at_y = i;
    }
  }
  const GridPoint &a = x.corners[at_x], &b = x.corners[(at_x + 1) % 3],
                  &c = x.corners[(at_x + 2) % 3];
  const GridPoint &d = y.corners[at_y], &e = y.corners[(at_y + 1) % 3],
                  &f = y.corners[(at_y + 2) % 3];
  const LatticeTriangle whole_x = lattice(a, b, c), whole_y = lattice(d, e, f);
  if (shared == 0) return triangles_overlap(whole_x, whole_y);
  if (shared == 3) return true;
  if (shared == 1)  // whatever they share beside that corner reaches the opposite side of one
    return triangles_overlap(lattice(b, c, c), whole_y) ||
           triangles_overlap(lattice(e, f, f), whole_x);
  // Across an edge they meet elsewhere only when folded flat onto each other.
  if (triangles_overlap(lattice(a, a, a), whole_y) || triangles_overlap(lattice(d, d, d), whole_x))
    return true;
  const GridPoint &p = b, &q = c;
  return triangles_overlap(lattice(a, p, p), lattice(d, q, q)) ||
         triangles_overlap(lattice(a, q, q), lattice(d, p, p));
}

std::size_t count_self_intersecting(const CoarseMesh& mesh, unsigned threads) {
  const TreeView tree = mesh.tree.view();
  std::vector<std::uint8_t> crosses(mesh.corners.size(), 0);  // by key
  for_each_index(tree.blocks.size(), threads, [&](std::size_t block) {
    std::vector<TreeEntry> stack;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {  // unused lanes repeat a face
      const TreeFace face = tree.blocks[block].face(lane);
      std::uint8_t& crossed = crosses[face.key.index];
      GridBox box;
      for (const GridPoint& p : face.corners) box.add(p);
      stack.assign(1, tree.root());
      while (!stack.empty() && crossed == 0) {
        const TreeEntry part = stack.back();
        stack.pop_back();
        if (part.kind() == TreeEntry::Kind::kInner) {
          tree.for_each_child(part, [&](const TreeEntry& child) {
            if (child.box.meets(box)) stack.push_back(child);
          });
          continue;
        }
        tree.for_each_face(part, [&](const TreeFace& other) {
          if (other.key != face.key && cross_each_other(mesh, face, other)) crossed = 1;
        });
      }
    }
  });
  return static_cast<std::size_t>(std::count(crosses.begin(), crosses.end(), 1));
}

/// Edges of more than two faces.
std::size_t count_non_manifold(const Faces& faces) {
  std::vector<std::uint64_t> edges;
  for (const auto& f : faces)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [lo, hi] = std::minmax(f[k], f[(k + 1) % 3]);
      edges.push_back(std::uint64_t{lo} << 32 | hi);
    }
  std::sort(edges.begin(), edges.end());
  std::size_t count = 0;
  for (std::size_t i = 2; i < edges.size(); ++i)
    count += edges[i] == edges[i - 2] && (i == 2 || edges[i] != edges[i - 3]) ? 1 : 0;
  return count;
}

/// Of a terrain: faces whose upper side looks down.
std::size_t count_turned_down(const GridMesh& mesh, const Faces& faces) {
  return static_cast<std::size_t>(std::count_if(faces.begin(), faces.end(), [&](const auto& f) {
    const Vec a = to_vec(mesh.positions[f[0]]);
    const Vec u = minus(to_vec(mesh.positions[f[1]]), a),
              v = minus(to_vec(mesh.positions[f[2]]), a);
    return u[0] * v[1] - u[1] * v[0] < 0;
  }));
}

void print_faults(const GridMesh& mesh, Faces faces, const std::string& whose, bool is_terrain,
                  unsigned threads) {
  const auto say = [&](const char* metric, double value, const char* unit) {
    print((whose + metric).c_str(), value, unit);
  };
  say("faces_at_10_percent", static_cast<double>(faces.size()), "faces");
  say("non_manifold_at_10_percent", static_cast<double>(count_non_manifold(faces)), "edges");
  if (is_terrain)
    say("turned_down_at_10_percent", static_cast<double>(count_turned_down(mesh, faces)), "faces");
  const CoarseMesh coarse(mesh, std::move(faces));
  const Errors errors = measure_error(mesh, coarse, threads);
  say("mean_error_at_10_percent", errors.mean, "diagonals");
  say("rms_error_at_10_percent", errors.rms, "diagonals");
  say("greatest_error_at_10_percent", errors.greatest, "diagonals");
  say("self_intersecting_at_10_percent",
      static_cast<double>(count_self_intersecting(coarse, threads)), "faces");
}

// ---- opening ----

/// Resident pages that belong to this process alone: not those of the file, which the kernel can
/// drop.
double private_memory_bytes() {
  long resident = 0, shared = 0;
  if (std::FILE* file = std::fopen("/proc/self/statm", "r"); file != nullptr) {
    if (std::fscanf(file, "%*d %ld %ld", &resident, &shared) != 2) resident = shared = 0;
    std::fclose(file);
  }
  return static_cast<double>(resident - shared) * static_cast<double>(::sysconf(_SC_PAGESIZE));
}

/// Opens, serves one request and says what that took; `loud` or not, since the first time also
/// loads the program.
void open_model(const std::string& path, bool loud) {
  const auto print = [loud](const char* metric, double value, const char* unit) {
    if (loud) ::print(metric, value, unit);
  };
  const double before = static_cast<double>(resident_memory_bytes());
  const double private_before = private_memory_bytes();
  const auto grown_private = [private_before] { return private_memory_bytes() - private_before; };
  const auto grown = [before] { return static_cast<double>(resident_memory_bytes()) - before; };
  Stopwatch watch;
  ModelFile file = must(ModelFile::open(path));
  print("open", watch.seconds() * 1e3, "ms");
  print("resident_after_open", grown(), "bytes");
  print("private_after_open", grown_private(), "bytes");
  // One request about a 256th of the model's width, as a peer far from everything else makes.
  RegionRequest request{.max_splits = 1024};
  GridBox all;
  for (const BaseRoot& root : file.header().roots) {
    all.add(root.position);
    if (root.node.size > 1) request.attach.push_back(root.node);
  }
  const GridPoint& middle = file.header().roots[file.header().roots.size() / 2].position;
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    const std::int32_t radius = (all.hi[k] - all.lo[k]) / 512 + 1;
    box.lo[k] = middle[k] - radius;
    box.hi[k] = middle[k] + radius;
  }
  request.region.push_back(box);
  watch.lap();
  const Demand demand =
      must(collect(file.store(), request, [&](NodeSpan node) { return file.require(node); }));
  print("first_request", watch.seconds() * 1e3, "ms");
  print("first_request_splits", static_cast<double>(demand.treelet.size()), "splits");
  print("resident_after_request", grown(), "bytes");
  print("private_after_request", grown_private(), "bytes");
}

/// Runs `work` in a process of its own, so that what this one touched does not count.
template <class Work>
void apart(const Work& work) {
  std::fflush(stdout);
  const pid_t child = ::fork();
  if (child == 0) {
    work();
    std::fflush(stdout);
    ::_exit(0);
  }
  int status = 0;
  if (child < 0 || ::waitpid(child, &status, 0) < 0 || status != 0) std::exit(1);
}

void bake_small(const std::string& output) {
  const CleanResult clean = must(clean_mesh(generate_terrain(64, 1)));
  const BakedModel model = must(bake(clean.mesh, clean.report.rounding_error_m, {}));
  must(write_model_file(model.header, model.store, model.numbers, output));
}

void bake_model(const std::string& input, const std::string& output, bool is_terrain,
                unsigned threads) {
  Stopwatch whole, watch;
  IndexedMesh read = must(import_mesh(input));
  print("read", watch.lap(), "s");
  const CleanResult clean = must(clean_mesh(read));
  read = {};
  print("clean", watch.lap(), "s");
  double simplified = 0;
  const BakedModel model = must(bake(clean.mesh, clean.report.rounding_error_m,
                                     {.threads = threads, .on_progress = [&](double share) {
                                        if (share == 1) simplified = watch.seconds();
                                      }}));
  print("simplify", simplified, "s");
  print("number_and_bound", watch.lap() - simplified, "s");
  const WrittenModel written =
      must(write_model_file(model.header, model.store, model.numbers, output, threads));
  print("write", watch.lap(), "s");
  print("bake", whole.seconds(), "s");
  print("bake_processor_time", static_cast<double>(std::clock()) / CLOCKS_PER_SEC, "s");
  print("peak_resident", static_cast<double>(peak_memory_bytes()), "bytes");

  print("faces", static_cast<double>(clean.mesh.faces.size()), "faces");
  print("file", static_cast<double>(written.file_bytes), "bytes");
  print("header", static_cast<double>(written.header_bytes), "bytes");
  print("split", static_cast<double>(written.block_bytes) / model.header.split_count(), "bytes");
  std::uint32_t deepest = 0;
  double depths = 0;
  std::vector<std::uint32_t> depth(model.header.vertex_count);
  for (auto c = model.log.collapses.rbegin(); c != model.log.collapses.rend(); ++c) {
    depth[c->kept] += 1;
    depth[c->removed] = depth[c->kept];
  }
  for (const std::uint32_t d : depth) {
    deepest = std::max(deepest, d);
    depths += d;
  }
  print("forest_depth", deepest, "splits");
  print("forest_depth_mean", depths / model.header.vertex_count, "splits");
  std::printf("content_hash,%s,\n", to_hex(written.content_hash).c_str());

  const Faces faces = coarse_faces(clean.mesh, model.log, clean.mesh.positions.size() / 10);
  print_faults(clean.mesh, faces, "", is_terrain, threads);
#ifdef NEARMESH_PEER_MESHOPTIMIZER
  std::printf("meshoptimizer,%s,\n", meshoptimizer_version().c_str());
  double seconds = 0;
  Faces theirs = simplify_by_meshoptimizer(clean.mesh, faces.size(), seconds);
  print("meshoptimizer_simplify", seconds, "s");
  print_faults(clean.mesh, std::move(theirs), "meshoptimizer_", is_terrain, threads);
#endif
}

}  // namespace

int main(int argc, char** argv) {
  keep_large_heap();  // as nearmesh-model does
  const std::string what = argc > 1 ? argv[1] : "1000000";
  const unsigned threads = argc > 2 ? static_cast<unsigned>(std::strtoul(argv[2], nullptr, 10)) : 0;
  std::uint64_t faces = 0;
  const bool is_count = std::from_chars(what.data(), what.data() + what.size(), faces).ptr ==
                        what.data() + what.size();
  const std::string stem = "/tmp/nearmesh-bench-bake-" + std::to_string(::getpid());
  const std::string mesh = is_count ? stem + ".ply" : what, model = stem + ".spm";
  if (is_count)
    apart([&] {
      const double side = std::sqrt(static_cast<double>(faces) / 2);
      const auto size = static_cast<std::uint32_t>(std::clamp(std::ceil(side), 2.0, 4096.0));
      if (!write_ply(generate_terrain(size, 1), mesh).is_ok()) ::_exit(1);
    });
  apart([&] { bake_model(mesh, model, is_count, threads); });
  if (is_count) std::remove(mesh.c_str());
  apart([&] {
    const std::string small = stem + "-small.spm";
    bake_small(small);
    open_model(small, false);
    std::remove(small.c_str());
    open_model(model, true);
  });
  std::remove(model.c_str());
  return 0;
}
