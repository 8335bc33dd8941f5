// SPDX-License-Identifier: Apache-2.0
#pragma once
// A peer's channel whose samples are kept as a recorder would hear them, to be spoilt and written;
// and what recordings they give.

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "taped_channels.hpp"

namespace nearmesh::test {

struct KeptSample {
  wire::SessionId by = 0;  ///< the participant
  std::variant<wire::MeshHeader, wire::BodyDirectory, wire::BodyPoses, wire::NearPoses,
               wire::BodyPromises, wire::WatchedBodies, wire::BoundsReport, wire::ContactReport,
               wire::HeldDetail, wire::RegionSubscription>
      message;
  /// Instead, where it is for a peer; it may have no bytes, but it has a number.
  wire::SplitBatchMessage batch{};
  wire::SessionId peer = 0;

  [[nodiscard]] bool is_batch() const { return peer != 0; }

  template <class Message>
  [[nodiscard]] Message* as() {
    return is_batch() ? nullptr : std::get_if<Message>(&message);
  }
  template <class Message>
  [[nodiscard]] const Message* as() const {
    return is_batch() ? nullptr : std::get_if<Message>(&message);
  }
};
using KeptSamples = std::vector<KeptSample>;

class KeptChannel final : public subscriber::Channel {
 public:
  KeptChannel(std::unique_ptr<subscriber::Channel> inner, KeptSamples& kept)
      : inner_(std::move(inner)), kept_(kept) {}
  wire::SessionId own_id() const override { return inner_->own_id(); }
  void send(const wire::RegionSubscription& message) override { pass(message); }
  void send(const wire::BodyPoses& message) override { pass(message); }
  void send(const wire::BodyDirectory& message) override { pass(message); }
  void promise(const wire::BodyPromises& message) override {
    keep(own_id(), message);
    inner_->promise(message);
  }
  void send_near(const wire::NearPoses& message) override {
    keep(own_id(), message);
    inner_->send_near(message);
  }
  void want(const wire::WantedPoses& message) override { inner_->want(message); }
  bool has_recorder() const override { return records; }
  void send(const wire::ContactReport& message) override { pass(message); }
  void tell_held(const wire::HeldDetail& message) override {
    keep(own_id(), message);
    inner_->tell_held(message);
  }
  void tell_watched(const wire::WatchedBodies& message) override {
    keep(own_id(), message);
    inner_->tell_watched(message);
  }
  void tell_bounds(const wire::BoundsReport& message) override {
    keep(own_id(), message);
    inner_->tell_bounds(message);
  }
  bool records = true;
  bool recorder_comes = false;  ///< by the next take()
  Inbox take() override {
    Inbox inbox = inner_->take();
    inbox.recorder_came |= std::exchange(recorder_comes, false);
    for (const Header& header : inbox.headers)
      if (headers_.insert(header.message.content_hash).second)
        keep(header.publisher, header.message);
    for (const wire::SplitBatchMessage& batch : inbox.batches)
      kept_.push_back({.by = batch.publisher, .message = {}, .batch = batch, .peer = own_id()});
    return inbox;
  }

 private:
  template <class Message>
  void pass(const Message& message) {
    keep(own_id(), message);
    inner_->send(message);
  }
  template <class Message>
  void keep(wire::SessionId by, const Message& message) {
    kept_.push_back({.by = by, .message = message});
  }
  std::unique_ptr<subscriber::Channel> inner_;
  KeptSamples& kept_;
  std::set<ContentHash> headers_;
};

/// In their order, a millisecond apart.
/// `unheard`: who had sent contact reports before.
inline void write_samples(const KeptSamples& samples, const std::string& path,
                          wire::SessionId unheard = 0) {
  Tape tape(RecordingWriter::create(path, {7, 0, wire::kWireVersion, "kept", "idl"}).value(),
            "kept");
  tape.now_ns = 1'700'000'000'000'000'000;
  if (unheard != 0) tape.miss_reports(unheard, 7);
  for (const KeptSample& sample : samples) {
    tape.now_ns += 1'000'000;
    if (sample.is_batch()) {
      tape.put(sample.by, sample.peer, sample.batch);
    } else {
      std::visit([&](const auto& message) { tape.put(sample.by, message); }, sample.message);
    }
  }
  EXPECT_TRUE(tape.close().is_ok());
}

}  // namespace nearmesh::test
