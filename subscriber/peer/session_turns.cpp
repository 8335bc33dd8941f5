// SPDX-License-Identifier: Apache-2.0
// Which pairs an update asks within its budget, and what is said of the others.
//
// A pair is due at an update: one that touches, or is not certified, at that which asked it last;
// one that is free when it may touch by what was said of it, but kMostFreeTurns later at most; a
// new one kNewTurns before it came. Who is due first is asked first. One that takes so much longer
// than expected that time is over is cut short: it is put off, stays due as it was, and is asked to
// its end where it comes first. Where batches leave no time none is asked; the next update then
// asks the first to its end, whatever that takes. So does an update whose whole budget is less than
// that. So one of two updates asks a pair, and none starves: of n pairs each is asked again after
// kMostFreeTurns + 2 n updates at the latest, since whoever was asked after a pair was due is due
// after it.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include "core/base/hash.hpp"
#include "pair_readiness.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr double kMostFreeTurns = 16, kNewTurns = 8;

/// The same as long as nothing of what is held has changed.
std::uint64_t changes_of(const Replica& replica) {
  return mix(replica.mesh().state_hash() ^ mix(replica.taken_batches()));
}

/// What was answered, for when it need not be asked again.
Answered whole_of(const PairAnswer& result) {
  Answered whole{.answer = result.answer,
                 .contacts = result.contacts,
                 .depth = result.depth,
                 .safe_horizon_s = result.safe_horizon_s};
  whole.answer.stats = {};
  if (result.swept) whole.swept = *result.swept;
  return whole;
}

}  // namespace

/// What the last certified answer of a pair says of the frame's poses. Precondition: there is one;
/// both bodies are ready.
LastCertified Session::Impl::last_certified_of(const Pair& pair, ClearanceLeft& left) const {
  const Pair::Certified& then = *pair.certified;
  left = {};
  LastCertified last = then.said;
  last.age_s = time_s - then.time_s;
  last.clearance_m = 0;
  if (last.pair_total > 0 || then.content_a != pair.a->model->content_hash ||
      then.content_b != pair.b->model->content_hash)
    return last;
  const auto moved = [this](const Body& body, const Pose& pose) {
    return MovedBody{body.reach, pose, body.motion->pose, wire::age_s(stamp_of(body), time_s)};
  };
  left = clearance_left(moved(*pair.a, then.kept.pose_a), moved(*pair.b, then.kept.pose_b),
                        lattice_exponent(pair.a->grid(), pair.b->grid()), then.said.clearance_m);
  last.clearance_m = left.clearance_m;
  last.safe_s = left.safe_s;
  return last;
}

/// Whether what is held has not changed since the last certified answer: then what it was follows
/// from poses and motions alone. Precondition: there is one; both bodies are ready.
bool Session::Impl::is_as_then(const Pair& pair) const {
  const Pair::Certified& then = *pair.certified;
  return then.content_a == pair.a->model->content_hash &&
         then.content_b == pair.b->model->content_hash &&
         then.changes_a == changes_of(*pair.a->model->replica) &&
         then.changes_b == changes_of(*pair.b->model->replica);
}

/// The answer where how little both have moved since the last one makes it certain. Precondition:
/// is_as_then().
std::optional<Answered> Session::Impl::still_free_of(const Pair& pair) const {
  const Pair::Certified& then = *pair.certified;
  if (then.now.clearance_m == 0 || pair.a->solid || pair.b->solid) return std::nullopt;
  return still_free(asked_body_of(*pair.a), asked_body_of(*pair.b), then.kept, then.left,
                    answer_options_of(pair));
}

/// Pair::known(): what every peer answers that holds the same. Of bodies that lie where they lay it
/// is what it was, contacts, depth and all. Precondition: there is a certified answer; both bodies
/// are ready.
void Session::Impl::find_known(Pair& pair) const {
  if (!is_as_then(pair)) return;
  const Pair::Certified& then = *pair.certified;
  const auto lies = [](const Body& body, const Pose& pose) {
    return is_at_rest(*body.motion) && body.motion->pose == pose;
  };
  pair.lies = then.at_rest && lies(*pair.a, then.kept.pose_a) && lies(*pair.b, then.kept.pose_b);
  if (!pair.lies) pair.still = still_free_of(pair);
}

/// By update; see above.
double Session::Impl::due_of(const Pair& pair) const {
  const Pair::Turn& turn = pair.turn;
  if (turn.asked_in == 0) return static_cast<double>(turn.came_in) - kNewTurns;
  const auto asked_in = static_cast<double>(turn.asked_in);
  if (!pair.certified || pair.certified->asked_in != turn.asked_in) return asked_in;
  const double safe_s = pair.certified->now.safe_s;
  if (safe_s <= 0) return asked_in;
  const double turns = frame_s > 0 ? safe_s / frame_s : kMostFreeTurns;
  return std::min(static_cast<double>(updates) + turns, asked_in + kMostFreeTurns);
}

/// What is known of each pair before any is asked: whether it can be, and what is left of what was
/// said of it.
void Session::Impl::look_at_pairs() {
  for (Pair* pair : listed) {
    for (Body* body : {pair->a, pair->b}) {
      if (std::exchange(body->looked_at_in, updates) == updates) continue;
      body->is_ready = why_not_ready(*body).empty();
      if (body->is_ready) body->reach = reach_of(body->view(), *body->motion);
    }
    if (pair->turn.came_in == 0) pair->turn.came_in = updates;
    pair->is_ready = pair->a->is_ready && pair->b->is_ready;
    pair->lies = false;
    pair->still.reset();
    if (!pair->is_ready || !pair->certified) continue;
    pair->certified->now = last_certified_of(*pair, pair->certified->left);
    find_known(*pair);
  }
}

/// Places in `listed`: those who are due first, where all will not be asked; else as they stand.
std::vector<std::uint32_t> Session::Impl::take_turns(double left_s) const {
  std::vector<std::uint32_t> turns(listed.size());
  double expected_s = 0;
  bool is_any_cut_short = false;
  for (std::uint32_t i = 0; i < turns.size(); ++i) {
    turns[i] = i;
    expected_s += cost_of(*listed[i]);
    is_any_cut_short |= listed[i]->turn.is_cut_short;
  }
  if (2 * expected_s < left_s && !is_any_cut_short) return turns;
  std::vector<double> due(turns.size());
  for (std::uint32_t i = 0; i < turns.size(); ++i) due[i] = due_of(*listed[i]);
  std::sort(turns.begin(), turns.end(), [&](std::uint32_t i, std::uint32_t j) {
    return due[i] != due[j] ? due[i] < due[j] : i < j;
  });
  return turns;
}

/// What asking a pair will take, as far as is known: what it took then, or, since that may be long
/// ago, what pairs take.
double Session::Impl::cost_of(const Pair& pair) const {
  if (pair.known() != nullptr) return 0;
  return std::max(pair.turn.cost_s, pair_cost.seconds());
}

/// What is set aside for that which follows the answers: what it takes of late, and what has waited
/// so long that it takes its turn in any case.
double Session::Impl::ending_s(const FrameBudget& budget) const {
  const double look_s = updates - looked_ahead_in >= kPatientLooks ? look_cost.seconds() : 0;
  return std::min(rest_cost.seconds() + channel->needs_s() + look_s, budget.seconds() / 2) +
         margin_of(budget);
}

void Session::Impl::answer_pairs(std::uint64_t frame, const FrameBudget& budget,
                                 FrameReport& report) {
  look_at_pairs();
  const double end_s = ending_s(budget), most_s = budget.seconds() - end_s;
  const std::vector<std::uint32_t> turns = take_turns(budget.left_s() - end_s);
  report.answers.resize(listed.size());  // asked in place: they are large
  std::vector<AskedPair> asked(listed.size());
  std::atomic<std::size_t> next{0};
  std::atomic<bool> is_any_asked{false}, is_too_late{false};
  const IsOver is_over = [&] { return budget.left_s() < end_s; };
  asked_by_s = budget.spent_s();
  // Whichever job comes first takes the first turn, in whatever order the host runs them.
  run_jobs(turns.size(), [&](std::size_t) {
    const std::uint32_t place = turns[next++];
    const Pair& pair = *listed[place];
    const auto take_turn = [&] {
      if (is_too_late) return Turn::kPutOff;  // none is expected to take less
      const double left_s = budget.left_s() - end_s, cost_s = cost_of(pair);
      const bool is_first = !is_any_asked.exchange(true);
      const bool waits_in_vain = pair.turn.is_cut_short || asked_none || most_s <= cost_s;
      if (is_first && waits_in_vain) return Turn::kWhole;
      if (left_s >= cost_s || (is_first && left_s > 0)) return Turn::kTimed;
      is_too_late = left_s < pair_cost.seconds();
      return Turn::kPutOff;
    };
    ask_pair(pair, report.answers[place], asked[place], take_turn, is_over);
    if (asked[place].query_s > 0) asked[place].ended_s = budget.spent_s();
  });
  asked_none = is_any_asked;
  for (const AskedPair& pair : asked) {
    asked_by_s = std::max(asked_by_s, pair.ended_s);
    if (pair.query_s > 0 && !pair.is_cut_short) asked_none = false;
  }
  for (std::size_t i = 0; i < asked.size(); ++i)
    settle_pair(*listed[i], report.answers[i], asked[i], frame, report);
}

/// Its turn did not come.
void Session::Impl::put_off(const Pair& pair, PairAnswer& result) const {
  result.put_off = true;
  result.reason = kOutOfBudget;
  if (pair.certified) result.last_certified = pair.certified->now;
}

void Session::Impl::note_turn(Pair& pair, const PairAnswer& result, const AskedPair& asked) {
  pair.is_put_off = result.put_off;
  if (asked.query_s > 0) pair.turn.is_cut_short = asked.is_cut_short;
  if (asked.is_cut_short) pair.turn.cost_s = std::max(pair.turn.cost_s, 2 * asked.query_s);
  if (!result.asked) return;
  pair.turn.asked_in = updates;
  pair.turn.cost_s = asked.query_s;
  pair_cost.add(asked.query_s);
  if (!is_certified(result.answer.status)) return;
  pair.certified = {.said = {.status = result.answer.status,
                             .contained = result.answer.contained,
                             .pair_total = result.answer.pair_total,
                             .clearance_m = result.answer.clearance_m},
                    .asked_in = updates,
                    .time_s = time_s,
                    .kept = {.clearance_m = result.answer.clearance_m,
                             .clearance_share = result.answer.clearance_share,
                             .clearance_by_larger_m = result.answer.clearance_by_larger_m,
                             .distance_at_most_m = result.answer.distance_at_most_m,
                             .nearest_a_m = result.answer.nearest_a_m,
                             .nearest_b_m = result.answer.nearest_b_m,
                             .pose_a = result.pose_a,
                             .pose_b = result.pose_b},
                    .content_a = result.content_a,
                    .content_b = result.content_b,
                    .changes_a = changes_of(*pair.a->model->replica),
                    .changes_b = changes_of(*pair.b->model->replica)};
  if (is_at_rest(*pair.a->motion) && is_at_rest(*pair.b->motion) && asked.complaints.empty())
    pair.certified->at_rest = {whole_of(result), std::nullopt};
}

/// Of many pairs of faces it takes as long as all else that lying bodies do.
std::uint64_t Session::Impl::digest_of(Pair& pair, const PairAnswer& result) {
  if (!pair.lies) return digest(result.answer);
  std::optional<std::uint64_t>& kept = pair.certified->at_rest->digest;
  if (!kept) kept = digest(result.answer);
  return *kept;
}

/// It was answered without being asked: certified now, by what was said of the poses of then.
void Session::Impl::note_known(Pair& pair) {
  pair.is_put_off = false;
  pair.turn.asked_in = updates;
  pair.turn.is_cut_short = false;
  pair.certified->asked_in = updates;
  pair.certified->time_s = time_s;
}

}  // namespace nearmesh::subscriber
