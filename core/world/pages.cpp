// SPDX-License-Identifier: Apache-2.0
#include "pages.hpp"

#include <algorithm>
#include <bit>
#include <string>

#include "core/base/digest.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {
namespace {

/// An entry with what its parent needs exactly.
struct Child {
  WorldEntry entry;
  CellBox box;
  std::uint64_t faces = 0;
};

WorldEntry make_entry(const ContentHash& content, const CellBox& box, std::uint64_t faces) {
  WorldEntry entry{.log2_faces = static_cast<std::uint8_t>(std::bit_width(faces) - 1),
                   .content = content};
  for (std::size_t k = 0; k < 3; ++k) {
    entry.place[k] = static_cast<std::int32_t>(box.lo[k]);
    entry.extent[k] = box_extent_code(box.hi[k] - box.lo[k]);
  }
  return entry;
}

/// Shares children out to so many pages: by halves, across where they spread most.
void share_out(std::span<Child> children, std::size_t pages,
               std::vector<std::span<Child>>& shares) {
  if (pages == 1) {
    shares.push_back(children);
    return;
  }
  std::size_t widest = 0;
  std::int64_t spread = -1;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto [least, most] = std::ranges::minmax_element(
        children, {}, [k](const Child& child) { return child.entry.place[k]; });
    const std::int64_t wide = std::int64_t{most->entry.place[k]} - least->entry.place[k];
    if (wide > spread) {
      spread = wide;
      widest = k;
    }
  }
  // Boxes and contents come last: a tile that is exchanged stays where it was.
  std::ranges::sort(children, [widest](const Child& a, const Child& b) {
    const std::int32_t x = a.entry.place[widest], y = b.entry.place[widest];
    return x != y ? x < y : a.entry < b.entry;
  });
  const std::size_t left = pages / 2, middle = children.size() * left / pages;
  share_out(children.first(middle), left, shares);
  share_out(children.subspan(middle), pages - left, shares);
}

std::vector<Child> make_level(std::vector<Child> children, std::uint8_t level, WorldPages& out) {
  std::vector<std::span<Child>> shares;
  share_out(children, (children.size() + kMaxPageEntries - 1) / kMaxPageEntries, shares);
  std::vector<Child> parents;
  for (const std::span<Child> share : shares) {
    WorldPage page{.level = level};
    Child parent{.box = share.front().box};
    for (const Child& child : share) {
      page.entries.push_back(child.entry);
      parent.box.add(child.entry.box());  // what a peer knows of it
      parent.faces += child.faces;
    }
    std::ranges::sort(page.entries);
    std::vector<std::uint8_t> bytes = encode_page(page);
    const ContentHash content = digest_of(bytes);
    parent.entry = make_entry(content, parent.box, parent.faces);
    parents.push_back(parent);
    out.pages.emplace_back(content, std::move(bytes));
  }
  return parents;
}

}  // namespace

Result<WorldPages> make_pages(const CommonLattice& lattice, int bits,
                              const std::vector<PlacedTile>& tiles) {
  if (tiles.empty())
    return Status(StatusCode::kInvalidArgument, "world: expected at least one tile, found none");
  std::vector<Child> children;
  for (const PlacedTile& tile : tiles) {
    CellBox box;
    for (std::size_t k = 0; k < 3; ++k) {
      box.lo[k] = tile.place[k];
      box.hi[k] = tile.place[k] + tile.extent[k];
      if (box.lo[k] < -kWorldCells || box.hi[k] >= kWorldCells)
        return Status(StatusCode::kUnsupported,
                      "world: expected tiles within 2^30 cells of 2^" +
                          std::to_string(lattice.exponent) +
                          " m from its origin, found one that reaches from " +
                          std::to_string(box.lo[k]) + " to " + std::to_string(box.hi[k]) +
                          ": take a larger cell, or an origin in the middle");
    }
    NEARMESH_ASSERT(tile.faces > 0 && tile.content.is_set());
    children.push_back({make_entry(tile.content, box, tile.faces), box, tile.faces});
  }
  std::ranges::sort(children, {}, &Child::entry);
  const auto twice = std::ranges::adjacent_find(children, {}, &Child::entry);
  if (twice != children.end())
    return Status(StatusCode::kInvalidArgument, "world: the tile " + to_hex(twice->entry.content) +
                                                    " stands twice at " +
                                                    std::to_string(twice->entry.place[0]) + ", " +
                                                    std::to_string(twice->entry.place[1]) + ", " +
                                                    std::to_string(twice->entry.place[2]));
  WorldPages out{.world = {.lattice = lattice, .bits = bits, .tiles = tiles.size()}};
  for (const PlacedTile& tile : tiles) out.world.faces += tile.faces;
  for (std::uint8_t level = 0;; ++level) {
    NEARMESH_ASSERT(level <= kMaxPageLevel);
    children = make_level(std::move(children), level, out);
    if (children.size() > 1) continue;
    out.world.root_level = level;
    out.world.root = children.front().entry.content;
    break;
  }
  std::ranges::reverse(out.pages);
  out.name = digest_of(encode_world(out.world));
  return out;
}

}  // namespace nearmesh
