// SPDX-License-Identifier: Apache-2.0
// Writes the demo's flights: two aircraft over the generated terrain, each with clear frames, near
// misses and touching frames, meeting each other once in the middle. Knows nothing but the
// terrain's generator.

#include <CLI/CLI.hpp>
#include <cmath>
#include <fstream>

#include "nearmesh/core/mesh/generate.hpp"

namespace {

using Point = std::array<double, 3>;

// Heights of the generated terrain: its vertices stand in rows on a square lattice.
class Ground {
 public:
  Ground(std::uint32_t cells, std::uint64_t seed)
      : cells_(cells), mesh_(nearmesh::generate_terrain(cells, seed)) {
    origin_ = mesh_.positions_m.front()[0];
    step_ = mesh_.positions_m[1][0] - origin_;
  }
  /// Highest vertex within `radius_m` of a place.
  [[nodiscard]] double top(double x, double y, double radius_m) const {
    double top = -1e9;
    const int reach = static_cast<int>(radius_m / step_) + 1;
    const int i = cell(x), j = cell(y);
    for (int row = j - reach; row <= j + reach; ++row)
      for (int column = i - reach; column <= i + reach; ++column)
        top = std::max(top, height(column, row));
    return top;
  }

 private:
  [[nodiscard]] int cell(double x) const {
    return static_cast<int>(std::lround((x - origin_) / step_));
  }
  [[nodiscard]] double height(int column, int row) const {
    const int last = static_cast<int>(cells_);
    column = std::clamp(column, 0, last);
    row = std::clamp(row, 0, last);
    return mesh_.positions_m[static_cast<std::size_t>(row) * (cells_ + 1) +
                             static_cast<std::size_t>(column)][2];
  }
  std::uint32_t cells_;
  nearmesh::IndexedMesh mesh_;
  double origin_ = 0, step_ = 1;
};

// Height over the ground's top by frame: clear, near miss, up to the meeting, near miss, touching,
// away.
double clearance_m(int frame, int frames) {
  struct Key {
    double at, height;
  };
  constexpr Key kKeys[] = {{0.00, 120}, {0.10, 100}, {0.20, 9}, {0.30, 8},
                           {0.42, 90},  {0.58, 90},  {0.68, 8}, {0.76, 6},
                           {0.82, -12}, {0.94, -12}, {1.00, 60}};
  const double t = static_cast<double>(frame) / (frames - 1);
  for (std::size_t i = 1; i < std::size(kKeys); ++i) {
    if (t > kKeys[i].at) continue;
    const double s = (t - kKeys[i - 1].at) / (kKeys[i].at - kKeys[i - 1].at);
    return kKeys[i - 1].height + (kKeys[i].height - kKeys[i - 1].height) * s * s * (3 - 2 * s);
  }
  return kKeys[std::size(kKeys) - 1].height;
}

// Both fly along x through the middle of the terrain, in opposite directions; the altitude that
// both use near the meeting is the same, so that they touch there. Every second round goes back the
// same way.
bool write_flight(const std::string& path, const Ground& ground, int frames, int rounds,
                  double rate_hz, double direction) {
  constexpr double kSpeedMps = 160;
  const double middle = ground.top(0, 0, 96) + 140;
  std::ofstream out(path);
  out.precision(17);
  out << "t,R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n";
  for (int n = 0; n < frames * rounds; ++n) {
    const bool is_back = n / frames % 2 == 1;
    const int frame = is_back ? frames - 1 - n % frames : n % frames;
    const double facing = is_back ? -direction : direction;
    const double s = (frame - (frames - 1) / 2.0) / rate_hz;
    const double x = direction * kSpeedMps * s;
    const double along = s * rate_hz / frames * 2;  // -1 .. 1
    const double y = direction * 600 * along * along * along;
    const double meeting = std::max(0.0, 1 - 6 * std::abs(along));
    const double low = ground.top(x, y, 48) + clearance_m(frame, frames);
    const double z = low + (middle - low) * std::min(1.0, 2 * meeting);
    out << n / rate_hz << ',' << facing << ",0,0,0," << facing << ",0,0,0,1," << x << ',' << y
        << ',' << z << '\n';
  }
  out.close();
  return out.good();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Writes the flights of the nearmesh demo.", "nearmesh-demo-flights"};
  std::string folder = ".";
  std::uint32_t cells = 708;
  std::uint64_t seed = 1;
  int frames = 200, rounds = 1;
  double rate_hz = 20;
  app.add_option("folder", folder, "Where flight1.csv and flight2.csv go")->required();
  app.add_option("--size", cells, "Cells a side of the terrain")->capture_default_str();
  app.add_option("--seed", seed, "Seed of the terrain")->capture_default_str();
  app.add_option("--rounds", rounds, "There, back, there again")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  app.add_option("--frames", frames, "Frames of a round")
      ->capture_default_str()
      ->check(CLI::Range(2, 100000));
  app.add_option("--rate", rate_hz, "Frames a second")->capture_default_str();
  app.set_version_flag("--version", "nearmesh-demo-flights " NEARMESH_VERSION);
  CLI11_PARSE(app, argc, argv);
  const Ground ground(cells, seed);
  for (const auto& [name, direction] :
       {std::pair("flight1.csv", 1.0), std::pair("flight2.csv", -1.0)}) {
    const std::string path = folder + "/" + name;
    if (!write_flight(path, ground, frames, rounds, rate_hz, direction)) {
      std::fprintf(stderr, "nearmesh-demo-flights: cannot write %s\n", path.c_str());
      return 1;
    }
  }
  return 0;
}
