// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which headers count: those that come from a participant whose hello announces their content.
// Anybody can write a header; only who serves a content can say what it is. Fast DDS: for the rooms
// named dds alone.

#include <map>
#include <string>
#include <vector>

#include "core/base/stopwatch.hpp"
#include "idl/dds/listeners.hpp"
#include "nearmesh/subscriber/peer/channel.hpp"

namespace nearmesh::subscriber {

/// Threads: one. The mailbox must outlive it.
class DdsHeaders {
 public:
  /// What may wait for a hello: of one participant, and of all.
  static constexpr std::size_t kMaxBytesOfOne = 32U << 20, kMaxBytesOfAll = 64U << 20;
  static constexpr std::size_t kMaxOfOne = wire::kMaxModels, kMaxOfAll = 4 * wire::kMaxModels;
  static constexpr double kPatience_s = 5;  ///< then a header that waits is complained of

  /// A header that counts, and who wrote it.
  struct Counted {
    Channel::Header header;
    wire::Handle writer;
  };

  DdsHeaders(wire::Mailbox& mailbox, std::string topic);

  /// A hello that the host gets, and who wrote it.
  void announced(const wire::Hello& hello, const wire::Handle& writer);
  /// The publisher is gone. Headers of its that the host has not taken wait again: Fast DDS does
  /// not repeat them when the same writer is found again.
  void lost(wire::SessionId publisher, std::vector<Counted> not_taken);
  void heard(wire::MeshHeader&& header, const wire::Handle& writer);
  void take(const std::vector<wire::ReaderListener::Match>& matches);
  /// Those that count by now; each once.
  [[nodiscard]] std::vector<Counted> release();
  /// Complains of those that have waited for long, of each writer once. Out: how many that were.
  [[nodiscard]] std::uint64_t complain_of_strays();
  /// With a bus: nobody is known any more.
  void clear();

 private:
  struct Waiting {
    wire::MeshHeader header;
    wire::Handle writer;
    double since_s = 0;
    bool is_told = false;
    bool is_gone = false;  ///< the writer is, and may be found again
  };
  struct Announced {
    wire::Handle writer;
    std::vector<ContentHash> contents;
  };
  [[nodiscard]] bool has_room(const wire::MeshHeader& header, const wire::Handle& writer) const;
  void refuse(const wire::Handle& writer, const std::string& why);

  wire::Mailbox& mailbox_;
  const std::string topic_;
  const Stopwatch clock_;
  std::map<wire::SessionId, Announced> announced_;
  std::vector<Waiting> waiting_;
  std::uint64_t dropped_ = 0;
};

}  // namespace nearmesh::subscriber
