// SPDX-License-Identifier: Apache-2.0
#include "simulation.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <string>

#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::sites {
namespace {

constexpr double kSlowest_mps = 50;
constexpr double kLow_m = 100, kHigh_m = 3000, kGround_m = 500;
constexpr std::size_t kHubs = 12;
constexpr double kHubReach_m = 5000;
/// From the body's origin to its farthest point, rounded up; and so far may two bodies be whose
/// promises meet.
constexpr double kReach_m = 16;
/// Of bodies whose promises are as old as they get, with what is looked ahead.
double farthest_m(const Scenario& scenario) {
  const double s = Simulation::kRenewed_s + 1 / scenario.frame_rate_hz +
                   subscriber::SessionOptions{}.lookahead_s;
  return 2 * (Flights::kMostSpeed_mps * s + kReach_m);
}
constexpr double kMostPeerFrames = 1e8;

double distance_m(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return std::sqrt(x * x + y * y + z * z);
}

Status refuse(const std::string& why) {
  return {StatusCode::kInvalidArgument, "scenario: expected " + why};
}

bool are_around(std::uint32_t a, std::uint32_t b, std::uint32_t cells_a_side) {
  const auto apart = [](std::uint32_t x, std::uint32_t y) { return x > y ? x - y : y - x; };
  return apart(a / cells_a_side, b / cells_a_side) <= 1 &&
         apart(a % cells_a_side, b % cells_a_side) <= 1;
}

}  // namespace

Status check(const Scenario& scenario) {
  const auto lies = [](double x, double low, double high) { return x >= low && x <= high; };
  if (!lies(scenario.peers, 2, 20'000)) return refuse("2 to 20,000 peers");
  if (!lies(scenario.sites_a_side, 1, 8)) return refuse("1 to 8 sites a side");
  if (!lies(scenario.side_m, 1e4, 2e6)) return refuse("a side of 10 to 2,000 km");
  if (!lies(scenario.gathered, 0, 1)) return refuse("a gathered share of 0 to 1");
  if (!lies(scenario.frame_rate_hz, 1, 100)) return refuse("1 to 100 frames a second");
  if (!lies(scenario.duration_s * scenario.frame_rate_hz, 1, 600 * scenario.frame_rate_hz))
    return refuse("a frame to 600 s");
  if (scenario.peers * scenario.duration_s * scenario.frame_rate_hz > kMostPeerFrames)
    return refuse("at most 10^8 frames of peers");
  if (scenario.cells_a_side.empty()) return refuse("cells");
  for (const std::uint32_t cells : scenario.cells_a_side) {
    if (!lies(cells, 1, 128) || (cells != 1 && cells % scenario.sites_a_side != 0))
      return refuse("1 to 128 cells a side, a multiple of the sites', or 1");
    if (cells != 1 && scenario.side_m / cells < farthest_m(scenario))
      return refuse("cells of " +
                    std::to_string(static_cast<int>(std::ceil(farthest_m(scenario)))) +
                    " m or more: bodies that are near would be farther apart than a cell");
  }
  return Status::ok();
}

// --- Flights

Flights::Flights(const Scenario& scenario)
    : side_m_(scenario.side_m),
      gathered_(scenario.gathered),
      step_s_(1 / scenario.frame_rate_hz),
      random_(scenario.seed),
      flights_(scenario.peers),
      motions_(scenario.peers) {
  for (std::size_t i = 0; i < kHubs; ++i)
    hubs_m_.push_back({random_.between(0, side_m_), random_.between(0, side_m_), 0});
  for (std::size_t body = 0; body < flights_.size(); ++body) {
    auto& place_m = motions_[body].pose.translation_m = draw_place();
    flights_[body].speed_mps = random_.between(kSlowest_mps, kMostSpeed_mps);
    head_for(body);
    // On its way already.
    const double done = random_.unit();
    for (std::size_t k = 0; k < 3; ++k)
      place_m[k] += done * (flights_[body].goal_m[k] - place_m[k]);
  }
}

std::array<double, 3> Flights::draw_place() {
  const double height_m = random_.between(kLow_m, kHigh_m);
  if (random_.unit() >= gathered_)
    return {random_.between(0, side_m_), random_.between(0, side_m_), height_m};
  const auto& hub_m = hubs_m_[random_.below(kHubs)];
  std::array<double, 3> place_m{0, 0, height_m};
  for (std::size_t k = 0; k < 2; ++k)
    place_m[k] = std::clamp(hub_m[k] + random_.between(-kHubReach_m, kHubReach_m), 0.0, side_m_);
  return place_m;
}

void Flights::head_for(std::size_t body) {
  Flight& flight = flights_[body];
  Motion& motion = motions_[body];
  flight.goal_m = draw_place();
  const double way_m = std::max(1.0, distance_m(flight.goal_m, motion.pose.translation_m));
  for (std::size_t k = 0; k < 3; ++k)
    motion.linear_velocity_mps[k] =
        flight.speed_mps * ((flight.goal_m[k] - motion.pose.translation_m[k]) / way_m);
}

void Flights::step() {
  for (std::size_t body = 0; body < flights_.size(); ++body) {
    auto& place_m = motions_[body].pose.translation_m;
    if (distance_m(place_m, flights_[body].goal_m) < flights_[body].speed_mps * step_s_)
      head_for(body);
    for (std::size_t k = 0; k < 3; ++k)
      place_m[k] = std::clamp(place_m[k] + motions_[body].linear_velocity_mps[k] * step_s_, 0.0,
                              k == 2 ? kHigh_m : side_m_);
  }
}

const ModelBounds& Flights::bounds() {
  // 20 by 20 by 6 m, in cells of 1/128 m.
  static const ModelBounds kBounds(Grid{.origin_m = {-10, -10, -3}, .exponent = -7},
                                   GridBox{{{0, 0, 0}}, {{2560, 2560, 768}}});
  return kBounds;
}

// --- Simulation

Result<Simulation> Simulation::make(const Scenario& scenario) {
  NEARMESH_RETURN_IF_ERROR(check(scenario));
  return Simulation(scenario);
}

Simulation::Simulation(const Scenario& scenario)
    : scenario_(scenario),
      flights_(scenario),
      lookahead_s_(subscriber::SessionOptions{}.lookahead_s),
      promises_(scenario.peers),
      renewed_(scenario.peers),
      asks_(scenario.peers),
      cells_(scenario.cells_a_side.size()) {
  const auto note = [](std::vector<std::uint32_t>& bodies, BroadPhase::Slot slot,
                       std::uint32_t body) {
    bodies.resize(std::max<std::size_t>(bodies.size(), slot + 1));
    bodies[slot] = body;
  };
  for (std::uint32_t body = 0; body < scenario.peers; ++body) {
    note(body_of_, slots_.emplace_back(near_.add({})), body);
    note(promiser_of_, promise_slots_.emplace_back(promised_.add({})), body);
  }
  const BroadPhase::Slot ground = near_.add({.is_scenery = true});
  note(body_of_, ground, scenario.peers);
  const WorldBox box{{0, 0, 0}, {scenario.side_m, scenario.side_m, kGround_m}};
  near_.place(ground, box, [&] { return box; });
  for (const std::uint32_t cells : scenario.cells_a_side)
    counts_.layouts.push_back({.cells_a_side = cells});
}

std::uint32_t Simulation::cell_of(std::size_t body, std::uint32_t cells_a_side) const {
  const auto& place_m = flights_.motions()[body].pose.translation_m;
  const auto along = [&](double m) {
    const auto at = static_cast<std::uint32_t>(m / scenario_.side_m * cells_a_side);
    return std::min(at, cells_a_side - 1);
  };
  return along(place_m[1]) * cells_a_side + along(place_m[0]);
}

void Simulation::find_near() {
  constexpr double kRoam_s = 2;
  const ModelBounds& bounds = Flights::bounds();
  for (std::size_t body = 0; body < slots_.size(); ++body) {
    const Motion& motion = flights_.motions()[body];
    near_.place(slots_[body], bounds.around(motion, lookahead_s_, 0), [&] {
      return bounds.around(motion,
                           lookahead_s_ + kRoam_s * (1 + static_cast<double>(body % 16) / 16), 0);
    });
  }
  std::fill(asks_.begin(), asks_.end(), std::uint8_t{0});
  pairs_before_.swap(pairs_);
  pairs_.clear();
  for (const auto& [one, two] : near_.find_near()) {
    const auto [lower, higher] = std::minmax(body_of_[one], body_of_[two]);
    asks_[lower] = 1;
    if (higher == scenario_.peers) continue;  // the ground
    asks_[higher] = 1;
    pairs_.emplace_back(lower, higher);
  }
  std::sort(pairs_.begin(), pairs_.end());
}

void Simulation::renew_promises() {
  for (std::size_t body = 0; body < promises_.size(); ++body) {
    const auto& place_m = flights_.motions()[body].pose.translation_m;
    Promise& promise = promises_[body];
    renewed_[body] = counts_.frames == 0 || now_s_ - promise.from_s >= kRenewed_s;
    if (renewed_[body] != 0) promise = {place_m, now_s_};
    // Those of all bodies end one after the other.
    if (counts_.frames == 0)
      promise.from_s -=
          kRenewed_s * static_cast<double>(body) / static_cast<double>(promises_.size());
    const double radius_m =
        Flights::kMostSpeed_mps * (now_s_ - promise.from_s + lookahead_s_) + kReach_m;
    WorldBox box;
    for (std::size_t k = 0; k < 3; ++k) {
      box.lo_m[k] = promise.place_m[k] - radius_m;
      box.hi_m[k] = promise.place_m[k] + radius_m;
    }
    promised_.place(promise_slots_[body], box, [&] { return box; });
  }
  wanted_.clear();
  for (const auto& [one, two] : promised_.find_near())
    wanted_.push_back(std::minmax(promiser_of_[one], promiser_of_[two]));
}

void Simulation::count_heard(LayoutCounts& layout, std::vector<std::uint32_t>& cells) const {
  const std::uint32_t a_side = layout.cells_a_side, sites_a_side = scenario_.sites_a_side;
  std::vector<std::uint64_t> members(std::size_t{a_side} * a_side), renewals(members.size());
  std::vector<std::uint32_t> sites(slots_.size());
  std::vector<std::uint64_t> at_site(std::size_t{sites_a_side} * sites_a_side),
      renewals_at(at_site.size());
  const bool has_moved = !cells.empty();
  cells.resize(slots_.size());
  for (std::size_t body = 0; body < slots_.size(); ++body) {
    const std::uint32_t cell = cell_of(body, a_side);
    if (has_moved && cells[body] != cell) ++layout.cell_changes;
    cells[body] = cell;
    sites[body] = cell_of(body, sites_a_side);
    ++members[cell];
    ++at_site[sites[body]];
    renewals[cell] += renewed_[body];
    renewals_at[sites[body]] += renewed_[body];
  }
  for (std::uint32_t row = 0; row < a_side; ++row)
    for (std::uint32_t column = 0; column < a_side; ++column) {
      const std::size_t cell = std::size_t{row} * a_side + column;
      if (members[cell] == 0) continue;
      const auto site_at = [&](std::uint32_t r, std::uint32_t c) {
        return (r * sites_a_side / a_side) * sites_a_side + c * sites_a_side / a_side;
      };
      std::uint64_t around = 0;
      std::set<std::uint32_t> other_sites;
      for (std::uint32_t r = row - std::min(row, 1U); r <= std::min(row + 1, a_side - 1); ++r)
        for (std::uint32_t c = column - std::min(column, 1U); c <= std::min(column + 1, a_side - 1);
             ++c) {
          if (r == row && c == column) continue;
          around += members[std::size_t{r} * a_side + c];
          if (site_at(r, c) != site_at(row, column)) other_sites.insert(site_at(r, c));
        }
      layout.most_members = std::max(layout.most_members, members[cell]);
      layout.most_heard = std::max(layout.most_heard, members[cell] - 1 + around);
      layout.most_brought = std::max(layout.most_brought, around);
      const auto tell = [&](Heard& heard, std::uint64_t told) {
        heard.told += told;
        heard.in_cell += told * (members[cell] - 1);
        heard.brought += told * around;
        heard.across += told * other_sites.size();
      };
      tell(layout.poses, members[cell]);
      tell(layout.promises, renewals[cell]);
    }
  // Of one domain nobody hands on: each hearer elsewhere is sent its own.
  if (a_side == 1)
    for (std::size_t site = 0; site < at_site.size(); ++site) {
      layout.poses.across += at_site[site] * (slots_.size() - at_site[site]);
      layout.promises.across += renewals_at[site] * (slots_.size() - at_site[site]);
    }
  for (const auto& [a, b] : pairs_) {
    layout.pairs_of_cells += cells[a] != cells[b] ? 1 : 0;
    layout.pairs_of_sites += sites[a] != sites[b] ? 1 : 0;
    layout.pairs_unheard += are_around(cells[a], cells[b], a_side) ? 0 : 1;
  }
  for (const auto& [a, b] : wanted_) {
    constexpr std::uint64_t kBoth = 2;
    layout.wanted_poses.told += kBoth;
    (cells[a] == cells[b] ? layout.wanted_poses.in_cell : layout.wanted_poses.brought) += kBoth;
    layout.wanted_poses.across += sites[a] != sites[b] ? kBoth : 0;
    layout.pairs_unheard += are_around(cells[a], cells[b], a_side) ? 0 : 1;
  }
}

void Simulation::step() {
  if (counts_.frames > 0) flights_.step();
  now_s_ = static_cast<double>(counts_.frames) / scenario_.frame_rate_hz;
  find_near();
  renew_promises();
  for (std::size_t i = 0; i < cells_.size(); ++i) count_heard(counts_.layouts[i], cells_[i]);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> fresh;
  std::set_difference(pairs_.begin(), pairs_.end(), pairs_before_.begin(), pairs_before_.end(),
                      std::back_inserter(fresh));
  counts_.near_pairs += pairs_.size();
  counts_.new_pairs += fresh.size();
  std::vector<std::uint64_t> near_at(std::size_t{scenario_.sites_a_side} * scenario_.sites_a_side);
  for (std::size_t body = 0; body < asks_.size(); ++body) {
    counts_.peers_near += asks_[body];
    near_at[cell_of(body, scenario_.sites_a_side)] += asks_[body];
  }
  counts_.most_peers_near_a_site =
      std::max(counts_.most_peers_near_a_site, *std::max_element(near_at.begin(), near_at.end()));
  ++counts_.frames;
}

const Counts& Simulation::run() {
  const auto frames =
      static_cast<std::uint64_t>(scenario_.duration_s * scenario_.frame_rate_hz + 0.5);
  while (counts_.frames < frames) step();
  return counts_;
}

}  // namespace nearmesh::sites
