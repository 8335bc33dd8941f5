// SPDX-License-Identifier: Apache-2.0
#pragma once
// A peer as it reports: which bodies it watches, what it has answered, which of its bounds reports
// wait to be judged.

#include <algorithm>
#include <cstdint>
#include <deque>
#include <iterator>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/broadphase/body_place.hpp"
#include "nearmesh/idl/messages/messages.hpp"
#include "pose_tape.hpp"
#include "recorded_peer.hpp"

namespace nearmesh::subscriber {

/// A body that a peer watches.
struct WatchedBody {
  wire::SessionId mover = 0;  // 0: it is in place
  wire::WatchedBodies::Known known = wire::WatchedBodies::Known::kByPose;
  std::size_t mover_place = 0;
  std::uint32_t number = 0;
  std::string name;  // empty: not known yet
  ContentHash content;
  Company company;
  double max_age_s = 0;
  const ModelBounds* bounds = nullptr;
  // As it was last put into the broad phase.
  BroadPhase::Slot slot = 0;
  std::optional<Motion> motion;
  BodyPlace place;
};

/// One peer, as one participant speaks for it.
struct Watcher {
  struct Waiting {
    std::int64_t id = 0;
    int round = 0;
    wire::BoundsReport report;
  };
  std::map<std::uint32_t, std::map<std::uint32_t, wire::WatchedBodies>> told;  // by part, edition
  std::uint32_t whole_until = 0;  // all editions up to this came
  std::deque<Waiting> waiting;
  // What it watched when a report was judged last.
  std::uint32_t edition = 0;  // 0: none
  LookAhead ahead;
  std::vector<WatchedBody> bodies;
  std::vector<wire::SessionId> movers;
  BroadPhase broad;
  std::vector<std::size_t> by_slot;  // of the bodies

  /// Contact reports, by their bodies' names in order, then frame; for a while.
  struct Said {
    double since_s = 0;  // a frame may be repeated
    int round = 0;
    bool put_off = false;  // told once, until the pair is asked again
  };
  std::map<std::pair<std::string, std::string>, std::map<std::uint64_t, Said>> said;
  std::optional<std::uint64_t> first_said;  // frame
  std::uint64_t latest_frame = 0;           // of the report that came last, of either kind

  void take(wire::ContactReport&& report, int round) {
    if (!first_said) first_said = report.frame;
    latest_frame = report.frame;
    // What claims something where nothing could be known is no answer: verify calls it different.
    const bool is_known = report.asked && why_stale(report).empty();
    if (!is_known && !claims_nothing(report)) return;
    if (report.body_b < report.body_a) std::swap(report.body_a, report.body_b);
    auto& frames = said[{std::move(report.body_a), std::move(report.body_b)}];
    const auto at = frames.try_emplace(report.frame, Said{report.time_s}).first;
    at->second = {std::min(at->second.since_s, report.time_s), round, report.put_off};
  }
  [[nodiscard]] bool has_said(const std::string& a, const std::string& b,
                              const wire::BoundsReport& report) const {
    const auto pair = said.find(std::minmax(a, b));
    if (pair == said.end()) return false;
    const auto after = pair->second.upper_bound(report.frame);
    if (after == pair->second.begin()) return false;
    const auto& [frame, last] = *std::prev(after);
    // Where a frame is repeated at another time, what is as before is not said again.
    return last.put_off || (frame == report.frame && last.since_s <= report.time_s);
  }
  void forget(int round) {
    for (auto& [names, frames] : said) {
      const std::uint64_t last = frames.rbegin()->first;
      std::erase_if(frames, [last, round](const auto& one) {
        return one.second.round + kRoundsKept < round && !(one.first == last && one.second.put_off);
      });
    }
    std::erase_if(said, [](const auto& pair) { return pair.second.empty(); });
  }

  void take(wire::WatchedBodies&& watched) {
    if (watched.edition == whole_until + 1) whole_until = watched.edition;
    auto& editions = told[watched.part];
    editions.insert_or_assign(watched.edition, std::move(watched));
    if (std::cmp_greater(editions.size(), 2 * kMessagesARound)) editions.erase(editions.begin());
  }
};

}  // namespace nearmesh::subscriber
