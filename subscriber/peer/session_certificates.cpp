// SPDX-License-Identifier: Apache-2.0
// What a session asks of a publisher that serves both models of a pair: it says where the bodies
// are and what it holds, and the publisher chooses the detail that certifies.
#include <algorithm>
#include <atomic>
#include <map>
#include <utility>

#include "core/base/hash.hpp"
#include "core/certificate/certificate.hpp"
#include "core/certificate/mirror.hpp"
#include "core/query/lacking_ahead.hpp"
#include "core/replica/held_nodes.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// So many answers in a row may bring nothing to a pair before it names what it lacks itself.
constexpr int kMaxFruitless = 2;
/// Who holds so much that it takes more bytes to tell, or more splits than a publisher listens to,
/// names what it lacks itself: that takes some kilobytes.
constexpr std::size_t kMaxToldBytes = 64 * 1024;

/// So long models of a request that was refused are asked for by region: then it is tried again.
constexpr double kRefused_s = 8;

/// Of both models of a pair that are ready.
template <class Pair>
std::uint64_t states_of(const Pair& pair) {
  return mix(pair.a->model->replica->mesh().state_hash()) ^
         mix(pair.b->model->replica->mesh().state_hash() + 1);
}

/// How a body's model moves. The poses of a world place its own origin; a tile's model begins at
/// zero.
Motion motion_of_model(const Body& body) {
  Motion motion = *body.motion;
  if (!body.tile_grid) return motion;
  const auto& r = motion.pose.rotation;
  const auto &from_m = body.tile_grid->origin_m, &w = motion.angular_velocity_radps;
  std::array<double, 3> way_m{};
  for (std::size_t k = 0; k < 3; ++k) {
    way_m[k] = r[3 * k] * from_m[0] + r[3 * k + 1] * from_m[1] + r[3 * k + 2] * from_m[2];
    motion.pose.translation_m[k] += way_m[k];
  }
  auto& v = motion.linear_velocity_mps;
  v[0] += w[1] * way_m[2] - w[2] * way_m[1];
  v[1] += w[2] * way_m[0] - w[0] * way_m[2];
  v[2] += w[0] * way_m[1] - w[1] * way_m[0];
  return motion;
}

}  // namespace

// How soon a pair needs detail.
Session::Impl::Need Session::Impl::need_of(const Pair& pair, const PairAnswer& answer) const {
  const Answer& now = answer.answer;
  if (!now.missing_a.empty() || !now.missing_b.empty()) return Need::kNow;
  if (horizon_s() <= 0) return Need::kNothing;
  if (answer.swept && !(answer.swept->missing_a.empty() && answer.swept->missing_b.empty()))
    return Need::kAhead;
  if (pair.lies && options.margin_m == 0) return Need::kNothing;
  // What nothing meets until then is certified until then, by what is held.
  if (pair.by_region && stays_certified(answer, soon_s(pair))) return Need::kNothing;
  // Where a look found nothing, an eighth of the horizon may pass before the next: another eighth
  // is left then.
  return std::abs(time_s - pair.looked_ahead_s) < horizon_s() / 8 ? Need::kNothing : Need::kLook;
}

bool Session::Impl::is_lacking_soon(const Pair& pair, std::uint64_t max_tests) const {
  const auto lacking =
      lacking_ahead(pair.a->view(), *pair.a->motion, pair.a->name, pair.b->view(), *pair.b->motion,
                    pair.b->name, soon_s(pair), options.margin_m, {}, {}, max_tests);
  return lacking.is_ok() && !lacking.value().is_nothing();
}

bool Session::Impl::has_open(const ContentHash& content) const {
  const auto open = outstanding.find(content);
  return open != outstanding.end() && !is_lost(open->second);
}

// Somebody serves it, no request about it is open, and what came is taken in.
bool Session::Impl::may_ask_for(const PeerModel& model) {
  return model.waiting.empty() && !has_open(model.content_hash) &&
         publisher_of(model.content_hash) != nullptr;
}

// The publishers that were told where bodies are, and have not answered: each answers one such
// request at a time.
std::set<wire::SessionId> Session::Impl::told_of_bodies() const {
  std::set<wire::SessionId> found;
  for (const auto& [content, open] : outstanding)
    if (open.is_certificate && !is_lost(open)) found.insert(open.publisher);
  return found;
}

// The pairs for which a publisher chooses, and that need detail or may: none of whose models waits
// for an answer.
std::vector<Session::Impl::Candidate> Session::Impl::find_candidates(const FrameReport& report) {
  std::vector<Candidate> candidates;
  const std::set<wire::SessionId> at_work = told_of_bodies();
  for (std::size_t i = 0; i < listed.size(); ++i) {
    if (report.answers[i].put_off) continue;
    Pair& pair = *listed[i];
    const PeerModel &a = *pair.a->model, &b = *pair.b->model;
    const Publisher* publisher = publisher_of(a.content_hash, b.content_hash);
    if (pair.asked.fruitless > 0 && a.is_ready() && b.is_ready() &&
        states_of(pair) != pair.asked.states)
      pair.asked = {};
    pair.by_region = publisher == nullptr || publisher->by_region.contains(a.content_hash) ||
                     publisher->by_region.contains(b.content_hash) || a.is_too_much_to_tell ||
                     b.is_too_much_to_tell || pair.asked.fruitless >= kMaxFruitless ||
                     clock.seconds() < std::max(a.by_region_until_s, b.by_region_until_s);
    if (pair.by_region || !report.answers[i].reason.empty()) continue;
    if (!a.waiting.empty() || !b.waiting.empty()) continue;
    if (at_work.contains(publisher->hello.publisher) || has_open(a.content_hash) ||
        has_open(b.content_hash))
      continue;
    if (const Need need = need_of(pair, report.answers[i]); need != Need::kNothing)
      candidates.push_back({&pair, need});
  }
  return candidates;
}

/// As many as there is time for, those first that were looked at longest ago; one in any case in
/// some updates. The others wait for another update. `looked_in`: the last update that looked, or
/// had no need to.
void Session::Impl::look_ahead(const FrameBudget& budget, std::vector<Candidate>& candidates,
                               std::uint64_t& looked_in) {
  std::vector<Candidate*> looks;
  for (Candidate& candidate : candidates)
    if (candidate.need == Need::kLook) looks.push_back(&candidate);
  std::stable_sort(looks.begin(), looks.end(), [](const Candidate* one, const Candidate* two) {
    return one->pair->looked_ahead_s < two->pair->looked_ahead_s;
  });
  std::atomic<std::size_t> next{0}, looked{0};
  run_jobs(looks.size(), [&](std::size_t) {
    const std::size_t turn = next++;
    Candidate& look = *looks[turn];
    const double left_s = budget.left_s();
    if ((turn > 0 || updates - looked_in < kPatientLooks) &&
        left_s < (look.pair->look_cost_s > 0 ? look.pair->look_cost_s : look_cost.seconds()))
      return;
    const Stopwatch watch;
    look.need = is_lacking_soon(*look.pair, tests_within(left_s)) ? Need::kAhead : Need::kNothing;
    look.pair->look_cost_s = watch.seconds();
    ++looked;
  });
  stats.looks_ahead += looked;
  if (looked > 0 || looks.empty()) looked_in = updates;
  for (const Candidate* look : looks)
    if (look->need != Need::kLook) look_cost.add(look->pair->look_cost_s);
}

// Where one publisher serves both models of a pair it is told where the bodies are, and chooses
// what certifies.
void Session::Impl::ask_certificates(const FrameBudget& budget, const FrameReport& report) {
  std::vector<Candidate> candidates = find_candidates(report);
  look_ahead(budget, candidates, looked_ahead_in);
  struct Due {
    std::vector<Pair*> now, ahead;
  };
  std::map<wire::SessionId, Due> due;
  for (const Candidate& candidate : candidates) {
    Pair& pair = *candidate.pair;
    if (candidate.need == Need::kLook) continue;
    if (candidate.need == Need::kNothing) {
      pair.looked_ahead_s = time_s;
      continue;
    }
    const PeerModel &a = *pair.a->model, &b = *pair.b->model;
    for (const ContentHash& content : {a.content_hash, b.content_hash})
      if (const auto lost = outstanding.find(content); lost != outstanding.end())
        count_lost(lost->second);
    // Perhaps another than before, where that one is lost.
    Due& its = due[publisher_of(a.content_hash, b.content_hash)->hello.publisher];
    (candidate.need == Need::kNow ? its.now : its.ahead).push_back(&pair);
  }
  for (auto& [id, its] : due) {
    const std::uint8_t priority = its.now.empty() ? kHorizon : kNeededNow;
    its.now.insert(its.now.end(), its.ahead.begin(), its.ahead.end());
    request_certificate(publishers.at(id), its.now, priority);
  }
}

void Session::Impl::request_certificate(const Publisher& publisher, std::span<Pair* const> asked,
                                        std::uint8_t priority) {
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
  // Of those behind one that has no place any more who needs no other model.
  std::vector<Pair*> taken;
  for (Pair* pair : asked) {
    if (taken.size() == kMaxAskedPairs) break;
    const auto is_new = [&models](const Body& body) {
      return std::find(models.begin(), models.end(), body.model) == models.end();
    };
    const int more =
        (is_new(*pair->a) ? 1 : 0) + (is_new(*pair->b) && pair->a->model != pair->b->model ? 1 : 0);
    if (models.size() + static_cast<std::size_t>(more) > kMaxAskedModels) continue;
    taken.push_back(pair);
    CertificateRequest::Pair& said = certificate.pairs.emplace_back(
        relative(motion_of_model(*pair->a), motion_of_model(*pair->b)));
    said.a = place_of(pair->a->model);
    said.b = place_of(pair->b->model);
    said.solid_a = pair->a->solid;
    said.solid_b = pair->b->solid;
  }
  const wire::SessionId id = publisher.hello.publisher;
  bool is_too_much = false, has_told_held = true;
  for (PeerModel* model : models) {
    CertificateRequest::Model& said = certificate.models.emplace_back();
    said.content = model->content_hash;
    said.state = model->replica->mesh().state_hash();
    const ActiveMesh& mesh = model->replica->mesh();
    const bool holds_any = mesh.split_count() > 0 || !mesh.half_spaces().is_empty();
    const bool is_new = model->told != id && holds_any;
    if (model->tells_held || is_new) said.held = held_nodes(*model->replica).bits;
    model->is_too_much_to_tell =
        said.held.size() > kMaxToldBytes ||
        (!said.held.empty() && model->replica->mesh().split_count() > MirrorMaker::kMostHeld);
    is_too_much |= model->is_too_much_to_tell;
    has_told_held &= !said.held.empty();
  }
  if (is_too_much) return;  // by region, from the next update on
  for (PeerModel* model : models) {
    model->told = id;
    model->tells_held = false;
  }
  send_request(publisher, priority, {.certificate = std::move(certificate)});
  ++stats.requests;
  for (PeerModel* model : models)
    open_request(model->content_hash, publisher,
                 {.priority = priority, .is_certificate = true, .has_told_held = has_told_held});
  for (Pair* pair : taken) {
    const Pair::Asked last = pair->asked;
    pair->asked = {.request = last_request, .states = states_of(*pair)};
    if (last.states == pair->asked.states)
      pair->asked.fruitless = last.fruitless + (last.is_answered ? 1 : 0);
  }
}

/// For one of its models that cannot be read, perhaps: each is asked for by itself for a while.
void Session::Impl::take_refused_certificate(const wire::SplitBatchMessage& message) {
  std::erase_if(outstanding, [&](const auto& entry) {
    const auto& [content, open] = entry;
    if (!open.is_answered_by(message) || !open.is_certificate) return false;
    if (PeerModel* model = replicas.find(content); model != nullptr) {
      model->tells_held |= open.has_told_held;  // what it said of us is lost, too
      model->by_region_until_s = clock.seconds() + kRefused_s;
    }
    return true;
  });
}

}  // namespace nearmesh::subscriber
