// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/verify.hpp"

#include <algorithm>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <new>
#include <optional>

#include "nearmesh/core/abtree/ab_tree.hpp"
#include "nearmesh/core/base/hash.hpp"
#include "nearmesh/core/base/parallel.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/core/refine/replica.hpp"
#include "nearmesh/wire/payload.hpp"
#include "nearmesh/wire/topics.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::int64_t kChunk = 8192;  ///< messages between two rounds of work

struct Model {
  Replica replica;
  AbTree tree;
  explicit Model(SpmHeader header) : replica(std::move(header)), tree(replica.mesh()) {}
};

/// What a peer was sent of one model, and how much of it is taken in.
struct Stream {
  std::unique_ptr<Model> model;
  std::deque<std::vector<std::uint8_t>> waiting;
  std::uint32_t applied = 0, received = 0;
};

struct Report {
  std::int64_t id = 0;
  wire::ContactReport message;
};

using Headers = std::map<std::uint64_t, SpmHeader>;

/// One peer, lived through again.
class Peer {
 public:
  void take(wire::SplitBatchMessage&& batch) {
    std::uint32_t& last = last_sequence_[batch.publisher];
    if (batch.sequence <= last) return;
    // Of which model the missing ones were is unknown: from here on none is complete.
    if (batch.sequence != last + 1) gap_ = true;
    last = batch.sequence;
    if (batch.refused || batch.bytes.empty()) return;  // the peer does not take these in either
    ++found_.batches;
    Stream& stream = streams_[batch.content_hash];
    if (gap_) return;
    ++stream.received;
    stream.waiting.push_back(std::move(batch.bytes));
  }
  void take(Report&& report) { reports_.push_back(std::move(report)); }

  /// Reports, in order, as far as what they speak of is here. `final`: nothing more comes.
  void work(const Headers& headers, bool final) {
    for (; !reports_.empty(); reports_.pop_front()) {
      const Report& report = reports_.front();
      if (!report.message.asked) {
        ++found_.not_asked;
      } else if (report.message.gave_up_detail) {
        ++found_.gave_up;
      } else {
        const bool a = reach(report.message.a, headers), b = reach(report.message.b, headers);
        if (!(a && b) && !gap_ && !final) return;
        if (a && b)
          compare(report);
        else
          ++found_.lacking;
      }
    }
  }

  [[nodiscard]] const VerifyReport& found() const { return found_; }

 private:
  /// Takes in batches up to what the report has; false when they are not here.
  bool reach(const wire::ContactReport::Asked& asked, const Headers& headers) {
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

  void compare(const Report& report) {
    const wire::ContactReport& recorded = report.message;
    for (const auto& [asked, body] :
         {std::pair(&recorded.a, &recorded.body_a), std::pair(&recorded.b, &recorded.body_b)}) {
      const Stream& stream = streams_[asked->content_hash];
      const std::uint64_t state = stream.model->replica.mesh().state_hash();
      if (stream.applied == asked->applied_batches && state == asked->state_digest) continue;
      std::string what = "model of " + *body + " after " + std::to_string(asked->applied_batches) +
                         " batches: recorded state " + to_hex(asked->state_digest) + ", found ";
      what += stream.applied == asked->applied_batches
                  ? to_hex(state)
                  : std::to_string(stream.applied) + " batches taken in before";
      differ({.message = report.id, .recorded = recorded, .state = true, .what = what});
      return;
    }
    const Answer answer = ask(recorded);
    const std::uint64_t found = digest(answer);
    found_.digest = mix(found_.digest ^ found);
    if (found == recorded.answer_digest) {
      ++found_.verified;
      return;
    }
    Difference difference{.message = report.id, .recorded = recorded};
    const auto say = [](AnswerStatus status, std::uint64_t pairs, std::uint64_t digest) {
      return std::string(to_string(status)) + ", " + std::to_string(pairs) + " pairs, digest " +
             to_hex(digest);
    };
    difference.what = "recorded " +
                      say(static_cast<AnswerStatus>(recorded.status), recorded.pair_count,
                          recorded.answer_digest) +
                      "; found " + say(answer.status, answer.pair_total, found);
    std::vector<std::array<FaceKey, 2>> pairs;
    for (const FacePair& pair : answer.pairs) {
      if (pairs.size() == wire::kMaxReportPairs) break;
      pairs.push_back({pair.a, pair.b});
    }
    const auto without = [](const auto& list, const auto& other) {
      std::vector<std::array<FaceKey, 2>> rest;
      for (const auto& pair : list)
        if (std::find(other.begin(), other.end(), pair) == other.end()) rest.push_back(pair);
      return rest;
    };
    difference.only_recorded = without(recorded.pairs, pairs);
    difference.only_found = without(pairs, recorded.pairs);
    differ(std::move(difference));
  }

  /// As Session does.
  Answer ask(const wire::ContactReport& recorded) {
    const auto view = [&](const wire::ContactReport::Asked& asked) {
      const Model& model = *streams_[asked.content_hash].model;
      return model.tree.view(model.replica.header().grid);
    };
    const TreeView a = view(recorded.a), b = view(recorded.b);
    const Result<PosedPair> posed = pose_pair(*a.grid, recorded.a.pose, recorded.body_a, *b.grid,
                                              recorded.b.pose, recorded.body_b);
    if (!posed.is_ok()) return {};
    Answer answer = query(a, posed.value().a, b, posed.value().b,
                          {.solid_a = recorded.a.solid, .solid_b = recorded.b.solid});
    if (answer.status == AnswerStatus::kUncertain && answer.missing_a.empty() &&
        answer.missing_b.empty())
      answer.uncertainty_m = std::numeric_limits<double>::infinity();
    return answer;
  }

  void differ(Difference difference) {
    ++found_.different;
    found_.digest = mix(found_.digest ^ static_cast<std::uint64_t>(difference.message));
    if (found_.differences.size() < kMaxDifferences)
      found_.differences.push_back(std::move(difference));
  }

  std::map<std::uint64_t, Stream> streams_;                 // by content hash
  std::map<wire::SessionId, std::uint32_t> last_sequence_;  // by publisher
  bool gap_ = false;
  std::deque<Report> reports_;
  VerifyReport found_;
};

/// All of them, in order of their partitions.
class Peers {
 public:
  explicit Peers(unsigned threads) : threads_(threads) {}

  Peer& of(const std::string& partition) {
    std::unique_ptr<Peer>& peer = peers_[partition];
    if (peer == nullptr) peer = std::make_unique<Peer>();
    return *peer;
  }
  void work(const Headers& headers, bool final) {
    std::vector<Peer*> all;
    for (auto& [partition, peer] : peers_) all.push_back(peer.get());
    for_each_index(all.size(), threads_, [&](std::size_t i) { all[i]->work(headers, final); });
  }
  void sum_up(VerifyReport& sum) const {
    sum.peers = peers_.size();
    for (const auto& [partition, peer] : peers_) {
      const VerifyReport& found = peer->found();
      sum.verified += found.verified;
      sum.different += found.different;
      sum.not_asked += found.not_asked;
      sum.lacking += found.lacking;
      sum.gave_up += found.gave_up;
      sum.batches += found.batches;
      sum.digest = mix(sum.digest ^ found.digest);
      sum.differences.insert(sum.differences.end(), found.differences.begin(),
                             found.differences.end());
    }
    std::sort(sum.differences.begin(), sum.differences.end(),
              [](const Difference& a, const Difference& b) { return a.message < b.message; });
  }

 private:
  const unsigned threads_;
  std::map<std::string, std::unique_ptr<Peer>> peers_;
};

}  // namespace

Result<VerifyReport> verify(RecordingReader& recording, unsigned threads) {
  if (recording.facts().wire_version != wire::kWireVersion)
    return Status{StatusCode::kUnsupported,
                  "recorded with wire version " + std::to_string(recording.facts().wire_version) +
                      ", this build speaks " + std::to_string(wire::kWireVersion)};
  const wire::TopicNames names(recording.facts().prefix);
  VerifyReport report;
  Headers headers;
  Peers peers(threads);
  const auto take = [&](std::int64_t id, const RecordedMessage& message) {
    const RecordedWriter& writer = recording.writers()[message.writer];
    const std::string& topic = recording.topics()[writer.topic].name;
    if (topic == names.mesh_header) {
      const auto header = wire::decode_payload<wire::MeshHeader>(message.cdr);
      if (!header.is_ok() || headers.contains(header.value().content_hash)) return true;
      if (auto decoded = decode_header(header.value().bytes); decoded.is_ok())
        headers.emplace(header.value().content_hash, std::move(decoded).value());
    } else if (topic == names.split_batch) {
      if (auto batch = wire::decode_payload<wire::SplitBatchMessage>(message.cdr); batch.is_ok())
        peers.of(writer.partition).take(std::move(batch).value());
    } else if (topic == names.contact_report) {
      ++report.reports;
      auto decoded = wire::decode_payload<wire::ContactReport>(message.cdr);
      if (!decoded.is_ok()) {
        ++report.malformed;
        return true;
      }
      const std::string partition = wire::partition_of(decoded.value().peer);
      peers.of(partition).take({id, std::move(decoded).value()});
    }
    return true;
  };
  try {
    for (std::int64_t first = 1; first <= recording.message_count(); first += kChunk) {
      NEARMESH_RETURN_IF_ERROR(recording.read(first, first + kChunk, take));
      peers.work(headers, false);
    }
    peers.work(headers, true);
  } catch (const std::bad_alloc&) {  // replicas span all ids that a header announces
    return Status{StatusCode::kIo, "no memory for the peers' replicas"};
  }
  peers.sum_up(report);
  return report;
}

}  // namespace nearmesh::subscriber
