// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/query/contacts.hpp"

#include <bit>
#include <map>

#include "contact_errors.hpp"
#include "core/base/hash.hpp"
#include "exact_distance.hpp"
#include "model_pairs.hpp"

namespace nearmesh {
namespace {

using test::Point;
using test::operator-;

// ---- random pairs of models ---------------------------------------------------------------------

/// Two full models, and the poses in which they touch.
class ContactPair : public test::ModelPair {
 protected:
  test::FullModel full_a_{a_}, full_b_{b_};

  struct Case {
    PosedPair posed;
    Answer answer;
    Contacts contacts;
  };
  [[nodiscard]] Case solve(const PosedPair& posed) const {
    Answer answer = query(full_a_.tree.view(), posed.a, full_b_.tree.view(), posed.b);
    Contacts contacts =
        find_contacts(full_a_.tree.view(), posed.a, full_b_.tree.view(), posed.b, answer);
    return {posed, std::move(answer), std::move(contacts)};
  }
  [[nodiscard]] std::vector<Case> touching_cases(int tries, std::size_t max_pairs) const {
    std::vector<Case> cases;
    Random random(31);
    for (int i = 0; i < tries && cases.size() < 15; ++i) {
      PosedPair posed = test::near_pose(random, a_, b_);
      if (i % 3 == 0)  // far from the origin, together
        for (std::size_t k = 0; k < 3; ++k)
          for (PosedFrame* frame : {&posed.a, &posed.b})
            frame->translation[k] += std::int64_t{1} << (44 + 5 * k);
      Case one = solve(posed);
      if (!one.answer.pairs.empty() && one.answer.pairs.size() <= max_pairs)
        cases.push_back(std::move(one));
    }
    EXPECT_GT(cases.size(), 5U);
    return cases;
  }
  [[nodiscard]] LatticeTriangle face_a(const Case& c, const FaceKey& key) const {
    return test::posed(a_.store, c.posed.a, a_.store.face(key));
  }
  [[nodiscard]] LatticeTriangle face_b(const Case& c, const FaceKey& key) const {
    return test::posed(b_.store, c.posed.b, b_.store.face(key));
  }
};
INSTANTIATE_TEST_SUITE_P(Models, ContactPair, test::model_pairs(), test::name_of_pair);

TEST_P(ContactPair, SegmentsLieOnBothFacesWithinThePositionError) {
  for (const Case& c : touching_cases(120, 2000)) {
    const test::Quad bound = std::ldexp(c.contacts.position_error_m, -c.posed.a.lattice_exp);
    const test::Quad square = bound * bound;
    for (const ContactSegment& segment : c.contacts.segments) {
      EXPECT_FALSE(segment.approximate);
      const LatticeTriangle ta = face_a(c, segment.pair.a), tb = face_b(c, segment.pair.b);
      for (const Point& end : {segment.p_m, segment.q_m}) {
        test::QuadVec p;
        for (std::size_t k = 0; k < 3; ++k)
          p[k] = static_cast<test::Quad>(std::ldexp(end[k], -c.posed.a.lattice_exp));
        EXPECT_TRUE(test::point_triangle_square(p, ta) <= square);
        EXPECT_TRUE(test::point_triangle_square(p, tb) <= square);
      }
    }
  }
}

TEST_P(ContactPair, PatchesHoldEveryPairOnceAndAreThoseOfTheDefinition) {
  for (const Case& c : touching_cases(120, 250)) {
    const std::vector<FacePair>& pairs = c.answer.pairs;
    // By the definition: neighbours pair by pair, then the closure by flooding.
    const auto share_corner = [](const SplitStore& store, const FaceKey& x, const FaceKey& y) {
      for (const VertexId u : store.face(x).corners())
        for (const VertexId v : store.face(y).corners())
          if (store.position(u) == store.position(v)) return true;
      return false;
    };
    std::vector<std::size_t> group(pairs.size());
    for (std::size_t i = 0; i < pairs.size(); ++i) group[i] = i;
    for (bool changed = true; changed;) {
      changed = false;
      for (std::size_t i = 0; i < pairs.size(); ++i)
        for (std::size_t j = 0; j < i; ++j) {
          if (group[i] == group[j]) continue;
          if ((pairs[i].a == pairs[j].a && share_corner(b_.store, pairs[i].b, pairs[j].b)) ||
              (pairs[i].b == pairs[j].b && share_corner(a_.store, pairs[i].a, pairs[j].a))) {
            group[i] = group[j] = std::min(group[i], group[j]);
            changed = true;
          }
        }
    }
    std::map<std::size_t, std::vector<FacePair>> expected;
    for (std::size_t i = 0; i < pairs.size(); ++i) expected[group[i]].push_back(pairs[i]);
    ASSERT_EQ(c.contacts.patches.size(), expected.size());
    auto at = expected.begin();
    std::size_t next = 0;
    for (const ContactPatch& patch : c.contacts.patches) {
      EXPECT_EQ(patch.first, next);
      next += patch.count;
      std::vector<FacePair> found;
      for (std::size_t i = patch.first; i < next; ++i)
        if (found.empty() || found.back() != c.contacts.segments[i].pair)
          found.push_back(c.contacts.segments[i].pair);
      EXPECT_EQ(found, (at++)->second);
    }
    EXPECT_EQ(next, c.contacts.segments.size());
  }
}

TEST_P(ContactPair, AFewEndsSpanEachPatchWithinTheStatedError) {
  int large = 0;
  for (const Case& c : touching_cases(120, 2000)) {
    for (const ContactPatch& patch : c.contacts.patches) {
      ASSERT_GE(patch.manifold_count, 1U);
      ASSERT_LE(patch.manifold_count, 4U);
      std::array<test::Vec, 4> points;  // the last again, so that there are four
      for (std::size_t i = 0; i < 4; ++i) {
        const Point& p = patch.manifold_m[std::min<std::size_t>(i, patch.manifold_count - 1)];
        points[i] = {p[0], p[1], p[2]};
      }
      std::array<bool, 4> is_end{};
      double reach = 0, most = 0;
      for (std::uint32_t s = patch.first; s < patch.first + patch.count; ++s)
        for (const Point& end : {c.contacts.segments[s].p_m, c.contacts.segments[s].q_m}) {
          for (std::size_t i = 0; i < patch.manifold_count; ++i)
            is_end[i] = is_end[i] || patch.manifold_m[i] == end;
          const test::Vec p{end[0], end[1], end[2]};
          long double off = std::numeric_limits<long double>::infinity();
          for (std::size_t left_out = 0; left_out < 4; ++left_out) {
            std::array<test::Vec, 3> face;
            for (std::size_t i = 0, next = 0; i < 4; ++i)
              if (i != left_out) face[next++] = points[i];
            off = std::min(off, test::point_triangle(p, face));
          }
          most = std::max(most, static_cast<double>(off));
          reach = std::max(reach, static_cast<double>(test::length(p - points[0])));
        }
      EXPECT_LE(most, patch.manifold_error_m + 4 * c.contacts.position_error_m + 1e-9 * reach);
      EXPECT_LE(patch.manifold_error_m, reach);
      for (std::size_t i = 0; i < patch.manifold_count; ++i) EXPECT_TRUE(is_end[i]);
      large += patch.manifold_count == 4 ? 1 : 0;
    }
  }
  if (std::string(GetParam().first) != "one_face") {
    EXPECT_GT(large, 0);
  }
}

TEST(Manifold, OfABallInAPlaneSpansTheCircle) {
  const test::ContactScene scene = test::sphere_in_plane();
  const PosedPair posed = scene.posed();
  const test::FullModel a(scene.a), b(scene.b);
  const Answer answer = query(a.tree.view(), posed.a, b.tree.view(), posed.b);
  const Contacts contacts = find_contacts(a.tree.view(), posed.a, b.tree.view(), posed.b, answer);
  ASSERT_EQ(contacts.patches.size(), 1U);
  const ContactPatch& patch = contacts.patches[0];
  ASSERT_EQ(patch.manifold_count, 4U);
  // Of a circle of radius 0.6 a square leaves 0.18 out on each side; the ball is a polyhedron.
  EXPECT_LT(patch.manifold_error_m, 0.25);
  EXPECT_GT(patch.manifold_error_m, 0.1);
}

std::array<long double, 3> normal_of(const LatticeTriangle& t) {
  std::array<test::Vec, 3> c;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) c[i][k] = static_cast<long double>(t[i].v[k] - t[0].v[k]);
  return test::cross(c[1], c[2]);
}

TEST_P(ContactPair, NoFaceOfTheReferenceIsFartherFromTheNormalThanStated) {
  std::size_t known = 0;
  for (const Case& c : touching_cases(120, 2000))
    for (const ContactPatch& patch : c.contacts.patches) {
      EXPECT_NEAR(test::norm3(patch.normal), 1, 1e-15);
      if (patch.normal_error_rad == kNoNormal_rad) continue;
      ++known;
      EXPECT_LT(patch.normal_error_rad, kNoNormal_rad / 2);
      long double greatest = 0;
      for (std::size_t i = patch.first; i < patch.first + patch.count; ++i) {
        const FacePair& pair = c.contacts.segments[i].pair;
        test::Vec n = normal_of(patch.normal_is_of_a ? face_a(c, pair.a) : face_b(c, pair.b));
        const long double size = test::length(n) * (patch.normal_is_of_a ? 1 : -1);
        if (size == 0) continue;
        for (std::size_t k = 0; k < 3; ++k) n[k] = n[k] / size - patch.normal[k];
        greatest = std::max(greatest, 2 * std::asin(test::length(n) / 2));
      }
      EXPECT_LE(greatest, patch.normal_error_rad);
      EXPECT_NEAR(static_cast<double>(greatest), patch.normal_error_rad, 1e-12);  // and no looser
    }
  EXPECT_GT(known, 3U);
}

TEST_P(ContactPair, SwappedBodiesHaveTheSamePatchesWithOppositeNormals) {
  for (const Case& c : touching_cases(80, 2000)) {
    const Answer answer = query(full_b_.tree.view(), c.posed.b, full_a_.tree.view(), c.posed.a);
    const Contacts swapped =
        find_contacts(full_b_.tree.view(), c.posed.b, full_a_.tree.view(), c.posed.a, answer);
    const double near_m = 4 * c.contacts.position_error_m;
    EXPECT_LE(swapped.position_error_m, near_m);
    ASSERT_EQ(swapped.segments.size(), c.contacts.segments.size());
    ASSERT_EQ(swapped.patches.size(), c.contacts.patches.size());
    std::map<FacePair, std::size_t> patch_of;
    for (std::size_t i = 0; i < swapped.patches.size(); ++i)
      patch_of[swapped.segments[swapped.patches[i].first].pair] = i;
    for (const ContactPatch& patch : c.contacts.patches) {
      // The patch of the swapped answer that holds this one's pairs.
      std::size_t found = swapped.patches.size();
      for (std::size_t i = patch.first; i < patch.first + patch.count; ++i) {
        const FacePair& pair = c.contacts.segments[i].pair;
        if (const auto at = patch_of.find({pair.b, pair.a}); at != patch_of.end())
          found = at->second;
      }
      ASSERT_LT(found, swapped.patches.size());
      const ContactPatch& other = swapped.patches[found];
      EXPECT_EQ(other.count, patch.count);
      EXPECT_NEAR(other.length_m, patch.length_m, patch.count * near_m);
      EXPECT_EQ(other.normal_is_of_a, !patch.normal_is_of_a);
      if (patch.length_m < 1e9 * near_m) continue;  // its weights are rounding errors
      EXPECT_NEAR(other.normal_error_rad, patch.normal_error_rad, 1e-7);
      for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_NEAR(other.normal[k], -patch.normal[k], 1e-7);
        EXPECT_NEAR(other.centroid_m[k], patch.centroid_m[k], 1e-7 * patch.length_m);
      }
    }
  }
}

TEST_P(ContactPair, MovedAndTurnedTogetherTheyHaveTheSamePatches) {
  for (const Case& c : touching_cases(80, 2000)) {
    // A quarter turn about z, then a move by powers of two: exact on the lattice.
    PosedPair turned = c.posed;
    const std::array<std::int64_t, 3> move{1 << 20, -(1 << 25), 1 << 10};
    for (PosedFrame* frame : {&turned.a, &turned.b}) {
      const PosedFrame old = *frame;
      for (std::size_t k = 0; k < 3; ++k) {
        frame->rotation[k] = -old.rotation[3 + k];
        frame->rotation[3 + k] = old.rotation[k];
      }
      frame->translation[0] = -old.translation[1];
      frame->translation[1] = old.translation[0];
      for (std::size_t k = 0; k < 3; ++k) frame->translation[k] += move[k];
    }
    const Case other = solve(turned);
    ASSERT_EQ(other.answer.pairs, c.answer.pairs);
    ASSERT_EQ(other.contacts.segments.size(), c.contacts.segments.size());
    ASSERT_EQ(other.contacts.patches.size(), c.contacts.patches.size());
    const double near_m = c.contacts.position_error_m + other.contacts.position_error_m;
    const auto expect_moved = [&](const Point& after, const Point& before) {
      const Point expected{-before[1], before[0], before[2]};
      for (std::size_t k = 0; k < 3; ++k)
        EXPECT_NEAR(after[k],
                    expected[k] + std::ldexp(static_cast<double>(move[k]), turned.a.lattice_exp),
                    near_m);
    };
    for (std::size_t i = 0; i < c.contacts.segments.size(); ++i) {
      expect_moved(other.contacts.segments[i].p_m, c.contacts.segments[i].p_m);
      expect_moved(other.contacts.segments[i].q_m, c.contacts.segments[i].q_m);
    }
    for (std::size_t i = 0; i < c.contacts.patches.size(); ++i) {
      const ContactPatch &before = c.contacts.patches[i], &after = other.contacts.patches[i];
      EXPECT_EQ(after.first, before.first);
      EXPECT_EQ(after.count, before.count);
      EXPECT_NEAR(after.length_m, before.length_m, 1e-12 * before.length_m);
      EXPECT_EQ(after.normal_is_of_a, before.normal_is_of_a);
      EXPECT_NEAR(after.normal[0], -before.normal[1], 1e-12);
      EXPECT_NEAR(after.normal[1], before.normal[0], 1e-12);
      EXPECT_NEAR(after.normal[2], before.normal[2], 1e-12);
      EXPECT_NEAR(after.normal_error_rad, before.normal_error_rad, 1e-12);
    }
  }
}

TEST_P(ContactPair, OfTheSameFacesAreTheSameFromEitherKindOfTree) {
  LocalModel a(a_.store, a_.header.grid), b(b_.store, b_.header.grid);
  for (const Case& c : touching_cases(40, 2000)) {
    const Answer answer =
        certify(a, c.posed.a, test::no_require, b, c.posed.b, test::no_require, {}).value();
    const Contacts contacts = find_contacts(a.view(), c.posed.a, b.view(), c.posed.b, answer);
    ASSERT_EQ(contacts.segments.size(), c.contacts.segments.size());
    for (std::size_t i = 0; i < contacts.segments.size(); ++i) {
      EXPECT_EQ(contacts.segments[i].p_m, c.contacts.segments[i].p_m);
      EXPECT_EQ(contacts.segments[i].q_m, c.contacts.segments[i].q_m);
    }
    ASSERT_EQ(contacts.patches.size(), c.contacts.patches.size());
    for (std::size_t i = 0; i < contacts.patches.size(); ++i)
      EXPECT_EQ(contacts.patches[i].normal, c.contacts.patches[i].normal);
  }
}

TEST_P(ContactPair, ApproximateOnesAreFlaggedJustWhereAFaceIsNotExact) {
  Random random(17);
  std::size_t exact = 0, coarse = 0;
  for (int i = 0; i < 30; ++i) {
    ActiveMesh a(a_.store), b(b_.store);
    RefineDelta delta;
    for (ActiveMesh* mesh : {&a, &b}) {
      const std::uint32_t n = mesh->store().vertex_count(), first = random.below(n);
      for (std::uint32_t v = first; v < std::min(n, first + n / 2); ++v)
        ASSERT_TRUE(mesh->split({v}, delta));
    }
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Contacts contacts = approximate_contacts(a, posed.a, b, posed.b);
    for (const ContactPatch& patch : contacts.patches) {
      bool approximate = false;
      for (std::size_t j = patch.first; j < patch.first + patch.count; ++j) {
        const ContactSegment& segment = contacts.segments[j];
        EXPECT_EQ(segment.approximate, !a.is_exact(a_.store.face(segment.pair.a)) ||
                                           !b.is_exact(b_.store.face(segment.pair.b)));
        approximate = approximate || segment.approximate;
        ++(segment.approximate ? coarse : exact);
      }
      EXPECT_EQ(patch.approximate, approximate);
      EXPECT_EQ(patch.uncertainty_m > 0, approximate);
    }
  }
  EXPECT_GT(exact + coarse, 20U / (kPart * kPart));
}

TEST_P(ContactPair, OfATruncatedAnswerSaySo) {
  for (const Case& c : touching_cases(60, 2000)) {
    EXPECT_FALSE(c.contacts.truncated);
    EXPECT_EQ(c.contacts.pair_total, c.answer.pairs.size());
    const Answer cut = query(full_a_.tree.view(), c.posed.a, full_b_.tree.view(), c.posed.b,
                             {.max_pairs = c.answer.pairs.size() - 1});
    const Contacts contacts =
        find_contacts(full_a_.tree.view(), c.posed.a, full_b_.tree.view(), c.posed.b, cut);
    EXPECT_TRUE(contacts.truncated);
    EXPECT_EQ(contacts.pair_total, c.answer.pairs.size());
    EXPECT_LT(contacts.segments.size(), c.contacts.segments.size());
  }
}

// ---- known contacts -----------------------------------------------------------------------------

Contacts contacts_of(const BakedModel& a, const Pose& pose_a, const BakedModel& b,
                     const Pose& pose_b) {
  const PosedPair posed = pose_pair(a.header.grid, pose_a, "a", b.header.grid, pose_b, "b").value();
  const test::FullModel full_a(a), full_b(b);
  const Answer answer = query(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b);
  return find_contacts(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b, answer);
}

TEST(Contacts, OfNothingAreNone) {
  const BakedModel box = test::bake_mesh(test::make_box({1, 1, 1}, 1), 16);
  const Contacts contacts = contacts_of(box, {}, box, {.translation_m = {0, 0, 3}});
  EXPECT_TRUE(contacts.segments.empty());
  EXPECT_TRUE(contacts.patches.empty());
}

TEST(Contacts, OfASphereSunkIntoAPlaneAreTheCircle) {
  const test::ContactScene scene = test::sphere_in_plane();
  const Contacts contacts = contacts_of(scene.a, scene.pose_a, scene.b, scene.pose_b);
  EXPECT_LT(contacts.position_error_m, 2e-15);
  ASSERT_EQ(contacts.patches.size(), 1U);
  const ContactPatch& circle = contacts.patches[0];
  EXPECT_NEAR(circle.length_m, 2 * 0.6 * 3.14159265, 0.015);
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_NEAR(circle.centroid_m[k], (Point{0.037, -0.021, 0})[k], 1e-3);
  EXPECT_TRUE(circle.normal_is_of_a);
  EXPECT_EQ(circle.normal, (Point{0, 0, 1}));
  EXPECT_LT(circle.normal_error_rad, 1e-13);
  for (const ContactSegment& segment : contacts.segments)
    for (const Point& p : {segment.p_m, segment.q_m})
      EXPECT_NEAR(std::hypot(p[0] - 0.037, p[1] + 0.021), 0.6, 0.006);
  // The plane above the sphere: B moves up all the same.
  const Contacts below = contacts_of(scene.b, scene.pose_b, scene.a, scene.pose_a);
  EXPECT_EQ(below.patches[0].normal, (Point{0, 0, -1}));
}

class ContactsOnPlane : public ::testing::Test {
 protected:
  BakedModel plane_ = test::bake_mesh(test::make_plane(8, 7), 16);
  BakedModel box_ = test::bake_mesh(test::make_box({1, 1, 1}, 2), 16);
  void expect_up(const ContactPatch& patch) {
    EXPECT_NEAR(test::angle_rad(patch.normal, {0, 0, 1}), 0, 1e-12);
    EXPECT_LT(patch.normal_error_rad, 1e-12);
  }
};

TEST_F(ContactsOnPlane, OfABoxsFaceAreOnePatch) {
  const Contacts contacts = contacts_of(plane_, {}, box_, {.translation_m = {0.25, 0.125, 1}});
  ASSERT_EQ(contacts.patches.size(), 1U);
  expect_up(contacts.patches[0]);
  double least = 9, greatest = -9;
  for (const ContactSegment& segment : contacts.segments)
    for (const Point& p : {segment.p_m, segment.q_m}) {
      EXPECT_EQ(p[2], 0);
      least = std::min(least, p[0]);
      greatest = std::max(greatest, p[0]);
    }
  EXPECT_EQ(least, -0.75);
  EXPECT_EQ(greatest, 1.25);
}

TEST_F(ContactsOnPlane, OfABoxsEdgeAreTheEdge) {
  // Turned by an eighth about y, and sunk by 0.2 mm: the cut is a strip along the edge.
  const double r = std::sqrt(0.5);
  const Pose pose{{r, 0, r, 0, 1, 0, -r, 0, r}, {0, 0, 1.414}};
  const Contacts contacts = contacts_of(plane_, {}, box_, pose);
  ASSERT_EQ(contacts.patches.size(), 1U);
  expect_up(contacts.patches[0]);
  EXPECT_NEAR(contacts.patches[0].centroid_m[0], 0, 1e-6);
  EXPECT_NEAR(contacts.patches[0].centroid_m[1], 0, 1e-6);
}

TEST_F(ContactsOnPlane, OfATipAreAPoint) {
  const BakedModel tip = test::bake_mesh(test::make_cone(1, 1, 8, 1), 16);
  const Pose upside_down{{1, 0, 0, 0, -1, 0, 0, 0, -1}, {0.3125, 0.25, 1}};
  const Contacts contacts = contacts_of(plane_, {}, tip, upside_down);
  ASSERT_EQ(contacts.patches.size(), 1U);
  const ContactPatch& patch = contacts.patches[0];
  EXPECT_EQ(patch.length_m, 0);
  EXPECT_EQ(patch.centroid_m, (Point{0.3125, 0.25, 0}));
  expect_up(patch);
  for (const ContactSegment& segment : contacts.segments) EXPECT_EQ(segment.p_m, segment.q_m);
}

TEST(Contacts, ThatLieApartAreTwoPatches) {
  const BakedModel plate = test::bake_mesh(test::make_plate(6, 0.5, 16), 16);
  const BakedModel torus = test::bake_mesh(test::make_torus(1.5, 0.4, 32, 16), 16);
  // Standing upright through the plate's top and bottom: two places, each with a rim above and one
  // below.
  const Contacts contacts = contacts_of(plate, {}, torus, {{1, 0, 0, 0, 0, -1, 0, 1, 0}, {}});
  ASSERT_EQ(contacts.patches.size(), 4U);
  int up = 0;
  for (const ContactPatch& patch : contacts.patches) {
    EXPECT_LT(test::angle_rad({0, 0, patch.normal[2]}, patch.normal), 1e-9);
    EXPECT_NEAR(patch.centroid_m[2], patch.normal[2] > 0 ? 0 : -0.5, 1e-6);
    EXPECT_NEAR(std::abs(patch.centroid_m[0]), 1.5, 0.1);
    up += patch.normal[2] > 0;
  }
  EXPECT_EQ(up, 2);
}

TEST(Contacts, OfFacesThatCancelHaveNoNormal) {
  // A thin plate sunk through a thin plate: every face of each has its opposite in the patch.
  const BakedModel blade = test::bake_mesh(test::make_box({1, 1, 0.01}, 1), 16);
  const Contacts contacts = contacts_of(blade, {}, blade, {{1, 0, 0, 0, 0, -1, 0, 1, 0}, {}});
  ASSERT_EQ(contacts.patches.size(), 1U);
  EXPECT_EQ(contacts.patches[0].normal_error_rad, kNoNormal_rad);
  EXPECT_NEAR(test::norm3(contacts.patches[0].normal), 1, 1e-12);
}

TEST(Contacts, AreTheSameBitsOnEveryMachine) {
  const BakedModel ground = test::bake_mesh(generate_terrain(16, 5), 16);
  const BakedModel craft = test::bake_mesh(generate_aircraft(600, 5), 16);
  std::uint64_t hash = 0;
  std::size_t segments = 0;
  const auto add = [&hash](double x) { hash = mix(hash ^ std::bit_cast<std::uint64_t>(x)); };
  for (std::uint32_t i = 0; i < 16; ++i) {
    const auto [c, s] = test::unit_circle(i, 16);
    const Point at = test::position_m(ground.header, ground.store, {10 + 13 * i});
    const Contacts contacts =
        contacts_of(ground, {}, craft, {{c, 0, s, 0, 1, 0, -s, 0, c}, {at[0], at[1], at[2] + 1}});
    segments += contacts.segments.size();
    add(contacts.position_error_m);
    for (const ContactSegment& segment : contacts.segments)
      for (const Point& p : {segment.p_m, segment.q_m})
        for (const double x : p) add(x);
    for (const ContactPatch& patch : contacts.patches) {
      for (const double x : patch.centroid_m) add(x);
      for (const double x : patch.normal) add(x);
      add(patch.length_m);
      add(patch.normal_error_rad);
    }
  }
  EXPECT_GT(segments, 300U);
  EXPECT_EQ(hash, 15414266713836927583U);
}

TEST(Contacts, OfSegmentsHaveNoNormal) {
  const IndexedMesh x{{{-1, 0, 0}, {1, 0, 0}}, {{0, 1, 0}}},
      y{{{0, -1, 0}, {0, 1, 0}}, {{0, 1, 0}}};
  const Contacts contacts = contacts_of(test::bake_mesh(x), {}, test::bake_mesh(y), {});
  ASSERT_EQ(contacts.patches.size(), 1U);
  EXPECT_EQ(contacts.patches[0].normal_error_rad, kNoNormal_rad);
  EXPECT_EQ(contacts.patches[0].normal, (Point{0, 0, 1}));
  for (const double v : contacts.patches[0].centroid_m) EXPECT_NEAR(v, 0, 1e-6);
}

}  // namespace
}  // namespace nearmesh
