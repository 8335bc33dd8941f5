// SPDX-License-Identifier: Apache-2.0
// nearmesh-publisher replay: a recorded session into a live domain.
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "commands.hpp"
#include "core/base/counted.hpp"
#include "core/base/stopwatch.hpp"
#include "core/command/json_text.hpp"
#include "idl/program/logging.hpp"
#include "line_commands.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "publisher/dds/dds_replay.hpp"
#include "replay_bar.hpp"

namespace nearmesh::publisher::program {
namespace {

constexpr double kDiscovery_s = 1;  ///< who listens has found all writers by then
constexpr double kLinger_s = 0.3;   ///< what was lost at the very end is repaired within that
constexpr double kLoop_s = 0.02;    ///< how soon a line or a signal is noticed

std::string last_part(const std::string& topic) { return topic.substr(topic.rfind('/') + 1); }

/// Names on the bus; the prefix is set in `transport`.
Result<wire::TopicNames> rename(const RecordingReader& recording,
                                const std::vector<std::string>& remaps,
                                wire::TransportOptions& transport) {
  const std::string& recorded = recording.facts().prefix;
  if (transport.prefix.empty()) transport.prefix = recorded;
  std::map<std::string, std::string> topics;  // recorded to new
  for (const std::string& remap : remaps) {
    const std::size_t at = remap.find(":=");
    const auto refuse = [&](const std::string& why) {
      return Status{StatusCode::kInvalidArgument, "remap " + remap + ": " + why};
    };
    if (at == std::string::npos || at == 0) return refuse("expected OLD:=NEW");
    const std::string from = remap.substr(0, at), to = remap.substr(at + 2);
    if (const Status status = wire::check_prefix(to); !status.is_ok())
      return refuse(status.message());
    if (from == recorded) {
      transport.prefix = to;
      continue;
    }
    std::string known = recorded;
    bool found = false;
    for (const RecordedTopic& topic : recording.topics()) {
      known += ", " + topic.name;
      if (topic.name != from && last_part(topic.name) != from) continue;
      topics[topic.name] = to;
      found = true;
    }
    if (!found) return refuse("the recording has no " + from + ", but " + known);
  }
  const wire::TopicNames old_names(recorded);
  wire::TopicNames names(transport.prefix);
  for (const auto& [from, to] : topics)
    if (const auto place = old_names.find(from)) names.rename(*place, to);
  return names;
}

void report_gaps(const RecordingReader& recording) {
  std::map<std::string, std::uint64_t> missing;
  for (const RecordingGap& gap : recording.gaps())
    missing[last_part(recording.topics()[recording.writers()[gap.writer].topic].name)] += gap.count;
  for (const auto& [topic, count] : missing)
    spdlog::warn("{}: {} samples are missing in the recording", topic, count);
}

/// What is happening, on standard error: one line that is renewed on a terminal, else a line now
/// and then. What is being typed behind it stays.
class Progress {
 public:
  void show(double clock_s, Replay& replay) {
    const Playhead& playhead = replay.playhead();
    const double time_s = playhead.time_s(clock_s), start_s = playhead.start_s();
    const double share = played_share(time_s, start_s, playhead.end_s());
    shown_share_ = std::min(shown_share_, share);  // it went back
    if (terminal_ ? clock_s - shown_s_ < 0.1
                  : clock_s - shown_s_ < 10 && share < shown_share_ + 0.25)
      return;
    shown_s_ = clock_s;
    shown_share_ = share;
    const ReplayStats& stats = replay.stats();
    char text[200];
    std::snprintf(text, sizeof text, "%s %.1f of %.1f s%s: %llu samples; %llu live peers",
                  bar_of(share).c_str(), time_s, playhead.end_s(),
                  playhead.is_paused() ? ", paused" : "",
                  static_cast<unsigned long long>(stats.messages()),
                  static_cast<unsigned long long>(stats.live_peers));
    // Over the line that stands there; the cursor goes back to where it was (ESC 7 and ESC 8).
    if (!terminal_)
      std::fprintf(stderr, "%s\n", text);
    else
      std::fprintf(stderr,
                   std::exchange(stands_, true) ? "\x1b\x37\r%-76.76s\x1b\x38" : "\r%-76.76s> ",
                   text);
  }
  /// While the recording is read.
  void show_reading(double share, double clock_s) {
    if (!terminal_ || clock_s - shown_s_ < 0.1) return;
    shown_s_ = clock_s;
    std::fprintf(stderr, "\rreading the recording: %.0f %%\x1b[K", 100 * share);
  }
  void clear() {
    if (terminal_) std::fprintf(stderr, "\r\x1b[K");
    stands_ = false;
  }

 private:
  bool stands_ = false;
  const bool terminal_ = ::isatty(STDERR_FILENO) != 0;
  double shown_s_ = -1, shown_share_ = 0;
};

/// False when it is to end.
Result<bool> obey(const Order& order, Replay& replay, double now_s) {
  Playhead& playhead = replay.playhead();
  switch (order.kind) {
    case Order::Kind::kPause:
      playhead.is_paused() ? playhead.resume(now_s) : playhead.pause(now_s);
      break;
    case Order::Kind::kStep:
      playhead.pause(now_s);
      NEARMESH_RETURN_IF_ERROR(replay.step_to_pose(now_s));
      break;
    case Order::Kind::kSeek:
      NEARMESH_RETURN_IF_ERROR(replay.seek(std::min(order.seconds, playhead.end_s()), now_s));
      break;
    case Order::Kind::kMove:
      NEARMESH_RETURN_IF_ERROR(replay.seek(playhead.time_s(now_s) + order.seconds, now_s));
      break;
    case Order::Kind::kQuit:
      return false;
  }
  return true;
}

nlohmann::ordered_json to_json(const ReplayOptions& options, const ReplayStats& stats,
                               double seconds, double until_s) {
  nlohmann::ordered_json topics = nlohmann::ordered_json::array();
  std::uint64_t bytes = 0;
  for (wire::TopicPlace place = 0; place < wire::kTopicCount; ++place) {
    if (!wire::kTopicFacts[place].is_recorded || wire::kTopicFacts[place].tells_who) continue;
    const ReplayStats::Topic& topic = stats.topics[place];
    bytes += topic.bytes;
    topics.push_back({{"name", wire::kTopicFacts[place].name},
                      {"messages", topic.messages},
                      {"bytes", topic.bytes}});
  }
  return {{"replayed",
           {{"session", options.path},
            {"rate", options.playhead.rate},
            {"start_s", options.playhead.start_s},
            {"until_s", until_s},
            {"loops", stats.loops},
            {"seconds", seconds},
            {"messages", stats.messages()},
            {"bytes", bytes},
            {"topics", topics},
            {"restored", stats.restored},
            {"failed", stats.failed},
            {"late_p99_ms", 1e3 * stats.late.quantile(0.99)},
            {"live_requests", stats.requests},
            {"live_batches", stats.batches},
            {"live_batch_bytes", stats.batch_bytes}}}};
}

/// Until all was played, or a line, a signal or the end of this program's identity ends it.
Status play(Replay& replay, const DdsReplay& outlet, const Stopwatch& clock) {
  LineInput input;
  Progress progress;
  NEARMESH_RETURN_IF_ERROR(replay.begin());
  bool going = true;
  while (going && stop_requested == 0 && outlet.identity().is_ok() && !replay.is_done()) {
    NEARMESH_RETURN_IF_ERROR(replay.step(clock.seconds()));
    for (auto line = input.read(); going && line; line = input.read()) {
      progress.clear();
      const Result<Order> order = parse_order(*line);
      if (!order.is_ok()) {
        spdlog::warn("{}", order.status().message());
        continue;
      }
      const Result<bool> obeyed = obey(order.value(), replay, clock.seconds());
      NEARMESH_RETURN_IF_ERROR(obeyed);
      going = obeyed.value();
    }
    const std::vector<std::string> complaints = replay.take_complaints();
    if (!complaints.empty()) progress.clear();
    for (const std::string& line : complaints) spdlog::warn("{}", line);
    progress.show(clock.seconds(), replay);
    replay.wait(kLoop_s, clock.seconds());
  }
  progress.clear();
  return Status::ok();
}

void report(const ReplayOptions& options, Replay& replay, double seconds, double until_s) {
  const ReplayStats& stats = replay.stats();
  spdlog::info(
      "played up to {:.3f} s: {} samples in {:.3f} s, 99 % at most {:.2f} ms late; {} requests of "
      "live peers, {} batches",
      until_s, stats.messages(), seconds, 1e3 * stats.late.quantile(0.99), stats.requests,
      stats.batches);
  if (stats.failed > 0) spdlog::warn("{} samples could not be sent", stats.failed);
  if (options.json) std::printf("%s\n", text_of(to_json(options, stats, seconds, until_s)).c_str());
}

}  // namespace

Outcome run(ReplayOptions options) {
  wire::program::log_fastdds();
  wire::program::log_network(options.transport);
  // Nothing was begun yet: whoever stops it need not wait until an .mcap file is unpacked.
  wire::program::end_on_signals();
  const Result<std::unique_ptr<RecordingReader>> opened = RecordingReader::open(options.path);
  NEARMESH_RETURN_IF_ERROR(opened);
  wire::program::stop_on_signals();
  RecordingReader& recording = *opened.value();
  const Stopwatch clock;
  Progress reading;
  const auto index = ReplayIndex::build(recording, options.topics, [&](double share) {
    reading.show_reading(share, clock.seconds());
    return stop_requested == 0;
  });
  reading.clear();
  const auto in_file = [&](const Status& status) {
    return Status{status.code(), options.path + ": " + status.message()};
  };
  if (!index.is_ok()) return in_file(index.status());
  if (stop_requested != 0) return Status::ok();
  Result<Playhead> playhead = Playhead::create(recording, options.playhead, clock.seconds());
  if (!playhead.is_ok()) return in_file(playhead.status());
  const Result<wire::TopicNames> names = rename(recording, options.remaps, options.transport);
  NEARMESH_RETURN_IF_ERROR(names);
  report_gaps(recording);
  const auto outlet = DdsReplay::create(options.transport, index.value()->streams(), names.value());
  NEARMESH_RETURN_IF_ERROR(outlet);
  spdlog::info("replaying {}: {:.3f} to {:.3f} s of {} and {}, on domain {}, topics {}/*",
               options.path, playhead.value().start_s(), playhead.value().end_s(),
               counted(index.value()->publishers().size(), "publisher"),
               counted(index.value()->peers().size(), "peer"), options.transport.domain,
               options.transport.prefix);
  Replay replay(recording, *index.value(), *outlet.value(), std::move(playhead).value(),
                options.loop);
  if (!options.models.empty()) {
    const Result<std::unique_ptr<ModelFolder>> models = ModelFolder::open(options.models);
    if (!models.is_ok())
      return Status{models.status().code(), "--models " + models.status().message()};
    for (const std::string& line : models.value()->complaints()) spdlog::warn("{}", line);
    const Result<std::size_t> found = replay.serve_from(*models.value());
    NEARMESH_RETURN_IF_ERROR(found);
    spdlog::info("{} of {} recorded models are served from {}", found.value(),
                 index.value()->details().size(), options.models);
  }
  for (const double until_s = clock.seconds() + kDiscovery_s;
       clock.seconds() < until_s && stop_requested == 0;) {
    NEARMESH_RETURN_IF_ERROR(replay.prepare());
    outlet.value()->wait(index.value()->has_all_batches() ? kLoop_s : 0);
  }
  const double begun_s = clock.seconds();
  NEARMESH_RETURN_IF_ERROR(replay.playhead().seek(replay.playhead().start_s(), begun_s));
  NEARMESH_RETURN_IF_ERROR(play(replay, *outlet.value(), clock));
  const double ended_s = clock.seconds();
  while (clock.seconds() < ended_s + kLinger_s && stop_requested == 0)
    outlet.value()->wait(kLoop_s);
  report(options, replay, ended_s - begun_s, replay.playhead().time_s(ended_s));
  if (Status identity = outlet.value()->identity(); !identity.is_ok())
    return {std::move(identity), wire::program::kIdentityEnded};
  return Status::ok();
}

}  // namespace nearmesh::publisher::program
