// SPDX-License-Identifier: Apache-2.0
#include "verify.hpp"

#include <algorithm>
#include <limits>

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
        expect_nothing(report, found_.not_asked, "nothing was asked");
        break;
      case Standing::kPutOff:
        expect_nothing(report, found_.put_off, "not asked within the budget");
        break;
      case Standing::kStale:
        found_.digest = mix(found_.digest ^ digest(nothing_known()));
        expect_nothing(report, found_.verified, why_stale(report.message));
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

  /// Where nothing could be known, which the report itself says, nothing may be claimed. `counted`:
  /// what it counts as then.
  void expect_nothing(const RecordedReport& report, std::uint64_t& counted,
                      const std::string& why) {
    const wire::ContactReport& recorded = report.message;
    if (claims_nothing(recorded)) {
      ++counted;
      return;
    }
    differ({.message = report.id,
            .recorded = recorded,
            .what = why + "; and yet recorded " + said_by(recorded)});
  }

  static std::string say(AnswerStatus status, std::uint64_t pairs, std::uint64_t digest) {
    return std::string(to_string(status)) + ", " + std::to_string(pairs) + " pairs, digest " +
           to_hex(digest);
  }
  static std::string say_bound(double uncertainty_m) {
    return uncertainty_m < std::numeric_limits<double>::max()
               ? "uncertain within " + std::to_string(uncertainty_m) + " m"
               : "without a bound";
  }
  static std::string said_by(const wire::ContactReport& recorded) {
    return say(static_cast<AnswerStatus>(recorded.status), recorded.pair_count,
               recorded.answer_digest) +
           ", clearance " + std::to_string(recorded.clearance_m) + " m, " +
           say_bound(recorded.uncertainty_m);
  }

  void compare(const RecordedReport& report) {
    const wire::ContactReport& recorded = report.message;
    if (const std::string why = why_not_rebuilt(recorded); !why.empty()) {
      differ({.message = report.id, .recorded = recorded, .state = true, .what = why});
      return;
    }
    if (recorded.cut) {
      compare_cut(report);
      return;
    }
    const Result<Again> again = ask_again(recorded);
    if (!again.is_ok()) {
      differ({.message = report.id, .recorded = recorded, .what = again.status().message()});
      return;
    }
    const Answer& answer = again.value().answer;
    const std::uint64_t found = again.value().digest;
    found_.digest = mix(found_.digest ^ found);
    if (is_said(recorded, again.value())) {
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

  /// What was found depends on the peer's options, and, where its tests were spent, on its
  /// processor: so what it lists is looked at pair by pair, and not searched for. What else it says
  /// is counted again, as far as it follows whatever the options were.
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

  /// What was asked, body against body or tile by tile.
  struct Part {
    const Replica *a = nullptr, *b = nullptr;
    AskedBody asked_a, asked_b;
    PosedPair posed;
  };
  /// None of a world's near tiles is left out.
  static bool knows_all_tiles(const wire::ContactReport& recorded, const std::vector<Part>& parts) {
    return !recorded.world ||
           (recorded.world->missing_pages.empty() && parts.size() == recorded.world->tiles.size());
  }

  /// Of an answer that was cut; empty where all that it says is so.
  [[nodiscard]] std::string why_unproved(const wire::ContactReport& recorded) const {
    const auto status = static_cast<AnswerStatus>(recorded.status);
    const std::string said = std::string("recorded ") + to_string(status) + ", cut";
    const bool touches = status == AnswerStatus::kContact || status == AnswerStatus::kPartial;
    if (!touches && status != AnswerStatus::kUncertain) return said;
    if (touches != (recorded.pair_count > 0))
      return said + (touches ? ", without pairs of faces" : ", with pairs of faces");
    // Of what touches, or may, there is none; and of what is certain nothing is unseen.
    if (recorded.clearance_m != 0)
      return said + ", with a clearance of " + std::to_string(recorded.clearance_m) + " m";
    if (status == AnswerStatus::kContact && recorded.uncertainty_m != 0)
      return said + ", " + say_bound(recorded.uncertainty_m);
    const Result<std::vector<Part>> found = parts_of(recorded);
    if (!found.is_ok()) return found.status().message();
    const std::vector<Part>& parts = found.value();
    const auto is_so = [&](const std::array<FaceKey, 2>& faces) {
      return std::any_of(parts.begin(), parts.end(), [&](const Part& part) {
        return faces_touch(part.a->mesh(), part.posed.a, faces[0], part.b->mesh(), part.posed.b,
                           faces[1]);
      });
    };
    if (!std::all_of(recorded.pairs.begin(), recorded.pairs.end(), is_so))
      return said + "; faces that it lists do not touch, or are not held";
    const bool is_all = knows_all_tiles(recorded, parts);
    return status == AnswerStatus::kContact ? why_not_contact(recorded, parts, is_all, said)
                                            : why_not_open(recorded, parts, is_all, said);
  }

  /// It says that they touch at all, each tile of a world apart; or how many there are.
  [[nodiscard]] static std::string why_not_contact(const wire::ContactReport& recorded,
                                                   const std::vector<Part>& parts, bool is_all,
                                                   const std::string& said) {
    std::uint64_t touching = 0, total = 0;
    for (const Part& part : parts) {
      const auto ask = [&part](bool any) {
        return query(part.asked_a.view, part.posed.a, part.asked_b.view, part.posed.b,
                     {.any = any, .clearance = Clearance::kNone, .max_pairs = 0});
      };
      touching += ask(true).pair_total > 0 ? 1 : 0;
      if (recorded.pair_count == 1) continue;
      const Answer all = ask(false);
      is_all &= is_certified(all.status);
      total += all.pair_total;
    }
    if (touching == recorded.pair_count || (is_all && total == recorded.pair_count)) return {};
    return said + ", " + std::to_string(recorded.pair_count) + " pairs; found " +
           std::to_string(total) + (is_all ? "" : ", which may not be all");
  }

  /// Of one that leaves something open. Where it has a bound, its tests did not end the search: it
  /// is made again, to its end, and gives the same. Without pairs it was one for any pair, since no
  /// other option cuts such an answer. Where it has no bound, what was found is some of what there
  /// is. That is counted as far as kCutTests go, or it might cost more than the peer could spend.
  [[nodiscard]] static std::string why_not_open(const wire::ContactReport& recorded,
                                                const std::vector<Part>& parts, bool is_all,
                                                const std::string& said) {
    const bool has_bound = recorded.uncertainty_m < std::numeric_limits<double>::max();
    if (!has_bound && recorded.pair_count == 0) return {};
    if (has_bound && !is_all)
      return said + ", " + say_bound(recorded.uncertainty_m) +
             ", though pages or tiles were missing";
    std::uint64_t total = 0;
    double uncertainty_m = 0;
    bool is_open = false;
    for (const Part& part : parts) {
      const Result<Answered> asked = answer(part.asked_a, part.asked_b,
                                            {.clearance = Clearance::kNone,
                                             .any = recorded.pair_count == 0,
                                             .max_pairs = 0,
                                             .max_tests = has_bound ? kAllTests : kCutTests});
      if (!asked.is_ok()) return asked.status().message();
      const Answer& found = asked.value().answer;
      total += found.pair_total;
      if (!has_bound && (found.exhausted || recorded.pair_count <= total)) return {};
      uncertainty_m = std::max(uncertainty_m, found.uncertainty_m);
      is_open |= !is_certified(found.status);
    }
    if (has_bound && is_open && recorded.uncertainty_m == uncertainty_m &&
        recorded.pair_count == static_cast<std::uint32_t>(total))
      return {};
    return said + ", " + std::to_string(recorded.pair_count) + " pairs, " +
           say_bound(recorded.uncertainty_m) + "; found " + std::to_string(total) + ", " +
           say_bound(uncertainty_m);
  }

  [[nodiscard]] Result<std::vector<Part>> parts_of(const wire::ContactReport& recorded) const {
    std::vector<Part> parts;
    const auto asked_body = [](const TreeView& view, const wire::ContactReport::Asked& body,
                               const std::string& name) {
      return AskedBody{view, Motion{.pose = body.pose}, name, body.solid};
    };
    const auto add = [&](const Replica& a, const TreeView& view_a, const Replica& b,
                         const TreeView& view_b) {
      Result<PosedPair> posed = pose_pair(*view_a.grid, recorded.a.pose, recorded.body_a,
                                          *view_b.grid, recorded.b.pose, recorded.body_b);
      NEARMESH_RETURN_IF_ERROR(posed);
      Part& part = parts.emplace_back(Part{&a, &b, asked_body(view_a, recorded.a, recorded.body_a),
                                           asked_body(view_b, recorded.b, recorded.body_b),
                                           std::move(posed).value()});
      // Nobody asks what is inside a tile.
      if (recorded.world) (recorded.world->is_a ? part.asked_a : part.asked_b).solid = false;
      return Status::ok();
    };
    if (!recorded.world) {
      const Replica &a = replica(recorded.a.content_hash), &b = replica(recorded.b.content_hash);
      NEARMESH_RETURN_IF_ERROR(add(a, a.view(), b, b.view()));
      return parts;
    }
    const bool is_a = recorded.world->is_a;
    const Replica& other = replica((is_a ? recorded.b : recorded.a).content_hash);
    for (const AskedTile& tile : asked_world().tiles) {
      if (!tile.asked) continue;
      const Replica& its = replica(tile.entry->content);
      NEARMESH_RETURN_IF_ERROR(is_a ? add(its, tile.view(its), other, other.view())
                                    : add(other, other.view(), its, tile.view(its)));
    }
    return parts;
  }

  /// What the peer's session says, and the digest of all of it.
  struct Again {
    Answer answer;
    std::uint64_t digest = 0;
  };
  [[nodiscard]] Result<Again> ask_again(const wire::ContactReport& recorded,
                                        const AnswerOptions& options = {}) const {
    if (!recorded.world) {
      Result<Answered> asked = ask(recorded, options);
      NEARMESH_RETURN_IF_ERROR(asked);
      const std::uint64_t found = digest(asked.value().answer);
      return Again{std::move(asked.value().answer), found};
    }
    const AskedWorld& world = asked_world();
    const bool is_a = recorded.world->is_a;
    TileSum sum({.world_is_a = is_a, .clearance = options.clearance},
                (is_a ? recorded.a : recorded.b).content_hash, world.around);
    for (const AskedTile& tile : world.tiles) {
      if (!tile.asked) {
        sum.add_unknown(*tile.entry);
        continue;
      }
      const Result<Answered> asked = ask_tile(recorded, tile, options);
      NEARMESH_RETURN_IF_ERROR(asked);
      sum.add(*tile.entry, asked.value().answer);
    }
    Answer answer = sum.finish();
    return Again{std::move(answer), sum.digest()};
  }

  /// All that the report says of an answer, but for its bound.
  static bool is_said(const wire::ContactReport& recorded, const Again& again) {
    const Answer& answer = again.answer;
    const std::size_t listed = std::min(answer.pairs.size(), wire::kMaxReportPairs);
    if (again.digest != recorded.answer_digest ||
        recorded.status != static_cast<std::uint8_t>(answer.status) ||
        recorded.pair_count != static_cast<std::uint32_t>(answer.pair_total) ||
        recorded.uncertainty_m !=
            std::min(answer.uncertainty_m, std::numeric_limits<double>::max()))
      return false;
    return std::equal(recorded.pairs.begin(), recorded.pairs.end(), answer.pairs.begin(),
                      answer.pairs.begin() + static_cast<std::ptrdiff_t>(listed),
                      [](const std::array<FaceKey, 2>& one, const FacePair& two) {
                        return one[0] == two.a && one[1] == two.b;
                      });
  }

  /// A clearance is a bound: less than what can be proved is true, too. The peer may have sought
  /// longer than is the default.
  bool is_bound_proved(const wire::ContactReport& recorded, const Answer& answer) const {
    if (recorded.clearance_m <= answer.clearance_m) return true;
    const Result<Again> sought = ask_again(recorded, {.clearance = Clearance::kExact});
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
    sum.put_off += found.put_off;
    sum.cut += found.cut;
    sum.lacking += found.lacking;
    sum.gave_up += found.gave_up;
    sum.batches += peer->batches();
    for (const auto& [content_hash, wanted] : peer->wanted()) {
      if (wanted.reports == 0) continue;  // a tile's: its world is wanted
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
