// SPDX-License-Identifier: Apache-2.0
// What it takes to certify an answer: bytes, splits, batches and round trips of a peer that starts
// from the base mesh, and what a peer weighs after a flight. CSV rows metric,value,unit:
//   nearmesh-bench-bytes MODEL.spm RADIUS_SHARE [--flight]
// A body of 1,280 faces, a sphere whose radius is a share of the model's largest side, is set down
// until it touches, in 45 places; with --flight it also slides along the ground for 200 frames, a
// fifth of its radius each, in a process of its own, where each request says the mean velocity of
// the last ten frames (the body is set down on vertices, so that of one frame swings to both sides
// of its way) and a horizon of ten. Requests are those of a peer's Session that holds the body
// whole; counts are exact, the same in every run. `answer`: the publisher's processor time a
// request; `mirror`: what the memory of a peer's state takes there, and while it sleeps. Bytes are
// payload plus framing: `wire` is ours (kBatchFramingBytes), `lean` 76 bytes a batch. Requests are
// counted apart.

#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <functional>
#include <list>
#include <string>

#include "core/base/resources.hpp"
#include "core/certificate/certificate.hpp"
#include "core/query/lacking_ahead.hpp"
#include "core/replica/held_nodes.hpp"
#include "core/replica/replica.hpp"
#include "core/spm/packed_certificate.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "served.hpp"
#include "touching.hpp"

using namespace nearmesh;
using namespace nearmesh::perf;

namespace {

constexpr int kPlaces = 45;
constexpr int kFrames = 200;
constexpr std::size_t kMeanFrames = 10;
constexpr double kLeanFramingBytes = 76;
constexpr double kFrame_s = 0.02, kHorizon_s = 10 * kFrame_s;

void row(const std::string& metric, double value, const char* unit) {
  std::printf("%s,%.6g,%s\n", metric.c_str(), value, unit);
}

// ---- publisher and peer -------------------------------------------------------------------------

using Batches = std::vector<std::vector<std::uint8_t>>;
using Serve = std::function<Batches(const CertificateRequest&)>;

/// The body, of which both sides hold all.
struct Ball {
  explicit Ball(double radius_m) : served(bake_ball(radius_m)), whole(served.whole()) {}
  static BakedModel bake_ball(double radius_m) {
    const CleanResult clean = clean_mesh(make_ball(radius_m)).value();
    return bake(clean.mesh, clean.report.rounding_error_m, {}).value();
  }
  [[nodiscard]] TreeView view() const { return whole->model().view(); }

  Served served;
  std::shared_ptr<Mirror> whole;
};

/// One that serves one peer.
class Publisher {
 public:
  Publisher(ModelFile& file, const Ball& ball)
      : ball_(ball), mirror_(std::make_shared<Mirror>(test::lent(file))) {}

  Batches answer(const CertificateRequest& request) {
    if (request.models[0].state != mirror_->state()) std::abort();
    const double start_s = processor_s();
    CertificateMaker maker(request, {mirror_, ball_.whole});
    Batches batches;
    while (!maker.is_done())
      for (auto& bytes : maker.next().value().batches) {
        seal_batch(mirror_->file().header().content, bytes);
        batches.push_back(std::move(bytes));
      }
    spent_s += processor_s() - start_s;
    return batches;
  }

  /// What the mirror takes while it sleeps.
  [[nodiscard]] double asleep_bytes() const {
    return static_cast<double>(held_nodes(mirror_->model().mesh).bits.size());
  }

  double spent_s = 0;

 private:
  static double processor_s() {
    return static_cast<double>(std::clock()) / static_cast<double>(CLOCKS_PER_SEC);
  }

  const Ball& ball_;
  std::shared_ptr<Mirror> mirror_;
};

struct Cost {
  double splits = 0, batches = 0, payload = 0, requests = 0, request_bytes = 0;
  [[nodiscard]] double wire() const {
    return payload + batches * static_cast<double>(kBatchFramingBytes);
  }
  [[nodiscard]] double lean() const { return payload + batches * kLeanFramingBytes; }
};

class Peer {
 public:
  Peer(const SpmHeader& header, const Ball& ball, Serve serve)
      : replica_(header), ball_(ball), body_(ball.view()), serve_(std::move(serve)) {}

  // Asks until the answer is certified, for the horizon too.
  void certify(const Motion& motion, double horizon_s) {
    while (!is_certified_at(motion.pose)) ask(motion, horizon_s);
  }
  // As a session: where the nearest quarter of the horizon lacks something, all of it is asked for.
  void look_ahead(const Motion& motion) {
    if (!lacking_ahead(view(), {}, "model", body_, motion, "body", kHorizon_s / 4, 0)
             .value()
             .is_nothing())
      ask(motion, kHorizon_s);
  }
  [[nodiscard]] TreeView view() const { return replica_.view(); }
  [[nodiscard]] AbTreeStats tree_stats() const { return replica_.tree().stats(); }
  Cost cost;

 private:
  [[nodiscard]] bool is_certified_at(const Pose& pose) const {
    const PosedPair frames = posed(replica_.header().grid, *body_.grid, pose);
    return is_certified(query(view(), frames.a, body_, frames.b).status);
  }
  void ask(const Motion& motion, double horizon_s) {
    CertificateRequest request;
    request.horizon_s = static_cast<float>(horizon_s);
    request.models = {{replica_.header().content, replica_.mesh().state_hash(), {}},
                      {ball_.served.file().content_hash(), ball_.whole->state(), {}}};
    request.pairs = {relative({}, motion)};
    request.pairs[0].b = 1;
    ++cost.requests;
    cost.request_bytes += static_cast<double>(pack_certificate(request).size());
    for (const auto& bytes : serve_(request)) {
      const std::uint32_t before = replica_.mesh().split_count();
      if (!replica_.take(bytes).status.is_ok()) std::abort();
      cost.splits += replica_.mesh().split_count() - before;
      cost.payload += static_cast<double>(bytes.size());
      ++cost.batches;
    }
  }

  Replica replica_;
  const Ball& ball_;
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
  const Ball ball(radius_m);
  const TreeView body = ball.view();
  std::vector<TouchingPlace> places;
  {
    const TriangleTree full = build_full_tree(file.header(), file.store()).value();
    places = touching_poses(full.view(), body, file.store(), radius_m, kPlaces);
  }
  Cost touching, least;
  double rounds = 0, spent_s = 0, asleep_bytes = 0;
  std::list<Publisher> publishers;  // kept for their memory
  const std::uint64_t before = resident_memory_bytes();
  for (const auto& [pose, away] : places) {
    Publisher& publisher = publishers.emplace_back(file, ball);
    Peer peer(file.header(), ball, [&publisher](const CertificateRequest& request) {
      return publisher.answer(request);
    });
    peer.certify({.pose = pose}, 0);
    spent_s += publisher.spent_s;
    asleep_bytes += publisher.asleep_bytes();
  }
  row("touching_answer", 1e3 * spent_s / kPlaces, "ms");
  row("touching_mirror", static_cast<double>(resident_memory_bytes() - before) / 1024 / kPlaces,
      "kB");
  row("touching_mirror_asleep", asleep_bytes / kPlaces, "B");
  for (const auto& [pose, away] : places) {
    Publisher publisher(file, ball);
    Peer peer(file.header(), ball, [&publisher](const CertificateRequest& request) {
      return publisher.answer(request);
    });
    peer.certify({.pose = pose}, 0);
    touching.splits += peer.cost.splits;
    touching.batches += peer.cost.batches;
    touching.payload += peer.cost.payload;
    touching.requests += peer.cost.requests;
    touching.request_bytes += peer.cost.request_bytes;
    // What the query itself names, split by split: no answer takes less.
    LocalModel model(file.store(), file.header().grid);
    const PosedPair frames = posed(model.grid, *body.grid, pose);
    while (true) {
      const Answer answer = query(model.view(), frames.a, body, frames.b);
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
  const Ball ball(radius_m);
  const TreeView body = ball.view();
  const auto header = file.header_bytes();
  put_all(socket, std::vector<std::uint8_t>(header.begin(), header.end()));
  put(socket, &radius_m, sizeof radius_m);
  put_all(socket, flight_poses(build_full_tree(file.header(), file.store()).value().view(), body,
                               file.store(), radius_m, kFrames));
  const std::uint64_t before = resident_memory_bytes();
  Publisher publisher(file, ball);
  double requests = 0;
  for (std::vector<std::uint8_t> bytes; get_all(socket, bytes); ++requests) {
    const Batches batches = publisher.answer(unpack_certificate(bytes).value());
    const std::uint64_t count = batches.size();
    put(socket, &count, sizeof count);
    for (const auto& batch : batches) put_all(socket, batch);
  }
  row("flight_answer", 1e3 * publisher.spent_s / requests, "ms");
  row("flight_mirror", static_cast<double>(resident_memory_bytes() - before) / 1024, "kB");
  row("flight_mirror_asleep", publisher.asleep_bytes(), "B");
  std::fflush(stdout);
}

void fly(int socket) {
  std::vector<std::uint8_t> header_bytes;
  std::vector<Pose> poses;
  double radius_m = 0;
  if (!get_all(socket, header_bytes) || !get(socket, &radius_m, sizeof radius_m)) std::exit(1);
  const SpmHeader header = decode_header(header_bytes).value();
  const Ball ball(radius_m);
  if (!get_all(socket, poses)) std::exit(1);
  const double before = static_cast<double>(resident_memory_bytes());
  Peer peer(header, ball, [socket](const CertificateRequest& request) {
    put_all(socket, pack_certificate(request));
    std::uint64_t count = 0;
    if (!get(socket, &count, sizeof count)) std::exit(1);
    Batches batches(count);
    for (auto& bytes : batches)
      if (!get_all(socket, bytes)) std::exit(1);
    return batches;
  });
  std::vector<double> frames;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double start = peer.cost.wire();
    Motion motion{.pose = poses[i]};
    const std::size_t since = i < kMeanFrames ? 0 : i - kMeanFrames;
    for (std::size_t axis = 0; axis < 3 && i > 0; ++axis)
      motion.linear_velocity_mps[axis] =
          (poses[i].translation_m[axis] - poses[since].translation_m[axis]) /
          (kFrame_s * static_cast<double>(i - since));
    peer.certify(motion, kHorizon_s);
    peer.look_ahead(motion);
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
