// SPDX-License-Identifier: Apache-2.0
#pragma once
// Peers whose bodies fly over a world in cells, and what each hears: counts, no bytes. Who is near
// whom the product's own broad phase decides, with a session's own look-ahead. The same counts on
// every machine.

#include <array>
#include <cstdint>
#include <vector>

#include "core/base/random.hpp"
#include "core/broadphase/broad_phase.hpp"
#include "nearmesh/core/base/status.hpp"

namespace nearmesh::sites {

/// A square world, sites that share it out as squares, and layouts that cut it in square cells. A
/// peer is in the domain of the cell that its body is over, and hears what the eight cells around
/// tell; a router brings it. One cell a side: one domain for all.
struct Scenario {
  std::uint32_t peers = 5000;      ///< 2 to 20,000, a body each
  std::uint32_t sites_a_side = 2;  ///< 1 to 8
  /// Each 1 to 128, and a multiple of sites_a_side or 1.
  std::vector<std::uint32_t> cells_a_side{1, 2, 8, 16, 32};
  double side_m = 320e3;  ///< of the world, 1e4 to 2e6; a cell holds what two near bodies may take
  double gathered = 0.5;  ///< of flights, those that go to a hub: 0 to 1
  double frame_rate_hz = 10;  ///< 1 to 100
  double duration_s = 60;     ///< above 0, to 600; at most 10^8 frames of peers
  std::uint64_t seed = 1;
};
/// Errors: kInvalidArgument naming what is out of range.
[[nodiscard]] Status check(const Scenario& scenario);

/// Straight flights from place to place, of bodies of some 20 m.
class Flights {
 public:
  /// Precondition: check accepted it.
  explicit Flights(const Scenario& scenario);
  void step();
  [[nodiscard]] const std::vector<Motion>& motions() const { return motions_; }
  /// Of every body, in its own frame.
  [[nodiscard]] static const ModelBounds& bounds();
  static constexpr double kMostSpeed_mps = 250;

 private:
  struct Flight {
    std::array<double, 3> goal_m{};
    double speed_mps = 0;
  };
  [[nodiscard]] std::array<double, 3> draw_place();
  void head_for(std::size_t body);

  double side_m_, gathered_, step_s_;
  Random random_;
  std::vector<std::array<double, 3>> hubs_m_;
  std::vector<Flight> flights_;
  std::vector<Motion> motions_;
};

/// Samples that are told, and how often they are heard. All since the start.
struct Heard {
  std::uint64_t told = 0;
  std::uint64_t in_cell = 0;  ///< by peers of the teller's own domain
  std::uint64_t brought = 0;  ///< by peers of cells around: a router writes each
  /// Over lines between sites: once for each other site, or, in one domain, for each hearer there.
  std::uint64_t across = 0;
  bool operator==(const Heard&) const = default;
};

struct LayoutCounts {
  std::uint32_t cells_a_side = 0;
  std::uint64_t most_members = 0;    ///< peers in one cell, of any frame
  std::uint64_t most_heard = 0;      ///< bodies that a peer hears of, of any frame
  std::uint64_t most_brought = 0;    ///< bodies that routers bring into one cell, of any frame
  std::uint64_t cell_changes = 0;    ///< bodies that came over another cell
  std::uint64_t pairs_of_cells = 0;  ///< near pairs, of all frames, of two cells
  std::uint64_t pairs_of_sites = 0;  ///< of two sites
  /// Near pairs of which neither hears the other: none, or the cells are too small.
  std::uint64_t pairs_unheard = 0;
  Heard poses;         ///< all, as today
  Heard promises;      ///< the same of promises
  Heard wanted_poses;  ///< poses told to those alone whose promises meet the body's
  bool operator==(const LayoutCounts&) const = default;
};

struct Counts {
  std::uint64_t frames = 0;
  std::uint64_t near_pairs = 0;  ///< of all frames
  std::uint64_t new_pairs = 0;   ///< that were not near in the frame before
  std::uint64_t peers_near = 0;  ///< of all frames: near a body or the ground, so that they ask
  std::uint64_t most_peers_near_a_site = 0;  ///< of any frame
  std::vector<LayoutCounts> layouts;         ///< as in the scenario
  bool operator==(const Counts&) const = default;
};

class Simulation {
 public:
  /// Errors: those of check().
  [[nodiscard]] static Result<Simulation> make(const Scenario& scenario);
  void step();
  /// To the end. Cost: some microseconds a peer and frame.
  [[nodiscard]] const Counts& run();

  [[nodiscard]] const Counts& counts() const { return counts_; }
  [[nodiscard]] const Flights& flights() const { return flights_; }
  /// Which cell a body is over, by rows.
  [[nodiscard]] std::uint32_t cell_of(std::size_t body, std::uint32_t cells_a_side) const;

  static constexpr double kRenewed_s = 4;

 private:
  explicit Simulation(const Scenario& scenario);
  /// Where a body was: since then it went no farther than its greatest speed allows.
  struct Promise {
    std::array<double, 3> place_m{};
    double from_s = 0;
  };
  void find_near();
  void renew_promises();
  void count_heard(LayoutCounts& layout, std::vector<std::uint32_t>& cells) const;

  Scenario scenario_;
  Flights flights_;
  double lookahead_s_, now_s_ = 0;
  BroadPhase near_, promised_;
  std::vector<BroadPhase::Slot> slots_, promise_slots_;  // by body
  std::vector<std::uint32_t> body_of_, promiser_of_;     // by slot
  std::vector<Promise> promises_;
  std::vector<std::uint8_t> renewed_, asks_;  // by body, in this frame
  std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs_, pairs_before_,
      wanted_;                                     // of bodies, the lower first
  std::vector<std::vector<std::uint32_t>> cells_;  // by layout, by body
  Counts counts_;
};

}  // namespace nearmesh::sites
