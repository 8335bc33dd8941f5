// SPDX-License-Identifier: Apache-2.0
#include "broad_phase.hpp"

#include <algorithm>
#include <utility>

#include "nearmesh/core/base/detail/assert.hpp"

namespace nearmesh {

BroadPhase::Slot BroadPhase::add(const Company& company) {
  Slot slot = static_cast<Slot>(bodies_.size());
  if (unused_.empty()) {
    bodies_.emplace_back();
    boxes_.emplace_back();
    is_changed_.emplace_back();
  } else {
    slot = unused_.back();
    unused_.pop_back();
  }
  bodies_[slot].company = company;
  all_pairs_ += pairs_with(company, &Members::all);
  ++members_[company].all;
  return slot;
}

void BroadPhase::remove(Slot slot) {
  lose(slot);
  Body& body = bodies_[slot];
  const auto its = members_.find(body.company);
  NEARMESH_ASSERT(its != members_.end());
  if (--its->second.all == 0) members_.erase(its);
  all_pairs_ -= pairs_with(body.company, &Members::all);
  unused_.push_back(slot);
}

void BroadPhase::lose(Slot slot) {
  Body& body = bodies_[slot];
  if (body.leaf == BoxTree::kNowhere) return;
  tree_of(body).remove(body.leaf);
  body.leaf = BoxTree::kNowhere;
  note_changed(slot);
  --members_[body.company].placed;
  placed_pairs_ -= pairs_with(body.company, &Members::placed);
}

std::uint64_t BroadPhase::pairs_with(const Company& company,
                                     std::uint64_t Members::*members) const {
  std::uint64_t pairs = 0;
  for (const auto& [other, count] : members_)
    if (company.wants(other)) pairs += count.*members;
  return pairs;
}

void BroadPhase::settle(Slot slot, const WorldBox& roam) {
  Body& body = bodies_[slot];
  WorldBox kept = roam;
  for (std::size_t k = 0; k < 3; ++k) {
    kept.lo_m[k] = std::min(kept.lo_m[k], boxes_[slot].lo_m[k]);
    kept.hi_m[k] = std::max(kept.hi_m[k], boxes_[slot].hi_m[k]);
  }
  if (body.leaf == BoxTree::kNowhere) {
    body.leaf = tree_of(body).insert(kept, slot);
    placed_pairs_ += pairs_with(body.company, &Members::placed);
    ++members_[body.company].placed;
  } else {
    tree_of(body).move(body.leaf, kept);
  }
  note_changed(slot);
}

void BroadPhase::note_changed(Slot slot) {
  if (std::exchange(is_changed_[slot], 1) == 0) changed_.push_back(slot);
}

void BroadPhase::look_around(Slot slot) {
  const Body& body = bodies_[slot];
  const auto take = [&](Slot other) {
    // Of two that have changed the first takes the pair.
    const bool is_others = other == slot || (is_changed_[other] != 0 && other < slot);
    if (!is_others && body.company.wants(bodies_[other].company))
      company_near_.emplace_back(slot, other);
  };
  const WorldBox roam = tree_of(body).box_of(body.leaf);
  movers_.for_each_meeting(roam, take);
  if (!body.company.is_scenery) scenery_.for_each_meeting(roam, take);
}

const std::vector<std::pair<BroadPhase::Slot, BroadPhase::Slot>>& BroadPhase::find_near() {
  std::erase_if(company_near_, [this](const auto& pair) {
    return (is_changed_[pair.first] | is_changed_[pair.second]) != 0;
  });
  for (const Slot slot : changed_)
    if (bodies_[slot].leaf != BoxTree::kNowhere) look_around(slot);
  for (const Slot slot : changed_) is_changed_[slot] = 0;
  changed_.clear();
  near_.clear();
  for (const auto& [one, two] : company_near_)
    if (boxes_[one].meets(boxes_[two])) near_.emplace_back(one, two);
  return near_;
}

}  // namespace nearmesh
