// SPDX-License-Identifier: Apache-2.0
#include "world_stream.hpp"

#include <malloc.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/resources.hpp"
#include "core/replica/replica.hpp"
#include "core/world/world_source.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/world/world_probe.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "subscriber/peer/session_impl.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using subscriber::Channel;
using subscriber::LocalChannel;
using subscriber::Session;

constexpr double kStep_s = 0.05, kSpeed_mps = 200, kAbove_m = 12;

/// Of this thread.
double cpu_s() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

/// So that a peer can end, and give its memory back, without its publisher. What the publisher
/// does, it does in calls of the peer's: that is counted apart.
class Link final : public Channel {
 public:
  explicit Link(LocalChannel& other, double* publisher_s = nullptr)
      : other_(other), publisher_s_(publisher_s) {}
  [[nodiscard]] wire::SessionId own_id() const override { return other_.own_id(); }
  void send(const wire::RegionSubscription& subscription) override {
    const double start_s = cpu_s();
    other_.send(subscription);
    if (publisher_s_ != nullptr) *publisher_s_ += cpu_s() - start_s;
  }
  void send(const wire::BodyPoses&) override {}
  void send(const wire::BodyDirectory&) override {}
  void send(const wire::ContactReport&) override {}
  [[nodiscard]] Inbox take() override { return other_.take(); }

 private:
  LocalChannel& other_;
  double* publisher_s_;
};

double resident_kb() {
  ::malloc_trim(0);
  return static_cast<double>(resident_memory_bytes()) / 1024;
}

/// A world on disk, how high its ground is, and who serves it beside an aircraft.
struct Served {
  LocalChannel publisher;
  WorldFolder folder;
  WorldProbe heights;
  std::array<double, 2> corner_m{}, sides_m{};  // of the world, along x and y

  static std::unique_ptr<Served> open(const std::string& path) {
    const auto aircraft = test::write_model(test::bake_mesh(generate_aircraft(500, 7), 16));
    auto file = ModelFile::open(aircraft->path());
    auto heights = WorldProbe::open(path);
    auto folder = WorldFolder::open(path);
    if (file.is_ok() && heights.is_ok() && folder.is_ok()) {
      auto served = std::unique_ptr<Served>(
          new Served{{}, std::move(folder).value(), std::move(heights).value()});
      const auto root = served->folder.root();
      if (root.is_ok() &&
          served->publisher.add_model("aircraft", std::move(file).value()).is_ok() &&
          served->publisher.add_world("world", path).is_ok()) {
        const CellBox box = root.value().box();
        const CommonLattice& lattice = served->folder.world().lattice;
        for (std::size_t k = 0; k < 2; ++k) {
          const auto lo = static_cast<double>(box.lo[k]), hi = static_cast<double>(box.hi[k]);
          served->corner_m[k] = lattice.origin_m[k] + std::ldexp(lo, lattice.exponent);
          served->sides_m[k] = std::ldexp(hi - lo, lattice.exponent);
        }
        return served;
      }
    }
    std::fprintf(stderr, "%s: no world that can be served\n", path.c_str());
    return nullptr;
  }
  /// Of the ground; 0 where there is none.
  double height_m(double x, double y) {
    const RayProbe ray{.origin_m = {x, y, 20e3}};
    WorldRayAnswer answer;
    const bool is_hit = heights.probe({}, {&ray, 1}, {&answer, 1}).is_ok() &&
                        answer.ray.status == ProbeStatus::kHit;
    return is_hit ? answer.ray.point_m[2] : 0.0;
  }
};

}  // namespace

bool run_stream(const std::string& folder, int frames) {
  constexpr double kLeg_m = 40e3;
  constexpr int kMostUpdates = 60;
  const std::unique_ptr<Served> served = Served::open(folder);
  if (served == nullptr) return false;
  auto session = std::make_unique<Session>(std::make_unique<Link>(served->publisher));
  const auto ground = session->add_body({.name = "ground", .model = "world"}).value();
  const auto body = session->add_body({.name = "one", .model = "aircraft", .own = true}).value();
  static_cast<void>(session->place_body(ground, {}));
  static_cast<void>(session->watch(body, ground));
  const auto bytes = [&session] {
    return session->stats().header_bytes + session->stats().batch_bytes;
  };
  std::uint64_t before_tile = 0, join_headers = 0, most_tiles = 0;
  int certified = 0, contacts = 0, updates = 0;
  std::printf("frame,updates,tiles,bytes,requests,certified\n");
  for (int frame = 0; frame < frames; ++frame) {
    // There and back in lanes beside each other.
    const double way_m = kSpeed_mps * kStep_s * frame, lane = std::floor(way_m / kLeg_m);
    const bool is_back = std::fmod(lane, 2) != 0;
    const double along_m = is_back ? (lane + 1) * kLeg_m - way_m : way_m - lane * kLeg_m;
    const double across_m = 0.3 * along_m + 500 * lane;
    const double speed_mps = is_back ? -kSpeed_mps : kSpeed_mps;
    Motion motion{.linear_velocity_mps = {speed_mps, 0.3 * speed_mps, 0}};
    motion.pose.translation_m = {along_m, across_m, served->height_m(along_m, across_m) + kAbove_m};
    bool is_certified = false;
    int tries = 0;
    std::size_t tiles = 0;
    for (; tries < kMostUpdates && !is_certified; ++tries) {
      const std::uint64_t had = bytes();
      const auto report =
          session->update(static_cast<std::uint64_t>(frame), kStep_s * frame, {{body, motion}}, 1);
      if (!report.is_ok()) return false;
      is_certified = report.value().all_certified();
      const auto& answer = report.value().answers.front();
      if (answer.world) tiles = answer.world->tiles.size();
      contacts += is_certified && answer.answer.pair_total > 0 ? 1 : 0;
      // The world's record and the aircraft's header come first.
      if (join_headers == 0) join_headers = session->stats().header_bytes;
      if (before_tile == 0 && session->stats().header_bytes > join_headers) before_tile = had;
    }
    updates += tries;
    most_tiles = std::max<std::uint64_t>(most_tiles, tiles);
    certified += is_certified ? 1 : 0;
    if (frame % std::max(frames / 10, 1) == 0)
      std::printf("%d,%d,%zu,%llu,%llu,%d\n", frame, tries, tiles,
                  static_cast<unsigned long long>(bytes()),
                  static_cast<unsigned long long>(session->stats().requests), is_certified ? 1 : 0);
  }
  const std::uint64_t all = bytes();
  const double with_kb = resident_kb();
  session.reset();
  std::printf(
      "# before the first tile %llu bytes; %d frames %llu bytes, %d certified, %d in contact, at "
      "most %llu tiles near, "
      "%.2f updates a frame; peer's memory %.0f KB\n",
      static_cast<unsigned long long>(before_tile), frames, static_cast<unsigned long long>(all),
      certified, contacts, static_cast<unsigned long long>(most_tiles),
      static_cast<double>(updates) / frames, with_kb - resident_kb());
  return true;
}

bool run_low(const std::string& folder, int frames) {
  constexpr int kColumns = 10, kBodies = kColumns * kColumns, kLegs = 5, kMostUpdates = 60;
  const std::unique_ptr<Served> served = Served::open(folder);
  if (served == nullptr) return false;
  double publisher_s = 0;
  Session session(std::make_unique<Link>(served->publisher, &publisher_s));
  const auto ground = session.add_body({.name = "ground", .model = "world"}).value();
  static_cast<void>(session.place_body(ground, {}));
  session.watch_all();
  std::vector<Session::OwnMotion> motions;
  for (int i = 0; i < kBodies; ++i)
    motions.push_back(
        {session.add_body({.name = "a" + std::to_string(i), .model = "aircraft", .own = true})
             .value(),
         {}});
  // Each in a square of the world for itself, to and fro.
  std::vector<double> heights_m(static_cast<std::size_t>(frames) * kBodies);
  const auto place = [&](int body, int step) {
    std::array<double, 3> at{};
    for (std::size_t k = 0; k < 2; ++k) {
      const int square = k == 0 ? body % kColumns : body / kColumns;
      at[k] = served->corner_m[k] + (square + 0.5) * served->sides_m[k] / kColumns +
              (k == 0 ? 1 : 0.3) * kSpeed_mps * kStep_s * (step - frames / 2);
    }
    return at;
  };
  for (int step = 0; step < frames; ++step)
    for (int body = 0; body < kBodies; ++body) {
      const auto at = place(body, step);
      heights_m[static_cast<std::size_t>(step * kBodies + body)] = served->height_m(at[0], at[1]);
    }
  std::vector<double> ms;
  double query_s = 0, broad_s = 0;
  std::uint64_t asked = 0, certified = 0, near = 0, tiles = 0, requests = 0, frame = 0;
  for (int leg = 0; leg < kLegs; ++leg)
    for (int i = 0; i < frames; ++i, ++frame) {
      const int step = leg % 2 == 0 ? i : frames - 1 - i;
      const double speed_mps = leg % 2 == 0 ? kSpeed_mps : -kSpeed_mps;
      for (int body = 0; body < kBodies; ++body) {
        Motion& motion = motions[static_cast<std::size_t>(body)].motion;
        motion.linear_velocity_mps = {speed_mps, 0.3 * speed_mps, 0};
        motion.pose.translation_m = place(body, step);
        motion.pose.translation_m[2] =
            heights_m[static_cast<std::size_t>(step * kBodies + body)] + kAbove_m;
      }
      const bool is_measured = leg > 0;
      bool is_settled = false;
      for (int tries = 0; tries < (is_measured ? 1 : kMostUpdates) && !is_settled; ++tries) {
        publisher_s = 0;
        const std::uint64_t had = session.stats().requests;
        const double start_s = cpu_s();
        const auto report = session.update(frame, kStep_s * static_cast<double>(frame), motions, 1);
        const double took_s = cpu_s() - start_s - publisher_s;
        if (!report.is_ok()) return false;
        is_settled = report.value().all_certified();
        if (!is_measured) continue;
        ms.push_back(took_s * 1e3);
        query_s += report.value().query_s;
        broad_s += report.value().broad_s;
        requests += session.stats().requests - had;
        near += report.value().answers.size();
        for (const auto& answer : report.value().answers) {
          asked += answer.world ? 1U : 0U;
          certified += answer.world && is_certified(answer.answer.status) ? 1U : 0U;
          tiles += answer.world ? answer.world->tiles.size() : 0;
        }
      }
    }
  std::sort(ms.begin(), ms.end());
  const auto count = static_cast<double>(ms.size());
  std::printf("what,bodies,tiles,p50_ms,p99_ms,worst_ms,certified,near_pairs,near_tiles\n");
  std::printf("low,%d,%llu,%.2f,%.2f,%.2f,%.4f,%.1f,%.1f\n", kBodies,
              static_cast<unsigned long long>(served->folder.world().tiles), ms[ms.size() / 2],
              ms[ms.size() * 99 / 100], ms.back(),
              static_cast<double>(certified) / static_cast<double>(asked),
              static_cast<double>(near) / count, static_cast<double>(tiles) / count);
  std::printf("# low: of a frame %.2f ms are queries, %.2f ms the broad phase; %.2f requests\n",
              query_s / count * 1e3, broad_s / count * 1e3, static_cast<double>(requests) / count);
  return true;
}

namespace {

/// What is allocated now.
double heap_bytes() {
  const struct mallinfo2 all = ::mallinfo2();
  return static_cast<double>(all.uordblks + all.hblkhd);
}

std::size_t open_files() {
  const std::filesystem::directory_iterator files("/proc/self/fd");
  return static_cast<std::size_t>(std::distance(begin(files), end(files)));
}

/// All pages of a world, and places of tiles, each of another content.
struct Listed {
  std::vector<ContentHash> pages;
  std::map<ContentHash, WorldEntry> tiles;

  bool add(const WorldFolder& folder, const WorldPage& page) {
    for (const WorldEntry& entry : page.entries) {
      if (page.level == 0) {
        tiles.try_emplace(entry.content, entry);
        continue;
      }
      pages.push_back(entry.content);
      const auto below = folder.page(entry, page.level - 1);
      if (!below.is_ok() || !add(folder, below.value())) return false;
    }
    return true;
  }
};

/// What a peer holds of a world: when it was sent all pages, and later, when for long enough
/// nothing was near but a body low over one tile.
struct HeldPages {
  double all_bytes = 0, later_bytes = 0;
};
HeldPages measure_pages(const WorldFolder& folder, const Listed& listed) {
  constexpr double kReach_m = 150;  // of a fast body: half a second of flight
  const double before = heap_bytes();
  auto world = subscriber::PeerWorld::from_record(folder.name(), encode_world(folder.world()));
  for (const ContentHash& page : listed.pages)
    static_cast<void>(world.value().take_page(page, folder.page_bytes(page).value()));
  HeldPages held{.all_bytes = heap_bytes() - before};
  const CellBox tile = listed.tiles.begin()->second.box();
  GridBox body;
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    body.lo[k] = body.hi[k] = static_cast<std::int32_t>((tile.lo[axis] + tile.hi[axis]) / 2);
  }
  const Grid grid = world_grid(folder.world());
  const auto reach = static_cast<std::uint32_t>(std::ldexp(kReach_m, -grid.exponent));
  static_cast<void>(world.value().tiles_around(make_relative_frame(grid, {}, grid, {}), body, reach,
                                               2 * subscriber::kUnused_s));
  world.value().give_up(2 * subscriber::kUnused_s, subscriber::kUnused_s);
  held.later_bytes = heap_bytes() - before;
  return held;
}

/// What a peer holds that has an aircraft for each tile, so many of them low over theirs and the
/// others far above.
struct HeldByPeer {
  double bytes = 0;
  std::uint64_t splits = 0;
};
std::optional<HeldByPeer> measure_held(const std::string& folder,
                                       const std::vector<WorldEntry>& tiles, std::size_t low) {
  constexpr int kMostUpdates = 400;
  const std::unique_ptr<Served> served = Served::open(folder);
  if (served == nullptr) return std::nullopt;
  auto session = std::make_unique<Session>(std::make_unique<Link>(served->publisher));
  const auto ground = session->add_body({.name = "ground", .model = "world"}).value();
  static_cast<void>(session->place_body(ground, {}));
  session->watch_all();
  const CommonLattice& lattice = served->folder.world().lattice;
  std::vector<Session::OwnMotion> motions;
  for (const WorldEntry& tile : tiles) {
    const CellBox box = tile.box();
    Motion motion;
    for (std::size_t k = 0; k < 2; ++k)
      motion.pose.translation_m[k] =
          lattice.origin_m[k] +
          std::ldexp(static_cast<double>(box.lo[k] + box.hi[k]) / 2, lattice.exponent);
    const auto& at = motion.pose.translation_m;
    motion.pose.translation_m[2] =
        motions.size() < low ? served->height_m(at[0], at[1]) + kAbove_m : 20e3;
    motion.linear_velocity_mps = {kSpeed_mps, 0, 0};
    const std::string name = "a" + std::to_string(motions.size());
    motions.push_back(
        {session->add_body({.name = name, .model = "aircraft", .own = true}).value(), motion});
  }
  bool is_certified = false;
  std::uint64_t frame = 0, had = 0;
  for (int quiet = 0; quiet < 20 && frame < kMostUpdates;) {  // as long as something comes
    const auto report = session->update(frame++, 0, motions, 1);
    if (!report.is_ok()) return std::nullopt;
    is_certified = report.value().all_certified();
    const std::uint64_t requests = session->stats().requests;
    quiet = std::exchange(had, requests) == requests ? quiet + 1 : 0;
  }
  if (!is_certified) return std::nullopt;
  // All that goes with the session: what the publisher has opened stays.
  const std::uint64_t splits = session->stats().held_splits;
  const double with_bytes = 1024 * resident_kb();
  session.reset();
  return HeldByPeer{with_bytes - 1024 * resident_kb(), splits};
}

}  // namespace

bool run_memory(const std::string& folder) {
  constexpr std::size_t kTiles = 32;
  static_cast<void>(WorldSource::open(folder));  // what libraries keep of a first use is no tile's
  const std::size_t files_before = open_files();
  double before = heap_bytes();
  const auto source = WorldSource::open(folder);
  const double at_rest = heap_bytes() - before;
  const std::size_t files = open_files() - files_before;
  const std::unique_ptr<Served> served = Served::open(folder);
  if (!source.is_ok() || served == nullptr) return false;
  const auto tile_count = static_cast<double>(served->folder.world().tiles);
  std::printf("what,bytes,of\n");
  std::printf("tile_at_rest_at_publisher,%.2f,%.0f bytes and %zu open files for %.0f tiles\n",
              at_rest / tile_count, at_rest, files, tile_count);
  Listed listed;
  const auto root = served->folder.root();
  listed.pages.push_back(served->folder.world().root);
  if (!root.is_ok() || !listed.add(served->folder, root.value())) return false;
  const HeldPages held = measure_pages(served->folder, listed);
  std::printf("far_tile_whose_page_is_held,%.1f,%zu pages: as many as there are\n",
              held.all_bytes / tile_count, listed.pages.size());
  std::printf("far_tile_at_peer,%.2f,once nothing was near it for %.0f s\n",
              held.later_bytes / tile_count, subscriber::kUnused_s);
  std::vector<WorldEntry> tiles;
  for (const auto& [content, entry] : listed.tiles)
    if (tiles.size() < kTiles) tiles.push_back(entry);
  if (tiles.size() < 2) return false;
  // Headers alone.
  before = heap_bytes();
  std::vector<Replica> replicas;
  for (const WorldEntry& tile : tiles) {
    const auto file = open_tile(served->folder, tile.content);
    if (!file.is_ok()) return false;
    replicas.push_back(Replica::from_header(file.value().header_bytes()).value());
  }
  std::printf("near_tile_at_peer_header,%.0f,%zu distinct tiles\n",
              (heap_bytes() - before) / static_cast<double>(tiles.size()), tiles.size());
  replicas.clear();
  const auto one = measure_held(folder, tiles, 1), all = measure_held(folder, tiles, tiles.size());
  if (!one || !all) return false;
  const auto more = static_cast<double>(tiles.size() - 1);
  std::printf(
      "near_tile_at_peer,%.0f,1 to %zu distinct tiles below an aircraft; %.0f splits each\n",
      (all->bytes - one->bytes) / more, tiles.size(),
      static_cast<double>(all->splits - one->splits) / more);
  return true;
}

}  // namespace nearmesh
