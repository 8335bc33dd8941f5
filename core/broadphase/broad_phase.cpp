// SPDX-License-Identifier: Apache-2.0
#include "broad_phase.hpp"

#include <algorithm>

#include "nearmesh/core/base/detail/assert.hpp"

namespace nearmesh {

BroadPhase::Slot BroadPhase::add(const Company& company) {
  Slot slot = static_cast<Slot>(bodies_.size());
  if (unused_.empty()) {
    bodies_.emplace_back();
    boxes_.emplace_back();
    settled_.emplace_back();
    company_near_.emplace_back();
  } else {
    slot = unused_.back();
    unused_.pop_back();
  }
  bodies_[slot].company = company;
  settled_[slot] = ++settlings_;  // what was near of who had the slot before is out of date
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
  company_near_[slot].clear();
  settled_[slot] = ++settlings_;
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
  settled_[slot] = ++settlings_;
  unsettled_.push_back(slot);
}

void BroadPhase::look_around(Slot slot) {
  const Body& body = bodies_[slot];
  std::vector<Slot>& near = company_near_[slot];
  near.clear();
  const auto take = [&](Slot other) {
    // Of two that have settled both, the pair stands at the later one.
    if (settled_[other] < settled_[slot] && body.company.wants(bodies_[other].company))
      near.push_back(other);
  };
  const WorldBox roam = tree_of(body).box_of(body.leaf);
  movers_.for_each_meeting(roam, take);
  if (!body.company.is_scenery) scenery_.for_each_meeting(roam, take);
}

const std::vector<std::pair<BroadPhase::Slot, BroadPhase::Slot>>& BroadPhase::find_near() {
  for (const Slot slot : unsettled_)
    if (bodies_[slot].leaf != BoxTree::kNowhere) look_around(slot);
  unsettled_.clear();
  near_.clear();
  for (Slot slot = 0; slot < bodies_.size(); ++slot) {
    std::erase_if(company_near_[slot], [&](Slot other) {
      if (settled_[other] > settled_[slot]) return true;
      if (boxes_[slot].meets(boxes_[other])) near_.emplace_back(slot, other);
      return false;
    });
  }
  return near_;
}

}  // namespace nearmesh
