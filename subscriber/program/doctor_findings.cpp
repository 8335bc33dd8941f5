// SPDX-License-Identifier: Apache-2.0
#include "doctor_findings.hpp"

#include <algorithm>
#include <cstdio>
#include <utility>

namespace nearmesh::subscriber::program {
namespace {

constexpr double kMostLoss = 0.05;  ///< of both ways together; above, say so
constexpr const char* kNotMeasured = "not measured: interrupted";
constexpr const char* kUntilThen = "; interrupted, so not all were sent";

}  // namespace

const char* to_string(Finding::Kind kind) {
  switch (kind) {
    case Finding::Kind::kFact:
      return "fact";
    case Finding::Kind::kGood:
      return "good";
    case Finding::Kind::kAdvice:
      return "advice";
    case Finding::Kind::kWrong:
      return "wrong";
  }
  return "unknown";
}

std::string milliseconds(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f ms", seconds * 1e3);
  return text;
}

Finding finding_of(RoundTrips trips) {
  std::vector<double>& times_s = trips.times_s;
  if (trips.is_overdue && !trips.is_interrupted)
    return {Finding::Kind::kWrong,
            trips.name,
            std::to_string(trips.bytes) + " bytes there and back: not within " +
                std::to_string(trips.patience_s) + " s",
            {}};
  if (times_s.empty()) return {Finding::Kind::kFact, trips.name, kNotMeasured, {}};
  std::sort(times_s.begin(), times_s.end());
  const double median_s = times_s[times_s.size() / 2];
  std::string text = "median " + milliseconds(median_s) + ", worst " +
                     milliseconds(times_s.back()) + " of " + std::to_string(times_s.size());
  nlohmann::ordered_json value = {{"bytes", trips.bytes},
                                  {"count", times_s.size()},
                                  {"median_s", median_s},
                                  {"worst_s", times_s.back()}};
  if (trips.bytes >= kMegabyte) {
    const double mbit_s = 16e-6 * static_cast<double>(trips.bytes) / median_s;
    char rate[48];
    std::snprintf(rate, sizeof rate, "; %.1f Mbit/s, both ways added", mbit_s);
    text += rate;
    value["mbit_per_s"] = mbit_s;
  }
  if (trips.is_interrupted) text += kUntilThen;
  return {Finding::Kind::kGood, trips.name, std::move(text), std::move(value)};
}

Finding finding_of(const Probes& probes) {
  const std::string name = "loss";
  if (probes.sent == 0) return {Finding::Kind::kFact, name, kNotMeasured, {}};
  const double loss = 1 - static_cast<double>(probes.back) / static_cast<double>(probes.sent);
  char text[80];
  std::snprintf(text, sizeof text, "%.1f %% of %zu kilobytes there and back", 100 * loss,
                probes.sent);
  const std::string all = std::string(text) + (probes.is_interrupted ? kUntilThen : "");
  if (loss > kMostLoss)
    return {Finding::Kind::kWrong, name, all + ": try --transport thin, or tcp", loss};
  return {Finding::Kind::kGood, name, all, loss};
}

}  // namespace nearmesh::subscriber::program
