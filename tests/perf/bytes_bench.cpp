// SPDX-License-Identifier: Apache-2.0
// What it takes to certify an answer: bytes, splits, batches and round trips of a peer that starts from the base mesh, and
// what a peer weighs after a flight. CSV rows metric,value,unit:
//   nearmesh-bench-bytes MODEL.spm RADIUS_SHARE [--flight]
// A body of 1,280 faces, a sphere whose radius is a share of the model's largest side, is set down until it touches, in 45
// places; with --flight it also slides along the ground for 200 frames, a fifth of its radius each, in a process of its
// own. Requests are those of a peer's Session; counts are exact, the same in every run. Bytes are payload plus framing:
// `wire` is ours (kBatchFramingBytes), `lean` 76 bytes a batch. Requests are counted apart.

#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <string>

#include "nearmesh/core/base/random.hpp"
#include "nearmesh/core/base/resources.hpp"
#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/refine/replica.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "nearmesh/subscriber/predict.hpp"
#include "random_rotation.hpp"

using namespace nearmesh;

namespace {

constexpr int kPlaces = 45;
constexpr int kFrames = 200;
constexpr double kLeanFramingBytes = 76;
constexpr std::size_t kRegionBoxes = 64;
constexpr std::uint32_t kRequestSplits = 4096;

void row(const std::string& metric, double value, const char* unit) {
  std::printf("%s,%.6g,%s\n", metric.c_str(), value, unit);
}

// ---- body ---------------------------------------------------------------------------------------

// An icosahedron, each face cut in four three times over, on the unit sphere.
IndexedMesh make_ball(double radius_m) {
  IndexedMesh mesh;
  const double g = (1 + std::sqrt(5.0)) / 2;
  mesh.positions_m = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                      {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  mesh.faces = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (int level = 0; level < 3; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middle;
    const auto between = [&](std::uint32_t a, std::uint32_t b) {
      const auto [at, added] = middle.try_emplace(
          std::minmax(a, b), static_cast<std::uint32_t>(mesh.positions_m.size()));
      if (added) {
        auto p = mesh.positions_m[a];
        for (std::size_t k = 0; k < 3; ++k) p[k] = (p[k] + mesh.positions_m[b][k]) / 2;
        mesh.positions_m.push_back(p);
      }
      return at->second;
    };
    std::vector<std::array<std::uint32_t, 3>> faces;
    for (const auto& [a, b, c] : mesh.faces) {
      const std::uint32_t ab = between(a, b), bc = between(b, c), ca = between(c, a);
      faces.insert(faces.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    mesh.faces = std::move(faces);
  }
  for (auto& p : mesh.positions_m) {
    const double length = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    for (double& x : p) x *= radius_m / length;
  }
  return mesh;
}

TriangleTree body_tree(double radius_m) {
  const CleanResult clean = clean_mesh(make_ball(radius_m), 21).value();
  std::vector<TreeFace> faces;
  for (const auto& f : clean.mesh.faces) {
    TreeFace face{{}, {{}, static_cast<std::uint32_t>(faces.size())}};
    for (std::size_t k = 0; k < 3; ++k) face.corners[k] = clean.mesh.positions[f[k]];
    faces.push_back(face);
  }
  return build_triangle_tree(clean.mesh.grid, std::move(faces));
}

// ---- poses --------------------------------------------------------------------------------------

using Vector = std::array<double, 3>;

Vector in_metres(const Grid& grid, const GridPoint& p) {
  Vector at;
  for (std::size_t k = 0; k < 3; ++k) at[k] = grid.origin_m[k] + std::ldexp(p.v[k], grid.exponent);
  return at;
}

double largest_side_m(const SpmHeader& header) {
  GridBox box;
  const SplitStore store(header);
  for (const BaseRoot& root : header.roots) box.add(store.box(root.node));
  std::int32_t side = 0;
  for (int k = 0; k < 3; ++k) side = std::max(side, box.hi[k] - box.lo[k]);
  return std::ldexp(side, header.grid.exponent);
}

PosedPair posed(const Grid& model, const Grid& body, const Pose& pose) {
  return pose_pair(model, {}, "model", body, pose, "body").value();
}

// Sets the body down from outside along a line through `at`: within a thousandth of its radius of letting go.
Pose touching_pose(const TreeView& model, const TreeView& body, const Vector& at,
                   const Vector& away, double radius_m, Pose pose = {}) {
  double in = 0.9 * radius_m, out = 4 * radius_m;  // the point is inside the body, then it is not
  const auto touches = [&](double distance_m) {
    for (std::size_t k = 0; k < 3; ++k) pose.translation_m[k] = at[k] + distance_m * away[k];
    const PosedPair frames = posed(*model.grid, *body.grid, pose);
    return !query(model, frames.a, body, frames.b, {.any = true, .clearance = false}).pairs.empty();
  };
  for (; touches(out); out += radius_m) in = out;
  while (out - in > 1e-3 * radius_m) {
    const double middle = (in + out) / 2;
    (touches(middle) ? in : out) = middle;
  }
  touches(in);
  return pose;
}

std::vector<Pose> touching_poses(const TreeView& model, const TreeView& body,
                                 const SplitStore& store, double radius_m) {
  Random random(11);
  std::vector<Pose> poses;
  const auto full = [&](const Pose& pose) {
    const PosedPair frames = posed(*model.grid, *body.grid, pose);
    return query(model, frames.a, body, frames.b, {.any = true, .clearance = false});
  };
  while (poses.size() < kPlaces) {
    const Vector at = in_metres(*model.grid, store.position({random.below(store.vertex_count())}));
    Vector away{random.between(-1, 1), random.between(-1, 1), random.between(-1, 1)};
    const double length = std::sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2]);
    if (length > 1 || length < 0.1) continue;
    for (double& x : away) x /= length;
    const Pose pose =
        touching_pose(model, body, at, away, radius_m, {.rotation = test::random_rotation(random)});
    if (full(pose).status == AnswerStatus::kContact) poses.push_back(pose);
  }
  return poses;
}

// Along a straight line over a ground whose z is up, set down anew in each frame on the nearest vertex.
std::vector<Pose> flight_poses(const TreeView& model, const TreeView& body, const SplitStore& store,
                               double radius_m) {
  std::vector<Pose> poses;
  const double length_m = 0.2 * radius_m * kFrames;
  for (int i = 0; i < kFrames; ++i) {
    const double x = (static_cast<double>(i) / kFrames - 0.5) * length_m, y = 0.3 * x;
    Vector nearest{1e300, 1e300, 0};
    for (std::uint32_t v = 0; v < store.vertex_count(); ++v) {
      const Vector at = in_metres(*model.grid, store.position({v}));
      if (std::hypot(at[0] - x, at[1] - y) < std::hypot(nearest[0] - x, nearest[1] - y))
        nearest = at;
    }
    poses.push_back(touching_pose(model, body, nearest, {0, 0, 1}, radius_m));
  }
  return poses;
}

// ---- publisher and peer -------------------------------------------------------------------------

using Batches = std::vector<std::vector<std::uint8_t>>;
using Serve = std::function<Batches(const RegionRequest&)>;

Batches serve(ModelFile& file, const RegionRequest& request) {
  if (const Status status = check_request(file.store(), request); !status.is_ok()) {
    std::fprintf(stderr, "%s\n", status.message().c_str());
    std::exit(1);
  }
  const Demand demand =
      collect(
          file.store(), request, [&file](NodeSpan node) { return file.require(node); },
          AttachRule::kAlways)
          .value();
  return encode_batches(file.header(), file.store(), demand.treelet, BoxPolicy::kCutNodes);
}

struct Cost {
  double splits = 0, batches = 0, payload = 0, requests = 0, request_bytes = 0;
  [[nodiscard]] double wire() const {
    return payload + batches * static_cast<double>(kBatchFramingBytes);
  }
  [[nodiscard]] double lean() const { return payload + batches * kLeanFramingBytes; }
};

class Peer {
 public:
  Peer(const SpmHeader& header, const TreeView& body, Serve serve)
      : replica_(header), tree_(replica_.mesh()), body_(body), serve_(std::move(serve)) {}

  // Asks until the answer is certified.
  void certify(const Pose& pose) {
    while (true) {
      const PosedPair frames = posed(replica_.header().grid, *body_.grid, pose);
      const Answer answer = query(view(), frames.a, body_, frames.b);
      if (is_certified(answer.status)) return;
      ask(pose, 0, answer.missing_a, kRequestSplits);
    }
  }
  // Asks once for what the body may meet within a margin; false when nothing is missing.
  bool prefetch(const Pose& pose, double margin_m, std::uint32_t max_splits) {
    return ask(pose, margin_m, {}, max_splits);
  }
  // Whether something is missing within a margin.
  [[nodiscard]] bool lacks(const Pose& pose, double margin_m) const {
    return request(pose, margin_m, {}, 1).has_value();
  }
  [[nodiscard]] TreeView view() const { return tree_.view(replica_.header().grid); }
  [[nodiscard]] AbTreeStats tree_stats() const { return tree_.stats(); }
  Cost cost;

 private:
  [[nodiscard]] std::optional<RegionRequest> request(const Pose& pose, double margin_m,
                                                     std::vector<NodeSpan> missing,
                                                     std::uint32_t max_splits) const {
    const auto region = [&](std::size_t max_parts, std::span<const GridBox> near) {
      return subscriber::swept_region(view(), {}, body_, Motion{.pose = pose}, 0, margin_m,
                                      max_parts, near);
    };
    return subscriber::make_request(replica_.store(), region, std::move(missing), kRegionBoxes,
                                    max_splits);
  }
  bool ask(const Pose& pose, double margin_m, std::vector<NodeSpan> missing,
           std::uint32_t max_splits) {
    const auto next = request(pose, margin_m, std::move(missing), max_splits);
    if (!next) return false;
    ++cost.requests;
    cost.request_bytes += static_cast<double>(8 * next->attach.size() + 40 * next->region.size());
    for (const auto& bytes : serve_(*next)) {
      const SplitBatch batch = decode_batch(replica_.header(), bytes).value();
      const Replica::Applied applied = replica_.apply_batch(batch);
      tree_.update(applied.delta);
      cost.splits += static_cast<double>(applied.delta.split.size());
      cost.payload += static_cast<double>(bytes.size());
      ++cost.batches;
    }
    return true;
  }

  Replica replica_;
  AbTree tree_;
  TreeView body_;
  Serve serve_;
};

// ---- single poses -------------------------------------------------------------------------------

void print_means(const std::string& name, const Cost& sum, double count) {
  row(name + "_lean_bytes", sum.lean() / count, "B");
  row(name + "_wire_bytes", sum.wire() / count, "B");
  row(name + "_payload", sum.payload / count, "B");
  row(name + "_splits", sum.splits / count, "splits");
  row(name + "_batches", sum.batches / count, "batches");
  row(name + "_requests", sum.requests / count, "requests");
  row(name + "_request_bytes", sum.request_bytes / count, "B");
}

void measure_poses(const std::string& path, double radius_share) {
  ModelFile file = ModelFile::open(path).value();
  if (const Status status = file.require_all(); !status.is_ok()) std::exit(1);
  const double radius_m = radius_share * largest_side_m(file.header());
  const TriangleTree body = body_tree(radius_m);
  std::vector<Pose> poses;
  {
    const TriangleTree full = build_full_tree(file.header(), file.store()).value();
    poses = touching_poses(full.view(), body.view(), file.store(), radius_m);
  }
  const Serve here = [&file](const RegionRequest& request) { return serve(file, request); };
  Cost touching, ahead, least;
  double rounds = 0;
  for (const Pose& pose : poses) {
    Peer peer(file.header(), body.view(), here);
    peer.certify(pose);
    const auto add = [&](Cost& sum) {
      sum.splits += peer.cost.splits;
      sum.batches += peer.cost.batches;
      sum.payload += peer.cost.payload;
      sum.requests += peer.cost.requests;
      sum.request_bytes += peer.cost.request_bytes;
    };
    add(touching);
    static_cast<void>(peer.prefetch(pose, 0.5 * radius_m, kRequestSplits));
    add(ahead);
    // What the query itself names, split by split: no answer takes less.
    LocalModel model(file.store(), file.header().grid);
    const PosedPair frames = posed(model.grid, body.grid, pose);
    while (true) {
      const Answer answer = query(model.view(), frames.a, body.view(), frames.b);
      ++rounds;
      if (is_certified(answer.status)) break;
      RefineDelta delta;
      for (const NodeSpan& node : answer.missing_a)
        static_cast<void>(model.mesh.split(file.store().split_of(node), delta));
      model.tree.update(delta);
    }
    for (const auto& bytes : encode_batches(file.header(), file.store(), active_treelet(model.mesh),
                                            BoxPolicy::kCutNodes)) {
      least.payload += static_cast<double>(bytes.size());
      ++least.batches;
    }
    least.splits += model.mesh.split_count();
  }
  print_means("touching", touching, kPlaces);
  print_means("touching_least", least, kPlaces);
  row("touching_least_rounds", rounds / kPlaces, "rounds");
  print_means("lookahead", ahead, kPlaces);
}

// ---- flight -------------------------------------------------------------------------------------

void put(int to, const void* data, std::size_t size) {
  for (const char* p = static_cast<const char*>(data); size > 0;) {
    const ssize_t n = ::write(to, p, size);
    if (n <= 0) std::exit(1);
    p += n;
    size -= static_cast<std::size_t>(n);
  }
}
bool get(int from, void* data, std::size_t size) {
  for (char* p = static_cast<char*>(data); size > 0;) {
    const ssize_t n = ::read(from, p, size);
    if (n <= 0) return false;
    p += n;
    size -= static_cast<std::size_t>(n);
  }
  return true;
}
template <class T>
void put_all(int to, const std::vector<T>& items) {
  const std::uint64_t count = items.size();
  put(to, &count, sizeof count);
  put(to, items.data(), items.size() * sizeof(T));
}
template <class T>
bool get_all(int from, std::vector<T>& items) {
  std::uint64_t count = 0;
  if (!get(from, &count, sizeof count)) return false;
  items.resize(count);
  return get(from, items.data(), items.size() * sizeof(T));
}

void publish(int socket, const std::string& path, double radius_share) {
  ModelFile file = ModelFile::open(path).value();
  const double radius_m = radius_share * largest_side_m(file.header());
  const TriangleTree body = body_tree(radius_m);
  const auto header = file.header_bytes();
  put_all(socket, std::vector<std::uint8_t>(header.begin(), header.end()));
  if (const Status status = file.require_all(); !status.is_ok()) std::exit(1);
  put_all(socket, flight_poses(build_full_tree(file.header(), file.store()).value().view(),
                               body.view(), file.store(), radius_m));
  for (RegionRequest request; get_all(socket, request.attach) && get_all(socket, request.region) &&
                              get(socket, &request.max_splits, sizeof request.max_splits);) {
    const Batches batches = serve(file, request);
    const std::uint64_t count = batches.size();
    put(socket, &count, sizeof count);
    for (const auto& bytes : batches) put_all(socket, bytes);
  }
}

void fly(int socket, double radius_share) {
  std::vector<std::uint8_t> header_bytes;
  std::vector<Pose> poses;
  if (!get_all(socket, header_bytes)) std::exit(1);
  const SpmHeader header = decode_header(header_bytes).value();
  const double radius_m = radius_share * largest_side_m(header);
  const TriangleTree body = body_tree(radius_m);
  if (!get_all(socket, poses)) std::exit(1);
  const double before = static_cast<double>(resident_memory_bytes());
  Peer peer(header, body.view(), [socket](const RegionRequest& request) {
    put_all(socket, request.attach);
    put_all(socket, request.region);
    put(socket, &request.max_splits, sizeof request.max_splits);
    std::uint64_t count = 0;
    if (!get(socket, &count, sizeof count)) std::exit(1);
    Batches batches(count);
    for (auto& bytes : batches)
      if (!get_all(socket, bytes)) std::exit(1);
    return batches;
  });
  std::vector<double> frames;
  for (const Pose& pose : poses) {
    const double start = peer.cost.wire();
    peer.certify(pose);
    if (peer.lacks(pose, 0.25 * radius_m))
      static_cast<void>(peer.prefetch(pose, 0.5 * radius_m, subscriber::kMaxAheadSplits));
    frames.push_back(peer.cost.wire() - start);
  }
  std::sort(frames.begin(), frames.end());
  row("flight_lean_bytes", peer.cost.lean(), "B");
  row("flight_wire_bytes", peer.cost.wire(), "B");
  row("flight_frame_p99", frames[frames.size() * 99 / 100], "B");
  row("flight_frame_worst", frames.back(), "B");
  row("flight_splits", peer.cost.splits, "splits");
  row("flight_batches", peer.cost.batches, "batches");
  row("flight_requests", peer.cost.requests, "requests");
  row("flight_request_bytes", peer.cost.request_bytes, "B");
  row("flight_before", before / 1048576, "MB");
  row("flight_resident", static_cast<double>(resident_memory_bytes()) / 1048576, "MB");
  row("flight_peak", static_cast<double>(peak_memory_bytes()) / 1048576, "MB");
  row("flight_tree", static_cast<double>(peer.tree_stats().bytes) / 1048576, "MB");
  row("flight_exact_faces", static_cast<double>(peer.tree_stats().exact_faces), "faces");
}

// The publisher lives in a process of its own, so that the peer's memory is the peer's alone.
void measure_flight(const std::string& path, double radius_share) {
  int sockets[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, sockets) != 0) std::exit(1);
  std::fflush(stdout);
  const pid_t child = ::fork();
  if (child == 0) {
    ::close(sockets[0]);
    publish(sockets[1], path, radius_share);
    std::_Exit(0);
  }
  ::close(sockets[1]);
  fly(sockets[0], radius_share);
  ::close(sockets[0]);
  ::waitpid(child, nullptr, 0);
}

}  // namespace

int main(int argc, char** argv) {
  const bool flight = argc == 4 && std::strcmp(argv[3], "--flight") == 0;
  if (argc != 3 && !flight) {
    std::fprintf(stderr, "usage: nearmesh-bench-bytes MODEL.spm RADIUS_SHARE [--flight]\n");
    return 2;
  }
  const double radius_share = std::strtod(argv[2], nullptr);
  if (flight) measure_flight(argv[1], radius_share);
  measure_poses(argv[1], radius_share);
  return 0;
}
