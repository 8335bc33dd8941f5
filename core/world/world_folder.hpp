// SPDX-License-Identifier: Apache-2.0
#pragma once
// A world on disk: a folder with its record, pages and tiles, each under the name of its content.
// What several worlds share lies there once.

#include <string>

#include "core/base/output_file.hpp"
#include "pages.hpp"

namespace nearmesh {

inline constexpr FileKind kWorldFile{"a world's record", "NMWORLD\x1a"};
inline constexpr FileKind kPageFile{"a page of a world", "NMWP"};

class WorldFolder {
 public:
  /// Errors: kNotFound (no world's record is there), kIo, kCorrupt, kUnsupported, naming the file.
  [[nodiscard]] static Result<WorldFolder> open(const std::string& folder);
  /// Where a world's record would be.
  [[nodiscard]] static std::string record_path(const std::string& folder);
  [[nodiscard]] static std::string page_path(const std::string& folder, const ContentHash& page);
  [[nodiscard]] static std::string tile_path(const std::string& folder, const ContentHash& tile);

  [[nodiscard]] const WorldRecord& world() const { return world_; }
  [[nodiscard]] const ContentHash& name() const { return name_; }
  [[nodiscard]] std::string page_path(const ContentHash& page) const {
    return page_path(folder_, page);
  }
  [[nodiscard]] std::string tile_path(const ContentHash& tile) const {
    return tile_path(folder_, tile);
  }
  [[nodiscard]] Result<WorldPage> root() const;
  /// A page as it goes on the wire. Errors: kNotFound; kIo, kCorrupt (other bytes than its name
  /// says), naming the file.
  [[nodiscard]] Result<std::vector<std::uint8_t>> page_bytes(const ContentHash& page) const;
  /// The page of an entry, which stands in a page of the level above. Errors: kIo, kCorrupt (other
  /// bytes than its name says, no page, or another than the entry announces), naming the file.
  [[nodiscard]] Result<WorldPage> page(const WorldEntry& entry, int level) const;

 private:
  [[nodiscard]] Result<WorldPage> read(const ContentHash& content) const;

  std::string folder_;
  WorldRecord world_;
  ContentHash name_;
};

/// What a world is called where nobody says: as its folder, of "data/valley/" "valley".
[[nodiscard]] std::string name_of_folder(const std::string& folder);

/// Makes the folder where there is none; pages that are there stay, and the record is replaced
/// last. Errors: kIo, kConflict, naming the file.
[[nodiscard]] Status write_world(const WorldPages& pages, const std::string& folder);

}  // namespace nearmesh
