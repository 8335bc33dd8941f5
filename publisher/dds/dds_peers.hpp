// SPDX-License-Identifier: Apache-2.0
#pragma once
// The publisher's endpoints towards live peers: one reader of subscriptions, and for each peer a
// writer of batches in a partition of its own. Shared by the channel of a publisher and that of a
// replay. Fast DDS: for the rooms named dds alone.

#include <chrono>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "idl/dds/bus.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/endpoint_names.hpp"
#include "idl/dds/endpoints.hpp"
#include "idl/dds/writer_books.hpp"
#include "publisher/serve/channel.hpp"

namespace nearmesh::publisher {

/// What discovery told of readers, until it is looked at. Threads: all.
class FoundReaders {
 public:
  static constexpr std::size_t kMost = 1024;
  void add(const wire::BusOptions::Found& reader);
  /// In order. None where there were too many since the last call: then any reader may have gone,
  /// and any may have come.
  [[nodiscard]] std::optional<std::vector<wire::BusOptions::Found>> take();

 private:
  std::mutex mutex_;
  std::vector<wire::BusOptions::Found> found_;
  bool has_lost_ = false;
};

/// Threads: one. The mailbox must outlive it, and the bus be closed before it goes.
class DdsPeers {
 public:
  DdsPeers(wire::Mailbox& mailbox, std::size_t max_peers)
      : mailbox_(mailbox), max_peers_(max_peers), reader_(mailbox) {}

  /// Makes the reader. After a bus was closed: forget() first.
  [[nodiscard]] Status open(wire::Bus& bus);
  /// The bus is gone, and all peers with it; they are among the lost.
  void forget();
  /// A peer that will ask hears batches in its partition already. Its writer is made now: both
  /// sides know of each other when it asks, else the first batches would come before the word of
  /// who writes them, and again after a heartbeat. Threads: all.
  void found(const wire::BusOptions::Found& reader);

  /// `wanted`: which subscriptions count; the others leave no trace. None of this participant's own
  /// writers do.
  template <class Wanted>
  [[nodiscard]] Inbox take(Wanted wanted) {
    std::vector<Heard> heard;
    const bool more =
        reader_.drain(kMaxTaken, [&](wire::RegionSubscription&& message, const wire::Handle& writer,
                                     wire::Microseconds received) {
          if (!is_own(writer) && wanted(message))
            heard.push_back({std::move(message), writer, received});
        });
    if (more) mailbox_.wake();
    return admit(std::move(heard));
  }
  /// Of take(), when there is no reader.
  [[nodiscard]] std::vector<wire::SessionId> take_lost();
  [[nodiscard]] bool send(wire::SessionId peer, const wire::SplitBatchMessage& batch);
  [[nodiscard]] std::size_t size() const { return peers_.size(); }
  /// As its participant is called; "" where that is not known.
  [[nodiscard]] std::string name_of(wire::SessionId peer) const;

 private:
  /// One call does not starve batches; what remains is taken by the next.
  static constexpr std::size_t kMaxTaken = 1024;
  struct Heard {
    wire::RegionSubscription message;
    wire::Handle writer;
    wire::Microseconds received;
  };
  struct Peer {
    std::unique_ptr<wire::Writer<wire::SplitBatchMessage>> writer;
    wire::Handle subscriptions;  ///< the peer's writer, by which its participant is known
    std::chrono::steady_clock::time_point added = std::chrono::steady_clock::now();
  };
  /// Of a reader that was found, before its peer has said anything.
  struct Prepared {
    wire::Handle reader;
    Peer peer;
  };

  [[nodiscard]] bool is_own(const wire::Handle& writer) const;
  [[nodiscard]] Inbox admit(std::vector<Heard> heard);
  bool admit(wire::SessionId peer, const wire::Handle& writer, wire::Microseconds received);
  bool add_peer(wire::SessionId peer, const wire::Handle& subscriptions);
  [[nodiscard]] Result<Peer> make_peer(wire::SessionId peer);
  void prepare();

  wire::Mailbox& mailbox_;
  const std::size_t max_peers_;
  wire::Reader<wire::RegionSubscription> reader_;
  std::map<wire::SessionId, Peer> peers_;
  std::map<wire::SessionId, Prepared> prepared_;  ///< none of these is among the peers
  FoundReaders found_;
  wire::SessionBook book_;
  std::vector<wire::SessionId> lost_;  ///< with a bus
  bool complained_of_limit_ = false;
  wire::Bus* bus_ = nullptr;
};

}  // namespace nearmesh::publisher
