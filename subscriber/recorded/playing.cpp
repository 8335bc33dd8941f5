// SPDX-License-Identifier: Apache-2.0
// A recording, lived through by its peers.
#include <algorithm>
#include <new>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/parallel.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "recorded_peer.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::int64_t kChunk = 8192;  ///< messages between two rounds of work

/// Hands the messages of a recording to its peers.
class Hands {
 public:
  Hands(const RecordingReader& recording, const wire::RecordedSamples& samples,
        const PlayPlan& plan, ModelSources& sources, Played& played)
      : recording_(recording), samples_(samples), plan_(plan), sources_(sources), played_(played) {}

  void take(std::int64_t id, const RecordedMessage& message) {
    if (const auto header = samples_.read<wire::MeshHeader>(message)) {
      sources_.take(*header);
    } else if (samples_.is<wire::SplitBatchMessage>(message)) {
      const std::string& partition = recording_.writers()[message.writer].partition;
      if (wire::peer_of(partition) == 0) return;  // whatever its writer called it
      RecordedPeer* peer = peer_of(partition);
      if (peer == nullptr) return;
      auto sample = wire::decode_payload<wire::SplitBatchMessage>(message.cdr);
      if (!sample.is_ok()) return;
      for (wire::SplitBatchMessage& batch : take_apart(std::move(sample).value())) {
        if (batch.is_piece) sources_.take_piece(batch);
        peer->take(std::move(batch));
      }
    } else if (const auto asked = samples_.read<wire::RegionSubscription>(message)) {
      RecordedPeer* peer = peer_of(wire::partition_of(asked->peer));
      if (peer != nullptr) peer->take(*asked);
    } else if (auto held = samples_.read<wire::HeldDetail>(message)) {
      RecordedPeer* peer = peer_of(wire::partition_of(held->peer));
      if (peer != nullptr) peer->take(std::move(*held));
    } else if (samples_.is<wire::ContactReport>(message)) {
      take_report(id, message);
    }
  }
  void work(bool final) {
    std::vector<RecordedPeer*> all;
    for (auto& [partition, peer] : played_.peers)
      if (peer != nullptr) all.push_back(peer.get());
    for_each_index(all.size(), plan_.threads,
                   [&](std::size_t i) { all[i]->work(sources_, final); });
  }

 private:
  RecordedPeer* peer_of(const std::string& partition) {
    const auto [at, is_new] = played_.peers.try_emplace(partition);
    if (is_new) at->second = plan_.make_peer(partition);
    return at->second.get();
  }
  void take_report(std::int64_t id, const RecordedMessage& message) {
    if (plan_.wants && !plan_.wants(id)) return;
    ++played_.reports;
    auto report = wire::decode_payload<wire::ContactReport>(message.cdr);
    if (!report.is_ok()) {
      ++played_.malformed;
      return;
    }
    RecordedPeer* peer = peer_of(wire::partition_of(report.value().peer));
    if (peer != nullptr) peer->take({id, message.received_ns, std::move(report).value()});
  }

  const RecordingReader& recording_;
  const wire::RecordedSamples& samples_;
  const PlayPlan& plan_;
  ModelSources& sources_;
  Played& played_;
};

}  // namespace

Playing::Playing(PlayPlan plan) : plan_(std::move(plan)), sources_(plan_.models) {}

Status Playing::go_on(RecordingReader& recording, bool final) {
  const FloatGuard guard;
  const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(recording);
  NEARMESH_RETURN_IF_ERROR(samples);
  Hands hands(recording, samples.value(), plan_, sources_, played_);
  const auto take = [&](std::int64_t id, const RecordedMessage& message) {
    hands.take(id, message);
    return true;
  };
  try {
    while (next_ <= recording.message_count()) {
      const std::int64_t end = std::min(next_ + kChunk, recording.message_count() + 1);
      NEARMESH_RETURN_IF_ERROR(recording.read(next_, end, take));
      next_ = end;
      hands.work(false);
      if (plan_.has_enough && plan_.has_enough()) break;
    }
    if (final) hands.work(true);
  } catch (const std::bad_alloc&) {  // replicas span all ids that a header announces
    return Status{StatusCode::kIo, "no memory for the peers' replicas"};
  }
  return Status::ok();
}

Played Playing::finish() {
  std::erase_if(played_.peers, [](const auto& entry) { return entry.second == nullptr; });
  return std::move(played_);
}

Result<Played> play(RecordingReader& recording, const PlayPlan& plan) {
  Playing playing(plan);
  NEARMESH_RETURN_IF_ERROR(playing.go_on(recording, true));
  return playing.finish();
}

}  // namespace nearmesh::subscriber
