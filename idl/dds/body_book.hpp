// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which peer moves which body. For the rooms named dds alone.
// The first writer of a body's poses keeps the body: poses of others are dropped. On an open bus until that writer is gone; on
// a secured one for good, and for all programs of its identity: Fast DDS lets nobody join whose participant does not carry 47
// bits of the hash of the certificate's subject in front (OMG DDS Security 1.1, 9.3.3; PKIDH::process_handshake_request).

#include <array>
#include <cstdint>
#include <map>
#include <string>

#include "fastdds_api.hpp"

namespace nearmesh::wire {

class BodyBook {
 public:
  using Handle = wire::Handle;
  enum class Claim : std::uint8_t {
    kOwn,     ///< the writer's, from now on if not before
    kOthers,  ///< another's
    kFull,    ///< this owner, or all together, have as many as are kept
  };
  /// Bodies kept of one owner, and of all: some 8 MB.
  static constexpr std::size_t kMaxOfOne = 1024, kMaxOfAll = 65536;

  explicit BodyBook(bool authenticated) : authenticated_(authenticated) {}

  [[nodiscard]] Claim claim(const std::string& body, const Handle& writer);
  /// The writer moves the body no more.
  void release(const std::string& body, const Handle& writer);
  /// The writer is gone. Cost: O(bodies).
  void forget(const Handle& writer);
  void clear();

 private:
  using Owner = std::array<std::uint8_t, 16>;
  [[nodiscard]] Owner owner_of(const Handle& writer) const;

  bool authenticated_;
  std::map<std::string, Owner> owners_;
  std::map<Owner, std::size_t> counts_;
};

}  // namespace nearmesh::wire
