// SPDX-License-Identifier: Apache-2.0
// A session in a host that has set the processor to compute otherwise.
#include "host_floats.hpp"

#include "bad_motions.hpp"
#include "local_host.hpp"

namespace nearmesh::test {
namespace {

TEST(HostFloatsOfASession, LeaveAnswersAsTheyAre) {
  const Flight flight = make_flight(7, 1);
  const Pose level;
  std::vector<double> times;
  for (std::size_t i = 0; i < flight.frames(); ++i) times.push_back(0.05 * static_cast<double>(i));
  // The host's part, which does not compute: declare, move, update.
  expect_same_under_all_floats([&] {
    std::vector<std::uint64_t> digests;
    auto made = std::make_unique<LocalChannel>();
    LocalChannel* link = made.get();
    digests.push_back(made->add_model("terrain", terrain().open()).is_ok() ? 1 : 0);
    digests.push_back(made->add_model("aircraft", aircraft().open()).is_ok() ? 1 : 0);
    // To be refused, not to trap, nor to be taken for 0.
    for (const SessionOptions& wrong :
         {SessionOptions{.margin_m = kNan}, SessionOptions{.sweep_s = kDenormal}})
      digests.push_back(check(wrong).is_ok() ? 1 : 0);
    Session session(std::move(made), {.lookahead_s = 0.2, .sweep_s = 0.1, .contacts = true});
    const BodyId ground = session.add_body({.name = "ground", .model = "terrain"}).value();
    const BodyId one = session.add_body({.name = "one", .model = "aircraft", .own = true}).value();
    const BodyId other = session.add_body({.name = "other", .model = "aircraft"}).value();
    digests.push_back(session.place_body(ground, level).is_ok() ? 1 : 0);
    digests.push_back(session.watch(ground, one).is_ok() ? 1 : 0);
    digests.push_back(session.watch(one, other).is_ok() ? 1 : 0);
    for (std::size_t i = 0; i < flight.frames(); ++i) {
      wire::BodyPose pose;
      pose.peer = 77;
      pose.body = "other";
      pose.pose = flight.two[i].pose;
      digests.push_back(link->deliver(pose).is_ok() ? 1 : 0);
      for (int round = 0; round < 3; ++round) {
        const Result<FrameReport> report = session.update(i, times[i], {{one, flight.one[i]}}, 1);
        digests.push_back(report.value().state_digest);
        digests.push_back(report.value().answers_digest);
        for (const PairAnswer& pair : report.value().answers) {
          digests.push_back(std::bit_cast<std::uint64_t>(pair.safe_horizon_s));
          if (pair.swept) digests.push_back(std::bit_cast<std::uint64_t>(pair.swept->free_until_s));
        }
      }
    }
    const auto ready = session.region_readiness(ground, {-50, -50, -50}, {50, 50, 50});
    digests.push_back(std::bit_cast<std::uint64_t>(ready.value().uncertainty_m));
    digests.push_back(session.readiness(one).value().pairs);
    const Result<Session::HeldMesh> held = session.held_mesh(one);
    for (const auto& corner : held.value().exact_m)
      for (const double at_m : corner) digests.push_back(std::bit_cast<std::uint64_t>(at_m));
    return digests;
  });
}

}  // namespace
}  // namespace nearmesh::test
