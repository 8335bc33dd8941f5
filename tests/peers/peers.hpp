// SPDX-License-Identifier: Apache-2.0
#pragma once
// The libraries that nearmesh is held against, one adapter each: two whole meshes, and what is
// asked of them under poses. All are given the same triangles, in metres, and the same poses, and
// do what a careful user of each would do. nearmesh-perf and nearmesh-chart time them,
// nearmesh-stability holds their answers against the truth.

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "nearmesh/core/geometry/pose.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh::peers {

/// Of one contact, as a library tells it.
struct ContactPoint {
  std::array<double, 3> at_m{}, normal{};  ///< world; the normal of any length, from a to b
  double depth_m = 0;                      ///< of the two triangles, along the normal
};

/// Built once, then asked pose by pose. What a library does not offer is nothing. Functions may
/// throw std::exception, and one that is used beyond what it documents may crash or hang.
class Peer {
 public:
  virtual ~Peer() = default;
  /// Places the bodies. Not timed: transforms are copied here, and a progressive replica fetches
  /// what it lacks.
  virtual void place(const Pose& a, const Pose& b) = 0;
  /// First contact: whether they touch. Timed.
  virtual bool touches() = 0;
  /// All touching pairs of triangles. Timed.
  virtual std::optional<std::uint64_t> count_pairs() { return std::nullopt; }
  /// Refits whatever it has to `positions_m` of body b after every vertex moved; false where the
  /// library cannot. Timed.
  virtual bool refit_b(const std::vector<std::array<double, 3>>& /*positions_m*/) { return false; }

  /// Distinct touching pairs of triangles, among as many as the library finds until it has `limit`.
  virtual std::optional<std::uint64_t> count_distinct_pairs(std::size_t /*limit*/) {
    return std::nullopt;
  }
  /// Where they touch.
  virtual std::optional<std::vector<ContactPoint>> contacts() { return std::nullopt; }
  /// Exact, of bodies that do not touch. Timed.
  virtual std::optional<double> distance_m() { return std::nullopt; }
  /// Whether they touch at any time while b moves to `end_b` in a straight line.
  virtual std::optional<bool> touches_on_the_way(const Pose& /*end_b*/) { return std::nullopt; }
  /// Whether the bodies touch, taken with their insides.
  virtual std::optional<bool> solids_meet() { return std::nullopt; }
};

/// A library, asked in one way.
struct PeerInfo {
  std::string name;             ///< of the library and the way, e.g. fcl-obb
  std::string library;          ///< e.g. FCL
  std::string version;          ///< e.g. 0.7.0
  bool counts_exactly = false;  ///< its number of pairs is to equal ours; booleans always are
  bool cuts_lists = false;      ///< count_distinct_pairs stops at the limit
  std::unique_ptr<Peer> (*make)(const IndexedMesh& a, const IndexedMesh& b) = nullptr;
  /// Whether the library reads a mesh file; nothing where it reads none.
  bool (*reads)(const std::string& path) = nullptr;
};

// Each is there where its target nearmesh_peer_NAME is, which defines NEARMESH_PEER_NAME for
// whoever links it.
[[nodiscard]] PeerInfo fcl_obb();
[[nodiscard]] PeerInfo fcl_obbrss();
[[nodiscard]] PeerInfo coal_obbrss();
[[nodiscard]] PeerInfo pqp();
/// The precision is that of the target: nearmesh_peer_bullet, as its users have it, or
/// nearmesh_peer_bullet_double.
[[nodiscard]] PeerInfo bullet();
[[nodiscard]] PeerInfo embree();
/// Trees of both bodies, moved by transforms: whether surfaces meet, not where.
[[nodiscard]] PeerInfo cgal_rigid();
/// A tree of a's posed triangles for each pose: which triangles meet.
[[nodiscard]] PeerInfo cgal_triangles();

/// Those that are timed, of the libraries that were found when this was built.
[[nodiscard]] std::vector<PeerInfo> timed_peers();

}  // namespace nearmesh::peers
