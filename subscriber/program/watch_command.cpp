// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber watch: the bus in a browser, as it is now. What `record` hears goes into a
// file that nobody keeps, what `report` shows is made of it as it grows, and a web socket carries
// it on; or ROS 2's topics do. At some size all of it begins anew.
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
/// A recorder has asked all peers what they hold, and heard it, so long after it came.
constexpr double kAsking_s = 6;

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

/// What is heard from some moment on, and the film of it.
class Heard {
 public:
  static Result<std::unique_ptr<Heard>> begin(const RecorderOptions& hearing,
                                              const FilmPlan& plan) {
    Result<std::unique_ptr<DdsRecorder>> recorder = DdsRecorder::create(hearing);
    NEARMESH_RETURN_IF_ERROR(recorder);
    return std::unique_ptr<Heard>(new Heard(hearing.path, plan, std::move(recorder).value()));
  }
  Heard(const Heard&) = delete;
  Heard& operator=(const Heard&) = delete;
  ~Heard() {
    recorder_.reset();
    std::error_code unused;
    for (const char* suffix : {"", "-wal", "-shm"}) std::filesystem::remove(path_ + suffix, unused);
  }

  /// Takes what came into the film.
  Status show() {
    Result<std::unique_ptr<RecordingReader>> reader = RecordingReader::open(path_);
    NEARMESH_RETURN_IF_ERROR(reader);
    if (reader.value()->message_count() <= seen_) return Status::ok();
    seen_ = reader.value()->message_count();
    return film_.go_on(*reader.value(), false);
  }
  void log_complaints() {
    for (const std::string& line : recorder_->take_complaints())
      wire::program::log("record").warn("{}", line);
  }
  [[nodiscard]] const FilmMaker& film() const { return film_; }
  [[nodiscard]] RecorderStats stats() const { return recorder_->stats(); }
  [[nodiscard]] double age_s() const { return age_.seconds(); }
  [[nodiscard]] Status finish() { return recorder_->finish(); }

 private:
  Heard(std::string path, const FilmPlan& plan, std::unique_ptr<DdsRecorder> recorder)
      : path_(std::move(path)), film_(plan), recorder_(std::move(recorder)) {}

  const std::string path_;
  FilmMaker film_;
  std::unique_ptr<DdsRecorder> recorder_;
  std::int64_t seen_ = 0;
  const Stopwatch age_{};
};

}  // namespace

Outcome run(const WatchOptions& options) {
  std::unique_ptr<DetailFolder> models;
  if (!options.models.empty()) {
    Result<std::unique_ptr<DetailFolder>> opened = DetailFolder::open(options.models);
    NEARMESH_RETURN_IF_ERROR(opened);
    models = std::move(opened).value();
  }
  if (options.max_bytes < kMinFileBytes)
    return Status{StatusCode::kInvalidArgument,
                  "--max-size: expected at least " + std::to_string(kMinFileBytes) +
                      " bytes, found " + std::to_string(options.max_bytes)};
  wire::program::log_fastdds();
  wire::program::log_network(options.transport);
  const Scratch scratch;
  if (scratch.path().empty())
    return Status{StatusCode::kIo,
                  "cannot make a folder for what is heard below the folder for temporary files: "
                  "name one that can be written by TMPDIR"};
  const Result<std::unique_ptr<LiveServer>> server = start_server(options.http);
  NEARMESH_RETURN_IF_ERROR(server);
  std::unique_ptr<Ros2Watch> ros2;
  double period_s = kPeriod_s;
  RecorderOptions hearing{.transport = options.transport};
  if (options.ros2.is_wanted) {
    Result<std::unique_ptr<Ros2Watch>> made = Ros2Watch::create(options);
    NEARMESH_RETURN_IF_ERROR(made);
    ros2 = std::move(made).value();
    period_s = hearing.commit_period_s = kRos2Period_s;
  }
  int begun = 0;
  const auto begin = [&] {
    hearing.path = scratch.path() + "/live_" + std::to_string(begun++) + ".db3";
    return Heard::begin(hearing, {.models = models.get(), .onlooker = ros2.get()});
  };
  Result<std::unique_ptr<Heard>> first = begin();
  NEARMESH_RETURN_IF_ERROR(first);
  std::unique_ptr<Heard> heard = std::move(first).value(), next;
  auto monitor = DdsMonitor::create(options.transport);
  NEARMESH_RETURN_IF_ERROR(monitor);
  if (server.value() != nullptr)
    std::printf("http://%s/\n", wire::program::listening_address(options.http)->c_str());
  if (ros2 != nullptr)
    std::printf("/tf, /nearmesh/contacts and /nearmesh/mesh on domain %u\n",
                options.ros2.domain.value_or(options.transport.domain));
  NEARMESH_RETURN_IF_ERROR(flush_standard_output());

  while (stop_requested == 0) {
    const Stopwatch clock;
    while (clock.seconds() < period_s && stop_requested == 0)
      monitor.value()->listen(std::min(0.1, period_s));
    heard->log_complaints();
    const RecorderStats stats = heard->stats();
    if (!stats.identity.is_ok()) return {stats.identity, wire::program::kIdentityEnded};
    NEARMESH_RETURN_IF_ERROR(stats.status);
    // All that was heard is kept, in a file and in the film, so it begins anew at some size: beside
    // what is shown, until it knows as much as who comes late can.
    if (next == nullptr && stats.file_bytes >= options.max_bytes) {
      Result<std::unique_ptr<Heard>> more = begin();
      NEARMESH_RETURN_IF_ERROR(more);
      next = std::move(more).value();
    }
    if (next != nullptr && next->age_s() >= kAsking_s) {
      heard = std::move(next);
      if (server.value() != nullptr) server.value()->begin_anew();
    }
    NEARMESH_RETURN_IF_ERROR(heard->show());
    if (server.value() != nullptr)
      server.value()->send([&](const auto& visit) { heard->film().visit(visit); },
                           processes_of(monitor.value()->view()),
                           [] { return stop_requested != 0; });
    if (ros2 != nullptr) {
      ros2->show();
      for (const std::string& line : ros2->take_complaints())
        wire::program::log("session").warn("{}", line);
    }
  }
  return heard->finish();
}

}  // namespace nearmesh::subscriber::program
