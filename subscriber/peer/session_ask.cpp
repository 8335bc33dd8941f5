// SPDX-License-Identifier: Apache-2.0
// What a session asks of publishers: of whom, for which parts, how soon again.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/counted.hpp"
#include "core/demand/collect.hpp"
#include "publisher_choice.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr double kMaxPatience_s = 8;

}  // namespace

void Session::Impl::sort_listed() {
  listed_of.clear();
  for (std::uint32_t i = 0; i < listed.size(); ++i) {
    const PeerModel *a = listed[i]->a->model, *b = listed[i]->b->model;
    listed_of[a].push_back(i);
    if (b != a) listed_of[b].push_back(i);
  }
}

/// In `listed`, ascending: the pairs with a body of that model.
std::span<const std::uint32_t> Session::Impl::places_of(const PeerModel& model) const {
  const auto at = listed_of.find(&model);
  if (at == listed_of.end()) return {};
  return at->second;
}

// Where, in a model's grid, all bodies are that a body of that model is watched against; of what is
// not certified, the rays instead where only the inside of a solid is undecided.
RegionMaker Session::Impl::region_of(const PeerModel& model, double lookahead_s,
                                     const FrameReport& report, Scope scope) {
  std::vector<RegionPart> rays;
  std::vector<std::pair<const Body*, const Body*>> against;
  for (const std::uint32_t i : places_of(model)) {
    const Pair& pair = *listed[i];
    const PairAnswer& answer = report.answers[i];
    if (!answer.reason.empty() && !answer.put_off) continue;
    if (scope != Scope::kAll && !pair.by_region) continue;
    if (scope == Scope::kUncertified && (answer.put_off || is_certified(answer.answer.status)))
      continue;
    // What nothing meets until then is certified until then, by what is held.
    if (scope == Scope::kByRegion && stays_certified(answer, lookahead_s)) continue;
    const Answer& undecided = answer.answer;
    if (scope == Scope::kUncertified && !(undecided.rays_a.empty() && undecided.rays_b.empty())) {
      // The surfaces are apart: only the rays wait for detail.
      if (pair.a->model == &model)
        rays.insert(rays.end(), undecided.rays_a.begin(), undecided.rays_a.end());
      if (pair.b->model == &model)
        rays.insert(rays.end(), undecided.rays_b.begin(), undecided.rays_b.end());
      continue;
    }
    if (pair.a->model == &model) against.emplace_back(pair.a, pair.b);
    if (pair.b->model == &model) against.emplace_back(pair.b, pair.a);
  }
  rays.resize(std::min(rays.size(), kMaxRegionBoxes / 2));
  if (rays.empty() && against.empty()) return nullptr;
  return [this, lookahead_s, rays, against](std::size_t max_parts, std::span<const GridBox> near) {
    std::vector<RegionPart> region = rays;
    for (const auto& [own, other] : against) {
      const std::size_t each = std::max<std::size_t>(
          1, std::min(max_parts, (kMaxRegionBoxes - rays.size()) / against.size()));
      ++stats.looks_ahead;
      const auto parts = swept_region(own->view(), *own->motion, other->view(), *other->motion,
                                      lookahead_s, options.margin_m, each, near);
      region.insert(region.end(), parts.begin(), parts.end());
    }
    return merge_by_place(std::move(region), kMaxRegionBoxes);
  };
}

// Of a free answer: its bound counts unresolved nodes as the answers of that time will.
bool Session::Impl::stays_certified(const PairAnswer& answer, double lookahead_s) const {
  return answer.asked && options.margin_m == 0 && is_certified(answer.answer.status) &&
         answer.answer.pair_total == 0 && answer.safe_horizon_s >= lookahead_s;
}

// What is not given up: somewhat more than will be asked for, or it would come and go.
std::vector<RegionPart> Session::Impl::kept_of(const PeerModel& model, const FrameReport& report) {
  const RegionMaker region = region_of(model, horizon_s(), report, Scope::kAll);
  std::vector<RegionPart> kept;
  if (region != nullptr) kept = region(kCoarseParts, root_reach(model.replica->store()));
  if (clock.seconds() < model.probed.kept_until_s)
    kept.insert(kept.end(), model.probed.kept.begin(), model.probed.kept.end());
  for (RegionPart& part : kept) {
    const std::int32_t radius = part.radius;
    part = reach_below(part.box);
    part.radius = radius;
  }
  return kept;
}

// Of those that serve it, and did not contradict it, the one that left the fewest requests in a row
// unanswered; among these the one that this peer prefers.
Publisher* Session::Impl::publisher_of(const ContentHash& content, const ContentHash& and_too) {
  Publisher* best = nullptr;
  std::uint64_t best_preference = 0;
  const auto gives = [this](const auto& entry, const ContentHash& wanted) {
    const PeerModel* held = replicas.find(wanted);
    return entry.second.serves(wanted) &&
           (held == nullptr || !held->is_ready() || !held->replica->distrusts(entry.first));
  };
  for (auto& entry : publishers) {
    auto& [id, publisher] = entry;
    if (!gives(entry, content) || (and_too.is_set() && !gives(entry, and_too))) continue;
    const std::uint64_t its = preference(channel->own_id(), id);
    if (best != nullptr &&
        (publisher.lost_requests > best->lost_requests ||
         (publisher.lost_requests == best->lost_requests && its <= best_preference)))
      continue;
    best = &publisher;
    best_preference = its;
  }
  return best;
}

// Whether one that is there has contradicted a model: nobody is left to ask where publisher_of()
// finds none.
bool Session::Impl::is_contradicted(const PeerModel& model) const {
  return model.is_ready() &&
         std::any_of(publishers.begin(), publishers.end(),
                     [&](const auto& entry) { return model.replica->distrusts(entry.first); });
}

// Why detail of a model is not here, and whether it may be expected.
std::string Session::Impl::awaited_of(const PeerModel& model, std::size_t missing) {
  if (missing == 0) return {};
  const std::string what = counted(missing, "node") + " of model " + model.name +
                           (missing == 1 ? " is" : " are") + " missing, ";
  const Publisher* publisher = publisher_of(model.content_hash);
  if (publisher == nullptr)
    return what + (publishers.empty() ? "no publisher is there"
                   : is_contradicted(model)
                       ? "and each publisher that serves it has contradicted it"
                       : "no publisher that is there serves it");
  if (publisher->lost_requests > 0)
    return what + "publisher " + called_of(*publisher) + " has not answered " +
           counted(publisher->lost_requests, "request") + " in a row";
  return what + "publisher " + called_of(*publisher) + " is asked for them";
}

// The nodes of a model that this update's answers lack, or those for the time ahead; ascending.
std::vector<NodeSpan> Session::Impl::missing_of(const PeerModel& model, const FrameReport& report,
                                                bool ahead) const {
  std::vector<NodeSpan> missing;
  const auto add = [&](const PeerModel* lacks, const std::vector<NodeSpan>& nodes) {
    if (lacks == &model) missing.insert(missing.end(), nodes.begin(), nodes.end());
  };
  for (const std::uint32_t i : places_of(model)) {
    const Pair& pair = *listed[i];
    const PairAnswer& answer = report.answers[i];
    if (!pair.by_region) continue;
    if (!ahead) {
      add(pair.a->model, answer.answer.missing_a);
      add(pair.b->model, answer.answer.missing_b);
    } else if (answer.swept) {
      add(pair.a->model, answer.swept->missing_a);
      add(pair.b->model, answer.swept->missing_b);
    }
  }
  std::sort(missing.begin(), missing.end());
  missing.erase(std::unique(missing.begin(), missing.end()), missing.end());
  missing.resize(std::min(missing.size(), kMaxAttachNodes));
  return missing;
}

// Its number is last_request then.
void Session::Impl::send_request(const Publisher& publisher, std::uint8_t priority,
                                 wire::RegionSubscription request) {
  request.peer = channel->own_id();
  request.publisher = publisher.hello.publisher;
  request.request = ++last_request;
  request.priority = priority;
  request.window_bytes = options.window_bytes;
  static_cast<void>(asked_publishers.note(request.publisher));
  const auto note_asked = [&](const ContentHash& content) {
    asked_about.put({content, request.publisher}, {});
  };
  if (request.certificate) {
    for (const auto& model : request.certificate->models) note_asked(model.content);
  } else {
    note_asked(request.content_hash);
  }
  channel->send(request);
}

// `missing`, ascending, is asked for in any case, before other unresolved nodes that meet the
// region.
bool Session::Impl::request(PeerModel& model, const RegionMaker& region,
                            std::vector<NodeSpan> missing, std::uint8_t priority) {
  Publisher* publisher = publisher_of(model.content_hash);
  if (publisher == nullptr) return false;
  if (region == nullptr) return false;
  std::optional<RegionRequest> region_request =
      make_request(model.replica->store(), region, std::move(missing), kRegionParts,
                   priority == kNeededNow ? kRequestSplits : kMaxAheadSplits,
                   priority == kNeededNow ? Portion::kLargestNodes : Portion::kWholeNodes);
  if (!region_request) return false;
  send_request(*publisher, priority,
               {.content_hash = model.content_hash, .region = std::move(*region_request)});
  open_request(model.content_hash, *publisher, {.priority = priority});
  ++stats.requests;
  return true;
}

// Which of the pairs that nobody chooses for lack something soon. After what is needed now was
// asked for.
void Session::Impl::look_ahead_by_region(const FrameBudget& budget, const FrameReport& report) {
  std::vector<Candidate> looks;
  for (std::size_t i = 0; i < listed.size(); ++i) {
    Pair& pair = *listed[i];
    pair.lacks_soon = false;
    const PairAnswer& answer = report.answers[i];
    if (!pair.by_region || answer.put_off || !answer.reason.empty()) continue;
    if (!may_ask_for(*pair.a->model) && !may_ask_for(*pair.b->model)) continue;
    if (need_of(pair, answer) == Need::kLook) looks.push_back({&pair, Need::kLook});
  }
  look_ahead(budget, looks, looked_by_region_in);
  for (const Candidate& look : looks) {
    if (look.need == Need::kNothing) look.pair->looked_ahead_s = time_s;
    look.pair->lacks_soon = look.need == Need::kAhead;
  }
}

// What the swept answers lack, and what else may be met within the horizon: all of it once
// something of it is lacked soon, for fewer and fuller batches than a little in each frame.
void Session::Impl::request_ahead(PeerModel& model, const FrameReport& report) {
  std::vector<NodeSpan> missing = missing_of(model, report, true);
  std::vector<Pair*> lacking;
  for (const std::uint32_t i : places_of(model))
    if (listed[i]->lacks_soon) lacking.push_back(listed[i]);
  if (missing.empty() && lacking.empty()) return;
  const bool is_sent = request(model, region_of(model, horizon_s(), report, Scope::kByRegion),
                               std::move(missing), kHorizon);
  if (is_sent) return;
  for (Pair* pair : lacking)
    pair->looked_ahead_s = time_s;  // nobody is there, or boxes do not nest
}

// One request may stand for several models; it is lost once.
void Session::Impl::count_lost(const Outstanding& lost) {
  if (lost.is_counted) return;
  const std::uint32_t request = lost.request;
  if (const auto asked = publishers.find(lost.publisher); asked != publishers.end())
    ++asked->second.lost_requests;
  for (auto& [content, open] : outstanding) {
    if (open.request != request) continue;
    open.is_counted = true;
    // What it said of us is lost, too.
    if (PeerModel* model = replicas.find(content); model != nullptr)
      model->tells_held |= open.has_told_held;
  }
}

// How long to wait for an answer: doubled with each one in a row that did not come, for it may need
// long.
double Session::Impl::patience_after(std::uint32_t lost_requests) const {
  constexpr std::uint32_t kMostDoublings = 20;
  return std::min(std::ldexp(options.request_timeout_s,
                             static_cast<int>(std::min(lost_requests, kMostDoublings))),
                  std::max(options.request_timeout_s, kMaxPatience_s));
}

// The request that was sent last, in place of what was asked of this content before. Whatever else
// the publisher sends meanwhile says that it lives, not that it has had the time for this: without
// a count of its own a long answer would be begun again and again, of two publishers at each in
// turn.
void Session::Impl::open_request(const ContentHash& content, const Publisher& publisher,
                                 Outstanding open) {
  if (const auto before = outstanding.find(content);
      before != outstanding.end() && is_lost(before->second))
    open.lost_before = before->second.lost_before + 1;
  open.request = last_request;
  open.heard_s = clock.seconds();
  open.patience_s = patience_after(std::max(publisher.lost_requests, open.lost_before));
  open.publisher = publisher.hello.publisher;
  outstanding[content] = open;
}

void Session::Impl::ask(const FrameBudget& budget, FrameReport& report) {
  // What nobody wants any more, and was not answered.
  std::erase_if(outstanding, [this](const auto& entry) {
    return is_lost(entry.second) && replicas.find(entry.first) == nullptr &&
           !wanted_bytes.contains(entry.first);
  });
  ask_for_bytes();
  ask_for_probes();
  ask_certificates(budget, report);
  sort_listed();
  // Models take turns where time is short; one is served in any case.
  auto& models = replicas.all();
  std::vector<PeerModel*> ahead;  // what is ahead may be asked for
  auto at = models.upper_bound(last_served);
  for (std::size_t i = 0; i < models.size(); ++i, ++at) {
    if (at == models.end()) at = models.begin();
    auto& [name, model] = *at;
    if (i > 0 && budget.left_s() < region_cost.seconds()) break;
    last_served = name;
    if (!model.is_ready() || !model.waiting.empty()) continue;
    settle_audit(model, report);
    audit(model);
    // One request at a time and model: the next one names what the answer has left unresolved, so
    // nothing is sent twice. Only what is needed now does not wait for a horizon; the publisher
    // drops what is left of that.
    const auto open = outstanding.find(model.content_hash);
    bool may_prefetch = horizon_s() > 0;
    if (open != outstanding.end()) {
      const bool lost = is_lost(open->second);
      if (!lost && open->second.priority == kNeededNow) continue;
      may_prefetch = may_prefetch && lost;
      if (lost) count_lost(open->second);
    }
    // What an answer lacks is named outright: boxes of nodes need not nest, so the walk may miss a
    // node that the query met.
    const Stopwatch watch;
    const bool is_asked = request(model, region_of(model, 0, report, Scope::kUncertified),
                                  missing_of(model, report, false), kNeededNow);
    region_cost.add(watch.seconds());
    if (!is_asked && may_prefetch) ahead.push_back(&model);
  }
  if (ahead.empty()) return;
  look_ahead_by_region(budget, report);
  for (PeerModel* model : ahead) {
    // What is ahead can wait for some updates.
    if (budget.left_s() < ahead_cost.seconds() && updates - asked_ahead_in < kPatientLooks) return;
    const Stopwatch watch;
    request_ahead(*model, report);
    ahead_cost.add(watch.seconds());
    asked_ahead_in = updates;
  }
}

}  // namespace nearmesh::subscriber
