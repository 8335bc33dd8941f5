// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber watch: the bus in a browser, as it is now. What `record` hears goes into a file that nobody keeps, what
// `report` shows is made of it as it grows, and a web socket carries it on.
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/base/standard_streams.hpp"
#include "core/base/stopwatch.hpp"
#include "idl/program/logging.hpp"
#include "idl/program/metrics.hpp"
#include "live_server.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "subscriber/dds/dds_monitor.hpp"
#include "subscriber/recorded/film.hpp"
#include "subscriber/report/html_page.hpp"
#include "subscriber/report/player_page.hpp"

namespace nearmesh::subscriber::program {
namespace {

constexpr double kPeriod_s = 0.25;

/// A folder that is gone with it.
class Scratch {
 public:
  Scratch() {
    std::string pattern =
        (std::filesystem::temp_directory_path() / "nearmesh_watch_XXXXXX").string();
    if (::mkdtemp(pattern.data()) != nullptr) path_ = pattern;
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  ~Scratch() {
    std::error_code unused;
    if (!path_.empty()) std::filesystem::remove_all(path_, unused);
  }
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

/// What each process says of itself, for the table on the page.
std::string processes_of(const BusView& view) {
  nlohmann::json json{{"processes", nlohmann::json::array()}, {"errors", view.errors}};
  for (const wire::ProcessStatus& process : view.processes) {
    nlohmann::json entry{{"id", wire::partition_of(process.session)},
                         {"name", process.name},
                         {"publisher", process.is_publisher},
                         {"bytes_per_s", process.bytes_per_s},
                         {"waiting_batches", process.waiting_batches},
                         {"requests", process.requests},
                         {"refused", process.refused},
                         {"resident_bytes", process.resident_bytes}};
    if (process.is_publisher) {
      entry["peers"] = process.peers;
    } else {
      entry["watched_pairs"] = process.watched_pairs;
      entry["certified_pairs"] = process.certified_pairs;
      entry["uncertainty_m"] = process.uncertainty_m;  // infinite is null
      entry["oldest_body"] = process.oldest_body;
      entry["oldest_age_s"] = process.oldest_age_s;
    }
    json["processes"].push_back(std::move(entry));
  }
  return json.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

}  // namespace

Outcome run(const WatchOptions& options) {
  const std::optional<std::string> address = wire::program::listening_address(options.http);
  if (!address)
    return Status{StatusCode::kInvalidArgument,
                  "--http " + options.http + ": expected PORT or ADDRESS:PORT"};
  if (report::player_files().three.empty())
    return Status{StatusCode::kUnsupported, report::kNoPlayer};
  std::unique_ptr<ModelFolder> models;
  if (!options.models.empty()) {
    Result<std::unique_ptr<ModelFolder>> opened = ModelFolder::open(options.models);
    NEARMESH_RETURN_IF_ERROR(opened);
    models = std::move(opened).value();
  }
  wire::program::log_fastdds();
  wire::program::log_network(options.transport);
  const Scratch scratch;
  if (scratch.path().empty())
    return Status{StatusCode::kIo, "cannot make a folder for what is heard (TMPDIR)"};
  const std::string path = scratch.path() + "/live.db3";
  Result<std::string> page = report::live_page("Live");
  NEARMESH_RETURN_IF_ERROR(page);
  Result<std::unique_ptr<LiveServer>> server = LiveServer::start(*address, std::move(page).value());
  NEARMESH_RETURN_IF_ERROR(server);
  Result<std::unique_ptr<DdsRecorder>> recorder =
      DdsRecorder::create({.transport = options.transport, .path = path});
  NEARMESH_RETURN_IF_ERROR(recorder);
  auto monitor = DdsMonitor::create(options.transport);
  NEARMESH_RETURN_IF_ERROR(monitor);
  std::printf("http://%s/\n", address->c_str());
  NEARMESH_RETURN_IF_ERROR(flush_standard_output());

  FilmMaker film({.models = models.get()});
  std::int64_t seen = 0;
  while (stop_requested == 0) {
    const Stopwatch clock;
    while (clock.seconds() < kPeriod_s && stop_requested == 0)
      monitor.value()->listen(std::min(0.1, kPeriod_s));
    for (const std::string& line : recorder.value()->take_complaints())
      wire::program::log("record").warn("{}", line);
    const RecorderStats stats = recorder.value()->stats();
    if (!stats.identity.is_ok()) return {stats.identity, wire::program::kIdentityEnded};
    NEARMESH_RETURN_IF_ERROR(stats.status);
    Result<std::unique_ptr<RecordingReader>> reader = RecordingReader::open(path);
    NEARMESH_RETURN_IF_ERROR(reader);
    if (reader.value()->message_count() > seen) {
      seen = reader.value()->message_count();
      NEARMESH_RETURN_IF_ERROR(film.go_on(*reader.value(), false));
    }
    server.value()->send([&](const auto& visit) { film.visit(visit); },
                         processes_of(monitor.value()->view()));
  }
  return recorder.value()->finish();
}

}  // namespace nearmesh::subscriber::program
