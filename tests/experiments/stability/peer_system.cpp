// SPDX-License-Identifier: Apache-2.0
// The other libraries, as systems. What a library without progressive meshes is given of body a:
// where a part was streamed the triangles of what has come, else all.
#include "contact_check.hpp"
#include "nearmesh_system.hpp"
#include "system.hpp"
#include "tests/peers/peers.hpp"

namespace nearmesh::stability {
namespace {

using Kind = Verdict::Kind;

constexpr std::size_t kAllPairs = 100'000'000;

Kind kind_if(bool touches) { return touches ? Kind::kTouches : Kind::kFree; }

IndexedMesh held_of(const Case& asked) {
  return asked.model_a ? held_mesh(*asked.model_a, asked.held_a) : *asked.a.mesh;
}

class PeerSystem : public System {
 public:
  PeerSystem(peers::PeerInfo info, std::string call)
      : info_(std::move(info)), call_(std::move(call)) {}
  [[nodiscard]] std::string name() const override { return info_.library; }
  [[nodiscard]] std::string version() const override { return info_.version; }
  [[nodiscard]] std::string call() const override { return call_; }

  [[nodiscard]] Verdict answer(const Case& asked) const override {
    switch (asked.question) {
      case Question::kBounds:
      case Question::kIncremental:
        return {};
      case Question::kFile:
        if (info_.reads == nullptr) return {};
        return {.kind = info_.reads(asked.path) ? Kind::kFree : Kind::kRefused};
      case Question::kLimit:
        if (!info_.cuts_lists) return {};
        break;
      default:
        break;
    }
    const std::unique_ptr<peers::Peer> peer = info_.make(held_of(asked), *asked.b.mesh);
    peer->place(asked.a.pose, asked.b.pose);
    if (asked.question == Question::kContacts) {
      const auto points = peer->contacts();
      return points ? judge_contacts(asked, *points) : Verdict{};
    }
    if (asked.question == Question::kSweep) {
      Pose end = asked.end_b;
      if (asked.half_turn) end.rotation = {-1, 0, 0, 0, -1, 0, 0, 0, 1};
      const std::optional<bool> hit = peer->touches_on_the_way(end);
      return hit ? Verdict{.kind = kind_if(*hit)} : Verdict{};
    }
    // A library that knows no insides is asked about surfaces.
    if (asked.question == Question::kSolids)
      if (const std::optional<bool> meet = peer->solids_meet()) return {.kind = kind_if(*meet)};
    const std::uint64_t pairs =
        peer->count_distinct_pairs(asked.question == Question::kLimit ? asked.limit : kAllPairs)
            .value();
    return {.kind = kind_if(pairs > 0), .has_pairs = true, .pairs = pairs};
  }

 private:
  peers::PeerInfo info_;
  std::string call_;
};

}  // namespace

std::vector<std::unique_ptr<System>> make_peers() {
  std::vector<std::unique_ptr<System>> systems;
  [[maybe_unused]] const auto add = [&](const peers::PeerInfo& info, const char* call) {
    systems.push_back(std::make_unique<PeerSystem>(info, call));
  };
#ifdef NEARMESH_PEER_FCL
  add(peers::fcl_obbrss(),
      "BVHModel<OBBRSSd>, collide() with num_max_contacts 1e8 (where a limit is asked for: that) "
      "and "
      "enable_contact false; "
      "pairs are distinct (b1, b2). Paths: continuousCollide(), CCDC_NAIVE with 1000 steps, "
      "CCDM_LINEAR (of its "
      "settings the one that finds most of these hits). "
      "Contact points: enable_contact true, Contact::pos and normal");
#endif
#ifdef NEARMESH_PEER_BULLET_DOUBLE
  add(peers::bullet(),
      "double precision, btGImpactMeshShape with margin 0, "
      "btGImpactCollisionAlgorithm::processCollision; contacts at distance <= 0, pairs are "
      "distinct (triangle, triangle). Paths: convexSweepTest of the moving body's hull against "
      "btBvhTriangleMeshShape. Contact points: "
      "the points and normals that the algorithm reports");
#endif
#ifdef NEARMESH_PEER_CGAL
  add(peers::cgal_triangles(),
      "exact predicates, inexact constructions; AABB_tree of a's posed triangles, "
      "all_intersected_primitives for "
      "each of b's; files by IO::read_polygon_soup. Insides: "
      "Polygon_mesh_processing::do_intersect with do_overlap_test_of_bounded_sides");
#endif
  return systems;
}

}  // namespace nearmesh::stability
