// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which peer moves which body. For the rooms named dds alone.
// The first writer of a body's poses keeps the body: poses of others are dropped. On an open bus
// until that writer is gone; on a secured one beyond that, and for all programs of its identity:
// Fast DDS lets nobody join whose participant does not carry 47 bits of the hash of the
// certificate's subject in front (OMG DDS Security 1.1, 9.3.3; PKIDH::process_handshake_request).
// Names of bodies that are gone are kept there as long as there is room: else the bodies of weeks
// would fill it, and those that are there would be ignored.

#include <array>
#include <cstdint>
#include <string>
#include <variant>

#include "core/base/lru_map.hpp"
#include "fastdds_api.hpp"

namespace nearmesh::wire {

/// Leading bytes of a participant's identifier that an identity decides, on a secured bus.
inline constexpr std::size_t kIdentityBytes = 6;

class BodyBook {
 public:
  using Handle = wire::Handle;
  enum class Claim : std::uint8_t {
    kOwn,     ///< the writer's, from now on if not before
    kOthers,  ///< another's
    kFull,    ///< this owner, or all together, move as many as are kept
  };
  /// Bodies kept of one owner, and of all: some 12 MB.
  static constexpr std::size_t kMaxOfOne = 1024, kMaxOfAll = 65536;

  explicit BodyBook(bool authenticated) : authenticated_(authenticated) {}

  [[nodiscard]] Claim claim(const std::string& body, const Handle& writer);
  /// The writer moves the body no more. On a secured bus the name stays its owner's until room is
  /// needed, for the owner's own bodies or, where all is full, for anybody's: then who was released
  /// longest ago is forgotten.
  void release(const std::string& body, const Handle& writer);
  /// The writer is gone: on a secured bus release() its bodies instead.
  void forget(const Handle& writer);
  /// As forget(), of all writers.
  void clear();

 private:
  using Owner = std::array<std::uint8_t, 16>;
  [[nodiscard]] Owner owner_of(const Handle& writer) const;

  const bool authenticated_;
  LruMap<std::string, std::monostate, Owner> bodies_{kMaxOfOne, kMaxOfAll};  ///< pinned: moved
};

}  // namespace nearmesh::wire
