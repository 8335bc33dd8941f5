// SPDX-License-Identifier: Apache-2.0
#include "tables.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string_view>

namespace nearmesh::sites {
namespace {

using Cells = std::vector<std::string>;

std::string lines_of(const Cells& head, const std::vector<Cells>& rows) {
  std::string out;
  const auto line = [&out](const Cells& cells) {
    out += "|";
    for (const std::string& cell : cells) out += " " + cell + " |";
    out += "\n";
  };
  line(head);
  out += "|";
  for (std::size_t i = 0; i < head.size(); ++i) out += "---|";
  out += "\n";
  for (const Cells& row : rows) line(row);
  return out;
}

double of(std::uint64_t count) { return static_cast<double>(count); }
std::string percent(double share) { return number(100 * share) + " %"; }
double mbit_per_s(double bytes_per_s) { return 8e-6 * bytes_per_s; }

/// A layout, as tables name it.
std::string name_of(const LayoutCounts& layout, const Scenario& scenario) {
  const double a_side = layout.cells_a_side;
  if (layout.cells_a_side == 1) return "one for all";
  std::string name =
      number(a_side * a_side) + " cells of " + number(scenario.side_m / a_side / 1000) + " km";
  return layout.cells_a_side == scenario.sites_a_side ? name + ", one a site" : name;
}
/// Domains that a site must tell apart.
double domains_a_site(const LayoutCounts& layout, const Scenario& scenario) {
  const double a_side = std::max<double>(1, layout.cells_a_side / scenario.sites_a_side);
  return a_side * a_side;
}
/// In the fullest domain: its peers, a publisher, and a router where there are other domains.
double participants_of(const LayoutCounts& layout) {
  return of(layout.most_members) + (layout.cells_a_side == 1 ? 1 : 2);
}

/// What is heard, a second; and what writes and hears it.
struct Traffic {
  double heard = 0, heard_bytes = 0;  ///< by a peer
  double brought = 0;                 ///< samples that routers write, all together
  double across_bytes = 0;            ///< between sites, all lines together

  /// Of samples of so many bytes on the wire, with the share of time that the counts took.
  void add(const Heard& samples, double wire_bytes, double share, double peers) {
    heard += of(samples.in_cell + samples.brought) * share / peers;
    heard_bytes += of(samples.in_cell + samples.brought) * share / peers * wire_bytes;
    brought += of(samples.brought) * share;
    across_bytes += of(samples.across) * share * wire_bytes;
  }
};
struct Plan {
  Traffic today, promised;
};
/// Means.
Plan plan_of(const LayoutCounts& layout, const Measured& measured, const Scenario& scenario,
             const Counts& counts) {
  const double a_second = scenario.frame_rate_hz / of(counts.frames);
  const double around = measured.around_bytes(), peers = scenario.peers;
  Plan plan;
  plan.today.add(layout.poses, measured.pose_wire_bytes, a_second, peers);
  plan.promised.add(layout.promises, message_bytes().promise + around, a_second, peers);
  plan.promised.add(layout.wanted_poses, measured.pose_wire_bytes, a_second, peers);
  return plan;
}
/// Writer and reader are taken to have half of it each.
double cores_of(double samples_per_s, const Measured& measured) {
  return samples_per_s * measured.pose_cpu_s / 2;
}

Table discovery(const Inputs& inputs) {
  std::vector<Cells> rows;
  for (const Measured::Row& row : inputs.measured.rows) {
    const double n = row.participants, pairs = n * (n - 1);
    rows.push_back({number(n), number(row.rate_hz), number(row.join_unicast_bytes / 1e6),
                    number(row.join_unicast_bytes / pairs / 1e3),
                    number(row.join_multicast_bytes / 1e3), number(row.join_cpu_s),
                    number(1e3 * row.join_cpu_s / pairs), number(row.stay_unicast_bytes / 1e3),
                    number(row.stay_cpu_s)});
  }
  return {"measured-discovery", lines_of({"participants", "poses/s of each peer", "joining, MB",
                                          "of each ordered pair, kB", "multicast, kB", "CPU s",
                                          "of each ordered pair, ms", "staying, kB/s", "cores"},
                                         rows)};
}

Table server(const Inputs& inputs) {
  std::vector<Cells> rows;
  for (const Measured::Row& with : inputs.server)
    for (const Measured::Row& plain : inputs.measured.rows)
      if (with.participants == plain.participants && with.rate_hz == plain.rate_hz)
        rows.push_back({number(with.participants), number(plain.join_unicast_bytes / 1e6),
                        number(with.join_unicast_bytes / 1e6), number(plain.join_cpu_s),
                        number(with.join_cpu_s), number(plain.stay_unicast_bytes / 1e3),
                        number(with.stay_unicast_bytes / 1e3)});
  return {"measured-server", lines_of({"participants", "joining, MB", "through a server", "CPU s",
                                       "through a server", "staying, kB/s", "with a server"},
                                      rows)};
}

Table lines(const Inputs& inputs) {
  const MessageBytes bytes = message_bytes();
  const Measured& measured = inputs.measured;
  const Asking& asking = inputs.asking;
  return {
      "measured-lines",
      lines_of(
          {"what", "is"},
          {{"to join, each tells each other", number(measured.join_bytes.at_0 / 1e3) + " kB, and " +
                                                  number(measured.join_bytes.slope / 1e3) +
                                                  " kB more for each participant"},
           {"which takes both together", number(1e3 * measured.join_cpu_s.slope) + " ms of CPU"},
           {"to start a program", number(1e3 * measured.join_cpu_s.at_0) + " ms of CPU"},
           {"to stay, each tells each other", number(measured.stay_bytes_per_s.slope) + " bytes/s"},
           {"a sample of one body's pose, to one reader",
            number(measured.pose_wire_bytes) + " bytes, " + number(bytes.poses) +
                " of them payload; " + number(1e6 * measured.pose_cpu_s) +
                " us of CPU of both together"},
           {"a promise of one body", number(bytes.promise) + " bytes of payload"},
           {"a request about one pair", number(bytes.request) + " bytes of payload"},
           {"its answer, of flights like the demo's",
            number(asking.answer_bytes) + " bytes of detail in a sample of " + number(bytes.batch) +
                " more; " + number(1e3 * asking.publisher_cpu_s) + " ms of the publisher"}})};
}

Table joining(const Measured& measured, const Scenario& scenario, const Counts& counts) {
  std::vector<Cells> rows;
  for (const LayoutCounts& layout : counts.layouts) {
    const double n = participants_of(layout), domains = domains_a_site(layout, scenario);
    rows.push_back({name_of(layout, scenario),
                    number(domains) + (domains > kMostDomains ? ", too many" : ""), number(n),
                    number(measured.all_join_bytes(n) / 1e9),
                    number(measured.all_join_cpu_s(n) / n),
                    number((measured.all_join_bytes(n) - measured.all_join_bytes(n - 1)) / 1e6),
                    number(mbit_per_s(measured.stay_bytes_per_s.at(n - 1))),
                    number(n / measured.most_participants) + " times"});
  }
  return {"computed-joining", lines_of({"domains", "of one site", "participants in the fullest",
                                        "all join, GB", "CPU s of each", "one more joins, MB",
                                        "to stay, Mbit/s to each", "of what was measured"},
                                       rows)};
}

Table poses(const Measured& measured, const Scenario& scenario, const Counts& counts) {
  std::vector<Cells> rows;
  for (const LayoutCounts& layout : counts.layouts) {
    const Traffic today = plan_of(layout, measured, scenario, counts).today;
    const double most = of(layout.most_heard), poses_hz = most * scenario.frame_rate_hz;
    const bool fits = of(layout.most_brought) <= most_bodies_of_a_writer();
    rows.push_back({name_of(layout, scenario),
                    number(of(layout.poses.in_cell + layout.poses.brought) / of(layout.poses.told)),
                    number(most), number(mbit_per_s(poses_hz * measured.pose_wire_bytes)),
                    number(cores_of(poses_hz, measured)), number(today.brought),
                    number(cores_of(today.brought, measured)),
                    number(mbit_per_s(today.across_bytes)),
                    number(of(layout.most_brought)) + (fits ? "" : ", too many")});
  }
  return {"computed-poses",
          lines_of({"domains", "bodies heard by a peer, mean", "most", "to that peer, Mbit/s",
                    "its cores", "routers write, samples/s", "their cores", "between sites, Mbit/s",
                    "bodies through one writer"},
                   rows)};
}

/// Without promises, and with them.
std::string both(double today, double promised) { return number(today) + " / " + number(promised); }

Table promises(const Measured& measured, const Scenario& scenario, const Counts& counts) {
  std::vector<Cells> rows;
  for (const LayoutCounts& layout : counts.layouts) {
    const auto [today, promised] = plan_of(layout, measured, scenario, counts);
    rows.push_back({name_of(layout, scenario),
                    both(mbit_per_s(today.heard_bytes), mbit_per_s(promised.heard_bytes)),
                    both(cores_of(today.heard, measured), cores_of(promised.heard, measured)),
                    both(today.brought, promised.brought),
                    both(cores_of(today.brought, measured), cores_of(promised.brought, measured)),
                    both(mbit_per_s(today.across_bytes), mbit_per_s(promised.across_bytes))});
  }
  return {"computed-promises",
          lines_of({"domains", "to a peer, Mbit/s", "its cores", "routers write, samples/s",
                    "their cores", "between sites, Mbit/s"},
                   rows)};
}

Result<Table> fewer(const Measured& measured, const Scenario& scenario) {
  std::uint32_t finest = 1;
  for (const std::uint32_t cells : scenario.cells_a_side)
    if (domains_a_site({.cells_a_side = cells}, scenario) <= kMostDomains)
      finest = std::max(finest, cells);
  std::vector<Cells> rows;
  for (const double share : {0.1, 0.2, 0.4, 1.0}) {
    Scenario some = scenario;
    some.peers = static_cast<std::uint32_t>(share * scenario.peers);
    some.cells_a_side = {finest};
    auto simulation = Simulation::make(some);
    NEARMESH_RETURN_IF_ERROR(simulation);
    const Counts& counts = simulation.value().run();
    const LayoutCounts& layout = counts.layouts[0];
    const auto [today, promised] = plan_of(layout, measured, some, counts);
    rows.push_back({number(some.peers), number(participants_of(layout)),
                    number(of(layout.most_heard)),
                    both(mbit_per_s(today.heard_bytes), mbit_per_s(promised.heard_bytes)),
                    both(cores_of(today.brought, measured), cores_of(promised.brought, measured)),
                    both(mbit_per_s(today.across_bytes), mbit_per_s(promised.across_bytes))});
  }
  return Table{"computed-peers",
               lines_of({"peers", "participants in the fullest", "bodies heard by a peer, most",
                         "to a peer, Mbit/s", "routers' cores", "between sites, Mbit/s"},
                        rows)};
}

Table borders(const Scenario& scenario, const Counts& counts) {
  std::vector<Cells> rows;
  for (const LayoutCounts& layout : counts.layouts) {
    const double minutes = of(counts.frames) / scenario.frame_rate_hz / 60;
    const double pairs = std::max(1.0, of(counts.near_pairs));
    rows.push_back({name_of(layout, scenario), number(of(layout.cell_changes) / minutes),
                    percent(of(layout.pairs_of_cells) / pairs),
                    percent(of(layout.pairs_of_sites) / pairs), number(of(layout.pairs_unheard))});
  }
  return {"computed-borders", lines_of({"domains", "bodies that come over another cell, a minute",
                                        "near pairs of two cells", "of two sites",
                                        "near pairs that do not hear each other"},
                                       rows)};
}

Table requests(const Inputs& inputs, const Scenario& scenario, const Counts& counts) {
  const Asking& asking = inputs.asking;
  const double frames = of(counts.frames), seconds = frames / scenario.frame_rate_hz;
  const double sites = scenario.sites_a_side * scenario.sites_a_side;
  const double asks_hz = of(counts.peers_near) / frames * asking.requests_per_s;
  const double most_asks_hz = of(counts.most_peers_near_a_site) * asking.requests_per_s;
  const double answer_bytes =
      asking.answer_bytes + message_bytes().batch + inputs.measured.around_bytes();
  return {
      "computed-requests",
      lines_of({"what", "is"},
               {{"pairs of bodies that may be near, at an instant",
                 number(of(counts.near_pairs) / frames)},
                {"that come near, a second", number(of(counts.new_pairs) / seconds)},
                {"peers near a body or the ground, at an instant",
                 number(of(counts.peers_near) / frames)},
                {"most of them at one site", number(of(counts.most_peers_near_a_site))},
                {"requests/s of all", number(asks_hz)},
                {"requests/s at the fullest site", number(most_asks_hz)},
                {"cores of its publishers", number(most_asks_hz * asking.publisher_cpu_s)},
                {"answers at that site, Mbit/s", number(mbit_per_s(most_asks_hz * answer_bytes))},
                {"answers between sites, where each serves its own, Mbit/s", "0"},
                {"where one site serves all, Mbit/s",
                 number(mbit_per_s(asks_hz * answer_bytes * (sites - 1) / sites))}})};
}

Table topics() {
  std::vector<Cells> rows;
  for (const Crossing& one : crossings())
    rows.push_back(
        {"`" + std::string(one.topic) + "`", one.crosses ? "yes" : "no", std::string(one.why)});
  return {"topics", lines_of({"topic", "crosses", "why"}, rows)};
}

Table guessed() {
  std::vector<Cells> rows;
  for (const Guess& guess : guesses()) rows.push_back({guess.what, guess.value, guess.proof});
  return {"guessed", lines_of({"guess", "value", "what would prove it"}, rows)};
}

constexpr std::string_view kBegin = "<!-- table ", kClose = " -->", kEnd = "<!-- end -->";

}  // namespace

std::string number(double x) {
  std::array<char, 64> text{};
  if (std::abs(x) < 999.5) {
    std::snprintf(text.data(), text.size(), "%.3g", x);
    return text.data();
  }
  std::snprintf(text.data(), text.size(), "%.0f", x);
  std::string out = text.data();
  for (auto at = static_cast<std::ptrdiff_t>(out.size()) - 3; at > (x < 0 ? 1 : 0); at -= 3)
    out.insert(static_cast<std::size_t>(at), ",");
  return out;
}

Result<Inputs> Inputs::read(const std::string& docs) {
  auto measured = Measured::read(docs + "/sites/discovery.csv");
  NEARMESH_RETURN_IF_ERROR(measured);
  auto server = Measured::read_rows(docs + "/sites/discovery-server.csv");
  NEARMESH_RETURN_IF_ERROR(server);
  auto asking = Asking::read(docs + "/network/peers-light.csv");
  NEARMESH_RETURN_IF_ERROR(asking);
  return Inputs{std::move(measured).value(), std::move(server).value(), asking.value()};
}

Result<std::vector<Table>> make_tables(const Inputs& inputs, const Scenario& scenario) {
  auto simulation = Simulation::make(scenario);
  NEARMESH_RETURN_IF_ERROR(simulation);
  const Counts& counts = simulation.value().run();
  auto of_fewer = fewer(inputs.measured, scenario);
  NEARMESH_RETURN_IF_ERROR(of_fewer);
  return std::vector<Table>{{"allow-list", "```yaml\n" + allow_list("nearmesh") + "```\n"},
                            topics(),
                            discovery(inputs),
                            server(inputs),
                            lines(inputs),
                            joining(inputs.measured, scenario, counts),
                            poses(inputs.measured, scenario, counts),
                            promises(inputs.measured, scenario, counts),
                            std::move(of_fewer).value(),
                            borders(scenario, counts),
                            requests(inputs, scenario, counts),
                            guessed()};
}

Result<std::string> with_tables(const std::string& page, const std::vector<Table>& tables) {
  std::string out;
  std::vector<std::string> written;
  for (std::size_t at = 0;;) {
    const std::size_t begin = page.find(kBegin, at);
    if (begin == std::string::npos) {
      out += page.substr(at);
      break;
    }
    const std::size_t name_at = begin + kBegin.size(), name_end = page.find(kClose, name_at);
    const std::size_t end = page.find(kEnd, name_at);
    if (name_end == std::string::npos || end == std::string::npos || end < name_end)
      return Status(StatusCode::kInvalidArgument, "page: a table without an end");
    const std::string name = page.substr(name_at, name_end - name_at);
    const auto table = std::find_if(tables.begin(), tables.end(),
                                    [&](const Table& one) { return one.name == name; });
    if (table == tables.end())
      return Status(StatusCode::kInvalidArgument, "page: there is no table " + name);
    out += page.substr(at, name_end + kClose.size() - at) + "\n\n" + table->text + "\n";
    at = end;
    written.push_back(name);
  }
  for (const Table& table : tables)
    if (std::find(written.begin(), written.end(), table.name) == written.end())
      return Status(StatusCode::kInvalidArgument, "page: no place for table " + table.name);
  return out;
}

}  // namespace nearmesh::sites
