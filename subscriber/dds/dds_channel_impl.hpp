// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a DdsChannel is made of. The host's calls leave in queues what is to be sent, and take what
// has come (dds_channel.cpp). One thread of the channel's own speaks with Fast DDS: it opens
// endpoints and sends (dds_channel_thread.cpp), and takes what comes (dds_channel_receive.cpp).

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <future>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "core/base/lru_map.hpp"
#include "dds_headers.hpp"
#include "dds_hellos.hpp"
#include "dds_poses.hpp"
#include "idl/dds/bus.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/endpoints.hpp"
#include "idl/dds/routes.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"

namespace nearmesh::subscriber {

using wire::Handle;
using wire::Microseconds;
using wire::SessionId;

class DdsChannel::Impl {
 public:
  explicit Impl(const DdsChannelOptions& options)
      : options_(options),
        own_id_(options.session != 0 ? options.session : wire::make_session_id()),
        names_(options.transport.prefix),
        hellos_(mailbox_, names_.of<wire::Hello>()),
        headers_(mailbox_, names_.of<wire::MeshHeader>()),
        movers_(mailbox_, names_.of<wire::BodyPoses>(), !options.transport.security.empty()) {}
  ~Impl();

  Status start();
  SessionId own_id() const { return own_id_; }
  Status identity() const {
    const std::lock_guard lock(mutex_);
    return wire::identity_of(door_.get());
  }
  std::map<SessionId, PoseCounts> pose_counts() const {
    const std::lock_guard lock(mutex_);
    std::map<SessionId, PoseCounts> counts;
    tally_.for_each([&](SessionId peer, const PoseCounts& heard) { counts.emplace(peer, heard); });
    for (const auto& [peer, samples] : routes_.sent()) counts[peer].sent_near = samples;
    return counts;
  }
  bool has_recorder() const { return held_writer_.listener().has_readers(); }
  void send(const wire::RegionSubscription& subscription);
  template <class Message>
  void put(std::deque<Message> Impl::*queue, const Message& message);
  /// What holds of the own bodies, by part: kept, for as a new participant it is said again. All
  /// that was said is sent, not the latest alone: reports name the edition that they are about.
  template <class Message>
  struct Kept {
    std::map<std::uint32_t, Message> parts;
    std::deque<Message> unsent;

    void say_again() {
      unsent.clear();
      for (const auto& [part, message] : parts) unsent.push_back(message);
    }
  };
  template <class Message>
  void keep(Kept<Message> Impl::*kept, const Message& message);
  void tell_who(const wire::BodyDirectory& directory);
  void tell(wire::ProcessStatus& status);
  Inbox take();
  void wait(double seconds);

  // Written by the host, emptied by the I/O thread.
  std::deque<wire::RegionSubscription> subscriptions_;
  std::deque<wire::BodyPoses> poses_;
  std::deque<wire::NearPoses> near_;
  std::deque<wire::WantedPoses> wanted_;
  std::deque<wire::BodyPromises> promises_;
  std::deque<wire::ContactReport> reports_;
  std::deque<wire::HeldDetail> held_;
  std::deque<wire::ProcessStatus> statuses_;
  std::deque<wire::BoundsReport> bounds_;
  Kept<wire::BodyDirectory> directory_;
  Kept<wire::WatchedBodies> watched_;

 private:
  /// What came of a publisher that was asked, and has not been acknowledged.
  struct Account {
    std::uint32_t window_bytes = 0;
    std::uint32_t sequence = 0;
    std::size_t bytes = 0;
    std::chrono::steady_clock::time_point acknowledged{};
  };

  void run(std::promise<Status> started);
  Status open();
  template <class Endpoint, class... How>
  Status open(Endpoint& endpoint, const How&... how);
  void open_what_is_of_use();
  Status open_promising();
  Status open_promised();
  Status open_bounding();
  Status open_holding();
  bool receive();
  bool receive_hellos();
  bool receive_poses();
  void drop_ended();
  template <class Use>
  void note(SessionId peer, const Handle& writer, const Use& use) {
    if (!movers_.may_speak_for(peer, writer)) return;
    const std::lock_guard lock(mutex_);
    PoseCounts* const known = tally_.use(peer);
    use(known != nullptr ? *known : *tally_.put(peer, {}));
  }
  void tell_lost(SessionId publisher);
  Status rejoin();
  bool flush();
  void tell_moved();
  [[nodiscard]] bool names_bodies(std::uint32_t first, std::uint32_t count, bool promised) const;
  template <class Message>
  bool end_silent_parts(const std::deque<Message>& queue, std::set<std::uint32_t>& retold,
                        wire::Writer<Message>& writer);
  double acknowledge();
  template <class Message>
  bool flush(std::deque<Message>& queue, wire::Writer<Message>& writer);
  template <class Message>
  void deliver(std::vector<Message> Inbox::*list, Message&& message, std::size_t limit,
               const std::string& topic);
  void deliver_batch(wire::SplitBatchMessage&& batch);
  void deliver_header(DdsHeaders::Counted&& header);
  void receive_headers();
  [[nodiscard]] bool is_of_its_publisher(const wire::SplitBatchMessage& batch,
                                         const Handle& writer);
  [[nodiscard]] bool is_of_its_peer(const wire::WantedPoses& wanted, const Handle& writer);
  void note_batch(const wire::SplitBatchMessage& batch);
  void complain_of_overflow(const std::string& topic);

  const DdsChannelOptions options_;
  const SessionId own_id_;
  const wire::TopicNames names_;
  wire::Mailbox mailbox_;
  wire::Reader<wire::Hello> hello_reader_{mailbox_};
  wire::Reader<wire::MeshHeader> header_reader_{mailbox_};
  wire::Reader<wire::SplitBatchMessage> batch_reader_{mailbox_};
  wire::Reader<wire::BodyPoses> pose_reader_{mailbox_};
  wire::Reader<wire::NearPoses> near_reader_{mailbox_};
  wire::Reader<wire::WantedPoses> wanted_reader_{mailbox_};
  wire::Reader<wire::BodyPromises> promise_reader_{mailbox_};
  wire::Reader<wire::BodyDirectory> directory_reader_{mailbox_};
  wire::Writer<wire::RegionSubscription> subscription_writer_{mailbox_};
  wire::Writer<wire::BodyPoses> pose_writer_{mailbox_};
  wire::Writer<wire::NearPoses> near_writer_{mailbox_};
  wire::Writer<wire::WantedPoses> wanted_writer_{mailbox_};
  wire::Writer<wire::BodyPromises> promise_writer_{mailbox_};
  wire::Writer<wire::BodyDirectory> directory_writer_{mailbox_};
  wire::Writer<wire::ContactReport> report_writer_{mailbox_};
  wire::Writer<wire::WatchedBodies> watched_writer_{mailbox_};
  wire::Writer<wire::BoundsReport> bounds_writer_{mailbox_};
  wire::Writer<wire::HeldDetail> held_writer_{mailbox_};  ///< heard by recorders alone
  wire::Writer<wire::ProcessStatus> status_writer_{mailbox_};

  mutable std::mutex mutex_;  ///< outgoing queues and inbox; never held during a DDS call
  std::condition_variable arrived_;
  Inbox inbox_;
  std::shared_ptr<wire::DoorWatch> door_;  ///< of the bus
  std::map<SessionId, Account> accounts_;  ///< by publisher: those that requests were sent to
  std::vector<DdsHeaders::Counted> counted_headers_;  ///< of the inbox
  std::size_t waiting_header_bytes_ = 0;
  /// In the inbox; by who was asked, 0: of all others.
  std::map<SessionId, std::size_t> waiting_batches_;
  LruMap<SessionId, PoseCounts> tally_{kMaxWaitingOthers};  ///< what was heard of those heard last
  /// Parts of own bodies, of poses and of promises, of whose bodies something else was said.
  std::set<std::uint32_t> retold_poses_, retold_promises_;
  bool has_other_bodies_ = false;  ///< than the door was told
  /// Bodies that are moved here and not in DdsChannelOptions::moves.
  std::set<std::string> not_told_;
  std::set<std::string> overflowed_;  ///< topics that already complained since the last take()

  // The I/O thread's own.
  DdsHellos hellos_;
  DdsHeaders headers_;
  DdsPoses movers_;
  wire::Wishers wishers_;
  wire::Routes routes_{own_id_};
  std::unique_ptr<wire::Bus> bus_;
  bool promises_made_ = false;  ///< of own bodies
  bool bounds_told_ = false;

  // What others open, as discovery told it.
  std::atomic<bool> promises_found_ = false, recorder_found_ = false;
  std::atomic<bool> stopping_ = false;
  std::thread thread_;
};

}  // namespace nearmesh::subscriber
