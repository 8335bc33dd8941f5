// SPDX-License-Identifier: Apache-2.0
#include "tile_sum.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/base/hash.hpp"

namespace nearmesh {
namespace {

/// The distance, its points and what bounds it, of the tile that is nearer. Of tiles that touch
/// nothing matters.
void take_nearer(const Answer& tile, Answer& sum) {
  if (tile.clearance_m < sum.clearance_m) {
    sum.clearance_m = tile.clearance_m;
    sum.clearance_share = tile.clearance_share;
  }
  if (tile.distance_at_most_m < sum.distance_at_most_m) {
    sum.distance_at_most_m = tile.distance_at_most_m;
    sum.nearest_a_m = tile.nearest_a_m;
    sum.nearest_b_m = tile.nearest_b_m;
  }
}

}  // namespace

void add_sorted(std::vector<NodeSpan>& nodes, const std::vector<NodeSpan>& more) {
  nodes.insert(nodes.end(), more.begin(), more.end());
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
}

TileSum::TileSum(const TileSumOptions& options, const ContentHash& world, const TilesAround& around)
    : options_(options) {
  sum_.clearance_m = around.rest_m;
  words_.push_back(world.high);
  if (around.near.missing.empty()) return;
  is_all_certified_ = false;
  sum_.uncertainty_m = std::numeric_limits<double>::infinity();
}

void TileSum::note(const WorldEntry& tile, std::size_t pairs,
                   const std::vector<NodeSpan>& missing) {
  words_.push_back(tile.content.high);
  for (const std::int32_t cells : tile.place) words_.push_back(static_cast<std::uint32_t>(cells));
  words_.push_back(pairs);
  for (const NodeSpan& node : missing)
    words_.push_back(std::uint64_t{node.first.value} << 32 | node.size);
}

void TileSum::add_unknown(const WorldEntry& tile) {
  is_all_certified_ = false;
  sum_.uncertainty_m = std::numeric_limits<double>::infinity();
  note(tile, 0, {});
}

std::size_t TileSum::add(const WorldEntry& tile, const Answer& answer) {
  is_all_certified_ &= is_certified(answer.status);
  sum_.pair_total += answer.pair_total;
  const std::size_t room = options_.max_pairs - std::min(options_.max_pairs, sum_.pairs.size());
  const std::size_t listed = std::min(answer.pairs.size(), room);
  sum_.pairs.insert(sum_.pairs.end(), answer.pairs.begin(),
                    answer.pairs.begin() + static_cast<std::ptrdiff_t>(listed));
  sum_.truncated |= answer.truncated || listed < answer.pairs.size();
  sum_.exhausted |= answer.exhausted;
  const auto& of_tile = options_.world_is_a ? answer.missing_a : answer.missing_b;
  const auto& of_other = options_.world_is_a ? answer.missing_b : answer.missing_a;
  add_sorted(options_.world_is_a ? sum_.missing_b : sum_.missing_a, of_other);
  sum_.uncertainty_m = std::max(sum_.uncertainty_m, answer.uncertainty_m);
  if (answer.status == AnswerStatus::kContained) contained_ |= static_cast<int>(answer.contained);
  take_nearer(answer, sum_);
  if (answer.status != AnswerStatus::kFree) note(tile, listed, of_tile);
  return listed;
}

Answer TileSum::finish() {
  if (sum_.pair_total > 0) {
    sum_.status =
        is_all_certified_ || options_.any ? AnswerStatus::kContact : AnswerStatus::kPartial;
    sum_.distance_at_most_m = 0;
  } else if (!is_all_certified_) {
    sum_.status = AnswerStatus::kUncertain;
  } else {
    sum_.status = contained_ != 0 ? AnswerStatus::kContained : AnswerStatus::kFree;
    sum_.contained = static_cast<Containment>(contained_);
  }
  if (!is_certified(sum_.status) || sum_.pair_total > 0 || options_.clearance == Clearance::kNone) {
    sum_.clearance_m = 0;
    sum_.clearance_share = 0;
  }
  if (is_certified(sum_.status)) sum_.uncertainty_m = 0;
  digest_ = nearmesh::digest(sum_);
  for (const std::uint64_t word : words_) digest_ = mix(digest_ ^ word);
  return std::move(sum_);
}

}  // namespace nearmesh
