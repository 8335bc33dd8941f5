// SPDX-License-Identifier: Apache-2.0
#pragma once
// Two domains joined as a DDS Router joins them: it hands on the topics that cross (facts.hpp),
// both ways, and writes each through one writer, in whose name all peers of the other side speak.
// For tests, in the place of the vendor's.

#include <array>
#include <atomic>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include "facts.hpp"
#include "idl/dds/bus.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/endpoint_names.hpp"
#include "idl/dds/endpoints.hpp"

namespace nearmesh::sites {

class Forwarder {
 public:
  /// Throws std::runtime_error where a domain cannot be joined.
  Forwarder(const wire::TransportOptions& one, const wire::TransportOptions& other) {
    for (wire::TopicPlace place = 0; place < wire::kTopicCount; ++place)
      if (crossings()[place].crosses)
        wire::visit_topic(place, [this](const auto& topic) { return add(topic); });
    buses_ = {open(one), open(other)};
    for (const auto& lane : lanes_) require(lane->open(buses_));
    thread_ = std::thread([this] {
      while (!stops_) {
        bool more = false;
        for (const auto& lane : lanes_) more = lane->hand_on() || more;
        if (!more) mailbox_.wait(0.02);
      }
    });
  }
  ~Forwarder() {
    stops_ = true;
    mailbox_.wake();
    thread_.join();
  }
  Forwarder(const Forwarder&) = delete;
  Forwarder& operator=(const Forwarder&) = delete;

  [[nodiscard]] std::uint64_t handed_on() const { return handed_on_; }

 private:
  using Buses = std::array<std::unique_ptr<wire::Bus>, 2>;
  struct Lane {
    virtual ~Lane() = default;
    virtual Status open(const Buses& buses) = 0;
    virtual bool hand_on() = 0;  ///< out: there may be more
  };
  template <class Message>
  struct LaneOf final : Lane {
    /// What is read: two topics may share a message, as near_poses has that of body_poses.
    using Decoded =
        std::decay_t<decltype(wire::decode(
                                  std::declval<const typename wire::TypeOf<Message>::Data&>())
                                  .value())>;
    explicit LaneOf(Forwarder& own)
        : forwarder(own),
          readers{wire::Reader<Message>(own.mailbox_), wire::Reader<Message>(own.mailbox_)},
          writers{wire::Writer<Message>(own.mailbox_), wire::Writer<Message>(own.mailbox_)} {}
    Status open(const Buses& buses) override {
      for (std::size_t side = 0; side < 2; ++side) {
        NEARMESH_RETURN_IF_ERROR(writers[side].open(*buses[side]));
        NEARMESH_RETURN_IF_ERROR(readers[side].open(*buses[side]));
      }
      return Status::ok();
    }
    bool hand_on() override {
      bool more = false;
      for (std::size_t side = 0; side < 2; ++side)
        more = readers[side].drain(100, [&](Decoded&& message, const wire::Handle& writer,
                                            wire::Microseconds) {
          // What it wrote itself on this side came from the other.
          if (wire::have_one_participant(writer, readers[side].endpoint().get_instance_handle()))
            return;
          const bool taken =
              wire::write_patiently(std::string(wire::topic_of<Message>().name), forwarder.mailbox_,
                                    [&] { return writers[1 - side].write(Message{message}); });
          if (taken) ++forwarder.handed_on_;
        }) || more;
      return more;
    }
    Forwarder& forwarder;
    std::array<wire::Reader<Message>, 2> readers;
    std::array<wire::Writer<Message>, 2> writers;
  };
  template <class Message>
  bool add(const wire::Topic<Message>&) {
    lanes_.push_back(std::make_unique<LaneOf<Message>>(*this));
    return true;
  }
  static void require(const Status& status) {
    if (!status.is_ok()) throw std::runtime_error(status.message());
  }
  std::unique_ptr<wire::Bus> open(const wire::TransportOptions& transport) {
    auto bus = wire::Bus::open({.transport = transport}, mailbox_);
    require(bus.status());
    return std::move(bus).value();
  }

  wire::Mailbox mailbox_;
  std::vector<std::unique_ptr<Lane>> lanes_;
  Buses buses_;  // before the endpoints' listeners go
  std::atomic<std::uint64_t> handed_on_ = 0;
  std::atomic<bool> stops_ = false;
  std::thread thread_;
};

}  // namespace nearmesh::sites
