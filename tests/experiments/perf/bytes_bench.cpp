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
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>

#include "core/base/resources.hpp"
#include "core/replica/replica.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/spm/model_file.hpp"
#include "peer.hpp"
#include "touching.hpp"

using namespace nearmesh;
using namespace nearmesh::perf;

namespace {

constexpr int kPlaces = 45;
constexpr int kFrames = 200;
constexpr double kLeanFramingBytes = 76;

void row(const std::string& metric, double value, const char* unit) {
  std::printf("%s,%.6g,%s\n", metric.c_str(), value, unit);
}

// ---- publisher and peer -------------------------------------------------------------------------

using Serve = std::function<Batches(const RegionRequest&)>;

Batches serve(ModelFile& file, const RegionRequest& request) {
  const Demand demand =
      demand_of(file.store(), request, [&file](NodeSpan node) { return file.require(node); });
  Batches batches =
      encode_batches(file.header(), file.store(), demand.treelet, BoxPolicy::kCutNodes);
  for (auto& bytes : batches) seal_batch(file.header().content, bytes);
  return batches;
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
      : replica_(header), body_(body), serve_(std::move(serve)) {}

  // Asks until the answer is certified.
  void certify(const Pose& pose) {
    while (true) {
      const PosedPair frames = posed(replica_.header().grid, *body_.grid, pose);
      const Answer answer = query(view(), frames.a, body_, frames.b);
      if (is_certified(answer.status)) return;
      ask(pose, 0, answer.missing_a, kRequestSplits, Portion::kLargestNodes);
    }
  }
  // Asks once for what the body may meet within a margin; false when nothing is missing.
  bool prefetch(const Pose& pose, double margin_m, std::uint32_t max_splits, Portion portion) {
    return ask(pose, margin_m, {}, max_splits, portion);
  }
  // Whether something is missing within a margin.
  [[nodiscard]] bool lacks(const Pose& pose, double margin_m) const {
    const TreeView own = view();
    return nearmesh::lacks(replica_.store(), region_around(own, {}, body_, pose, margin_m));
  }
  [[nodiscard]] TreeView view() const { return replica_.view(); }
  [[nodiscard]] AbTreeStats tree_stats() const { return replica_.tree().stats(); }
  Cost cost;

 private:
  [[nodiscard]] std::optional<RegionRequest> request(const Pose& pose, double margin_m,
                                                     std::vector<NodeSpan> missing,
                                                     std::uint32_t max_splits,
                                                     Portion portion) const {
    return next_request(replica_.store(), view(), {}, body_, pose, margin_m, std::move(missing),
                        max_splits, portion);
  }
  bool ask(const Pose& pose, double margin_m, std::vector<NodeSpan> missing,
           std::uint32_t max_splits, Portion portion) {
    const auto next = request(pose, margin_m, std::move(missing), max_splits, portion);
    if (!next) return false;
    ++cost.requests;
    cost.request_bytes += static_cast<double>(request_bytes(*next));
    for (const auto& bytes : serve_(*next)) {
      const std::uint32_t before = replica_.mesh().split_count();
      if (!replica_.take(bytes).status.is_ok()) std::abort();
      cost.splits += replica_.mesh().split_count() - before;
      cost.payload += static_cast<double>(bytes.size());
      ++cost.batches;
    }
    return true;
  }

  Replica replica_;
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
  const double radius_m = radius_share * largest_side_m(file.header(), file.store());
  const TriangleTree body = body_tree(radius_m);
  std::vector<TouchingPlace> places;
  {
    const TriangleTree full = build_full_tree(file.header(), file.store()).value();
    places = touching_poses(full.view(), body.view(), file.store(), radius_m, kPlaces);
  }
  const Serve here = [&file](const RegionRequest& request) { return serve(file, request); };
  Cost touching, ahead, least;
  double rounds = 0;
  for (const auto& [pose, away] : places) {
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
    static_cast<void>(peer.prefetch(pose, 0.5 * radius_m, kRequestSplits, Portion::kLargestNodes));
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
  if (const Status status = file.require_all(); !status.is_ok()) std::exit(1);
  const double radius_m = radius_share * largest_side_m(file.header(), file.store());
  const TriangleTree body = body_tree(radius_m);
  const auto header = file.header_bytes();
  put_all(socket, std::vector<std::uint8_t>(header.begin(), header.end()));
  put(socket, &radius_m, sizeof radius_m);
  put_all(socket, flight_poses(build_full_tree(file.header(), file.store()).value().view(),
                               body.view(), file.store(), radius_m, kFrames));
  for (RegionRequest request; get_all(socket, request.attach) && get_all(socket, request.region) &&
                              get(socket, &request.max_splits, sizeof request.max_splits);) {
    const Batches batches = serve(file, request);
    const std::uint64_t count = batches.size();
    put(socket, &count, sizeof count);
    for (const auto& bytes : batches) put_all(socket, bytes);
  }
}

void fly(int socket) {
  std::vector<std::uint8_t> header_bytes;
  std::vector<Pose> poses;
  double radius_m = 0;
  if (!get_all(socket, header_bytes) || !get(socket, &radius_m, sizeof radius_m)) std::exit(1);
  const SpmHeader header = decode_header(header_bytes).value();
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
      static_cast<void>(peer.prefetch(pose, 0.5 * radius_m, kMaxAheadSplits, Portion::kWholeNodes));
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
  fly(sockets[0]);
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
