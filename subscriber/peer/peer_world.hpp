// SPDX-License-Identifier: Apache-2.0
#pragma once
// A world as far as it is here: its record, and the pages that were asked for.

#include <map>
#include <optional>
#include <span>

#include "core/broadphase/body_bounds.hpp"
#include "core/world/near_tiles.hpp"

namespace nearmesh::subscriber {

class PeerWorld {
 public:
  /// In: bytes that have the digest `name`. Errors: those of decode_world().
  [[nodiscard]] static Result<PeerWorld> from_record(const ContentHash& name,
                                                     std::span<const std::uint8_t> bytes);

  [[nodiscard]] const WorldRecord& record() const { return record_; }
  [[nodiscard]] const ContentHash& name() const { return name_; }
  [[nodiscard]] const WorldPage* root() const { return root_ ? &*root_ : nullptr; }
  /// It is not here, and did not come as what is no root of this world.
  [[nodiscard]] bool wants_root() const { return !root_ && !faulty_.contains(record_.root); }
  /// In: bytes that have the digest `content`. What is no page of this world is remembered as such,
  /// and said by tiles_around(). Out: the root came.
  bool take_page(const ContentHash& content, std::span<const std::uint8_t> bytes);
  /// Pages go by their content: those that the world before shares with this one are here then.
  void keep_pages_of(PeerWorld&& before);
  /// Of the root page's boxes. Precondition: there is a root.
  [[nodiscard]] ModelBounds bounds() const;
  [[nodiscard]] GridBox box() const;
  /// The page of an entry, checked, null if it is not here; it counts as used at that time. Errors:
  /// what was announced or came is no page of this world.
  [[nodiscard]] Result<const WorldPage*> page(const WorldEntry& entry, int level, double time_s);
  /// As find_tiles_around(), from the pages that are here; they count as used at that time.
  /// Precondition: there is a root.
  [[nodiscard]] Result<TilesAround> tiles_around(const RelativeFrame& body_in_world,
                                                 const GridBox& body, std::uint32_t reach_cells,
                                                 double time_s);
  [[nodiscard]] bool has_page(const ContentHash& content) const {
    return pages_.contains(content) || faulty_.contains(content);
  }
  /// Forgets pages, but the root, that were not used for so long.
  void give_up(double time_s, double unused_s);

 private:
  struct Page {
    WorldPage page;
    double used_s = 0;
    std::optional<WorldEntry> checked_as = {};  // at its level
  };
  WorldRecord record_;
  ContentHash name_;
  std::optional<WorldPage> root_;
  std::map<ContentHash, Page> pages_;
  std::map<ContentHash, Status> faulty_;
  double time_s_ = 0;
};

}  // namespace nearmesh::subscriber
