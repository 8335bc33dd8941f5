// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber status: who publishes, who flies, and what is refused, as heard on the bus.
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "commands.hpp"
#include "core/base/counted.hpp"
#include "core/base/hash.hpp"
#include "core/base/standard_streams.hpp"
#include "core/base/stopwatch.hpp"
#include "core/command/json_text.hpp"
#include "idl/messages/process_name.hpp"
#include "nearmesh/core/query/query.hpp"
#include "subscriber/dds/dds_monitor.hpp"

namespace nearmesh::subscriber::program {
namespace {

/// "1.2 MB".
std::string human(double bytes) {
  static constexpr const char* kUnits[] = {"B", "kB", "MB", "GB", "TB"};
  std::size_t unit = 0;
  while (bytes >= 999.5 && unit + 1 < std::size(kUnits)) {
    bytes /= 1000;
    ++unit;
  }
  char text[32];
  std::snprintf(text, sizeof text, unit == 0 ? "%.0f %s" : "%.1f %s", bytes, kUnits[unit]);
  return text;
}

/// What a peer can say now: "ready", or what it waits for.
std::string readiness(const wire::ProcessStatus& peer) {
  for (const auto& model : peer.models) {
    if (!model.content_hash.is_set()) return "waits: nobody serves model " + model.name;
    if (model.splits == 0) return "waits for the header of model " + model.name;
  }
  if (peer.certified_pairs == peer.watched_pairs) return "ready";
  if (!(peer.uncertainty_m < 1e300)) return "uncertain";
  char text[48];
  std::snprintf(text, sizeof text, "uncertain within %.3g m", peer.uncertainty_m);
  return text;
}

/// "no door", or what the door refused: "door refused 12 (submessages 11, source 1)".
std::string door_line(const wire::ProcessStatus& process) {
  if (!process.has_door) return "no door before Fast DDS (docs/embed.md)";
  std::uint64_t all = 0;
  std::string reasons;
  for (std::size_t i = 0; i < process.door_refused.size(); ++i) {
    if (process.door_refused[i] == 0) continue;
    all += process.door_refused[i];
    reasons += (reasons.empty() ? "" : ", ") +
               std::string(to_string(static_cast<wire::DoorRefusal>(i))) + " " +
               std::to_string(process.door_refused[i]);
  }
  return all == 0 ? "" : "door refused " + std::to_string(all) + " (" + reasons + ")";
}

/// "rig-2/1290", which is also the name of a process that was given none.
std::string place_of(const wire::ProcessStatus& process) {
  return process.host + "/" + std::to_string(process.process_id);
}

/// "moves aircraft, drone; hears 3 bodies of others, the oldest pose that of truck, 0.31 s; 1
/// stale".
std::string bodies_line(const wire::ProcessStatus& peer) {
  std::string line = "moves ";
  for (std::size_t i = 0; i < peer.moved.size(); ++i) line += (i > 0 ? ", " : "") + peer.moved[i];
  if (peer.moved_bodies == 0) line += "no body";
  if (peer.moved_bodies > peer.moved.size())
    line += " and " + std::to_string(peer.moved_bodies - peer.moved.size()) + " more";
  line += "; hears " + std::to_string(peer.heard_bodies) +
          (peer.heard_bodies == 1 ? " body of others" : " bodies of others");
  if (peer.oldest_body.empty()) return line;
  char age[48];
  std::snprintf(age, sizeof age, "%.2f s old", peer.oldest_age_s);
  line += std::isfinite(peer.oldest_age_s)
              ? ", the oldest pose that of " + peer.oldest_body + ", " + age
              : ", no pose has come of " + peer.oldest_body;
  return peer.stale_bodies == 0 ? line : line + "; " + std::to_string(peer.stale_bodies) + " stale";
}

void print_process(const wire::ProcessStatus& process) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  const std::string place = place_of(process);
  std::printf("  %s  %s%s%s  up %.0f s  %s\n", to_hex(process.session).c_str(),
              process.name == place ? "" : process.name.c_str(),
              process.name.empty() || process.name == place ? "" : "  ", place.c_str(),
              process.uptime_s, human(static_cast<double>(process.resident_bytes)).c_str());
  if (process.is_publisher) {
    std::printf("    %s, %s (%llu refused)", counted(process.peers, "peer").c_str(),
                counted(process.requests, "request").c_str(), count(process.refused));
  } else {
    std::printf("    %s: %u of %s certified, %s (%llu refused)", readiness(process).c_str(),
                process.certified_pairs, counted(process.watched_pairs, "pair").c_str(),
                counted(process.requests, "request").c_str(), count(process.refused));
  }
  std::printf("; %llu batches, %s, %s/s; %llu wait", count(process.batches),
              human(static_cast<double>(process.bytes)).c_str(), human(process.bytes_per_s).c_str(),
              count(process.waiting_batches));
  if (!process.is_publisher) std::printf(", %llu lost", count(process.lost_batches));
  std::printf("\n");
  if (!process.is_publisher) std::printf("    %s\n", bodies_line(process).c_str());
  if (const std::string line = door_line(process); !line.empty())
    std::printf("    %s\n", line.c_str());
  for (const auto& model : process.models) {
    std::printf("    model %s  content %s  %s", model.name.c_str(),
                to_hex(model.content_hash).c_str(), counted(model.faces, "face").c_str());
    if (!process.is_publisher)
      std::printf(", holds %llu of %llu splits", count(model.held_splits), count(model.splits));
    std::printf("\n");
  }
}

/// "ground and one: uncertain within 0.35 m, for 1.2 s".
void print_region(const RegionView& region) {
  const wire::ContactReport& report = region.report;
  const auto status = static_cast<AnswerStatus>(report.status);
  std::printf("    region %s and %s: %s", report.body_a.c_str(), report.body_b.c_str(),
              to_string(status));
  if (is_certified(status)) {
    if (report.pair_count > 0)
      std::printf(", %u touching face pairs", report.pair_count);
    else
      std::printf(", at least %.3g m apart", report.clearance_m);
  } else {
    if (report.uncertainty_m < 1e300) std::printf(" within %.3g m", report.uncertainty_m);
    std::printf(", for %.1f s", region.uncertain_s);
  }
  if (region.age_s > 1) std::printf(" (%.0f s ago)", region.age_s);
  const double oldest_s = std::max(wire::age_s(report.a.stamp, report.time_s),
                                   wire::age_s(report.b.stamp, report.time_s));
  if (std::isfinite(oldest_s)) std::printf("; the older pose %.2f s", oldest_s);
  std::printf("\n");
}

void print_regions(const BusView& view, const wire::ProcessStatus& peer) {
  for (const RegionView& region : view.regions)
    if (region.report.peer == peer.session) print_region(region);
  for (const RequestView& request : view.requests)
    if (request.peer == peer.session)
      for (const auto& model : peer.models)
        if (model.content_hash == request.content_hash)
          std::printf("    last asked for %u %s of model %s, %s, %.1f s ago\n",
                      request.pairs > 0 ? request.pairs : request.nodes,
                      request.pairs > 0 ? "pairs" : "nodes", model.name.c_str(),
                      request.priority == 0 ? "needed now" : "ahead", request.age_s);
}

/// Publishers of whom only their announcement was heard.
std::vector<wire::Hello> without_status(const BusView& view) {
  std::set<wire::SessionId> known;
  for (const auto& process : view.processes) known.insert(process.session);
  std::vector<wire::Hello> rest;
  for (const wire::Hello& hello : view.publishers)
    if (!known.contains(hello.publisher)) rest.push_back(hello);
  return rest;
}

void print_text(const BusView& view) {
  for (const bool publishers : {true, false}) {
    std::printf("%s\n", publishers ? "publishers" : "peers");
    bool any = false;
    for (const auto& process : view.processes) {
      if (process.is_publisher != publishers) continue;
      any = true;
      print_process(process);
      if (!publishers) print_regions(view, process);
    }
    if (publishers)
      for (const wire::Hello& hello : without_status(view)) {
        any = true;
        std::printf("  %s  (says nothing of itself)\n",
                    wire::called(hello.publisher, hello.name).c_str());
        for (const auto& model : hello.models)
          std::printf("    model %s  content %s\n", model.name.c_str(),
                      to_hex(model.content_hash).c_str());
      }
    if (!any) std::printf("  none\n");
  }
  std::printf("errors\n");
  for (const std::string& line : view.errors) std::printf("  %s\n", line.c_str());
  if (view.errors.empty()) std::printf("  none\n");
  std::printf("refusals\n");
  bool any = !view.refusals.empty();
  for (const std::string& line : view.refusals) std::printf("  %s\n", line.c_str());
  for (const auto& process : view.processes)
    for (const std::string& line : process.complaints) {
      any = true;
      std::printf("  %s %s: %s\n", process.is_publisher ? "publisher" : "peer",
                  wire::called(process.session, process.name).c_str(), line.c_str());
    }
  if (!any) std::printf("  none\n");
}

void add_regions(nlohmann::ordered_json& entry, const BusView& view, wire::SessionId peer) {
  entry["regions"] = nlohmann::ordered_json::array();
  for (const RegionView& region : view.regions) {
    const auto pose_age = [&](const wire::ContactReport::Asked& asked) {
      return wire::age_s(asked.stamp, region.report.time_s);  // infinite is null
    };
    if (region.report.peer == peer)
      entry["regions"].push_back(
          {{"a", region.report.body_a},
           {"b", region.report.body_b},
           {"status", to_string(static_cast<AnswerStatus>(region.report.status))},
           {"uncertainty_m", region.report.uncertainty_m},
           {"uncertain_s", region.uncertain_s},
           {"clearance_m", region.report.clearance_m},
           {"pairs", region.report.pair_count},
           {"age_s", region.age_s},
           {"time_s", region.report.time_s},
           {"age_a_s", pose_age(region.report.a)},
           {"age_b_s", pose_age(region.report.b)}});
  }
  entry["last_requests"] = nlohmann::ordered_json::array();
  for (const RequestView& request : view.requests)
    if (request.peer == peer)
      entry["last_requests"].push_back({{"content_hash", to_hex(request.content_hash)},
                                        {"nodes", request.nodes},
                                        {"pairs", request.pairs},
                                        {"needed_now", request.priority == 0},
                                        {"age_s", request.age_s}});
}

nlohmann::ordered_json to_json(const BusView& view, bool regions) {
  nlohmann::ordered_json json = {{"publishers", nlohmann::ordered_json::array()},
                                 {"peers", nlohmann::ordered_json::array()},
                                 {"errors", view.errors},
                                 {"refusals", view.refusals}};
  for (const auto& process : view.processes) {
    nlohmann::ordered_json entry = {{"session", to_hex(process.session)},
                                    {"name", process.name},
                                    {"host", process.host},
                                    {"process_id", process.process_id},
                                    {"uptime_s", process.uptime_s},
                                    {"resident_bytes", process.resident_bytes},
                                    {"requests", process.requests},
                                    {"refused", process.refused},
                                    {"batches", process.batches},
                                    {"bytes", process.bytes},
                                    {"bytes_per_s", process.bytes_per_s},
                                    {"waiting_batches", process.waiting_batches},
                                    {"complaints", process.complaints}};
    entry["has_door"] = process.has_door;
    for (std::size_t i = 0; i < process.door_refused.size(); ++i)
      entry["door_refused"][to_string(static_cast<wire::DoorRefusal>(i))] = process.door_refused[i];
    if (process.is_publisher) {
      entry["peers"] = process.peers;
    } else {
      entry["readiness"] = readiness(process);
      entry["watched_pairs"] = process.watched_pairs;
      entry["certified_pairs"] = process.certified_pairs;
      entry["uncertainty_m"] = process.uncertainty_m;
      entry["lost_batches"] = process.lost_batches;
      entry["moves"] = process.moved;
      entry["moved_bodies"] = process.moved_bodies;
      entry["heard_bodies"] = process.heard_bodies;
      entry["stale_bodies"] = process.stale_bodies;
      entry["oldest_pose"] = nullptr;
      if (!process.oldest_body.empty())  // infinite is null
        entry["oldest_pose"] = {{"body", process.oldest_body}, {"age_s", process.oldest_age_s}};
      if (regions) add_regions(entry, view, process.session);
    }
    entry["models"] = nlohmann::ordered_json::array();
    for (const auto& model : process.models)
      entry["models"].push_back({{"name", model.name},
                                 {"content_hash", to_hex(model.content_hash)},
                                 {"faces", model.faces},
                                 {"held_splits", model.held_splits},
                                 {"splits", model.splits}});
    json[process.is_publisher ? "publishers" : "peers"].push_back(std::move(entry));
  }
  for (const wire::Hello& hello : without_status(view)) {
    nlohmann::ordered_json entry = {{"session", to_hex(hello.publisher)}, {"name", hello.name}};
    entry["models"] = nlohmann::ordered_json::array();
    for (const auto& model : hello.models)
      entry["models"].push_back(
          {{"name", model.name}, {"content_hash", to_hex(model.content_hash)}});
    json["publishers"].push_back(std::move(entry));
  }
  return json;
}

}  // namespace

Outcome run(const StatusOptions& options) {
  auto monitor = DdsMonitor::create(options.transport, options.regions);
  NEARMESH_RETURN_IF_ERROR(monitor);
  do {
    const Stopwatch clock;
    while (clock.seconds() < options.seconds && stop_requested == 0)
      monitor.value()->listen(std::min(0.1, options.seconds - clock.seconds()));
    const BusView view = monitor.value()->view();
    if (options.json) {
      std::printf("%s\n", text_of(to_json(view, options.regions)).c_str());
    } else {
      if (options.watch && ::isatty(STDOUT_FILENO) != 0) std::printf("\x1b[H\x1b[2J");
      print_text(view);
    }
    NEARMESH_RETURN_IF_ERROR(flush_standard_output());
    if (Status identity = monitor.value()->identity(); !identity.is_ok())
      return {std::move(identity), wire::program::kIdentityEnded};
    if (!options.watch && view.processes.empty() && view.publishers.empty())
      return Status{StatusCode::kNotFound, "nobody was heard on domain " +
                                               std::to_string(options.transport.domain) +
                                               ", topics " + options.transport.prefix +
                                               "/*: nearmesh-subscriber doctor may say why"};
  } while (options.watch && stop_requested == 0);
  return Status::ok();
}

}  // namespace nearmesh::subscriber::program
