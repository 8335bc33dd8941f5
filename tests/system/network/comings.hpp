// SPDX-License-Identifier: Apache-2.0
#pragma once
// Joining late, again and again, and links that go down and come up.

#include <string>
#include <vector>

#include "runs.hpp"

namespace nearmesh::test {

struct Joins {
  std::uint64_t joined = 0;  ///< certified from the first frame on, and ended as planned
  std::uint64_t answers = 0, certified = 0, wrong = 0;
  std::vector<double> seconds;  ///< from a program's start to its first certified answer, ascending
  std::vector<std::string> faults;  ///< one for each that did not join, or was wrong
};
/// So many nearmesh-subscribers, one after the other, at a publisher that has long been serving and
/// with a peer that has long been flying, each near that one and over the ground. Every answer is
/// checked against the full meshes.
[[nodiscard]] Joins join_in_a_row(const Exercise& exercise, int times, double loss,
                                  std::uint64_t seed);

struct Outage {
  bool of_publisher = false;  ///< whose link was down
  double down_s = 0;
  /// From the link being up to an answer that needed new detail; -1: it did not come in time.
  double back_s = 0;
};
struct Outages {
  std::vector<Outage> all;
  std::uint64_t certified_while_down = 0, wrong = 0;
};
/// A publisher and a peer, whose links go down for each of these times in turn.
[[nodiscard]] Outages take_links_down(const Exercise& exercise, const std::vector<double>& down_s);

/// The same at length: joins.csv and outages.csv. Out: true when all went as it should.
[[nodiscard]] bool measure_joins(const std::string& out, const Exercise& exercise, int times,
                                 double loss, std::uint64_t seed);
[[nodiscard]] bool measure_outages(const std::string& out, const Exercise& exercise, int times,
                                   std::uint64_t seed);

}  // namespace nearmesh::test
