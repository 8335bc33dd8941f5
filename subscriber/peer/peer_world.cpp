// SPDX-License-Identifier: Apache-2.0
#include "peer_world.hpp"

#include <cmath>
#include <string>
#include <utility>

namespace nearmesh::subscriber {

Result<PeerWorld> PeerWorld::from_record(const ContentHash& name,
                                         std::span<const std::uint8_t> bytes) {
  Result<WorldRecord> record = decode_world(bytes);
  NEARMESH_RETURN_IF_ERROR(record);
  PeerWorld world;
  world.record_ = record.value();
  world.name_ = name;
  return world;
}

bool PeerWorld::take_page(const ContentHash& content, std::span<const std::uint8_t> bytes) {
  Result<WorldPage> page = decode_page(bytes);
  if (page.is_ok() && content == record_.root && page.value().level != record_.root_level)
    page = Status(StatusCode::kCorrupt, "page of a world: expected a root of level " +
                                            std::to_string(record_.root_level) + ", found " +
                                            std::to_string(page.value().level));
  if (!page.is_ok()) {
    faulty_.insert_or_assign(content, page.status());
    return false;
  }
  if (content == record_.root) {
    root_ = std::move(page).value();
    return true;
  }
  pages_.insert_or_assign(content, Page{std::move(page).value(), time_s_});
  return false;
}

void PeerWorld::keep_pages_of(PeerWorld&& before) {
  time_s_ = before.time_s_;
  pages_.merge(before.pages_);
  if (before.root_)
    pages_.emplace(before.record_.root, Page{*std::move(before.root_), before.time_s_});
  if (root_) return;
  const auto own = pages_.find(record_.root);
  if (own == pages_.end() || own->second.page.level != record_.root_level) return;
  root_ = std::move(own->second.page);
  pages_.erase(own);
}

GridBox PeerWorld::box() const {
  const CellBox all = root_->box();
  GridBox box;
  for (std::size_t k = 0; k < 3; ++k) {
    box.lo.v[k] = static_cast<std::int32_t>(all.lo[k]);
    box.hi.v[k] = static_cast<std::int32_t>(all.hi[k]);
  }
  return box;
}

ModelBounds PeerWorld::bounds() const { return {world_grid(record_), box()}; }

Result<TilesAround> PeerWorld::tiles_around(const RelativeFrame& body_in_world, const GridBox& body,
                                            std::uint32_t reach_cells, double time_s) {
  if (const auto fault = faulty_.find(record_.root); fault != faulty_.end()) return fault->second;
  const PageOf page_of = [&](const WorldEntry& entry, int level) {
    return page(entry, level, time_s);
  };
  return find_tiles_around(record_, *root_, page_of, body_in_world, body, reach_cells);
}

// One page may be announced by several, not all of them truly: whatever is announced is checked.
Result<const WorldPage*> PeerWorld::page(const WorldEntry& entry, int level, double time_s) {
  time_s_ = time_s;
  if (const auto fault = faulty_.find(entry.content); fault != faulty_.end()) return fault->second;
  const auto at = pages_.find(entry.content);
  if (at == pages_.end()) return nullptr;
  Page& found = at->second;
  if (found.checked_as != entry || found.page.level != level) {
    NEARMESH_RETURN_IF_ERROR(check_page(found.page, entry, level));
    found.checked_as = entry;
  }
  found.used_s = time_s;
  return &found.page;
}

void PeerWorld::give_up(double time_s, double unused_s) {
  std::erase_if(
      pages_, [&](const auto& entry) { return std::abs(time_s - entry.second.used_s) > unused_s; });
}

}  // namespace nearmesh::subscriber
