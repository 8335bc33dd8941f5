// SPDX-License-Identifier: Apache-2.0
// What FlightGear says of places and attitudes, in a scene's frame.
#include "geodesy.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "core/meshio/wgs84.hpp"
#include "link.hpp"

namespace flightgear {
namespace {

void expect_near(const Vector& a, const Vector& b, double by) {
  for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(a[k], b[k], by) << "coordinate " << k;
}
Vector column(const Matrix& m, std::size_t c) { return {m[c], m[3 + c], m[6 + c]}; }

// The axes of the ellipsoid, and a place of which others give the numbers: Paris, in the pages of
// MATLAB's geodetic2ecef.
TEST(Geodesy, KnowsPlacesByTheirNumbers) {
  expect_near(to_geocentric_m({0, 0, 0}), {6378137, 0, 0}, 1e-8);
  expect_near(to_geocentric_m({0, 90, 100}), {0, 6378237, 0}, 1e-8);
  expect_near(to_geocentric_m({90, 0, 0}), {0, 0, 6356752.314245}, 1e-6);
  expect_near(to_geocentric_m({48.8562, 2.3508, 67.4}), {4.2010e6, 172.4603e3, 4.7801e6}, 50);
}

// The terrain is made by core, and the aircraft put over it by this.
TEST(Geodesy, AgreesWithTheImportOfTerrain) {
  using nearmesh::meshio::sin_cos_deg;
  for (const double latitude : {-89.5, -33.3, 0.0, 46.5, 90.0})
    for (const double longitude : {-180.0, -71.0, 0.0, 7.5, 151.7}) {
      const Place place{latitude, longitude, 1234.5};
      const auto of_core =
          nearmesh::meshio::to_ecef(sin_cos_deg(latitude), sin_cos_deg(longitude), place.height_m);
      expect_near(to_geocentric_m(place), of_core, 1e-8);
      const SceneFrame frame({46, 7, 0});
      expect_near(frame.to_scene_m(place), nearmesh::meshio::TangentPlane(46, 7).from_ecef(of_core),
                  1e-7);
    }
}

TEST(Geodesy, FindsItsWayBack) {
  for (const double latitude : {-90.0, -89.999, -33.3, 0.0, 1e-9, 46.5, 89.0})
    for (const double height_m : {-10'000.0, 0.0, 165.0, 400'000.0}) {
      const Place place{latitude, 151.7, height_m};
      const Place again = to_place(to_geocentric_m(place));
      expect_near(to_geocentric_m(again), to_geocentric_m(place), 1e-6);
      EXPECT_NEAR(again.height_m, height_m, 1e-6);
    }
  const SceneFrame frame({-33.3, 151.7, 50});
  expect_near(frame.to_scene_m({-33.3, 151.7, 50}), {0, 0, 0}, 1e-8);
  const Vector at_m{-768, 320, 215.875};
  expect_near(frame.to_scene_m(frame.to_place(at_m)), at_m, 1e-6);
}

TEST(Geodesy, TurnsAircraftAsFlightGearDoes) {
  // Columns: nose, left, up; in north, east, down.
  const Matrix level = attitude_of(0, 0, 0);
  expect_near(column(level, 0), {1, 0, 0}, 1e-15);
  expect_near(column(level, 1), {0, -1, 0}, 1e-15);
  expect_near(column(level, 2), {0, 0, -1}, 1e-15);
  expect_near(column(attitude_of(0, 0, 90), 0), {0, 1, 0}, 1e-15);   // nose east
  expect_near(column(attitude_of(0, 0, 90), 1), {1, 0, 0}, 1e-15);   // left wing north
  expect_near(column(attitude_of(0, 90, 0), 0), {0, 0, -1}, 1e-15);  // nose up
  expect_near(column(attitude_of(90, 0, 0), 1), {0, 0, -1}, 1e-15);  // right wing down
  const double third = std::sqrt(3.0) / 2;
  expect_near(column(attitude_of(0, 30, 180), 0), {-third, 0, -0.5}, 1e-15);
  // All at once: the nose by pitch and heading alone, the left wing's height by roll and pitch.
  const Matrix all = attitude_of(20, 10, 240);
  constexpr double kDegree = 3.14159265358979323846 / 180;
  expect_near(column(all, 0),
              {std::cos(10 * kDegree) * std::cos(240 * kDegree),
               std::cos(10 * kDegree) * std::sin(240 * kDegree), -std::sin(10 * kDegree)},
              1e-15);
  EXPECT_NEAR(all[7], -std::sin(20 * kDegree) * std::cos(10 * kDegree), 1e-15);

  // At the origin east, north, up; a quarter of the earth further east what was up there is east
  // here.
  const SceneFrame frame({0, 0, 0});
  expect_near(frame.turn({0, 0, 0}, Vector{1, 2, 3}), {2, 1, -3}, 1e-15);
  expect_near(frame.turn({0, 90, 0}, Vector{0, 0, -1}), {1, 0, 0}, 1e-15);
  expect_near(column(frame.turn({0, 0, 0}, attitude_of(0, 0, 90)), 0), {1, 0, 0}, 1e-15);
}

TEST(FlightGearLink, TakesLinesOfItsProtocolAlone) {
  const std::string good = "1\t12.5\t0.5\t-0.25\t1000\t1\t-2\t359.5\t10\t-20\t3\n";
  std::string why;
  const auto state = parse_state(good, why);
  ASSERT_TRUE(state) << why;
  EXPECT_TRUE(state->flies);
  EXPECT_EQ(state->elapsed_s, 12.5);
  EXPECT_EQ(state->place.longitude_deg, -0.25);
  EXPECT_NEAR(state->place.height_m, 304.8, 1e-9);
  EXPECT_EQ(state->heading_deg, 359.5);
  EXPECT_NEAR(state->north_east_down_mps[1], -6.096, 1e-9);
  for (const char* line : {"", "\n", "1", "1\t12.5\t0.5\t-0.25\t1000\t1\t-2\t359.5\t10\t-20\n",
                           "1\t12.5\t0.5\t-0.25\t1000\t1\t-2\t359.5\t10\t-20\t3\t4\n",
                           "1\t12.5\tnan\t-0.25\t1000\t1\t-2\t359.5\t10\t-20\t3\n",
                           "1\t12.5\t90.5\t-0.25\t1000\t1\t-2\t359.5\t10\t-20\t3\n",
                           "1\t12.5\t0.5\t-0.25\tinf\t1\t-2\t359.5\t10\t-20\t3\n",
                           "1\t12.5\t0.5\t-0.25\t1000\t1\t-2\t9999\t10\t-20\t3\n",
                           "1\t12.5\t0.5 \t-0.25\t1000\t1\t-2\t359.5\t10\t-20\t3\n",
                           "1,12.5,0.5,-0.25,1000,1,-2,359.5,10,-20,3\n"}) {
    why.clear();
    EXPECT_FALSE(parse_state(line, why)) << line;
    EXPECT_FALSE(why.empty()) << line;
  }
  // While FlightGear starts.
  const auto starting = parse_state("0\t0\t0.5\t-0.25\t1000\t0\t0\t9999\t0\t0\t0\n", why);
  ASSERT_TRUE(starting);
  EXPECT_FALSE(starting->flies);
}

}  // namespace
}  // namespace flightgear
