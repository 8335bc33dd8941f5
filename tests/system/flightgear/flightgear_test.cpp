// SPDX-License-Identifier: Apache-2.0
// nearmesh-example-flightgear against a stand-in that speaks FlightGear's generic protocol as the
// example's own files describe it.

#include <cmath>
#include <map>
#include <regex>

#include "flights.hpp"

namespace nearmesh {
namespace {

using flightgear::Vector;

/// The names of a protocol's fields, in their order.
std::vector<std::string> protocol_fields(const std::string& file, const std::string& direction) {
  const std::string text =
      test::read_text(std::string(NEARMESH_FLIGHTGEAR_DIR "/Protocol/") + file + ".xml");
  const std::size_t from = text.find("<" + direction + ">"), to = text.find("</" + direction + ">");
  EXPECT_NE(from, std::string::npos) << file;
  EXPECT_NE(to, std::string::npos) << file;
  const std::string part = text.substr(from, to - from);
  std::vector<std::string> names;
  const std::regex name("<name>([^<]*)</name>");
  for (std::sregex_iterator at(part.begin(), part.end(), name), end; at != end; ++at)
    names.push_back((*at)[1]);
  return names;
}

/// Flies straight on at 20 Hz, and is put where it is told to be.
class StandIn {
 public:
  explicit StandIn(const flightgear::SceneFrame& scene, int port = flightgear_port())
      : scene_(scene), port_(port) {}

  Vector at_m{}, velocity_mps{};  ///< east, north, up; velocity of level flight east alone
  double heading_deg = 90;
  std::size_t puts = 0;
  std::map<std::string, std::string> shown;  ///< the last answer, by field
  std::vector<std::string> said;

  void step() {
    constexpr double kStep_s = 0.05;
    take();
    for (std::size_t k = 0; k < 3; ++k) at_m[k] += kStep_s * velocity_mps[k];
    elapsed_s_ += kStep_s;
    tell();
    test::pause(kStep_s);
    take();
  }
  /// What another program might send.
  void tell(const std::string& line) { ear_.send(port_, line); }
  bool fly_until(const std::function<bool()>& done) {
    for (double s = 0; s < test::kDeadline_s; s += 0.05) {
      step();
      if (done()) return true;
    }
    return false;
  }
  bool is_shown(const std::string& status, const std::string& with) {
    return fly_until([&] { return shown["status"] == status && shown["with"] == with; });
  }

 private:
  void tell() {
    constexpr double kFoot_m = 0.3048;
    const flightgear::Place place = scene_.to_place(at_m);
    const std::map<std::string, double> value{{"flies", 1},
                                              {"elapsed-s", elapsed_s_},
                                              {"latitude-deg", place.latitude_deg},
                                              {"longitude-deg", place.longitude_deg},
                                              {"altitude-ft", place.height_m / kFoot_m},
                                              {"roll-deg", 0},
                                              {"pitch-deg", 0},
                                              {"heading-deg", heading_deg},
                                              {"north-fps", velocity_mps[1] / kFoot_m},
                                              {"east-fps", velocity_mps[0] / kFoot_m},
                                              {"down-fps", -velocity_mps[2] / kFoot_m}};
    std::string line;
    for (const std::string& name : pose_fields_) {
      char text[64];
      std::snprintf(text, sizeof text, "%s%.10f", line.empty() ? "" : "\t", value.at(name));
      line += text;
    }
    tell(line + "\n");
  }
  void take() {
    while (const auto line = ears_[0].take()) {
      const auto fields = fields_of(*line);
      ASSERT_EQ(fields.size(), answer_fields_.size()) << *line;
      for (std::size_t i = 0; i < fields.size(); ++i) shown[answer_fields_[i]] = fields[i];
    }
    while (const auto line = ears_[1].take()) {
      const auto fields = fields_of(*line);
      ASSERT_EQ(fields.size(), put_fields_.size()) << *line;
      std::map<std::string, double> value;
      for (std::size_t i = 0; i < fields.size(); ++i) value[put_fields_[i]] = std::stod(fields[i]);
      at_m = scene_.to_scene_m(
          {value.at("latitude-deg"), value.at("longitude-deg"), value.at("altitude-ft") * 0.3048});
      ++puts;
    }
    while (const auto line = ears_[2].take()) said.push_back(*line);
  }

  const flightgear::SceneFrame& scene_;
  const int port_;
  const std::vector<std::string> pose_fields_ = protocol_fields("nearmesh-pose", "output"),
                                 put_fields_ = protocol_fields("nearmesh-pose", "input"),
                                 answer_fields_ = protocol_fields("nearmesh-answer", "input");
  const Ear ear_{0};
  const Ear ears_[3] = {Ear(port_ + 1), Ear(port_ + 2), Ear(port_ + 3)};
  double elapsed_s_ = 1;
};

TEST_F(FlightGearFlight, IsShownWhatItTouches) {
  begin_flight({});
  StandIn plane(scene);
  plane.at_m = {10, 20, 800};
  ASSERT_TRUE(plane.is_shown("free", "")) << bridge->err();
  // Its nose is at x = 30, the ground below at 167 at most.
  EXPECT_GT(std::stod(plane.shown["clearance-m"]), 500);
  EXPECT_LT(std::stod(plane.shown["clearance-m"]), 640);
  plane.at_m = {0, 0, 165};
  ASSERT_TRUE(plane.is_shown("contact", "terrain")) << bridge->err();
  EXPECT_GT(std::stoi(plane.shown["face-pairs"]), 0);
  ASSERT_TRUE(plane.fly_until([&] { return std::stod(plane.shown["depth-m"]) > 0; }));
  EXPECT_LT(std::stod(plane.shown["depth-m"]), 60);
  ASSERT_TRUE(plane.fly_until([&] {
    return !plane.said.empty() && plane.said.back() == "nearmesh: contact with terrain\n";
  }));
  EXPECT_EQ(plane.puts, 0U) << "it was not told to move anything";

  // What is no such line is refused, and the flight goes on.
  for (const char* line : {"", "1\t2\n", "1\t1\tnan\t0\t0\t0\t0\t0\t0\t0\t0\n"}) plane.tell(line);
  plane.at_m = {10, 20, 800};
  ASSERT_TRUE(plane.is_shown("free", ""));
  EXPECT_NE(bridge->err().find("refused: latitude-deg is \"nan\""), std::string::npos)
      << bridge->err();

  // FlightGear has ended, or hangs: nobody knows where it is.
  ASSERT_TRUE(test::await([&] {
    return bridge->out().find("nearmesh: uncertain with terrain: the pose of body flightgear is") !=
           std::string::npos;
  })) << bridge->out();
  end_flight();
  EXPECT_NE(bridge->out().find(" 3 refused; "), std::string::npos) << bridge->out();
  EXPECT_NE(bridge->out().find("; 0 held, 0 pushed out"), std::string::npos) << bridge->out();
}

/// Level into the hill, which is 172 m high.
TEST_F(FlightGearFlight, IsHeldWhereItWasFree) {
  begin_flight({"--on-contact", "hold", "--on-uncertain", "hold"});
  StandIn plane(scene);
  plane.at_m = {-760, 0, 140};
  ASSERT_TRUE(plane.is_shown("free", "")) << bridge->err();
  plane.velocity_mps = {60, 0, 0};
  ASSERT_TRUE(plane.is_shown("contact", "terrain")) << bridge->err();
  ASSERT_TRUE(plane.fly_until([&] { return plane.puts > 20; })) << bridge->err();
  // The ground is as high as it flies from x = -283 on; its nose is some 30 m ahead of it.
  EXPECT_GT(plane.at_m[0], -500);
  EXPECT_LT(plane.at_m[0], -280);
  EXPECT_NEAR(plane.at_m[2], 140, 0.01);
  plane.velocity_mps = {};
  ASSERT_TRUE(plane.is_shown("free", ""));
  end_flight();
  EXPECT_EQ(bridge->out().find("; 0 held"), std::string::npos) << bridge->out();
}

TEST_F(FlightGearFlight, IsPushedOut) {
  begin_flight({"--on-contact", "push"});
  StandIn plane(scene);
  plane.at_m = {10, 20, 800};
  ASSERT_TRUE(plane.is_shown("free", "")) << bridge->err();
  const Vector inside_m{0, 0, 160};
  plane.at_m = inside_m;
  ASSERT_TRUE(plane.fly_until([&] { return plane.puts > 0; })) << bridge->err();
  ASSERT_TRUE(plane.is_shown("free", "")) << bridge->err();
  double way_m = 0;
  for (std::size_t k = 0; k < 3; ++k)
    way_m += (plane.at_m[k] - inside_m[k]) * (plane.at_m[k] - inside_m[k]);
  EXPECT_GT(std::sqrt(way_m), 0.1);
  EXPECT_GT(plane.at_m[2], inside_m[2]) << "not through the ground, which has no floor";
  EXPECT_LT(std::sqrt(way_m), 60);
  end_flight();
  EXPECT_EQ(bridge->out().find(" 0 pushed out"), std::string::npos) << bridge->out();
}

/// Two that know nothing of each other but what their peers say.
TEST_F(FlightGearFlight, IsToldOfAnother) {
  begin_flight({});
  constexpr int kAfter = 8;
  test::Process second(
      folder, "nearmesh-example-flightgear",
      on_bus({"--origin", "0.5,0.5", "--port", std::to_string(flightgear_port() + kAfter),
              "--callsign", "second", "--wait-recorder"}));
  StandIn plane(scene), other(scene, flightgear_port() + kAfter);
  plane.at_m = {0, 0, 800};
  other.at_m = {200, 0, 800};
  const auto both_see = [&](const std::string& status, const std::string& plane_with,
                            const std::string& other_with) {
    return plane.fly_until([&] {
      other.step();
      return plane.shown["status"] == status && plane.shown["with"] == plane_with &&
             other.shown["status"] == status && other.shown["with"] == other_with;
    });
  };
  ASSERT_TRUE(both_see("free", "", "")) << bridge->out() << second.out();
  other.at_m = {20, 0, 800};
  ASSERT_TRUE(both_see("contact", "second", "flightgear")) << bridge->out() << second.out();
  second.signal(SIGINT);
  EXPECT_EQ(second.wait(), 0) << second.err();
  end_flight();
}

TEST(FlightGearExample, RefusesWhatIsNoPlace) {
  const test::Folder folder;
  std::string err;
  for (const char* origin : {"95,0", "1", "0,181", "x,y"})
    EXPECT_EQ(test::run(folder, "nearmesh-example-flightgear", {"--origin", origin}, nullptr, &err),
              2)
        << origin << err;
}

}  // namespace
}  // namespace nearmesh
