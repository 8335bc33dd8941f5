// SPDX-License-Identifier: Apache-2.0
#include "page.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>
#include <string_view>
#include <tuple>

#include "core/base/digest.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {
namespace {

constexpr std::string_view kPageMagic = "NMWP", kWorldMagic = "NMWORLD\x1a";
constexpr std::uint8_t kPageVersion = 1;
constexpr std::uint32_t kWorldVersion = 1;
constexpr std::size_t kPageHeadBytes = 8, kEntryBytes = 32;

Status corrupt(const std::string& what) { return {StatusCode::kCorrupt, what}; }

/// Little-endian words, one after the other.
class Writer {
 public:
  template <class T>
  void put(T value) {
    const auto bits = static_cast<std::uint64_t>(value);
    for (std::size_t i = 0; i < sizeof(T); ++i)
      bytes_.push_back(static_cast<std::uint8_t>(bits >> (8 * i)));
  }
  void put(std::string_view text) { bytes_.insert(bytes_.end(), text.begin(), text.end()); }
  void put(const ContentHash& hash) {
    put(hash.high);
    put(hash.low);
  }
  [[nodiscard]] std::vector<std::uint8_t> finish() && { return std::move(bytes_); }

 private:
  std::vector<std::uint8_t> bytes_;
};

/// Precondition of each: so many bytes are left.
class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : left_(bytes) {}
  template <class T>
  [[nodiscard]] T get() {
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i) bits |= std::uint64_t{left_[i]} << (8 * i);
    left_ = left_.subspan(sizeof(T));
    return static_cast<T>(bits);
  }
  [[nodiscard]] bool take(std::string_view text) {
    const bool is_there =
        std::equal(text.begin(), text.end(), left_.begin(),
                   [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
    left_ = left_.subspan(text.size());
    return is_there;
  }
  [[nodiscard]] ContentHash get_hash() {
    const auto high = get<std::uint64_t>();
    return {high, get<std::uint64_t>()};
  }

 private:
  std::span<const std::uint8_t> left_;
};

std::string at(const WorldEntry& entry) {
  return "(" + std::to_string(entry.place[0]) + ", " + std::to_string(entry.place[1]) + ", " +
         std::to_string(entry.place[2]) + ")";
}

}  // namespace

bool CellBox::contains(const CellBox& other) const {
  for (std::size_t k = 0; k < 3; ++k)
    if (other.lo[k] < lo[k] || other.hi[k] > hi[k]) return false;
  return true;
}

void CellBox::add(const CellBox& other) {
  for (std::size_t k = 0; k < 3; ++k) {
    lo[k] = std::min(lo[k], other.lo[k]);
    hi[k] = std::max(hi[k], other.hi[k]);
  }
}

CellBox WorldEntry::box() const {
  CellBox out;
  for (std::size_t k = 0; k < 3; ++k) {
    out.lo[k] = place[k];
    out.hi[k] = std::min(place[k] + box_extent(extent[k]), kWorldCells - 1);
  }
  return out;
}

CellBox WorldPage::box() const {
  CellBox out = entries.front().box();
  for (const WorldEntry& entry : entries) out.add(entry.box());
  return out;
}

std::vector<std::uint8_t> encode_page(const WorldPage& page) {
  NEARMESH_ASSERT(!page.entries.empty() && page.entries.size() <= kMaxPageEntries);
  Writer out;
  out.put(kPageMagic);
  out.put(kPageVersion);
  out.put(page.level);
  out.put(static_cast<std::uint16_t>(page.entries.size()));
  for (const WorldEntry& entry : page.entries) {
    for (const std::int32_t cells : entry.place) out.put(static_cast<std::uint32_t>(cells));
    for (const std::uint8_t code : entry.extent) out.put(code);
    out.put(entry.log2_faces);
    out.put(entry.content);
  }
  return std::move(out).finish();
}

Result<WorldPage> decode_page(std::span<const std::uint8_t> bytes) {
  if (bytes.size() < kPageHeadBytes)
    return corrupt("page of a world: expected 8 bytes at least, found " +
                   std::to_string(bytes.size()));
  Reader in(bytes);
  if (!in.take(kPageMagic)) return corrupt("page of a world: another magic number");
  if (const auto version = in.get<std::uint8_t>(); version != kPageVersion)
    return Status(StatusCode::kUnsupported,
                  "page of a world: expected version 1, found " + std::to_string(version));
  WorldPage page;
  page.level = in.get<std::uint8_t>();
  if (page.level > kMaxPageLevel)
    return corrupt("page of a world: expected a level up to 7, found " +
                   std::to_string(page.level));
  const std::size_t count = in.get<std::uint16_t>();
  if (count == 0 || count > kMaxPageEntries || bytes.size() != kPageHeadBytes + count * kEntryBytes)
    return corrupt("page of a world: " + std::to_string(count) + " entries in " +
                   std::to_string(bytes.size()) + " bytes");
  page.entries.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    WorldEntry entry;
    for (std::int32_t& cells : entry.place)
      cells = static_cast<std::int32_t>(in.get<std::uint32_t>());
    for (std::uint8_t& code : entry.extent) code = in.get<std::uint8_t>();
    entry.log2_faces = in.get<std::uint8_t>();
    entry.content = in.get_hash();
    const std::string where = "page of a world: entry " + std::to_string(i) + " at " + at(entry);
    for (const std::int32_t cells : entry.place)
      if (cells < -kWorldCells || cells >= kWorldCells)
        return corrupt(where + ": beyond 2^30 cells");
    for (const std::uint8_t code : entry.extent)
      if (code > kMaxExtentCode) return corrupt(where + ": extent " + std::to_string(code));
    if (entry.log2_faces > 63)
      return corrupt(where + ": 2^" + std::to_string(entry.log2_faces) + " faces");
    if (!entry.content.is_set()) return corrupt(where + ": no content");
    if (!page.entries.empty() && !(page.entries.back() < entry))
      return corrupt(where + ": not in ascending order");
    page.entries.push_back(entry);
  }
  return page;
}

Status check_page(const WorldPage& page, const WorldEntry& announced, int level) {
  const std::string where = "page of a world at " + at(announced);
  if (page.level != level)
    return corrupt(where + ": expected level " + std::to_string(level) + ", found " +
                   std::to_string(page.level));
  const CellBox box = announced.box();
  for (const WorldEntry& entry : page.entries) {
    if (!box.contains(entry.box()))
      return corrupt(where + ": its child at " + at(entry) + " lies outside of it");
    if (entry.log2_faces > announced.log2_faces)
      return corrupt(where + ": its child at " + at(entry) + " has more faces than it has");
  }
  return Status::ok();
}

std::vector<std::uint8_t> encode_world(const WorldRecord& world) {
  Writer out;
  out.put(kWorldMagic);
  out.put(kWorldVersion);
  out.put(static_cast<std::uint32_t>(world.lattice.exponent));
  out.put(static_cast<std::uint32_t>(world.bits));
  out.put(static_cast<std::uint32_t>(world.root_level));
  for (const double x : world.lattice.origin_m) out.put(std::bit_cast<std::uint64_t>(x));
  out.put(world.tiles);
  out.put(world.faces);
  out.put(world.root);
  return std::move(out).finish();
}

bool is_world_record(std::span<const std::uint8_t> bytes) {
  return bytes.size() == kWorldRecordBytes && bytes[0] == 'N' && bytes[1] == 'M' &&
         bytes[2] == 'W' && bytes[3] == 'O';
}

Result<WorldRecord> decode_world(std::span<const std::uint8_t> bytes) {
  if (bytes.size() != kWorldRecordBytes)
    return corrupt("world: expected 80 bytes, found " + std::to_string(bytes.size()));
  Reader in(bytes);
  if (!in.take(kWorldMagic)) return corrupt("world: another magic number");
  if (const auto version = in.get<std::uint32_t>(); version != kWorldVersion)
    return Status(StatusCode::kUnsupported,
                  "world: expected version 1, found " + std::to_string(version));
  WorldRecord world;
  world.lattice.exponent = static_cast<std::int32_t>(in.get<std::uint32_t>());
  const auto bits = in.get<std::uint32_t>(), level = in.get<std::uint32_t>();
  if (world.lattice.exponent < -kMaxGridExponent || world.lattice.exponent > kMaxGridExponent)
    return corrupt("world: a cell of 2^" + std::to_string(world.lattice.exponent) + " m");
  if (bits < kMinGridBits || bits > kMaxGridBits)
    return corrupt("world: grids of " + std::to_string(bits) + " bits");
  if (level > kMaxPageLevel) return corrupt("world: a root of level " + std::to_string(level));
  world.bits = static_cast<int>(bits);
  world.root_level = static_cast<std::uint8_t>(level);
  for (double& x : world.lattice.origin_m) {
    x = std::bit_cast<double>(in.get<std::uint64_t>());
    if (!is_lattice_place(std::ldexp(x, -world.lattice.exponent), 0))
      return corrupt("world: an origin that is no whole number of cells");
  }
  world.tiles = in.get<std::uint64_t>();
  world.faces = in.get<std::uint64_t>();
  world.root = in.get_hash();
  if (world.tiles == 0 || world.faces < world.tiles || !world.root.is_set())
    return corrupt("world: " + std::to_string(world.tiles) + " tiles of " +
                   std::to_string(world.faces) + " faces");
  return world;
}

namespace {

std::string named(const WorldRecord& world) {
  return "world " + to_hex(digest_of(encode_world(world)));
}

}  // namespace

Status MetPages::meet(const ContentHash& page) {
  if (!met_.insert(page).second)
    return corrupt(named(world_) + ": expected each page once, found page " + to_hex(page) +
                   " listed again; build the world anew");
  // Each page of an honest world has a tile of its own below it, or is above such a page.
  if (met_.size() > world_.tiles + kMaxPageLevel)
    return corrupt(named(world_) + ": expected pages of the " + std::to_string(world_.tiles) +
                   " tiles of its record, found page " + to_hex(page) +
                   " beyond what these need; build the world anew");
  return Status::ok();
}

Status check_each_once(const WorldRecord& world, std::span<const WorldEntry> tiles) {
  std::vector<const WorldEntry*> sorted;
  sorted.reserve(tiles.size());
  for (const WorldEntry& tile : tiles) sorted.push_back(&tile);
  const auto place_and_content = [](const WorldEntry* tile) {
    return std::tie(tile->place, tile->content);
  };
  std::ranges::sort(sorted, {}, place_and_content);
  const auto twice = std::ranges::adjacent_find(sorted, {}, place_and_content);
  if (twice == sorted.end()) return Status::ok();
  return corrupt(named(world) + ": expected each tile once in its place, found tile " +
                 to_hex((*twice)->content) + " twice at " + at(**twice) + "; build the world anew");
}

Status check_tile_grid(const Grid& grid, const WorldRecord& world) {
  const Grid expected = CommonLattice{.exponent = world.lattice.exponent}.grid_at({}, world.bits);
  if (grid == expected) return Status::ok();
  return {StatusCode::kConflict,
          "expected a tile of a world with cells of 2^" + std::to_string(expected.exponent) +
              " m and " + std::to_string(expected.bits) +
              " bits that begins at zero, found cells of 2^" + std::to_string(grid.exponent) +
              " m and " + std::to_string(grid.bits) + " bits, from " +
              std::to_string(grid.origin_m[0]) + ", " + std::to_string(grid.origin_m[1]) + ", " +
              std::to_string(grid.origin_m[2]) + " m"};
}

}  // namespace nearmesh
