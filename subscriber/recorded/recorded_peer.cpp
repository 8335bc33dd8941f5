// SPDX-License-Identifier: Apache-2.0
#include "recorded_peer.hpp"

#include <algorithm>
#include <new>

#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "core/base/parallel.hpp"
#include "core/replica/held_nodes.hpp"
#include "core/world/page.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::int64_t kChunk = 8192;  ///< messages between two rounds of work
/// Batches and what the peer said it held come to a recorder by different ways, some milliseconds apart: so many batches, and
/// so many rounds, are enough for the one to be found in the other.
constexpr std::size_t kLatest = 1024;
constexpr int kPatientRounds = 2;
constexpr std::size_t kMaxComplaints = 16;
/// Of an answer that was cut, since it may have been for its cost: some 10 to 50 ms.
constexpr std::uint64_t kCutTests = 2'000'000;

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

bool RecordedPeer::Numbers::follow(const Batch& batch) {
  Heard& last = heard[batch.publisher];
  // A publisher that lost the peer for a while counts from 1 again; requests only go up.
  const bool again = batch.sequence <= last.sequence;
  if (again && batch.request <= last.request) return false;  // heard before
  // Of which model the missing ones were is unknown: from here on none is complete.
  whole &= batch.sequence == (again ? 0 : last.sequence) + 1;
  last = {batch.sequence, std::max(batch.request, last.request)};
  return whole;
}

void RecordedPeer::Stretch::follow(const Batch& batch, const ContentHash& content_hash) {
  if (!numbers.whole || !numbers.follow(batch)) return;
  if (batch.content_hash != content_hash || batch.bytes == nullptr) return;
  ++received;
  waiting.push_back(batch);
}

RecordedPeer::Stream& RecordedPeer::stream_of(const ContentHash& content_hash) {
  Stream& stream = streams_[content_hash];
  if (stream.empty()) stream.push_back({.held = std::nullopt, .numbers = from_start_});
  return stream;
}

/// A stretch that goes on past the begin of the next makes that one needless.
void RecordedPeer::drop_followed(Stream& stream) {
  for (std::size_t i = 0; i + 1 < stream.size(); ++i)
    if (stream[i].numbers.whole && stream[i].end() >= stream[i + 1].first) stream.resize(i + 1);
}

void RecordedPeer::take(wire::SplitBatchMessage&& message) {
  Batch batch{message.publisher, message.sequence, message.request, message.content_hash, nullptr};
  if (!message.refused && !message.bytes.empty()) {  // else the peer does not take it in either
    ++batches_;
    batch.bytes = std::make_shared<const std::vector<std::uint8_t>>(std::move(message.bytes));
    stream_of(batch.content_hash);
  }
  for (auto& [content_hash, stream] : streams_) {
    for (Stretch& stretch : stream) stretch.follow(batch, content_hash);
    drop_followed(stream);
  }
  if (from_start_.whole) static_cast<void>(from_start_.follow(batch));
  latest_.push_back(std::move(batch));
  if (latest_.size() > kLatest) latest_.pop_front();
}

void RecordedPeer::take(wire::HeldDetail&& held) {
  Stream& stream = stream_of(held.content_hash);
  if (stream.back().numbers.whole && stream.back().end() >= held.applied_batches) return;
  Stretch next{.held = std::nullopt, .numbers = {}, .first = held.applied_batches};
  for (const wire::HeldDetail::Heard& heard : held.heard)
    next.numbers.heard[heard.publisher] = {heard.sequence, held.last_request};
  for (const Batch& batch : latest_) next.follow(batch, held.content_hash);
  next.held = std::move(held);
  stream.push_back(std::move(next));
}

void RecordedPeer::work(const ModelSources& sources, bool final) {
  for (auto& [content_hash, stream] : streams_)
    for (std::size_t i = 0; i + 1 < stream.size(); ++i)
      if (++stream[i].rounds > kPatientRounds) stream[i].numbers.whole = false;
  for (; !reports_.empty(); reports_.pop_front()) {
    const RecordedReport& report = reports_.front();
    if (!why_stale(report.message).empty()) {
      visit(report, Standing::kStale);
    } else if (report.message.put_off) {
      visit(report, Standing::kPutOff);
    } else if (!report.message.asked) {
      visit(report, Standing::kNotAsked);
    } else if (report.message.gave_up_detail) {
      visit(report, Standing::kGaveUp);
    } else {
      const Reach a = reach(report.message.a, sources, final),
                  b = reach(report.message.b, sources, final);
      if (a == Reach::kNever || b == Reach::kNever) {
        visit(report, Standing::kLacking);
      } else if (a == Reach::kNoFile || b == Reach::kNoFile) {
        if (a == Reach::kNoFile) ++wanted_[report.message.a.content_hash].reports;
        if (b == Reach::kNoFile &&
            (a != b || report.message.a.content_hash != report.message.b.content_hash))
          ++wanted_[report.message.b.content_hash].reports;
        visit(report, Standing::kNoFile);
      } else if (a == Reach::kNotYet || b == Reach::kNotYet) {
        return;
      } else {
        visit(report, Standing::kReached);
      }
    }
  }
}

/// Takes in batches up to what the report has.
RecordedPeer::Reach RecordedPeer::reach(const wire::ContactReport::Asked& asked,
                                        const ModelSources& sources, bool final) {
  Stream& stream = stream_of(asked.content_hash);
  for (;; stream.pop_front()) {
    Stretch& stretch = stream.front();
    const bool goes_on = stretch.numbers.whole && !final;
    if (asked.applied_batches <= stretch.end()) {
      if (asked.applied_batches < stretch.first) return Reach::kNever;
      const Reach begun = begin(stretch, asked.content_hash, sources);
      if (begun == Reach::kNotYet && !goes_on) return Reach::kNever;
      if (begun != Reach::kThere) return begun;
      for (; stretch.taken() < asked.applied_batches; stretch.waiting.pop_front())
        // The peer went on too where one was wrong.
        static_cast<void>(stretch.replica->take(*stretch.waiting.front().bytes,
                                                stretch.waiting.front().publisher));
      return Reach::kThere;
    }
    if (goes_on) return Reach::kNotYet;
    if (stream.size() == 1 || asked.applied_batches < stream[1].first) return Reach::kNever;
  }
}

/// Makes the replica at the stretch's begin.
RecordedPeer::Reach RecordedPeer::begin(Stretch& stretch, const ContentHash& content_hash,
                                        const ModelSources& sources) {
  if (stretch.replica) return Reach::kThere;
  if (stretch.failed) return Reach::kNever;
  if (stretch.no_file) return Reach::kNoFile;
  const auto header = sources.headers.find(content_hash);
  if (!stretch.held) {
    if (header == sources.headers.end()) return Reach::kNotYet;
    stretch.replica.emplace(header->second);
    return Reach::kThere;
  }
  const wire::HeldDetail& held = *stretch.held;
  Status status;
  const bool has_file =
      sources.files != nullptr && sources.files->lend(content_hash, [&](ModelFile& file) {
        stretch.replica.emplace(file.header());
        status = take_up(
            stretch,
            held_batch(
                file.store(), [&](NodeSpan node) { return file.require(node); }, held.nodes));
      });
  if (!has_file) {
    // A peer that held nothing is taken up without a file.
    const auto lacks = [](NodeSpan node) { return Status{StatusCode::kNotFound, to_string(node)}; };
    if (header != sources.headers.end()) stretch.replica.emplace(header->second);
    const Result<SplitBatch> batch = stretch.replica
                                         ? held_batch(stretch.replica->store(), lacks, held.nodes)
                                         : Status{StatusCode::kNotFound, "no header"};
    if (batch.status().code() == StatusCode::kNotFound) {
      stretch.replica.reset();
      stretch.no_file = true;
      wanted_[content_hash].name = held.model;
      return Reach::kNoFile;
    }
    status = take_up(stretch, batch);
  }
  if (status.is_ok()) return Reach::kThere;
  stretch.failed = true;
  stretch.replica.reset();
  if (complaints_.size() < kMaxComplaints)
    complaints_.push_back("peer " + wire::partition_of(held.peer) + ", model " + held.model +
                          " after " + std::to_string(held.applied_batches) +
                          " batches: " + status.message());
  return Reach::kNever;
}

Status RecordedPeer::take_up(Stretch& stretch, const Result<SplitBatch>& batch) {
  NEARMESH_RETURN_IF_ERROR(batch);
  NEARMESH_RETURN_IF_ERROR(stretch.replica->take(batch.value()).status);
  stretch.before = stretch.first - stretch.replica->taken_batches();
  const std::uint64_t state = stretch.replica->mesh().state_hash();
  if (state != stretch.held->state_digest)
    return {StatusCode::kConflict, "the peer said that it held state " +
                                       to_hex(stretch.held->state_digest) +
                                       ", what it listed gives " + to_hex(state)};
  if (held_nodes(*stretch.replica).box_digest != stretch.held->box_digest)
    return {StatusCode::kConflict,
            "the peer held boxes that are not the file's, as one does that a replay served"};
  return Status::ok();
}

const Replica& RecordedPeer::replica(const wire::ContactReport::Asked& asked) const {
  return *streams_.at(asked.content_hash).front().replica;
}

std::uint32_t RecordedPeer::taken_batches(const wire::ContactReport::Asked& asked) const {
  return streams_.at(asked.content_hash).front().taken();
}

Result<Answered> RecordedPeer::ask(const wire::ContactReport& report,
                                   const AnswerOptions& options) const {
  AnswerOptions bounded = options;
  if (report.cut) bounded.max_tests = std::min(bounded.max_tests, kCutTests);
  const auto body = [this](const wire::ContactReport::Asked& asked, const std::string& name) {
    return AskedBody{replica(asked).view(), Motion{.pose = asked.pose}, name, asked.solid};
  };
  return answer(body(report.a, report.body_a), body(report.b, report.body_b), bounded);
}

namespace {

/// Hands the messages of a recording to its peers.
class Hands {
 public:
  Hands(const RecordingReader& recording, const wire::RecordedSamples& samples,
        const PlayPlan& plan, ModelSources& sources, Played& played)
      : recording_(recording), samples_(samples), plan_(plan), sources_(sources), played_(played) {}

  void take(std::int64_t id, const RecordedMessage& message) {
    if (const auto header = samples_.read<wire::MeshHeader>(message)) {
      if (sources_.headers.contains(header->content_hash)) return;
      if (is_world_record(header->bytes)) played_.worlds[header->content_hash] = header->name;
      if (auto decoded = decode_header(header->bytes); decoded.is_ok())
        sources_.headers.emplace(header->content_hash, std::move(decoded).value());
    } else if (samples_.is<wire::SplitBatchMessage>(message)) {
      RecordedPeer* peer = peer_of(recording_.writers()[message.writer].partition);
      if (peer == nullptr) return;
      if (auto batch = wire::decode_payload<wire::SplitBatchMessage>(message.cdr); batch.is_ok())
        peer->take(std::move(batch).value());
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

Playing::Playing(PlayPlan plan) : plan_(std::move(plan)) { sources_.files = plan_.models; }

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
