// SPDX-License-Identifier: Apache-2.0
#include "verify.hpp"

#include <algorithm>

#include "core/base/hash.hpp"
#include "core/query/faces_touch.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber {
namespace {

/// One peer, with what came out of its reports.
class CheckedPeer final : public RecordedPeer {
 public:
  [[nodiscard]] const VerifyReport& found() const { return found_; }

 private:
  void visit(const RecordedReport& report, Standing standing) override {
    switch (standing) {
      case Standing::kReached:
        compare(report);
        break;
      case Standing::kNotAsked:
        ++found_.not_asked;
        break;
      case Standing::kPutOff:
        compare_put_off(report);
        break;
      case Standing::kStale:
        compare_stale(report);
        break;
      case Standing::kGaveUp:
        ++found_.gave_up;
        break;
      case Standing::kLacking:
      case Standing::kNoFile:
        ++found_.lacking;
        break;
    }
  }

  /// The report's times alone say what the answer must be.
  void compare_stale(const RecordedReport& report) {
    const wire::ContactReport& recorded = report.message;
    const std::uint64_t found = digest(nothing_known());
    found_.digest = mix(found_.digest ^ found);
    if (found == recorded.answer_digest &&
        recorded.status == static_cast<std::uint8_t>(AnswerStatus::kUncertain)) {
      ++found_.verified;
      return;
    }
    differ({.message = report.id,
            .recorded = recorded,
            .what = why_stale(recorded) + "; and yet recorded " +
                    to_string(static_cast<AnswerStatus>(recorded.status)) + ", digest " +
                    to_hex(recorded.answer_digest)});
  }

  /// It must claim nothing.
  void compare_put_off(const RecordedReport& report) {
    const wire::ContactReport& recorded = report.message;
    if (recorded.answer_digest == digest(nothing_known()) && recorded.pair_count == 0 &&
        recorded.status == static_cast<std::uint8_t>(AnswerStatus::kUncertain)) {
      ++found_.put_off;
      return;
    }
    differ({.message = report.id,
            .recorded = recorded,
            .what = std::string("not asked within the budget; and yet recorded ") +
                    to_string(static_cast<AnswerStatus>(recorded.status))});
  }

  void compare(const RecordedReport& report) {
    const wire::ContactReport& recorded = report.message;
    for (const auto& [asked, body] :
         {std::pair(&recorded.a, &recorded.body_a), std::pair(&recorded.b, &recorded.body_b)}) {
      const std::uint32_t taken_in = taken_batches(*asked);
      const std::uint64_t state = replica(*asked).mesh().state_hash();
      if (taken_in == asked->applied_batches && state == asked->state_digest) continue;
      std::string what = "model of " + *body + " after " + std::to_string(asked->applied_batches) +
                         " batches: recorded state " + to_hex(asked->state_digest) + ", found ";
      what += taken_in == asked->applied_batches
                  ? to_hex(state)
                  : std::to_string(taken_in) + " batches taken in before";
      differ({.message = report.id, .recorded = recorded, .state = true, .what = what});
      return;
    }
    if (recorded.cut) {
      compare_cut(report);
      return;
    }
    const Result<Answered> asked = ask(recorded);
    if (!asked.is_ok()) {
      differ({.message = report.id, .recorded = recorded, .what = asked.status().message()});
      return;
    }
    const Answer& answer = asked.value().answer;
    const std::uint64_t found = digest(answer);
    found_.digest = mix(found_.digest ^ found);
    if (found == recorded.answer_digest) {
      if (is_bound_proved(recorded, answer)) {
        ++found_.verified;
      } else {
        differ({.message = report.id,
                .recorded = recorded,
                .what = "recorded clearance " + std::to_string(recorded.clearance_m) +
                        " m; what the peer held proves less"});
      }
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

  /// What was found depends on the peer's options, and, where its tests were spent, on its processor: so what it lists is looked at
  /// pair by pair, and not searched for.
  void compare_cut(const RecordedReport& report) {
    const wire::ContactReport& recorded = report.message;
    const std::string what = why_unproved(recorded);
    found_.digest = mix(found_.digest ^ recorded.pair_count);
    if (what.empty()) {
      ++found_.verified;
      ++found_.cut;
    } else {
      differ({.message = report.id, .recorded = recorded, .what = what});
    }
  }

  /// Of an answer that was cut; empty where all that it says is so.
  [[nodiscard]] std::string why_unproved(const wire::ContactReport& recorded) const {
    const auto status = static_cast<AnswerStatus>(recorded.status);
    const std::string said = std::string("recorded ") + to_string(status) + ", cut";
    if (status != AnswerStatus::kContact && status != AnswerStatus::kPartial &&
        status != AnswerStatus::kUncertain)
      return said;
    if (status == AnswerStatus::kUncertain && recorded.pair_count > 0)
      return said + ", with pairs of faces";
    const Replica &a = replica(recorded.a), &b = replica(recorded.b);
    const Result<PosedPair> posed = pose_pair(a.header().grid, recorded.a.pose, recorded.body_a,
                                              b.header().grid, recorded.b.pose, recorded.body_b);
    if (!posed.is_ok()) return posed.status().message();
    for (const auto& [face_a, face_b] : recorded.pairs)
      if (!faces_touch(a.mesh(), posed.value().a, face_a, b.mesh(), posed.value().b, face_b))
        return said + "; faces that it lists do not touch, or are not held";
    if (status != AnswerStatus::kContact || (recorded.pair_count == 1 && !recorded.pairs.empty()))
      return {};
    // It says how many there are, or that there is one at all.
    const Answer all =
        query(a.view(), posed.value().a, b.view(), posed.value().b,
              {.any = recorded.pair_count == 1, .clearance = Clearance::kNone, .max_pairs = 0});
    if (all.status == AnswerStatus::kContact && all.pair_total == recorded.pair_count) return {};
    return said + ", " + std::to_string(recorded.pair_count) + " pairs; found " +
           to_string(all.status) + ", " + std::to_string(all.pair_total) + " pairs";
  }

  /// A clearance is a bound: less than what can be proved is true, too. The peer may have sought longer than is the default.
  bool is_bound_proved(const wire::ContactReport& recorded, const Answer& answer) const {
    if (recorded.clearance_m <= answer.clearance_m) return true;
    const Result<Answered> sought = ask(recorded, {.clearance = Clearance::kExact});
    return sought.is_ok() && recorded.clearance_m <= sought.value().answer.clearance_m;
  }

  void differ(Difference difference) {
    ++found_.different;
    found_.digest = mix(found_.digest ^ static_cast<std::uint64_t>(difference.message));
    if (found_.differences.size() < kMaxDifferences)
      found_.differences.push_back(std::move(difference));
  }

  VerifyReport found_;
};

}  // namespace

namespace {

/// What was said and is not in the recording, by its gaps.
void count_missing(const RecordingReader& recording, VerifyReport& sum) {
  const std::string type(wire::topic_of<wire::ContactReport>().type);
  for (const RecordingGap& gap : recording.gaps())
    if (recording.topics()[recording.writers()[gap.writer].topic].type == type)
      (gap.first_sequence == 1 ? sum.before : sum.missing) += gap.count;
}

}  // namespace

Result<VerifyReport> verify(RecordingReader& recording, const VerifyPlan& plan) {
  const Result<Played> played = play(
      recording, {.threads = plan.threads,
                  .make_peer = [](const std::string&) { return std::make_unique<CheckedPeer>(); },
                  .models = plan.models});
  NEARMESH_RETURN_IF_ERROR(played);
  VerifyReport sum{.reports = played.value().reports, .malformed = played.value().malformed};
  sum.peers = played.value().peers.size();
  count_missing(recording, sum);
  for (const auto& [content, name] : played.value().worlds)
    sum.complaints.push_back("world " + name + " (content " + to_hex(content) +
                             "): answers about it are not reported, so none of them is proved, but "
                             "for what bounds prove");
  for (const auto& [partition, peer] : played.value().peers) {
    const VerifyReport& found = static_cast<const CheckedPeer&>(*peer).found();
    sum.verified += found.verified;
    sum.different += found.different;
    sum.not_asked += found.not_asked;
    sum.put_off += found.put_off;
    sum.cut += found.cut;
    sum.lacking += found.lacking;
    sum.gave_up += found.gave_up;
    sum.batches += peer->batches();
    for (const auto& [content_hash, wanted] : peer->wanted()) {
      sum.wanted[content_hash].name = wanted.name;
      sum.wanted[content_hash].reports += wanted.reports;
    }
    sum.complaints.insert(sum.complaints.end(), peer->complaints().begin(),
                          peer->complaints().end());
    sum.digest = mix(sum.digest ^ found.digest);
    sum.differences.insert(sum.differences.end(), found.differences.begin(),
                           found.differences.end());
  }
  Result<BoundsProof> bounds = prove_bounds(recording);
  NEARMESH_RETURN_IF_ERROR(bounds);
  sum.bounds = std::move(bounds).value();
  if (sum.bounds.reports > 0) sum.digest = mix(sum.digest ^ sum.bounds.digest);
  std::sort(sum.differences.begin(), sum.differences.end(),
            [](const Difference& a, const Difference& b) { return a.message < b.message; });
  return sum;
}

}  // namespace nearmesh::subscriber
