// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber watch: the bus in a browser, as it is now. What `record` hears goes into a file that nobody keeps, what
// `report` shows is made of it as it grows, and a web socket carries it on; or ROS 2's topics do.
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
#include "ros2_watch.hpp"
#include "subscriber/dds/dds_monitor.hpp"
#include "subscriber/recorded/film.hpp"
#include "subscriber/report/html_page.hpp"
#include "subscriber/report/player_page.hpp"

namespace nearmesh::subscriber::program {
namespace {

constexpr double kPeriod_s = 0.25;
/// Positions are for the eye, too: what is heard is shown some 0.2 s later, not 0.5.
constexpr double kRos2Period_s = 0.1;

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

/// Nothing where no browser is to look.
Result<std::unique_ptr<LiveServer>> start_server(const std::string& http) {
  if (http.empty()) return std::unique_ptr<LiveServer>();
  const std::optional<std::string> address = wire::program::listening_address(http);
  if (!address)
    return Status{StatusCode::kInvalidArgument,
                  "--http " + http + ": expected PORT or ADDRESS:PORT"};
  if (report::player_files().three.empty())
    return Status{StatusCode::kUnsupported, report::kNoPlayer};
  Result<std::string> page = report::live_page("Live");
  NEARMESH_RETURN_IF_ERROR(page);
  return LiveServer::start(*address, std::move(page).value());
}

}  // namespace

Outcome run(const WatchOptions& options) {
  std::unique_ptr<DetailFolder> models;
  if (!options.models.empty()) {
    Result<std::unique_ptr<DetailFolder>> opened = DetailFolder::open(options.models);
    NEARMESH_RETURN_IF_ERROR(opened);
    models = std::move(opened).value();
  }
  wire::program::log_fastdds();
  wire::program::log_network(options.transport);
  const Scratch scratch;
  if (scratch.path().empty())
    return Status{StatusCode::kIo,
                  "cannot make a folder for what is heard below the folder for temporary files: "
                  "name one that can be written by TMPDIR"};
  const std::string path = scratch.path() + "/live.db3";
  const Result<std::unique_ptr<LiveServer>> server = start_server(options.http);
  NEARMESH_RETURN_IF_ERROR(server);
  std::unique_ptr<Ros2Watch> ros2;
  double period_s = kPeriod_s;
  RecorderOptions hearing{.transport = options.transport, .path = path};
  if (options.ros2.is_wanted) {
    Result<std::unique_ptr<Ros2Watch>> made = Ros2Watch::create(options);
    NEARMESH_RETURN_IF_ERROR(made);
    ros2 = std::move(made).value();
    period_s = hearing.commit_period_s = kRos2Period_s;
  }
  Result<std::unique_ptr<DdsRecorder>> recorder = DdsRecorder::create(hearing);
  NEARMESH_RETURN_IF_ERROR(recorder);
  auto monitor = DdsMonitor::create(options.transport);
  NEARMESH_RETURN_IF_ERROR(monitor);
  if (server.value() != nullptr)
    std::printf("http://%s/\n", wire::program::listening_address(options.http)->c_str());
  if (ros2 != nullptr)
    std::printf("/tf, /nearmesh/contacts and /nearmesh/mesh on domain %u\n",
                options.ros2.domain.value_or(options.transport.domain));
  NEARMESH_RETURN_IF_ERROR(flush_standard_output());

  FilmMaker film({.models = models.get(), .onlooker = ros2.get()});
  std::int64_t seen = 0;
  while (stop_requested == 0) {
    const Stopwatch clock;
    while (clock.seconds() < period_s && stop_requested == 0)
      monitor.value()->listen(std::min(0.1, period_s));
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
    if (server.value() != nullptr)
      server.value()->send([&](const auto& visit) { film.visit(visit); },
                           processes_of(monitor.value()->view()));
    if (ros2 != nullptr) {
      ros2->show();
      for (const std::string& line : ros2->take_complaints())
        wire::program::log("session").warn("{}", line);
    }
  }
  return recorder.value()->finish();
}

}  // namespace nearmesh::subscriber::program
