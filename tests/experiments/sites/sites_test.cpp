// SPDX-License-Identifier: Apache-2.0
// That docs/sites.md says what the simulation gives, and that the simulation counts what it says.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <set>
#include <sstream>

#include "nearmesh/idl/dds/payload.hpp"
#include "tables.hpp"
#include "test_models.hpp"

namespace nearmesh::sites {
namespace {

const std::string kDocs = NEARMESH_SITES_DOCS;
const std::string kDiscovery = kDocs + "/sites/discovery.csv";

std::string text_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// Dense enough that bodies meet.
Scenario small() {
  Scenario scenario;
  scenario.peers = 150;
  scenario.cells_a_side = {1, 2, 4};
  scenario.side_m = 10e3;
  scenario.duration_s = 4;
  return scenario;
}

TEST(SitesPage, SaysWhatTheSimulationGives) {
  const std::string page = text_of(kDocs + "/sites.md");
  const auto inputs = Inputs::read(kDocs);
  ASSERT_TRUE(inputs.is_ok()) << inputs.status().message();
  const auto tables = make_tables(inputs.value(), {});
  ASSERT_TRUE(tables.is_ok()) << tables.status().message();
  const auto now = with_tables(page, tables.value());
  ASSERT_TRUE(now.is_ok()) << now.status().message();
  EXPECT_TRUE(now.value() == page)
      << "stale: nearmesh-plan-sites --page docs/sites.md writes it anew";
}

TEST(SitesPage, AllPlansHearAllNearPairs) {
  auto simulation = std::move(Simulation::make({})).value();
  const Counts& counts = simulation.run();
  ASSERT_GT(counts.near_pairs, 0U);
  for (const LayoutCounts& layout : counts.layouts) EXPECT_EQ(layout.pairs_unheard, 0U);
}

TEST(SitesPage, HasAPlaceForEachTableAndNoOther) {
  const std::vector<Table> one{{"a", "| x |\n"}};
  EXPECT_EQ(with_tables("before\n<!-- table a -->\nold\n<!-- end -->\nafter", one).value(),
            "before\n<!-- table a -->\n\n| x |\n\n<!-- end -->\nafter");
  EXPECT_FALSE(with_tables("no place", one).is_ok());
  EXPECT_FALSE(
      with_tables("<!-- table b --><!-- end --><!-- table a --><!-- end -->", one).is_ok());
  EXPECT_FALSE(with_tables("<!-- table a --> no end", one).is_ok());
}

/// The same counts by looking at all pairs of bodies.
TEST(SitesSimulation, CountsAsBruteForceDoes) {
  auto simulation = std::move(Simulation::make(small())).value();
  const Scenario scenario = small();
  std::uint64_t near_pairs = 0, asks = 0;
  struct Sums {
    std::uint64_t told = 0, in_cell = 0, brought = 0, most_heard = 0, pairs_of_cells = 0,
                  pairs_of_sites = 0;
  };
  std::vector<Sums> sums(scenario.cells_a_side.size());
  for (int frame = 0; frame < 40; ++frame) {
    simulation.step();
    std::vector<WorldBox> boxes;
    for (const Motion& motion : simulation.flights().motions())
      boxes.push_back(Flights::bounds().around(motion, 0.5, 0));
    std::vector<bool> is_near(boxes.size());
    for (std::size_t a = 0; a < boxes.size(); ++a) {
      if (boxes[a].lo_m[2] <= 500) is_near[a] = true;
      for (std::size_t b = a + 1; b < boxes.size(); ++b) {
        if (!boxes[a].meets(boxes[b])) continue;
        ++near_pairs;
        is_near[a] = is_near[b] = true;
        for (std::size_t i = 0; i < sums.size(); ++i) {
          const std::uint32_t cells = scenario.cells_a_side[i];
          sums[i].pairs_of_cells += simulation.cell_of(a, cells) != simulation.cell_of(b, cells);
          sums[i].pairs_of_sites += simulation.cell_of(a, 2) != simulation.cell_of(b, 2);
        }
      }
    }
    for (const bool near : is_near) asks += near ? 1 : 0;
    for (std::size_t i = 0; i < sums.size(); ++i) {
      const std::uint32_t a_side = scenario.cells_a_side[i];
      for (std::size_t a = 0; a < boxes.size(); ++a) {
        ++sums[i].told;
        std::uint64_t heard = 0;
        for (std::size_t b = 0; b < boxes.size(); ++b) {
          if (a == b) continue;
          const int one = static_cast<int>(simulation.cell_of(a, a_side)),
                    two = static_cast<int>(simulation.cell_of(b, a_side)),
                    side = static_cast<int>(a_side);
          const bool is_heard =
              std::abs(one / side - two / side) <= 1 && std::abs(one % side - two % side) <= 1;
          heard += is_heard ? 1 : 0;
          if (is_heard) ++(one == two ? sums[i].in_cell : sums[i].brought);
        }
        sums[i].most_heard = std::max(sums[i].most_heard, heard);
      }
    }
  }
  const Counts& counts = simulation.counts();
  EXPECT_GT(near_pairs, 0U);
  EXPECT_EQ(counts.near_pairs, near_pairs);
  EXPECT_LE(counts.new_pairs, near_pairs);
  EXPECT_EQ(counts.peers_near, asks);
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const LayoutCounts& layout = counts.layouts[i];
    EXPECT_EQ(layout.poses.told, sums[i].told);
    EXPECT_EQ(layout.poses.in_cell, sums[i].in_cell) << layout.cells_a_side;
    EXPECT_EQ(layout.poses.brought, sums[i].brought) << layout.cells_a_side;
    EXPECT_EQ(layout.most_heard, sums[i].most_heard) << layout.cells_a_side;
    EXPECT_EQ(layout.pairs_of_cells, sums[i].pairs_of_cells) << layout.cells_a_side;
    EXPECT_EQ(layout.pairs_of_sites, sums[i].pairs_of_sites) << layout.cells_a_side;
  }
}

TEST(SitesSimulation, LayoutsShareOutTheSameSamples) {
  auto simulation = std::move(Simulation::make(small())).value();
  const Counts& counts = simulation.run();
  const std::uint64_t samples = counts.frames * small().peers;
  const LayoutCounts &one = counts.layouts[0], &four = counts.layouts[1];
  EXPECT_EQ(counts.frames, 40U);
  EXPECT_EQ(one.poses.in_cell, samples * (small().peers - 1));
  EXPECT_EQ(one.poses.brought, 0U);
  // Four cells are all around each other: a router brings what one domain would tell.
  EXPECT_EQ(four.poses.in_cell + four.poses.brought, one.poses.in_cell);
  EXPECT_EQ(four.poses.across, samples * 3);
  for (const LayoutCounts& layout : counts.layouts) {
    EXPECT_EQ(layout.poses.told, samples);
    EXPECT_EQ(layout.promises.told, one.promises.told);
    EXPECT_EQ(layout.wanted_poses.told, one.wanted_poses.told);
    EXPECT_EQ(layout.wanted_poses.told, layout.wanted_poses.in_cell + layout.wanted_poses.brought);
  }
}

/// Who is near has the other's promise near, so it wants its poses: nothing is missed by promising.
TEST(SitesSimulation, PromisesAreRenewedAndMeetWhereBodiesAreNear) {
  auto simulation = std::move(Simulation::make(small())).value();
  const Counts& counts = simulation.run();
  const double seconds = small().duration_s;
  const auto told = static_cast<double>(counts.layouts[0].promises.told);
  EXPECT_GE(told, small().peers * seconds / Simulation::kRenewed_s);
  EXPECT_LE(told, small().peers * (2 + seconds / Simulation::kRenewed_s));
  EXPECT_GE(counts.layouts[0].wanted_poses.told, 2 * counts.near_pairs);
}

TEST(SitesSimulation, IsTheSameEachTimeAndFollowsTheSeed) {
  const auto run = [](std::uint64_t seed) {
    Scenario scenario = small();
    scenario.seed = seed;
    return std::move(Simulation::make(scenario)).value().run();
  };
  EXPECT_EQ(run(1), run(1));
  EXPECT_NE(run(1), run(2));
}

TEST(SitesSimulation, RefusesScenariosOutOfRange) {
  ASSERT_TRUE(check(small()).is_ok());
  const double none = std::nan("");
  const auto refuses = [](auto change) {
    Scenario scenario = small();
    change(scenario);
    const Status status = check(scenario);
    EXPECT_EQ(Simulation::make(scenario).is_ok(), status.is_ok());
    return !status.is_ok() && status.message().starts_with("scenario: expected ");
  };
  for (const std::uint32_t peers : {0U, 1U, 20'001U, 0xffffffffU})
    EXPECT_TRUE(refuses([&](Scenario& s) { s.peers = peers; })) << peers;
  for (const std::uint32_t sites : {0U, 9U})
    EXPECT_TRUE(refuses([&](Scenario& s) { s.sites_a_side = sites; })) << sites;
  for (const std::uint32_t cells : {0U, 3U, 10U, 129U})
    EXPECT_TRUE(refuses([&](Scenario& s) { s.cells_a_side = {cells}; })) << cells;
  EXPECT_TRUE(refuses([](Scenario& s) { s.cells_a_side.clear(); }));
  for (const double side : {0.0, -1.0, 1e9, none})
    EXPECT_TRUE(refuses([&](Scenario& s) { s.side_m = side; })) << side;
  for (const double share : {-0.1, 1.1, none})
    EXPECT_TRUE(refuses([&](Scenario& s) { s.gathered = share; })) << share;
  for (const double rate : {0.0, -1.0, 101.0, none})
    EXPECT_TRUE(refuses([&](Scenario& s) { s.frame_rate_hz = rate; })) << rate;
  for (const double seconds : {0.0, -1.0, 601.0, none})
    EXPECT_TRUE(refuses([&](Scenario& s) { s.duration_s = seconds; })) << seconds;
  EXPECT_TRUE(refuses([](Scenario& s) {
    s.peers = 20'000;
    s.duration_s = 600;
  }));
}

TEST(SitesFacts, SizesAreThoseOfTheCodecs) {
  const MessageBytes bytes = message_bytes();
  wire::BodyPoses poses;
  poses.bodies.resize(1);
  EXPECT_EQ(bytes.poses, static_cast<double>(wire::encode_payload(poses).size()));
  EXPECT_GT(bytes.poses, 19 * 8);
  EXPECT_GT(bytes.promise, 4 * 8);
  EXPECT_LT(bytes.promise, bytes.poses / 2);
  EXPECT_GT(bytes.request, bytes.batch);
}

TEST(SitesFacts, LinesRunThroughWhatWasMeasured) {
  const Measured measured = std::move(Measured::read(kDiscovery)).value();
  for (const Measured::Row& row : measured.rows) {
    if (row.participants < 10 || row.rate_hz > 1) continue;
    EXPECT_NEAR(measured.all_join_bytes(row.participants) / row.join_unicast_bytes, 1, 0.1);
    EXPECT_NEAR(measured.all_join_cpu_s(row.participants) / row.join_cpu_s, 1, 0.1);
    const double poses = (row.participants - 1) * (row.participants - 2) * row.rate_hz;
    const double stay = row.participants * measured.stay_bytes_per_s.at(row.participants - 1);
    EXPECT_NEAR((stay + poses * measured.pose_wire_bytes) / row.stay_unicast_bytes, 1, 0.1);
  }
  EXPECT_GT(measured.around_bytes(), 0);
  EXPECT_GT(measured.pose_cpu_s, 0);
  EXPECT_GT(measured.join_cpu_s.slope, 0);
  EXPECT_GT(measured.join_cpu_s.at_0, 0);
}

TEST(SitesFacts, FilesThatLackWhatIsNeededAreRefused) {
  EXPECT_EQ(Measured::read(kDocs + "/none.csv").status().code(), StatusCode::kIo);
  const std::string all = text_of(kDiscovery);
  const auto refuses = [](const std::string& text) {
    const test::TempFile file(".csv");
    std::ofstream(file.path()) << text;
    return Measured::read(file.path()).status().code() == StatusCode::kInvalidArgument;
  };
  EXPECT_FALSE(refuses(all));
  EXPECT_TRUE(refuses(all.substr(0, all.find('\n') + 1)));
  EXPECT_TRUE(
      refuses(all.substr(0, all.rfind('\n', all.size() - 2) + 1)));  // a row less of one rate
  EXPECT_TRUE(refuses("participants,rate_hz\n2,1\n"));
  EXPECT_TRUE(refuses(all.substr(0, all.find("\n2,10"))));  // one rate
  EXPECT_TRUE(refuses(all + "many,1,1,1,1,1,1,1\n"));
}

TEST(SitesFacts, WhatPeersTellPeersCrossesAndNothingElse) {
  std::set<std::string> cross;
  for (const Crossing& one : crossings())
    if (one.crosses) cross.insert(std::string(one.topic));
  for (const char* name : {"body_poses", "body_directory"})
    EXPECT_EQ(cross.count(name), 1U) << name;
  for (const char* name : {"hello", "mesh_header", "split_batch", "region_subscription",
                           "contact_report", "held_detail", "process_status", "echo", "probe"})
    EXPECT_EQ(cross.count(name), 0U) << name;
  EXPECT_EQ(crossings().size(), wire::kTopicCount);
}

}  // namespace
}  // namespace nearmesh::sites
