// SPDX-License-Identifier: Apache-2.0
// Writes what examples/world flies: heights that go on without a seam when they are laid side by
// side, and for each peer a scene with its bodies and their trajectories.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

namespace {

constexpr double kSpacing_m = 5, kStep_m = 0.1;

struct Hills {
  double height_m, east_m, north_m;  // and how long a wave is, about
};
constexpr std::array<Hills, 3> kHills{{{200, 14'140, 14'140}, {60, 1'768, 2'828}, {8, 232, 267}}};

/// Heights that go on without a seam when they are laid side by side: hills of several lengths, of
/// which whole numbers fit. No part of the grid is like another.
class Ground {
 public:
  explicit Ground(int cells) : cells_(cells) {
    for (const Hills& hills : kHills) {
      std::vector<double>& east = east_.emplace_back();
      std::vector<double>& north = north_.emplace_back();
      for (int i = 0; i < cells; ++i) {
        east.push_back(hills.height_m * std::sin(phase(i, hills.east_m)));
        north.push_back(std::cos(phase(i, hills.north_m)));
      }
    }
  }
  /// Of the post in a column from the west and a row from the south.
  [[nodiscard]] double height_m(std::int64_t column, std::int64_t row) const {
    const auto i = static_cast<std::size_t>((column % cells_ + cells_) % cells_);
    const auto j = static_cast<std::size_t>((row % cells_ + cells_) % cells_);
    double metres = 300;
    for (std::size_t k = 0; k < east_.size(); ++k) metres += east_[k][i] * north_[k][j];
    return std::round(metres / kStep_m) * kStep_m;
  }
  /// Within a distance of a place, the highest post.
  [[nodiscard]] double top_m(double x_m, double y_m, double around_m) const {
    double top = -1e9;
    const auto first = [&](double at) {
      return static_cast<std::int64_t>((at - around_m) / kSpacing_m);
    };
    const auto last = [&](double at) {
      return static_cast<std::int64_t>((at + around_m) / kSpacing_m) + 1;
    };
    for (std::int64_t j = first(y_m); j <= last(y_m); ++j)
      for (std::int64_t i = first(x_m); i <= last(x_m); ++i) top = std::max(top, height_m(i, j));
    return top;
  }

 private:
  [[nodiscard]] double phase(int at, double length_m) const {
    const auto waves = std::max<std::int64_t>(1, std::llround(cells_ * kSpacing_m / length_m));
    return 2 * std::numbers::pi * static_cast<double>(at * waves % cells_) / cells_;
  }

  int cells_;
  std::vector<std::vector<double>> east_, north_;
};

bool write_heights(const std::filesystem::path& path, const Ground& ground, int cells) {
  std::ofstream out(path, std::ios::binary);
  for (int row = cells; row >= 0; --row)  // the northern one first
    for (int column = 0; column <= cells; ++column) {
      const auto sample =
          static_cast<std::int16_t>(std::lround(ground.height_m(column, row) / kStep_m));
      out.put(static_cast<char>(sample & 0xff)).put(static_cast<char>(sample >> 8));
    }
  out.close();
  return out.good();
}

struct Plan {
  int cells = 7071;  // a side of the heights
  int repeats = 10, peers = 4, bodies = 1000, low = 100, frames = 200;
  double rate_hz = 10;
};

enum class Flight : std::uint8_t { kHigh, kLow, kLowAndTouching };

/// Every body has a square of the world for itself. Those that fly low follow the ground; some
/// touch it for a while. Out: how fast it goes at most, metres a second; none where it cannot be
/// written.
std::optional<double> write_flight(const std::filesystem::path& path, const Ground& ground,
                                   const Plan& plan, int body, Flight flight) {
  constexpr double kSpeed_mps = 150, kAround_m = 20;
  const double world_m = plan.cells * kSpacing_m * plan.repeats;
  const int columns = static_cast<int>(std::ceil(std::sqrt(plan.bodies)));
  const double square_m = world_m / columns;
  const double x0 = (body % columns + 0.5) * square_m - kSpeed_mps * plan.frames / plan.rate_hz / 2;
  const double y_m = (body / columns + 0.5) * square_m;
  std::ofstream out(path);
  out.precision(17);
  out << "QW,QX,QY,QZ,T0,T1,T2\n";
  double before_m = 0, most_mps = kSpeed_mps;
  for (int frame = 0; frame < plan.frames; ++frame) {
    const double x_m = x0 + kSpeed_mps * frame / plan.rate_hz;
    const double way = static_cast<double>(frame) / plan.frames;
    const double dip = flight == Flight::kLowAndTouching && way > 0.4 && way < 0.6
                           ? std::sin((way - 0.4) / 0.2 * std::numbers::pi)
                           : 0;
    const double z_m = flight == Flight::kHigh ? 3000 + body % 50 * 100
                                               : ground.top_m(x_m, y_m, kAround_m) + 12 - 18 * dip;
    if (frame > 0)
      most_mps = std::max(most_mps, std::hypot(kSpeed_mps, (z_m - before_m) * plan.rate_hz));
    before_m = z_m;
    out << "1,0,0,0," << x_m << ',' << y_m << ',' << z_m << '\n';
  }
  out.close();
  return out.good() ? std::optional(most_mps) : std::nullopt;
}

bool write_peer(const std::filesystem::path& folder, const Ground& ground, const Plan& plan,
                int peer) {
  const std::string name = "peer" + std::to_string(peer + 1);
  const std::filesystem::path flights = folder / name;
  std::filesystem::create_directories(flights);
  std::string bodies =
      "bodies:\n  - {name: ground, model: world, pose: {translation: [0, 0, 0]}}\n";
  std::string moves = "moves:\n";
  const int share = plan.bodies / std::max(plan.low, 1);
  for (int body = peer; body < plan.bodies; body += plan.peers) {
    const std::string its = "craft" + std::to_string(body);
    const int which = body / plan.peers;  // of this peer's
    const bool is_low = plan.low > 0 && which % share == 0;
    const Flight flight = !is_low                  ? Flight::kHigh
                          : which / share % 4 == 0 ? Flight::kLowAndTouching
                                                   : Flight::kLow;
    const auto most_mps = write_flight(flights / (its + ".csv"), ground, plan, body, flight);
    if (!most_mps) return false;
    // Where hills are short, who follows them is fast: a scene whose bodies go faster than it says
    // is refused.
    bodies += "  - {name: " + its + ", model: aircraft, max_speed_mps: " +
              std::to_string(std::max(300.0, std::ceil(*most_mps))) + "}\n";
    moves += "  - {body: " + its + ", trajectory: " + name + "/" + its + ".csv}\n";
  }
  std::ofstream out(folder / (name + ".yaml"));
  out << bodies << moves << "pairs: own\nframe_rate_hz: " << plan.rate_hz
      << "\nbudget_ms: 40\nlookahead_s: 0.3\nstart_timeout_s: 120\n";
  out.close();
  return out.good();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Writes heights, scenes and flights of nearmesh's world example.",
               "nearmesh-world-flights"};
  std::string folder;
  Plan plan;
  app.add_option("folder", folder, "Where heights.raw, peer1.yaml and so on go")->required();
  app.add_option("--cells", plan.cells, "A side of the heights; 5 m each")
      ->capture_default_str()
      ->check(CLI::Range(64, 10'000));
  app.add_option("--repeats", plan.repeats, "How often the heights stand in each direction")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  app.add_option("--peers", plan.peers, "Processes")
      ->capture_default_str()
      ->check(CLI::Range(1, 100));
  app.add_option("--bodies", plan.bodies, "Of all peers together")
      ->capture_default_str()
      ->check(CLI::Range(1, 100'000));
  app.add_option("--low", plan.low, "So many of them fly close to the ground")
      ->capture_default_str()
      ->check(CLI::Range(0, 100'000));
  app.add_option("--frames", plan.frames, "Of a flight")
      ->capture_default_str()
      ->check(CLI::Range(1, 100'000));
  app.set_version_flag("--version", "nearmesh-world-flights " NEARMESH_VERSION);
  CLI11_PARSE(app, argc, argv);
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  const Ground ground(plan.cells);
  bool is_written = write_heights(folder + "/heights.raw", ground, plan.cells);
  for (int peer = 0; peer < plan.peers; ++peer)
    is_written = is_written && write_peer(folder, ground, plan, peer);
  if (!is_written)
    std::fprintf(stderr, "nearmesh-world-flights: cannot write in %s\n", folder.c_str());
  return is_written ? 0 : 1;
}
