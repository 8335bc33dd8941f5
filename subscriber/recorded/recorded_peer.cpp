// SPDX-License-Identifier: Apache-2.0
#include "recorded_peer.hpp"

#include <new>

#include "core/base/float_guard.hpp"
#include "core/base/parallel.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::int64_t kChunk = 8192;  ///< messages between two rounds of work

}  // namespace

std::string why_stale(const wire::ContactReport& report) {
  for (const auto& [asked, body] :
       {std::pair(&report.a, &report.body_a), std::pair(&report.b, &report.body_b)}) {
    if (asked->stamp.mover == wire::Mover::kNone) continue;
    std::string why = wire::why_stale(asked->stamp, report.time_s, *body);
    if (!why.empty()) return why;
  }
  return {};
}

void RecordedPeer::take(wire::SplitBatchMessage&& batch) {
  std::uint32_t& last = last_sequence_[batch.publisher];
  if (batch.sequence <= last) return;
  // Of which model the missing ones were is unknown: from here on none is complete.
  if (batch.sequence != last + 1) gap_ = true;
  last = batch.sequence;
  if (batch.refused || batch.bytes.empty()) return;  // the peer does not take these in either
  ++batches_;
  Stream& stream = streams_[batch.content_hash];
  if (gap_) return;
  ++stream.received;
  stream.waiting.push_back(std::move(batch));
}

void RecordedPeer::work(const RecordedHeaders& headers, bool final) {
  for (; !reports_.empty(); reports_.pop_front()) {
    const RecordedReport& report = reports_.front();
    if (!why_stale(report.message).empty()) {
      visit(report, Standing::kStale);
    } else if (!report.message.asked) {
      visit(report, Standing::kNotAsked);
    } else if (report.message.gave_up_detail) {
      visit(report, Standing::kGaveUp);
    } else {
      const bool a = reach(report.message.a, headers), b = reach(report.message.b, headers);
      if (!(a && b) && !gap_ && !final) return;
      visit(report, a && b ? Standing::kReached : Standing::kLacking);
    }
  }
}

/// Takes in batches up to what the report has; false when they are not here.
bool RecordedPeer::reach(const wire::ContactReport::Asked& asked, const RecordedHeaders& headers) {
  Stream& stream = streams_[asked.content_hash];
  if (!stream.replica) {
    const auto header = headers.find(asked.content_hash);
    if (header == headers.end()) return false;
    stream.replica.emplace(header->second);
  }
  if (asked.applied_batches > stream.received) return false;
  for (; stream.replica->taken_batches() < asked.applied_batches; stream.waiting.pop_front())
    // The peer went on too where one was wrong.
    static_cast<void>(
        stream.replica->take(stream.waiting.front().bytes, stream.waiting.front().publisher));
  return true;
}

const Replica& RecordedPeer::replica(const wire::ContactReport::Asked& asked) const {
  return *streams_.at(asked.content_hash).replica;
}

Result<Answered> RecordedPeer::ask(const wire::ContactReport& report,
                                   const AnswerOptions& options) const {
  const auto body = [this](const wire::ContactReport::Asked& asked, const std::string& name) {
    return AskedBody{replica(asked).view(), Motion{.pose = asked.pose}, name, asked.solid};
  };
  return answer(body(report.a, report.body_a), body(report.b, report.body_b), options);
}

namespace {

/// Hands the messages of a recording to its peers.
class Player {
 public:
  Player(const RecordingReader& recording, const wire::RecordedSamples& samples,
         const PlayPlan& plan)
      : recording_(recording), samples_(samples), plan_(plan) {}

  void take(std::int64_t id, const RecordedMessage& message) {
    if (const auto header = samples_.read<wire::MeshHeader>(message)) {
      if (headers_.contains(header->content_hash)) return;
      if (auto decoded = decode_header(header->bytes); decoded.is_ok())
        headers_.emplace(header->content_hash, std::move(decoded).value());
    } else if (samples_.is<wire::SplitBatchMessage>(message)) {
      RecordedPeer* peer = peer_of(recording_.writers()[message.writer].partition);
      if (peer == nullptr) return;
      if (auto batch = wire::decode_payload<wire::SplitBatchMessage>(message.cdr); batch.is_ok())
        peer->take(std::move(batch).value());
    } else if (samples_.is<wire::ContactReport>(message)) {
      take_report(id, message);
    }
  }
  void work(bool final) {
    std::vector<RecordedPeer*> all;
    for (auto& [partition, peer] : played_.peers)
      if (peer != nullptr) all.push_back(peer.get());
    for_each_index(all.size(), plan_.threads,
                   [&](std::size_t i) { all[i]->work(headers_, final); });
  }
  [[nodiscard]] Played finish() {
    std::erase_if(played_.peers, [](const auto& entry) { return entry.second == nullptr; });
    return std::move(played_);
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
  RecordedHeaders headers_;
  Played played_;
};

}  // namespace

Result<Played> play(RecordingReader& recording, const PlayPlan& plan) {
  const FloatGuard guard;
  const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(recording);
  NEARMESH_RETURN_IF_ERROR(samples);
  Player player(recording, samples.value(), plan);
  const auto take = [&](std::int64_t id, const RecordedMessage& message) {
    player.take(id, message);
    return true;
  };
  try {
    for (std::int64_t first = 1; first <= recording.message_count(); first += kChunk) {
      NEARMESH_RETURN_IF_ERROR(recording.read(first, first + kChunk, take));
      player.work(false);
      if (plan.has_enough && plan.has_enough()) break;
    }
    player.work(true);
  } catch (const std::bad_alloc&) {  // replicas span all ids that a header announces
    return Status{StatusCode::kIo, "no memory for the peers' replicas"};
  }
  return player.finish();
}

}  // namespace nearmesh::subscriber
