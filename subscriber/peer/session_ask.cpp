// SPDX-License-Identifier: Apache-2.0
// What a session asks of publishers: of whom, for which parts, how soon again.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/hash.hpp"
#include "core/certificate/certificate.hpp"
#include "core/demand/collect.hpp"
#include "core/query/lacking_ahead.hpp"
#include "core/replica/held_nodes.hpp"
#include "publisher_choice.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr double kMaxPatience_s = 8;

constexpr std::uint8_t kNeededNow = 0;
constexpr std::uint8_t kHorizon = 1;
/// So many answers in a row may bring nothing to a pair before it names what it lacks itself.
constexpr int kMaxFruitless = 2;

/// Of both models of a pair that are ready.
template <class Pair>
std::uint64_t states_of(const Pair& pair) {
  return mix(pair.a->model->replica->mesh().state_hash()) ^
         mix(pair.b->model->replica->mesh().state_hash() + 1);
}

}  // namespace

// Where, in a model's grid, all bodies are that a body of that model is watched against; of what is not certified,
// the rays instead where only the inside of a solid is undecided.
RegionMaker Session::Impl::region_of(const PeerModel& model, double lookahead_s,
                                     const FrameReport& report, Scope scope) {
  std::vector<RegionPart> rays;
  std::vector<std::pair<const Body*, const Body*>> against;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const PairAnswer& answer = report.answers[i];
    if (!answer.reason.empty() || (scope != Scope::kAll && !pairs[i].by_region)) continue;
    if (scope == Scope::kUncertified && is_certified(answer.answer.status)) continue;
    const Answer& undecided = answer.answer;
    if (scope == Scope::kUncertified && !(undecided.rays_a.empty() && undecided.rays_b.empty())) {
      // The surfaces are apart: only the rays wait for detail.
      if (pairs[i].a->model == &model)
        rays.insert(rays.end(), undecided.rays_a.begin(), undecided.rays_a.end());
      if (pairs[i].b->model == &model)
        rays.insert(rays.end(), undecided.rays_b.begin(), undecided.rays_b.end());
      continue;
    }
    if (pairs[i].a->model == &model) against.emplace_back(pairs[i].a, pairs[i].b);
    if (pairs[i].b->model == &model) against.emplace_back(pairs[i].b, pairs[i].a);
  }
  rays.resize(std::min(rays.size(), kMaxRegionBoxes / 2));
  if (rays.empty() && against.empty()) return nullptr;
  return [this, lookahead_s, rays, against](std::size_t max_parts, std::span<const GridBox> near) {
    std::vector<RegionPart> region = rays;
    for (const auto& [own, other] : against) {
      const std::size_t each = std::max<std::size_t>(
          1, std::min(max_parts, (kMaxRegionBoxes - rays.size()) / against.size()));
      ++stats.looks_ahead;
      const auto parts =
          swept_region(own->model->replica->view(), *own->motion, other->model->replica->view(),
                       *other->motion, lookahead_s, options.margin_m, each, near);
      region.insert(region.end(), parts.begin(), parts.end());
    }
    region.resize(std::min(region.size(), kMaxRegionBoxes));
    return region;
  };
}

// What is not given up: somewhat more than will be asked for, or it would come and go.
std::vector<RegionPart> Session::Impl::kept_of(const PeerModel& model, const FrameReport& report) {
  const RegionMaker region = region_of(model, horizon_s(), report, Scope::kAll);
  if (region == nullptr) return {};
  std::vector<RegionPart> kept = region(kCoarseParts, root_reach(model.replica->store()));
  for (RegionPart& part : kept) {
    const std::int32_t radius = part.radius;
    part = reach_below(part.box);
    part.radius = radius;
  }
  return kept;
}

// Of those that serve it, and did not contradict it, the one that left the fewest requests in a row unanswered; among these
// the one that this peer prefers.
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

// Whether one that is there has contradicted a model: nobody is left to ask where publisher_of() finds none.
bool Session::Impl::is_contradicted(const PeerModel& model) const {
  return model.is_ready() &&
         std::any_of(publishers.begin(), publishers.end(),
                     [&](const auto& entry) { return model.replica->distrusts(entry.first); });
}

// Why detail of a model is not here, and whether it may be expected.
std::string Session::Impl::awaited_of(const PeerModel& model, std::size_t missing) {
  if (missing == 0) return {};
  const std::string what =
      std::to_string(missing) + " nodes of model " + model.name + " are missing, ";
  const Publisher* publisher = publisher_of(model.content_hash);
  if (publisher == nullptr)
    return what + (publishers.empty() ? "no publisher is there"
                   : is_contradicted(model)
                       ? "and each publisher that serves it has contradicted it"
                       : "no publisher that is there serves it");
  if (publisher->lost_requests > 0)
    return what + "publisher " + to_hex(publisher->hello.publisher) + " has not answered " +
           std::to_string(publisher->lost_requests) + " requests in a row";
  return what + "publisher " + to_hex(publisher->hello.publisher) + " is asked for them";
}

// The nodes of a model that this update's answers lack, or those for the time ahead; ascending.
std::vector<NodeSpan> Session::Impl::missing_of(const PeerModel& model, const FrameReport& report,
                                                bool ahead) const {
  std::vector<NodeSpan> missing;
  const auto add = [&](const PeerModel* lacks, const std::vector<NodeSpan>& nodes) {
    if (lacks == &model) missing.insert(missing.end(), nodes.begin(), nodes.end());
  };
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const PairAnswer& answer = report.answers[i];
    if (!pairs[i].by_region) continue;
    if (!ahead) {
      add(pairs[i].a->model, answer.answer.missing_a);
      add(pairs[i].b->model, answer.answer.missing_b);
    } else if (answer.swept) {
      add(pairs[i].a->model, answer.swept->missing_a);
      add(pairs[i].b->model, answer.swept->missing_b);
    }
  }
  std::sort(missing.begin(), missing.end());
  missing.erase(std::unique(missing.begin(), missing.end()), missing.end());
  missing.resize(std::min(missing.size(), kMaxAttachNodes));
  return missing;
}

// `missing`, ascending, is asked for in any case, before other unresolved nodes that meet the region.
bool Session::Impl::request(PeerModel& model, const RegionMaker& region,
                            std::vector<NodeSpan> missing, std::uint8_t priority,
                            double patience_s) {
  Publisher* publisher = publisher_of(model.content_hash);
  if (publisher == nullptr) return false;
  if (region == nullptr) return false;
  std::optional<RegionRequest> region_request =
      make_request(model.replica->store(), region, std::move(missing), kRegionParts,
                   priority == kNeededNow ? kRequestSplits : kMaxAheadSplits,
                   priority == kNeededNow ? Portion::kLargestNodes : Portion::kWholeNodes);
  if (!region_request) return false;
  wire::RegionSubscription subscription;
  subscription.region = std::move(*region_request);
  subscription.peer = channel->own_id();
  subscription.publisher = publisher->hello.publisher;
  subscription.request = ++last_request;
  subscription.content_hash = model.content_hash;
  subscription.priority = priority;
  subscription.window_bytes = options.window_bytes;
  channel->send(subscription);
  outstanding[model.content_hash] = {.request = last_request,
                                     .priority = priority,
                                     .heard_s = clock.seconds(),
                                     .patience_s = patience_s,
                                     .publisher = publisher->hello.publisher};
  ++stats.requests;
  return true;
}

// What the swept answers lack, and what else may be met within the horizon.
bool Session::Impl::request_ahead(PeerModel& model, const FrameReport& report, double patience_s) {
  if (publisher_of(model.content_hash) == nullptr) return false;
  std::vector<NodeSpan> missing = missing_of(model, report, true);
  // Looking ahead costs more than most answers. Where a look found nothing to ask for, an eighth of the horizon may pass
  // before the next: half of it is left then.
  if (missing.empty() && std::abs(time_s - model.looked_ahead_s) < horizon_s() / 8) return false;
  // Asked for when the nearer half lacks something, then all of it: fewer and fuller batches than a little in each frame.
  const RegionMaker nearer = region_of(model, horizon_s() / 2, report, Scope::kByRegion);
  const bool is_due =
      !missing.empty() || (nearer != nullptr && lacks(model.replica->store(), nearer));
  const bool is_sent =
      is_due && request(model, region_of(model, horizon_s(), report, Scope::kByRegion),
                        std::move(missing), kHorizon, patience_s);
  model.looked_ahead_s = is_sent ? -std::numeric_limits<double>::infinity() : time_s;
  return is_sent;
}

// A request for a model was lost: how long to wait for the answer to the next, perhaps of another publisher.
double Session::Impl::patience_after(const ContentHash& content, Outstanding& lost) {
  const auto asked = publishers.find(lost.publisher);
  if (asked != publishers.end() && !std::exchange(lost.is_counted, true))
    ++asked->second.lost_requests;
  const Publisher* next = publisher_of(content);
  if (next != nullptr && next->lost_requests == 0) return options.request_timeout_s;
  return std::min(2 * lost.patience_s, kMaxPatience_s);
}

// How soon a pair needs detail, or not: none that it lacks is known.
std::optional<std::uint8_t> Session::Impl::urgency_of(Pair& pair, const PairAnswer& answer) {
  const Answer& now = answer.answer;
  if (!now.missing_a.empty() || !now.missing_b.empty()) return kNeededNow;
  if (horizon_s() <= 0) return std::nullopt;
  if (answer.swept && !(answer.swept->missing_a.empty() && answer.swept->missing_b.empty()))
    return kHorizon;
  // Where a look found nothing, an eighth of the horizon may pass before the next: half of it is left then.
  if (std::abs(time_s - pair.looked_ahead_s) < horizon_s() / 8) return std::nullopt;
  ++stats.looks_ahead;
  const auto lacking = lacking_ahead(pair.a->model->replica->view(), *pair.a->motion, pair.a->name,
                                     pair.b->model->replica->view(), *pair.b->motion, pair.b->name,
                                     horizon_s() / 2, options.margin_m);
  if (lacking.is_ok() && !lacking.value().is_nothing()) return kHorizon;
  pair.looked_ahead_s = time_s;
  return std::nullopt;
}

// A request is open that concerns the pair, or tells this publisher of bodies: it answers one at a time.
bool Session::Impl::has_open(wire::SessionId publisher, const Pair& pair) const {
  return std::any_of(outstanding.begin(), outstanding.end(), [&](const auto& entry) {
    const auto& [content, open] = entry;
    const bool is_lost = clock.seconds() - open.heard_s >= open.patience_s;
    return !is_lost &&
           (content == pair.a->model->content_hash || content == pair.b->model->content_hash ||
            (open.is_certificate && open.publisher == publisher));
  });
}

// Where one publisher serves both models of a pair it is told where the bodies are, and chooses what certifies.
void Session::Impl::ask_certificates(const FrameReport& report) {
  struct Due {
    std::vector<Pair*> now, ahead;
    double patience_s;
  };
  std::map<wire::SessionId, Due> due;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    Pair& pair = pairs[i];
    const PeerModel &a = *pair.a->model, &b = *pair.b->model;
    const Publisher* publisher = publisher_of(a.content_hash, b.content_hash);
    if (pair.asked.fruitless > 0 && a.is_ready() && b.is_ready() &&
        states_of(pair) != pair.asked.states)
      pair.asked = {};
    pair.by_region =
        publisher == nullptr || publisher->wants_regions || pair.asked.fruitless >= kMaxFruitless;
    if (pair.by_region || !report.answers[i].reason.empty()) continue;
    if (!a.waiting.empty() || !b.waiting.empty()) continue;
    if (has_open(publisher->hello.publisher, pair)) continue;
    const std::optional<std::uint8_t> urgency = urgency_of(pair, report.answers[i]);
    if (!urgency) continue;
    double patience_s = options.request_timeout_s;
    for (const ContentHash& content : {a.content_hash, b.content_hash})
      if (const auto lost = outstanding.find(content); lost != outstanding.end())
        patience_s = std::max(patience_s, patience_after(content, lost->second));
    publisher = publisher_of(a.content_hash, b.content_hash);  // another, where that one is lost
    Due& its = due.try_emplace(publisher->hello.publisher, Due{{}, {}, patience_s}).first->second;
    (*urgency == kNeededNow ? its.now : its.ahead).push_back(&pair);
  }
  for (auto& [id, its] : due) {
    const std::uint8_t priority = its.now.empty() ? kHorizon : kNeededNow;
    its.now.insert(its.now.end(), its.ahead.begin(), its.ahead.end());
    request_certificate(publishers.at(id), its.now, priority, its.patience_s);
  }
}

void Session::Impl::request_certificate(const Publisher& publisher, std::span<Pair* const> asked,
                                        std::uint8_t priority, double patience_s) {
  CertificateRequest certificate{.horizon_s = static_cast<float>(horizon_s()),
                                 .margin_m = static_cast<float>(options.margin_m),
                                 .models = {},
                                 .pairs = {}};
  std::vector<PeerModel*> models;
  const auto place_of = [&](PeerModel* model) {
    const auto at = std::find(models.begin(), models.end(), model);
    const auto place = static_cast<std::uint8_t>(at - models.begin());
    if (at == models.end()) models.push_back(model);
    return place;
  };
  ++last_request;
  for (Pair* pair : asked) {
    PeerModel *a = pair->a->model, *b = pair->b->model;
    if (certificate.pairs.size() == kMaxAskedPairs || models.size() + 2 > kMaxAskedModels) break;
    CertificateRequest::Pair& said =
        certificate.pairs.emplace_back(relative(*pair->a->motion, *pair->b->motion));
    said.a = place_of(a);
    said.b = place_of(b);
    said.solid_a = pair->a->solid;
    said.solid_b = pair->b->solid;
    const std::uint64_t states = states_of(*pair);
    const bool is_same = pair->asked.states == states;
    pair->asked = {.request = last_request,
                   .states = states,
                   .is_answered = false,
                   .fruitless =
                       is_same ? pair->asked.fruitless + (pair->asked.is_answered ? 1 : 0) : 0};
  }
  for (PeerModel* model : models) {
    CertificateRequest::Model& said = certificate.models.emplace_back();
    said.content = model->content_hash;
    said.state = model->replica->mesh().state_hash();
    if (std::exchange(model->tells_held, false)) said.held = held_nodes(*model->replica).bits;
    outstanding[model->content_hash] = {.request = last_request,
                                        .priority = priority,
                                        .heard_s = clock.seconds(),
                                        .patience_s = patience_s,
                                        .publisher = publisher.hello.publisher,
                                        .is_certificate = true};
  }
  wire::RegionSubscription subscription;
  subscription.peer = channel->own_id();
  subscription.publisher = publisher.hello.publisher;
  subscription.request = last_request;
  subscription.priority = priority;
  subscription.window_bytes = options.window_bytes;
  subscription.certificate = std::move(certificate);
  channel->send(subscription);
  ++stats.requests;
}

void Session::Impl::ask(const FrameReport& report) {
  ask_certificates(report);
  for (auto& [name, model] : replicas.all()) {
    if (!model.is_ready() || !model.waiting.empty()) continue;
    // One request at a time and model: the next one names what the answer has left unresolved, so nothing is sent
    // twice. Only what is needed now does not wait for a horizon; the publisher drops what is left of that.
    const auto open = outstanding.find(model.content_hash);
    double patience_s = options.request_timeout_s;
    bool may_prefetch = horizon_s() > 0;
    if (open != outstanding.end()) {
      const bool lost = clock.seconds() - open->second.heard_s >= open->second.patience_s;
      if (!lost && open->second.priority == kNeededNow) continue;
      may_prefetch = may_prefetch && lost;
      if (lost) patience_s = patience_after(model.content_hash, open->second);
    }
    // What an answer lacks is named outright: boxes of nodes need not nest, so the walk may miss a node that the query met.
    if (!request(model, region_of(model, 0, report, Scope::kUncertified),
                 missing_of(model, report, false), kNeededNow, patience_s) &&
        may_prefetch)
      static_cast<void>(request_ahead(model, report, patience_s));
  }
}

}  // namespace nearmesh::subscriber
