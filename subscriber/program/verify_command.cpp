// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber verify: does a recorded session come out the same again?
#include <spdlog/spdlog.h>

#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "commands.hpp"
#include "core/base/hash.hpp"
#include "core/base/stopwatch.hpp"
#include "core/command/json_text.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "subscriber/recorded/verify.hpp"

namespace nearmesh::subscriber::program {
namespace {

void print(const std::vector<std::array<FaceKey, 2>>& pairs, const char* where) {
  constexpr std::size_t kShown = 8;
  for (std::size_t i = 0; i < std::min(pairs.size(), kShown); ++i)
    std::printf("  only %s: face (%u, %u) and face (%u, %u)\n", where, pairs[i][0].split.value,
                pairs[i][0].index, pairs[i][1].split.value, pairs[i][1].index);
}

unsigned long long count(std::uint64_t n) { return n; }

/// 1 where answers are different or nothing can be read.
enum ExitCode : int { kNotAllProved = 3, kReportsAmiss = 4 };

void print_text(const BoundsProof& bounds) {
  if (bounds.reports + bounds.missing + bounds.before + bounds.broken == 0) return;
  std::printf(
      "free by bounds: %llu of %llu answers proved, in %llu of %llu reports; %llu wrong, %llu not "
      "provable, %llu malformed; %llu missing, %llu sent before the recorder heard their peers\n",
      count(bounds.proved_pairs), count(bounds.pairs), count(bounds.proved), count(bounds.reports),
      count(bounds.wrong), count(bounds.unprovable), count(bounds.malformed), count(bounds.missing),
      count(bounds.before));
  if (bounds.unreported > 0)
    std::printf("near: %llu of %llu answers are not reported; the first: %s\n",
                count(bounds.unreported), count(bounds.near_pairs),
                bounds.first_unreported.c_str());
  if (bounds.broken > 0)
    std::printf("broken promises: %llu samples of poses; the first: %s\n", count(bounds.broken),
                bounds.first_broken.c_str());
  for (const auto& [what, reports] : bounds.why_not)
    std::printf("  not in the recording, for %llu reports: %s\n", count(reports), what.c_str());
  if (bounds.wrong_ones.empty()) return;
  const WrongBounds& first = bounds.wrong_ones.front();
  std::printf("  first wrong one: message %lld, frame %llu, peer %s\n  %s\n",
              static_cast<long long>(first.message), count(first.recorded.frame),
              wire::partition_of(first.recorded.peer).c_str(), first.what.c_str());
}

void print_text(const VerifyReport& report) {
  std::printf("%llu of %llu answers proved, %llu different; %llu peers, digest %s\n",
              count(report.verified), count(report.answers()), count(report.different),
              count(report.peers), to_hex(report.digest).c_str());
  std::printf(
      "not proved: %llu for want of recorded batches, %llu after give-ups that are not recorded\n"
      "reports: %llu, %llu of them without an answer, %llu malformed; %llu missing, %llu sent "
      "before the recorder heard their peers\n",
      count(report.lacking), count(report.gave_up), count(report.reports), count(report.not_asked),
      count(report.malformed), count(report.missing), count(report.before));
  if (report.put_off > 0 || report.cut > 0)
    std::printf(
        "put off: %llu reports of pairs whose turn did not come within the budget; cut: %llu of "
        "the "
        "proved answers, by the peers' own options\n",
        count(report.put_off), count(report.cut));
  print_text(report.bounds);
  for (const auto& [content_hash, model] : report.wanted)
    std::printf("wanted: the file of model %s, content %s, for %llu reports (--models)\n",
                model.name.c_str(), to_hex(content_hash).c_str(), count(model.reports));
  if (report.differences.empty()) return;
  const Difference& first = report.differences.front();
  std::printf("first difference: message %lld, frame %llu, peer %s, bodies %s and %s\n  %s\n",
              static_cast<long long>(first.message), count(first.recorded.frame),
              wire::partition_of(first.recorded.peer).c_str(), first.recorded.body_a.c_str(),
              first.recorded.body_b.c_str(), first.what.c_str());
  print(first.only_recorded, "recorded");
  print(first.only_found, "found");
}

nlohmann::ordered_json to_json(const BoundsProof& bounds) {
  nlohmann::ordered_json json = {
      {"answers", bounds.pairs},         {"proved", bounds.proved_pairs},
      {"reports", bounds.reports},       {"proved_reports", bounds.proved},
      {"wrong", bounds.wrong},           {"not_provable", bounds.unprovable},
      {"malformed", bounds.malformed},   {"missing", bounds.missing},
      {"before", bounds.before},         {"near", bounds.near_pairs},
      {"unreported", bounds.unreported}, {"broken_promises", bounds.broken}};
  json["lacking"] = nlohmann::ordered_json::array();
  for (const auto& [what, reports] : bounds.why_not)
    json["lacking"].push_back({{"what", what}, {"reports", reports}});
  json["wrong_reports"] = nlohmann::ordered_json::array();
  for (const WrongBounds& one : bounds.wrong_ones)
    json["wrong_reports"].push_back({{"message", one.message},
                                     {"frame", one.recorded.frame},
                                     {"peer", wire::partition_of(one.recorded.peer)},
                                     {"what", one.what}});
  return json;
}

nlohmann::ordered_json to_json(const VerifyReport& report) {
  nlohmann::ordered_json json = {{"answers", report.answers()},
                                 {"proved", report.verified},
                                 {"different", report.different},
                                 {"lacking_batches", report.lacking},
                                 {"gave_up_detail", report.gave_up},
                                 {"reports", report.reports},
                                 {"without_answer", report.not_asked},
                                 {"put_off", report.put_off},
                                 {"cut", report.cut},
                                 {"malformed", report.malformed},
                                 {"missing", report.missing},
                                 {"before", report.before},
                                 {"peers", report.peers},
                                 {"digest", to_hex(report.digest)}};
  json["free_by_bounds"] = to_json(report.bounds);
  json["wanted"] = nlohmann::ordered_json::array();
  for (const auto& [content_hash, model] : report.wanted)
    json["wanted"].push_back(
        {{"name", model.name}, {"content_hash", to_hex(content_hash)}, {"reports", model.reports}});
  json["complaints"] = report.complaints;
  json["differences"] = nlohmann::ordered_json::array();
  for (const Difference& difference : report.differences)
    json["differences"].push_back({{"message", difference.message},
                                   {"frame", difference.recorded.frame},
                                   {"peer", wire::partition_of(difference.recorded.peer)},
                                   {"body_a", difference.recorded.body_a},
                                   {"body_b", difference.recorded.body_b},
                                   {"what", difference.what}});
  return json;
}

Outcome judge(const VerifyReport& report, const VerifyOptions& options) {
  const auto text = [](std::uint64_t n) { return std::to_string(n); };
  if (report.different > 0)
    return Status{StatusCode::kConflict, options.path + ": " + text(report.different) + " of " +
                                             text(report.answers()) + " answers differ"};
  const BoundsProof& bounds = report.bounds;
  if (bounds.wrong > 0)
    return Status{StatusCode::kConflict, options.path + ": " + text(bounds.wrong) + " of " +
                                             text(bounds.reports) +
                                             " reports of what is free by bounds are wrong"};
  if (bounds.broken > 0)
    return Status{StatusCode::kConflict,
                  options.path + ": " + text(bounds.broken) +
                      " samples of poses break promises, the first: " + bounds.first_broken};
  const std::uint64_t reports = report.reports + bounds.reports,
                      malformed = report.malformed + bounds.malformed,
                      missing = report.missing + bounds.missing + bounds.unreported;
  if (reports == 0 || malformed > 0 || (missing > 0 && !options.allow_unproved)) {
    Status amiss{StatusCode::kCorrupt,
                 options.path + ": " +
                     (reports == 0 ? "no report is recorded, so nothing is proved"
                                   : text(malformed) + " reports are malformed, " + text(missing) +
                                         " are missing")};
    return {std::move(amiss), kReportsAmiss};
  }
  const std::uint64_t unproved = report.answers() - report.verified;
  if (options.allow_unproved) return Status::ok();
  if (unproved == 0 && bounds.unprovable > 0)
    return {Status{StatusCode::kNotFound,
                   options.path + ": " + text(bounds.unprovable) + " of " + text(bounds.reports) +
                       " reports of what is free by bounds could not be proved"},
            kNotAllProved};
  if (unproved == 0) return Status::ok();
  std::string wanted;
  for (const auto& [content_hash, model] : report.wanted)
    wanted += (wanted.empty() ? "; --models wants the files of " : ", ") + model.name +
              " (content " + to_hex(content_hash) + ")";
  Status lacking{StatusCode::kNotFound, options.path + ": " + text(unproved) + " of " +
                                            text(report.answers()) +
                                            " answers could not be proved" + wanted};
  return {std::move(lacking), kNotAllProved};
}

}  // namespace

Outcome run(const VerifyOptions& options) {
  Result<std::unique_ptr<RecordingReader>> recording = RecordingReader::open(options.path);
  NEARMESH_RETURN_IF_ERROR(recording);
  RecordingReader& reader = *recording.value();
  std::unique_ptr<DetailFolder> models;
  if (!options.models.empty()) {
    Result<std::unique_ptr<DetailFolder>> opened = DetailFolder::open(options.models);
    NEARMESH_RETURN_IF_ERROR(opened);
    models = std::move(opened).value();
    for (const std::string& line : models->complaints()) spdlog::warn("{}", line);
  }
  const Stopwatch clock;
  const Result<VerifyReport> result =
      verify(reader, {.threads = options.threads, .models = models.get()});
  NEARMESH_RETURN_IF_ERROR(result);
  const VerifyReport& report = result.value();
  for (const std::string& line : report.complaints) spdlog::warn("{}", line);
  if (options.json) {
    std::printf("%s\n", text_of(to_json(report), 2).c_str());
  } else {
    print_text(report);
    std::fprintf(stderr, "%.1f s of session in %.2f s\n",
                 static_cast<double>(reader.end_ns() - reader.begin_ns()) * 1e-9, clock.seconds());
  }
  return judge(report, options);
}

}  // namespace nearmesh::subscriber::program
