// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which certificates count now: those of one authority that it has not taken back and that have not
// expired. For a program that runs on while lists change. No Fast DDS and no clock here.

#include <array>
#include <cstdint>
#include <ctime>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::wire {

struct IdentityPaths {
  std::string authority, certificate;
  std::string revocations;  ///< need not be there
};

/// What a certificate says.
struct IdentityFacts {
  std::string name;     ///< common name: "alice"
  std::string serial;   ///< hexadecimal; another for each certificate of the same name
  std::time_t end = 0;  ///< of it or of its authority, which may have been made long before
  /// With these a participant of this identity begins (OMG DDS Security 1.1, 9.3.3): a bit, and 47
  /// of the hash of the subject.
  std::array<std::uint8_t, 6> key_start{};
};

/// Threads: all.
class IdentityBook {
 public:
  /// Errors: as reading the two files. A list that is wrong is none: the first refresh() says so.
  [[nodiscard]] static Result<std::unique_ptr<IdentityBook>> open(const IdentityPaths& paths);
  ~IdentityBook();

  /// Reads the list again where its file has changed. What is not signed by the authority, or is
  /// older than the list in force, is refused: that one stays. Out: one line for the operator, or
  /// "".
  [[nodiscard]] std::string refresh();
  /// Of a certificate in PEM, as a handshake carries it. Nothing: it is none of this authority's.
  [[nodiscard]] std::optional<IdentityFacts> facts_of(std::span<const std::uint8_t> pem);
  /// Why it does not count, as a clause; "": it counts.
  [[nodiscard]] std::string fault_of(const IdentityFacts& facts, std::time_t now) const;
  [[nodiscard]] const IdentityFacts& own() const;

 private:
  IdentityBook();
  struct Impl;
  const std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::wire
