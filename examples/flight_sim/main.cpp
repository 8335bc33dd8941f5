// SPDX-License-Identifier: Apache-2.0
// A fixed-step flight simulator with a DDS of its own that asks nearmesh whether its aircraft touch
// the terrain or those of other simulators. What it takes to add nearmesh stands between the marks;
// the rest was there before.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <map>
#include <set>
#include <thread>

#include "flight.hpp"
#include "host_bus.hpp"
#include "nearmesh/eigen.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/wait_ready.hpp"

namespace {

using namespace flight_sim;

enum class Policy { kHold, kProceed, kConservative };

struct Options {
  std::string profiles = "profiles.xml", profile = "flight_sim", callsign = "alpha", security;
  std::uint32_t domain = 0, aircraft = 2;
  std::uint64_t seed = 1;
  double seconds = 20, budget_ms = 2, wait_s = 0;
  Policy policy = Policy::kHold;
};

struct Summary {
  std::uint64_t steps = 0, free = 0, contact = 0, uncertain = 0, held = 0, late = 0;
  std::vector<double> step_ms, nearmesh_ms;
};

// ---- nearmesh: begin ----------------------------------------------------------------------------

namespace nm = nearmesh::subscriber;

/// The exercise's clock, which all simulators share: here that of their machines, which are set
/// alike.
double exercise_time_s() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// A session, and what the simulator remembers of it.
struct Peer {
  std::unique_ptr<nm::Session> session;
  nm::BodyId terrain;
  std::vector<nm::BodyId> bodies;  ///< of the own aircraft, by place in the fleet
};

/// A session on the simulator's own participant, with the terrain and the own aircraft.
nearmesh::Result<Peer> join_nearmesh(const HostBus& bus, const std::vector<Aircraft>& fleet) {
  nm::DdsChannelOptions options;
  options.participant = bus.participant;
  options.transport.name = fleet.front().name;  // what operators see
  auto channel = nm::DdsChannel::create(options);
  if (!channel.is_ok()) return channel.status();
  Peer peer{.session = std::make_unique<nm::Session>(std::move(channel).value(),
                                                     nm::SessionOptions{.contacts = true})};
  nm::Session& session = *peer.session;
  peer.terrain = session.add_body({.name = "terrain", .model = "terrain"}).value();
  NEARMESH_RETURN_IF_ERROR(session.place_body(peer.terrain, {}));
  for (const Aircraft& own : fleet) {
    const auto body = session.add_body({.name = own.name, .model = "aircraft", .own = true});
    if (!body.is_ok()) return body.status();
    NEARMESH_RETURN_IF_ERROR(session.watch(peer.terrain, body.value()));
    peer.bodies.push_back(body.value());
  }
  return peer;
}

/// An aircraft of another simulator, whose poses come from its own nearmesh.
nearmesh::Status meet(Peer& peer, const std::string& name) {
  const auto other = peer.session->add_body({.name = name, .model = "aircraft"});
  if (!other.is_ok()) return other.status();
  for (const nm::BodyId own : peer.bodies)
    NEARMESH_RETURN_IF_ERROR(peer.session->watch(own, other.value()));
  return nearmesh::Status::ok();
}

std::vector<nm::Session::OwnMotion> motions_of(const Peer& peer,
                                               const std::vector<Aircraft>& fleet) {
  std::vector<nm::Session::OwnMotion> motions;
  for (std::size_t i = 0; i < fleet.size(); ++i)
    motions.push_back({peer.bodies[i], nearmesh::to_motion(fleet[i].pose, fleet[i].velocity_mps,
                                                           fleet[i].rates_radps)});
  return motions;
}

/// What an answer means for the pair's own aircraft, B or else A; `before` is where it was a step
/// ago.
void use_answer(const nm::PairAnswer& pair, bool is_b, Policy policy, Aircraft& own,
                const Aircraft& before, Summary& summary) {
  if (pair.contacts) {  // certified, or a part of it: what touches does touch
    ++summary.contact;
    for (const nearmesh::ContactPatch& patch : pair.contacts->patches) {
      const Vector away = nearmesh::to_eigen(patch.normal);  // the way B has to move
      push_out(own, is_b ? away : Vector(-away));
    }
  } else if (nearmesh::is_certified(pair.answer.status)) {
    ++summary.free;
  } else {  // not known yet: never free
    ++summary.uncertain;
    if (policy == Policy::kHold) own = before;
    if (policy == Policy::kConservative) push_out(own, Vector::UnitZ());
    summary.held += policy == Policy::kHold ? 1 : 0;
  }
}

// ---- nearmesh: end ------------------------------------------------------------------------------

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

int fail(const std::string& message) {
  std::fprintf(stderr, "flight_sim: %s\n", message.c_str());
  return 1;
}

int run(const Options& options) {
  const Ground ground;
  std::vector<Aircraft> fleet =
      make_fleet(ground, options.callsign, options.aircraft, options.seed);
  std::string why;
  const std::unique_ptr<HostBus> bus =
      HostBus::join(options.profiles, options.profile, options.domain, options.security, why);
  if (bus == nullptr) return fail(why);

  // ---- nearmesh: begin
  auto joined = join_nearmesh(*bus, fleet);
  if (!joined.is_ok()) return fail(joined.status().message());
  Peer& peer = joined.value();
  if (options.wait_s > 0) {
    const auto ready = nm::wait_ready(*peer.session, peer.terrain, options.wait_s,
                                      motions_of(peer, fleet), 0, exercise_time_s());
    if (!ready.is_ok()) return fail(ready.status().message());
    if (ready.value().readiness.stage != nm::ReadyStage::kCertified)
      return fail("not ready after " + std::to_string(options.wait_s) +
                  " s: " + ready.value().readiness.reason);
  }
  // ---- nearmesh: end

  Summary summary;
  std::set<std::string> known, said;  // aircraft; complaints
  for (const Aircraft& own : fleet) known.insert(own.name);
  const auto clock = [] { return std::chrono::steady_clock::now(); };
  const auto ms_since = [&](auto start) {
    return std::chrono::duration<double, std::milli>(clock() - start).count();
  };
  const auto steps = static_cast<std::uint64_t>(options.seconds / kStep_s + 0.5);
  const auto start = clock();
  const double start_s = exercise_time_s();
  for (std::uint64_t step = 0; step < steps; ++step) {
    const auto step_start = clock();
    const std::vector<Aircraft> before = fleet;
    for (Aircraft& own : fleet) fly(own, ground);
    for (const AircraftState& state : bus->take()) {
      const std::string name = state.name().to_string();
      if (!known.insert(name).second) continue;
      // ---- nearmesh: begin
      if (const auto met = meet(peer, name); !met.is_ok()) return fail(met.message());
      // ---- nearmesh: end
    }

    // ---- nearmesh: begin
    const auto update_start = clock();
    const auto report = peer.session->update(step, start_s + static_cast<double>(step) * kStep_s,
                                             motions_of(peer, fleet), options.budget_ms / 1000);
    if (!report.is_ok()) return fail(report.status().message());
    for (const std::string& line : report.value().complaints)
      if (said.insert(line).second)  // they come as often as their cause
        std::fprintf(stderr, "flight_sim: nearmesh: %s\n", line.c_str());
    for (const nm::PairAnswer& pair : report.value().answers) {
      for (std::size_t own = 0; own < fleet.size(); ++own)
        if (pair.a == peer.bodies[own] || pair.b == peer.bodies[own])
          use_answer(pair, pair.b == peer.bodies[own], options.policy, fleet[own], before[own],
                     summary);
    }
    summary.nearmesh_ms.push_back(ms_since(update_start));
    // ---- nearmesh: end

    for (const Aircraft& own : fleet) bus->publish(own, step);
    summary.step_ms.push_back(ms_since(step_start));
    ++summary.steps;
    const auto due = start + std::chrono::milliseconds(10) * (step + 1);
    summary.late += clock() > due ? 1 : 0;
    std::this_thread::sleep_until(due);
  }
  std::printf(
      "flight_sim %s: %llu steps, %zu other aircraft; answers %llu free, %llu contact, %llu "
      "uncertain (%llu held); p99 step %.2f ms, of it nearmesh %.2f ms; %llu steps late\n",
      options.callsign.c_str(), static_cast<unsigned long long>(summary.steps),
      known.size() - fleet.size(), static_cast<unsigned long long>(summary.free),
      static_cast<unsigned long long>(summary.contact),
      static_cast<unsigned long long>(summary.uncertain),
      static_cast<unsigned long long>(summary.held), percentile(summary.step_ms, 0.99),
      percentile(summary.nearmesh_ms, 0.99), static_cast<unsigned long long>(summary.late));
  if (std::fflush(stdout) != 0) return std::perror("standard output"), 1;  // a full disk, say
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Flies aircraft at 100 Hz over the terrain and says at its end what nearmesh answered. Needs "
      "nearmesh-publisher serving terrain.spm and aircraft.spm."};
  app.set_version_flag("--version", "flight_sim of nearmesh " NEARMESH_VERSION);
  app.option_defaults()->always_capture_default();
  Options options;
  app.add_option("--domain", options.domain, "DDS domain")->check(CLI::Range(0, 232));
  app.add_option("--profiles", options.profiles, "XML file of the simulator's QoS profiles");
  app.add_option("--profile", options.profile,
                 "participant profile in it: flight_sim, flight_sim_secured on a secured bus, or "
                 "flight_sim_loopback for one machine");
  app.add_option("--security", options.security,
                 "folder of this simulator's identity, made with --topic flight_sim/state: joins a "
                 "secured bus");
  app.add_option("--callsign", options.callsign, "first part of the own aircraft's names")
      ->check(CLI::Validator(
          [](const std::string& text) {
            return text.empty() || text.size() > 20 ? "expected 1 to 20 bytes" : std::string();
          },
          "TEXT"));
  app.add_option("--aircraft", options.aircraft, "own aircraft")->check(CLI::Range(1, 100));
  app.add_option("--seed", options.seed, "of the flights");
  app.add_option("--seconds", options.seconds, "simulated, in real time")
      ->check(CLI::Range(0.01, 1e6));
  app.add_option("--budget-ms", options.budget_ms, "of a step for all of an update")
      ->check(CLI::Range(0.0, 10.0));
  app.add_option("--wait-s", options.wait_s, "wait so long for certainty before the first step")
      ->check(CLI::Range(0.0, 3600.0));
  app.add_option("--policy", options.policy,
                 "while uncertain: hold (stay where it was), proceed (fly on), conservative (as if "
                 "it touched: up and away)")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Policy>{{"hold", Policy::kHold},
                                        {"proceed", Policy::kProceed},
                                        {"conservative", Policy::kConservative}},
          CLI::ignore_case))
      ->default_str("hold");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return run(options);
}
