// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a server of clusters chooses (rivals.cpp): of a node that stands in the way it tells
// half-spaces that part it from the other body, or opens it, whichever is cheaper in all.

#include <map>
#include <set>
#include <vector>

#include "clusters.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "nearmesh/core/spm/detail/half_space.hpp"

namespace nearmesh::chart {

// The last: of which node.
inline constexpr double kHalfSpaceBits = kDirectionBits + kReachBits + 2;

using HalfSpaces = std::map<std::uint32_t, std::vector<HalfSpace>>;  // by node

/// A part of a body as a peer holds it: the faces of an open cluster, or a box with half-spaces.
struct Part {
  CenteredBox box;
  GridPoint middle;
  const Node* open = nullptr;
  std::vector<HalfSpace> half_spaces{};
};

/// How two bodies lie to each other at one time.
struct Instant {
  RelativeFrame other_in_own, own_in_other;
};

/// The cheapest statements about one body that part it from, or hold its faces against, the parts
/// of the other at all instants.
class Planner {
 public:
  /// `known` and `told`: what the peer has of this body already; it costs nothing.
  Planner(const Clusters& own, const std::set<std::uint32_t>& known, const HalfSpaces& told,
          const std::vector<Instant>& instants)
      : own_(own), known_(known), told_(told), instants_(instants) {}

  struct Plan {
    double bits = 0;
    std::vector<std::uint32_t> opened;  ///< parents first
    HalfSpaces told;                    ///< new ones
    std::vector<Part> parts;
  };
  /// Once a planner.
  [[nodiscard]] Plan plan(const std::vector<Part>& others);

 private:
  struct Choice {
    bool opens = false;
    std::vector<HalfSpace> half_spaces;
  };
  struct Placed {
    const Part* part;
    const Instant* at;
  };

  [[nodiscard]] Part part_of(std::uint32_t i) const;
  [[nodiscard]] std::vector<HalfSpace> choose(std::uint32_t i, const Part& own,
                                              const std::vector<Placed>& close, bool& clear) const;
  bool gather(std::uint32_t i, std::vector<GridPoint>& points) const;
  double solve(std::uint32_t i, const std::vector<Placed>& above);
  void collect(std::uint32_t i, Plan& plan) const;

  const Clusters& own_;
  const std::set<std::uint32_t>& known_;
  const HalfSpaces& told_;
  const std::vector<Instant>& instants_;
  std::map<std::uint32_t, Choice> choices_;
};

/// A body of which all clusters are open.
[[nodiscard]] std::vector<Part> all_open(const Clusters& clusters);

}  // namespace nearmesh::chart
