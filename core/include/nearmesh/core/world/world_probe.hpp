// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Probes of a world on disk (docs/worlds.md): rays, balls and boxes against all of its tiles, as if
// they were one mesh. Pages tell which tiles a probe may meet; these are opened, and of each as
// much detail is read as the answer needs. So every answer is certified. There are no probes of
// points: a tile is cut open at its border, and nothing says that all of them together close. A ray
// down tells whether a point is below a ground.

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/query/probe.hpp"

namespace nearmesh {

/// A tile in one of its places.
struct WorldTile {
  ContentHash content;                  ///< of its model
  std::array<std::int32_t, 3> place{};  ///< where its grid begins, in cells from the world's origin
  bool operator==(const WorldTile&) const = default;
};
struct WorldRayAnswer {
  /// Its face is one of the tile's. Of faces of several tiles at one point any with the least key.
  RayAnswer ray;
  WorldTile tile;  ///< where ray.has_face
};
struct WorldShapeAnswer {
  ShapeAnswer shape;
  WorldTile tile;  ///< of a hit
};

class WorldProbe {
 public:
  /// Holds at most `most_tiles` open, with the detail that was read of them, the least recently
  /// used going first; and pages.
  /// Errors: kNotFound (no world's record is there), kIo, kCorrupt, kUnsupported, naming the file.
  [[nodiscard]] static Result<WorldProbe> open(const std::string& folder,
                                               std::size_t most_tiles = 64);
  WorldProbe(WorldProbe&&) noexcept;
  WorldProbe& operator=(WorldProbe&&) noexcept;
  ~WorldProbe();

  /// Answers a batch, of the world in a place. Rays are cut to the world's box. Preconditions
  /// (asserted): as many answers as probes.
  /// Errors: as probe() of a body; kIo, kCorrupt, kConflict, naming a file. Some answers may have
  /// been written then. After a std::bad_alloc it may be asked again.
  /// Deterministic: what was probed before changes nothing. Cost: a ray some us and what its tiles
  /// take to open and read. Threads: one at a time.
  [[nodiscard]] Status probe(const Pose& pose, std::span<const RayProbe> rays,
                             std::span<WorldRayAnswer> answers);
  [[nodiscard]] Status probe(const Pose& pose, std::span<const BallProbe> balls,
                             std::span<WorldShapeAnswer> answers);
  [[nodiscard]] Status probe(const Pose& pose, std::span<const BoxProbe> boxes,
                             std::span<WorldShapeAnswer> answers);

  /// How many tiles are open now.
  [[nodiscard]] std::size_t open_tiles() const;

 private:
  struct Impl;
  explicit WorldProbe(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh
