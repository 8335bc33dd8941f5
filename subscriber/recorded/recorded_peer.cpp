// SPDX-License-Identifier: Apache-2.0
#include "recorded_peer.hpp"

#include <limits>
#include <new>

#include "core/base/float_guard.hpp"
#include "core/base/parallel.hpp"
#include "nearmesh/idl/dds/payload.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::int64_t kChunk = 8192;  ///< messages between two rounds of work

}  // namespace

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
  stream.waiting.push_back(std::move(batch.bytes));
}

void RecordedPeer::work(const RecordedHeaders& headers, bool final) {
  for (; !reports_.empty(); reports_.pop_front()) {
    const RecordedReport& report = reports_.front();
    if (!report.message.asked) {
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
  if (stream.model == nullptr) {
    const auto header = headers.find(asked.content_hash);
    if (header == headers.end()) return false;
    stream.model = std::make_unique<Model>(header->second);
  }
  if (asked.applied_batches > stream.received) return false;
  for (; stream.applied < asked.applied_batches; ++stream.applied) {
    Model& model = *stream.model;
    const Result<SplitBatch> batch = decode_batch(model.replica.header(), stream.waiting.front());
    stream.waiting.pop_front();
    if (batch.is_ok()) model.tree.update(model.replica.apply_batch(batch.value()).delta);
  }
  return true;
}

const Replica& RecordedPeer::replica(const wire::ContactReport::Asked& asked) const {
  return streams_.at(asked.content_hash).model->replica;
}

TreeView RecordedPeer::view(const wire::ContactReport::Asked& asked) const {
  const Model& model = *streams_.at(asked.content_hash).model;
  return model.tree.view(model.replica.header().grid);
}

std::uint32_t RecordedPeer::applied(const wire::ContactReport::Asked& asked) const {
  return streams_.at(asked.content_hash).applied;
}

Result<PosedPair> RecordedPeer::posed(const wire::ContactReport& report) const {
  return pose_pair(*view(report.a).grid, report.a.pose, report.body_a, *view(report.b).grid,
                   report.b.pose, report.body_b);
}

Answer RecordedPeer::ask(const wire::ContactReport& report) const {
  const Result<PosedPair> placed = posed(report);
  if (!placed.is_ok()) return {};
  Answer answer = query(view(report.a), placed.value().a, view(report.b), placed.value().b,
                        {.solid_a = report.a.solid, .solid_b = report.b.solid});
  if (answer.status == AnswerStatus::kUncertain && answer.missing_a.empty() &&
      answer.missing_b.empty())
    answer.uncertainty_m = std::numeric_limits<double>::infinity();
  return answer;
}

namespace {

/// Hands the messages of a recording to its peers.
class Player {
 public:
  Player(const RecordingReader& recording, const PlayPlan& plan)
      : recording_(recording), plan_(plan), names_(recording.facts().prefix) {}

  void take(std::int64_t id, const RecordedMessage& message) {
    const RecordedWriter& writer = recording_.writers()[message.writer];
    const std::string& topic = recording_.topics()[writer.topic].name;
    if (topic == names_.mesh_header) {
      const auto header = wire::decode_payload<wire::MeshHeader>(message.cdr);
      if (!header.is_ok() || headers_.contains(header.value().content_hash)) return;
      if (auto decoded = decode_header(header.value().bytes); decoded.is_ok())
        headers_.emplace(header.value().content_hash, std::move(decoded).value());
    } else if (topic == names_.split_batch) {
      RecordedPeer* peer = peer_of(writer.partition);
      if (peer == nullptr) return;
      if (auto batch = wire::decode_payload<wire::SplitBatchMessage>(message.cdr); batch.is_ok())
        peer->take(std::move(batch).value());
    } else if (topic == names_.contact_report) {
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
  const PlayPlan& plan_;
  const wire::TopicNames names_;
  RecordedHeaders headers_;
  Played played_;
};

}  // namespace

Result<Played> play(RecordingReader& recording, const PlayPlan& plan) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(wire::check_recorded_version(recording.facts().wire_version));
  Player player(recording, plan);
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
