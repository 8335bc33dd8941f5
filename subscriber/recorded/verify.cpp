// SPDX-License-Identifier: Apache-2.0
#include "verify.hpp"

#include <algorithm>

#include "core/base/hash.hpp"
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
  for (const auto& [partition, peer] : played.value().peers) {
    const VerifyReport& found = static_cast<const CheckedPeer&>(*peer).found();
    sum.verified += found.verified;
    sum.different += found.different;
    sum.not_asked += found.not_asked;
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
  std::sort(sum.differences.begin(), sum.differences.end(),
            [](const Difference& a, const Difference& b) { return a.message < b.message; });
  return sum;
}

}  // namespace nearmesh::subscriber
