// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a plan of several sites rests on: the sizes of the product's own messages, the topics that
// cross between sites, what joining and staying cost as they were measured, and what is guessed.

#include <string>
#include <string_view>
#include <vector>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::sites {

/// Samples as the product's codecs write them, bytes with their encapsulation and without what
/// travels around them.
struct MessageBytes {
  double poses = 0;    ///< of a peer with one body
  double promise = 0;  ///< of the same
  double request = 0;  ///< about one pair of bodies, for the publisher to choose
  double batch = 0;    ///< a batch without its detail
};
[[nodiscard]] MessageBytes message_bytes();

/// DDS domains that one network has.
inline constexpr double kMostDomains = 233;
/// Of how many bodies a peer hears through one writer, as a router is: those beyond are ignored,
/// with one line.
[[nodiscard]] double most_bodies_of_a_writer();

/// Whether a router between sites hands a topic on.
struct Crossing {
  std::string_view topic;  ///< last part of its name
  bool crosses = false;
  std::string_view why;
};
/// Of each topic of the product's table, in its order. What peers tell peers crosses; publishers
/// and recorders are each site's own, and so is what is named in the source. A new topic falls in
/// by who writes and who reads it.
[[nodiscard]] std::vector<Crossing> crossings();
/// The allow list of an eProsima DDS Router, for all wire versions. `prefix`: of the topics.
[[nodiscard]] std::string allow_list(const std::string& prefix);

/// What participants of one domain cost each other: lines through what measure_discovery.py
/// measured.
struct Measured {
  /// y = at_0 + slope x.
  struct Line {
    double at_0 = 0, slope = 0;
    [[nodiscard]] double at(double x) const { return at_0 + slope * x; }
  };
  struct Row {
    double participants = 0, rate_hz = 0, join_unicast_bytes = 0, join_multicast_bytes = 0,
           join_cpu_s = 0, stay_unicast_bytes = 0, stay_multicast_bytes = 0, stay_cpu_s = 0;
  };
  std::vector<Row> rows;
  Line join_bytes;        ///< of each ordered pair, over all participants
  Line join_cpu_s;        ///< of each participant, over all others: at 0 what its start takes
  Line stay_bytes_per_s;  ///< of each participant, over all others: life signs, heartbeats
  /// Of a sample of poses to one reader, all in: acknowledged, with headers.
  double pose_wire_bytes = 0;
  double pose_cpu_s = 0;         ///< of the same, writer and reader together
  double most_participants = 0;  ///< that were measured

  /// All rows of such a file. Errors: kIo, kInvalidArgument naming the file and what is no number.
  [[nodiscard]] static Result<std::vector<Row>> read_rows(const std::string& path);
  /// Errors: also kInvalidArgument naming the file and what it lacks: two rates, the same three
  /// counts of participants or more at each.
  [[nodiscard]] static Result<Measured> read(const std::string& path);

  /// Until all that join in turn know each other; sums over all.
  [[nodiscard]] double all_join_bytes(double participants) const;
  [[nodiscard]] double all_join_cpu_s(double participants) const;
  /// What travels with a sample of poses beside its payload.
  [[nodiscard]] double around_bytes() const;
};

/// Of those who ask for detail: measured elsewhere (docs/network.md), for flights like the demo's.
struct Asking {
  double requests_per_s = 3.3;  ///< of a peer near something
  double answer_bytes = 0;      ///< of batches, a request
  double publisher_cpu_s = 0;   ///< a request
  /// From the largest row of docs/network/peers-light.csv. Errors: as Measured::read.
  [[nodiscard]] static Result<Asking> read(const std::string& path);
};

/// What nobody measured, and what would.
struct Guess {
  std::string what, value, proof;
};
[[nodiscard]] std::vector<Guess> guesses();

}  // namespace nearmesh::sites
