// SPDX-License-Identifier: Apache-2.0
#include "answer_lines.hpp"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "core/base/hash.hpp"
#include "core/query/contacts_json.hpp"

namespace nearmesh::subscriber::program {
namespace {

nlohmann::ordered_json to_json(const Depth& depth) {
  nlohmann::ordered_json json = {{"direction", depth.direction},
                                 {"at_least_m", depth.at_least_m},
                                 {"at_most_m", nullptr},
                                 {"missing", depth.missing_a.size() + depth.missing_b.size()}};
  if (depth.at_most_m < std::numeric_limits<double>::infinity()) {
    json["at_most_m"] = depth.at_most_m;
    json["separation_m"] = depth.separation_m;
  }
  if (depth.exhausted) json["exhausted"] = true;
  return json;
}

/// Those of two bodies; of a pair that is not listed they are `end` alone.
nlohmann::ordered_json events_to_json(const FrameReport& report, BodyId a, BodyId b) {
  nlohmann::ordered_json events = nlohmann::ordered_json::array();
  for (const ContactEvent& event : report.contact_events) {
    if (event.a != a || event.b != b) continue;
    events.push_back({{"change", to_string(event.change)}, {"id", event.id}});
    if (event.change == ContactChange::kBegin || event.change == ContactChange::kPersist)
      events.back()["patch"] = event.patch;
  }
  return events;
}

}  // namespace

nlohmann::ordered_json answer_to_json(std::uint64_t frame, double time_s, const PairAnswer& pair,
                                      const FrameReport& report, const Session& session,
                                      bool is_any) {
  const BodyOptions a = session.options_of(pair.a).value(), b = session.options_of(pair.b).value();
  const auto pose = [](const Pose& p) {
    std::vector<double> x(p.rotation.begin(), p.rotation.end());
    x.insert(x.end(), p.translation_m.begin(), p.translation_m.end());
    return x;
  };
  const auto finite = [](double x) -> nlohmann::ordered_json {
    if (std::isfinite(x)) return x;
    return nullptr;
  };
  const auto content = [](const ContentHash& hash) -> nlohmann::ordered_json {
    if (hash.is_set()) return to_hex(hash);
    return nullptr;
  };
  const Answer& answer = pair.answer;
  std::size_t missing = answer.missing_a.size() + answer.missing_b.size();
  nlohmann::ordered_json line = {{"frame", frame},
                                 {"time_s", time_s},
                                 {"a", a.name},
                                 {"b", b.name},
                                 {"model_a", a.model},
                                 {"model_b", b.model},
                                 {"content_a", content(pair.content_a)},
                                 {"content_b", content(pair.content_b)},
                                 {"solid_a", a.solid},
                                 {"solid_b", b.solid},
                                 {"age_a_s", finite(pair.age_a_s)},
                                 {"age_b_s", finite(pair.age_b_s)},
                                 {"status", to_string(answer.status)},
                                 {"pairs", answer.pair_total},
                                 {"pairs_digest", std::to_string(digest(answer.pairs))},
                                 {"digest", to_hex(digest(answer))},
                                 {"clearance_m", finite(answer.clearance_m)},
                                 {"distance_at_most_m", finite(answer.distance_at_most_m)},
                                 {"uncertainty_m", finite(answer.uncertainty_m)},
                                 {"safe_horizon_s", finite(pair.safe_horizon_s)},
                                 {"missing", missing},
                                 {"pose_a", pose(pair.pose_a)},
                                 {"pose_b", pose(pair.pose_b)}};
  if (answer.status == AnswerStatus::kContained) line["contained"] = to_string(answer.contained);
  if (pair.swept) {
    line["swept_status"] = to_string(pair.swept->status);
    line["free_until_s"] = pair.swept->free_until_s;
    line["hit_s"] = finite(pair.swept->hit_s);
  }
  if (pair.world) {
    line["tiles"] = pair.world->tiles.size();
    line["missing_pages"] = pair.world->missing_pages.size();
    for (const NearTile& tile : pair.world->tiles) missing += tile.missing.size();
    line["missing"] = missing;
  }
  if (is_any) line["any"] = true;
  if (answer.truncated) line["truncated"] = true;
  if (answer.exhausted) line["exhausted"] = true;
  if (pair.put_off) line["put_off"] = true;
  if (pair.last_certified) {
    const LastCertified& last = *pair.last_certified;
    line["last_certified"] = {{"status", to_string(last.status)},
                              {"pairs", last.pair_total},
                              {"age_s", last.age_s},
                              {"clearance_m", finite(last.clearance_m)},
                              {"safe_s", finite(last.safe_s)}};
  }
  if (!pair.reason.empty()) line["reason"] = pair.reason;
  if (!pair.awaited.empty()) line["awaited"] = pair.awaited;
  if (pair.contacts) {
    line["patches"] = pair.contacts->patches;
    line["position_error_m"] = pair.contacts->position_error_m;
  }
  if (nlohmann::ordered_json events = events_to_json(report, pair.a, pair.b); !events.empty())
    line["contact_events"] = std::move(events);
  if (pair.depth) line["depth"] = to_json(*pair.depth);
  if (answer.distance_at_most_m > 0 && std::isfinite(answer.distance_at_most_m)) {
    line["nearest_a_m"] = answer.nearest_a_m;
    line["nearest_b_m"] = answer.nearest_b_m;
  }
  return line;
}

nlohmann::ordered_json others_to_json(std::uint64_t frame, double time_s, const FrameReport& report,
                                      const Session& session) {
  const FreeByBounds& free = report.free_by_bounds;
  nlohmann::ordered_json line = {{"frame", frame},
                                 {"time_s", time_s},
                                 {"free_by_bounds",
                                  {{"pairs", free.pairs},
                                   {"clearance_m", free.clearance_m},
                                   {"safe_horizon_s", free.horizon_s},
                                   {"digest", to_hex(free.digest)}}},
                                 {"unknown_pairs", report.unknown_pairs},
                                 {"unknown", nlohmann::ordered_json::array()}};
  for (const UnknownBody& body : report.unknown)
    line["unknown"].push_back({{"body", session.name_of(body.body)}, {"reason", body.reason}});
  for (const ContactEvent& event : report.contact_events) {
    if (report.find(event.a, event.b) != nullptr) continue;
    line["contact_events"].push_back({{"change", to_string(event.change)},
                                      {"id", event.id},
                                      {"a", session.name_of(event.a)},
                                      {"b", session.name_of(event.b)}});
  }
  return line;
}

}  // namespace nearmesh::subscriber::program
