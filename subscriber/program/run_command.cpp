// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber run: a peer that flies its bodies along trajectories and answers, frame by
// frame, what touches.
#include <unistd.h>

#include <algorithm>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <thread>

#include "answer_lines.hpp"
#include "commands.hpp"
#include "core/base/output_file.hpp"
#include "core/base/standard_streams.hpp"
#include "core/base/stopwatch.hpp"
#include "exercise_clock.hpp"
#include "flight_summary.hpp"
#include "idl/messages/process_name.hpp"
#include "idl/program/logging.hpp"
#include "idl/program/metrics.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "ros2_flight.hpp"
#include "scene.hpp"
#include "wait_for_recorder.hpp"

namespace nearmesh::subscriber::program {
namespace {

constexpr FileKind kAnswersFile{"a file of answers", "{\"frame\":", "{\"summary\":"};

/// At the end, while others still fly.
constexpr double kStay_s = 5;

/// Of the first frame's poses, while it is waited for.
constexpr double kRepeat_s = 0.25;

constexpr double kLongestPause_s = 0.05;

void sleep_s(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

/// Between two updates that wait for others: a fiftieth of what has been waited already. A crowd
/// that waits leaves the processor to those that it waits for.
void pause_after(double waited_s, double least_s) {
  sleep_s(std::clamp(waited_s / 50, least_s, kLongestPause_s));
}

// One peer, from the scene to the summary.
class Flight {
 public:
  /// `clock` runs since the program's start.
  /// `ros2`: nothing where ROS 2 has no part in it.
  Flight(const RunOptions& options, const Scene& scene, std::unique_ptr<DdsChannel> channel,
         std::unique_ptr<Ros2Flight> ros2, Stopwatch clock)
      : options_(options),
        scene_(scene),
        clock_(clock),
        channel_(*channel),
        ros2_(std::move(ros2)),
        exercise_(moves_any(scene, ros2_.get())),
        session_(std::move(channel), scene.session) {}

  Status prepare() {
    if (!options_.metrics.empty()) {
      auto server = wire::program::MetricsServer::start(options_.metrics);
      NEARMESH_RETURN_IF_ERROR(server);
      metrics_ = std::move(server).value();
    }
    if (!options_.answers.empty()) {
      auto file = OutputFile::create(options_.answers, kAnswersFile, {options_.scene});
      NEARMESH_RETURN_IF_ERROR(file);
      answers_.emplace(std::move(file).value());
    }
    const auto is_of_ros2 = [this](std::size_t i) { return ros2_ != nullptr && ros2_->moves(i); };
    NEARMESH_RETURN_IF_ERROR(declare(scene_, is_of_ros2, session_).status);
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i)
      if (scene_.bodies[i].trajectory.empty() && !is_of_ros2(i)) others_.insert(id_of(i));
    if (scene_.watches_all) {
      scene_.watches_only_own ? session_.watch_own() : session_.watch_all();
      session_.discover_bodies();
    }
    return Status::ok();
  }

  // Holds the first frame until publishers and other peers have been heard, so that all start
  // together.
  Status wait_for_start() {
    std::string reason;
    double said_s = -kRepeat_s;
    while (stop_requested == 0) {
      NEARMESH_RETURN_IF_ERROR(channel_.identity());
      // Said again, or it ages: it waits, but has the velocity that it will fly with.
      const bool says = clock_.seconds() - said_s >= kRepeat_s;
      if (says) said_s = clock_.seconds();
      Result<FrameReport> report = update(0, with_heard(says ? motions(0) : no_motions_), 1);
      NEARMESH_RETURN_IF_ERROR(report);
      NEARMESH_RETURN_IF_ERROR(check_solids());
      log(report.value());
      note_certified(report.value());
      if (report.value().all_certified()) return Status::ok();
      for (const PairAnswer& pair : report.value().answers)
        if (!pair.reason.empty() || !pair.awaited.empty())
          reason = pair.reason.empty() ? pair.awaited : pair.reason;
      for (const UnknownBody& body : report.value().unknown) reason = body.reason;
      if (clock_.seconds() > scene_.start_timeout_s)
        return {StatusCode::kNotFound, "no certified answer within " +
                                           std::to_string(scene_.start_timeout_s) +
                                           " s: " + reason};
      pause_after(clock_.seconds(), 0.002);
    }
    return Status::ok();
  }

  // A frame begins a period after the one before it at the earliest. Frames that were late are not
  // made up for by faster ones: bodies would go faster than their trajectories say, and farther
  // than others were promised.
  Status fly() {
    const Stopwatch clock;
    for (std::uint64_t frame = 0;
         frame < scene_.frames && stop_requested == 0 && channel_.identity().is_ok(); ++frame) {
      NEARMESH_RETURN_IF_ERROR(fly_frame(frame));
      show_progress(frame + 1);
      while (left_s() > 0 && stop_requested == 0) sleep_s(std::min(kLongestPause_s, left_s()));
    }
    summary_.seconds = clock.seconds();
    summary_.stats = session_.stats();
    return Status::ok();
  }

  /// Why it ended before its time, if so.
  [[nodiscard]] Status identity() const { return channel_.identity(); }

  // Those who began later still ask about its bodies: it stays with them in place until they have
  // ended too.
  void stay() {
    if (scene_.frames == Scene::kForEver) return;
    std::vector<Session::OwnMotion> rest = motions(scene_.frames - 1);
    for (Session::OwnMotion& own : rest) own.motion = {.pose = own.motion.pose};
    const Stopwatch clock;
    for (bool said = false; stop_requested == 0 && clock.seconds() < kStay_s; said = true) {
      const auto report =
          update(scene_.frames - 1, with_heard(said ? no_motions_ : rest), scene_.budget_s);
      if (!report.is_ok() || !does_anybody_fly(report.value())) return;
      sleep_s(0.02);
    }
  }

  // Before the bus is left, as the summary.
  void keep_detail() {
    if (const Status kept = session_.write_cache(); !kept.is_ok())
      log_.warn("detail is not kept for the next time: {}", kept.message());
  }

  Status print_summary() {
    if (ros2_ != nullptr) {
      const Ros2Bridge::Counts counts = ros2_->counts();
      log_.info("ros2: {} poses taken, {} refused, {} transforms of other frames", counts.taken,
                counts.refused, counts.strange);
    }
    if (::isatty(STDERR_FILENO) != 0) std::fprintf(stderr, "\r%40s\r", "");
    if (options_.json) {
      std::printf("%s\n", to_json(summary_).dump().c_str());
    } else {
      print_text(summary_);
    }
    // Before the bus is left: an assertion of Fast DDS may end the process there (docs/network.md).
    NEARMESH_RETURN_IF_ERROR(flush_standard_output());
    // A flight of no frame leaves what the file holds of an earlier one.
    if (!answers_ || summary_.frames == 0) return Status::ok();
    NEARMESH_RETURN_IF_ERROR(answers_->write(to_json(summary_).dump() + '\n'));
    return answers_->close();
  }

 private:
  static bool moves_any(const Scene& scene, const Ros2Flight* ros2) {
    for (std::size_t i = 0; i < scene.bodies.size(); ++i)
      if (!scene.bodies[i].trajectory.empty() || (ros2 != nullptr && ros2->moves(i))) return true;
    return false;
  }
  // Bodies are added in the scene's order before any is discovered, and a session numbers them so.
  static BodyId id_of(std::size_t body) { return {static_cast<std::uint32_t>(body)}; }

  std::vector<Session::OwnMotion> motions(std::uint64_t frame) const {
    std::vector<Session::OwnMotion> all;
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i) {
      const std::vector<Motion>& trajectory = scene_.bodies[i].trajectory;
      if (trajectory.empty()) continue;
      // Who stays where its trajectory ends has no velocity any more: others would wait for what it
      // never reaches.
      all.push_back({id_of(i), frame < trajectory.size() ? trajectory[frame]
                                                         : Motion{.pose = trajectory.back().pose}});
    }
    return all;
  }

  /// And those that ROS 2 has moved since the last frame.
  std::vector<Session::OwnMotion> with_heard(std::vector<Session::OwnMotion> all) const {
    if (ros2_ != nullptr) ros2_->add_motions(all);
    return all;
  }

  // A mistake in the scene that shows when headers come, or when a publisher changes a model.
  [[nodiscard]] Status check_solids() const {
    for (std::size_t i = 0; i < scene_.bodies.size(); ++i)
      if (const SpmHeader* header = session_.header_of(id_of(i));
          scene_.bodies[i].solid && header != nullptr)
        NEARMESH_RETURN_IF_ERROR(check_solid(header->surface, scene_.bodies[i].name));
    return Status::ok();
  }

  Result<FrameReport> update(std::uint64_t frame, std::vector<Session::OwnMotion> motions,
                             double budget_s) {
    exercise_.follow(session_.heard_time_s());
    time_s_ = exercise_.now_s();
    if (ros2_ != nullptr) ros2_->take_out_jumps(session_, time_s_, motions);
    update_clock_ = {};
    auto report = session_.update(frame, time_s_, motions, budget_s);
    if (report.is_ok()) {
      for (const BodyId body : report.value().went) others_.erase(body);
      for (const BodyId body : report.value().came)
        if (session_.options_of(body).is_ok()) others_.insert(body);
      add_unrecorded(report.value().contact_events);
      if (ros2_ != nullptr) {
        ros2_->show(report.value(), session_);
        for (const std::string& line : ros2_->take_complaints()) log_.warn("{}", line);
      }
    }
    return report;
  }

  /// Of a frame's updates the last is recorded: what began or ended in one before is told with it.
  void add_unrecorded(std::vector<ContactEvent>& events) {
    std::vector<ContactEvent> ended;
    std::erase_if(events,
                  [this](const ContactEvent& event) {  // who never was recorded does not end
                    return event.change == ContactChange::kEnd && began_.erase(event.id) > 0;
                  });
    for (ContactEvent& event : events) {
      if (event.change == ContactChange::kBegin) began_.insert(event.id);
      if (event.change == ContactChange::kPersist && began_.contains(event.id))
        event.change = ContactChange::kBegin;
      if (event.change == ContactChange::kEnd) ended.push_back(event);
    }
    events.insert(events.end(), ended_.begin(), ended_.end());
    ended_.insert(ended_.end(), ended.begin(), ended.end());
  }

  [[nodiscard]] bool does_any_known_body_fly(const FrameReport& report) const {
    return std::any_of(others_.begin(), others_.end(), [&](BodyId other) {
      const bool is_unknown =
          std::any_of(report.unknown.begin(), report.unknown.end(),
                      [&](const UnknownBody& body) { return body.body == other; });
      const auto motion = session_.motion_of(other);
      return !is_unknown && motion && !is_at_rest(*motion);
    });
  }

  [[nodiscard]] bool does_anybody_fly(const FrameReport& report) const {
    if (scene_.watches_all) return does_any_known_body_fly(report);
    for (const PairAnswer& pair : report.answers)
      for (const BodyId body : {pair.a, pair.b})
        if (const auto motion = session_.motion_of(body);
            pair.asked && others_.contains(body) && !is_at_rest(*motion))
          return true;
    return false;
  }

  // Of a pair that is put off, what it was answered by an earlier update of this frame counts.
  void take_turns(FrameReport& report) {
    for (PairAnswer& pair : report.answers) {
      const auto key = std::pair(pair.a, pair.b);
      if (pair.asked) {
        answered_[key] = pair;
      } else if (const auto at = answered_.find(key); pair.put_off && at != answered_.end()) {
        pair = at->second;
      }
    }
  }

  // Of this frame.
  [[nodiscard]] double left_s() const { return 1 / scene_.frame_rate_hz - frame_clock_.seconds(); }

  // Asks again within the frame while detail is on its way and time is left; the last answers
  // count.
  Status fly_frame(std::uint64_t frame) {
    double load_s = 0, refine_s = 0, tree_s = 0, query_s = 0;
    answered_.clear();
    for (bool again = false;; again = true) {
      Result<FrameReport> result =
          update(frame, again ? no_motions_ : with_heard(motions(frame)), scene_.budget_s);
      NEARMESH_RETURN_IF_ERROR(result);
      NEARMESH_RETURN_IF_ERROR(check_solids());
      if (!again) frame_clock_ = update_clock_;
      FrameReport& report = result.value();
      take_turns(report);
      log(report);
      note_certified(report);
      load_s += report.load_s;
      refine_s += report.refine_s;
      tree_s += report.tree_s;
      query_s += report.query_s;
      const bool more_time = left_s() > 0.25 / scene_.frame_rate_hz + 0.002;
      if (report.all_certified() || !more_time || stop_requested != 0) {
        NEARMESH_RETURN_IF_ERROR(record(frame, report));
        break;
      }
      pause_after(frame_clock_.seconds(), 0.001);
    }
    summary_.load.add(load_s);
    summary_.refine.add(refine_s);
    summary_.tree.add(tree_s);
    summary_.query.add(query_s);
    ++summary_.frames;
    return Status::ok();
  }

  // Frame by frame to the end of both streams: whoever reads along, or after this process was
  // killed, finds it there.
  Status record(std::uint64_t frame, const FrameReport& report) {
    for (const PairAnswer& pair : report.answers) {
      if (pair.put_off) ++summary_.put_off;
      ++summary_.by_status[static_cast<std::size_t>(pair.answer.status)];
      summary_.contact_pairs += pair.answer.pair_total;
      if (!options_.json && !answers_) continue;
      const std::string line =
          answer_to_json(frame, time_s_, pair, report, session_, scene_.session.any).dump() + '\n';
      if (options_.json) std::fputs(line.c_str(), stdout);
      if (answers_) NEARMESH_RETURN_IF_ERROR(answers_->write(line));
    }
    if (scene_.watches_all) NEARMESH_RETURN_IF_ERROR(record_others(frame, report));
    began_.clear();
    ended_.clear();
    if (options_.json) NEARMESH_RETURN_IF_ERROR(flush_standard_output());
    return answers_ ? answers_->put_in_place() : Status::ok();
  }

  // The pairs that are not listed: free by bounds, or unknown.
  Status record_others(std::uint64_t frame, const FrameReport& report) {
    summary_.free_by_bounds += report.free_by_bounds.pairs;
    summary_.unknown += report.unknown_pairs;
    if (!options_.json && !answers_) return Status::ok();
    const std::string line = others_to_json(frame, time_s_, report, session_).dump() + '\n';
    if (options_.json) std::fputs(line.c_str(), stdout);
    return answers_ ? answers_->write(line) : Status::ok();
  }

  void note_certified(const FrameReport& report) {
    if (summary_.first_certified_s) return;
    if (report.free_by_bounds.pairs > 0) summary_.first_certified_s = clock_.seconds();
    for (const PairAnswer& pair : report.answers)
      if (is_certified(pair.answer.status)) {
        summary_.first_certified_s = clock_.seconds();
        return;
      }
  }

  // What every frame may say: trouble, which is rare, and on demand what was done.
  void log(const FrameReport& report) {
    for (const std::string& line : report.complaints) log_.warn("{}", line);
    log_.debug("{} answers, all certified: {}, {} batches wait; {:.3f} ms to refine, {:.3f} to ask",
               report.answers.size(), report.all_certified(), report.batches_waiting,
               1e3 * (report.load_s + report.refine_s + report.tree_s), 1e3 * report.query_s);
    if (metrics_ != nullptr) metrics_->set(session_.status());
  }

  void show_progress(std::uint64_t done) const {
    const bool terminal = ::isatty(STDERR_FILENO) != 0;
    if (scene_.frames == Scene::kForEver ||
        (!terminal && done % std::max<std::uint64_t>(1, scene_.frames / 4) != 0))
      return;
    const auto& [free, contact, partial, uncertain, contained] = summary_.by_status;
    std::fprintf(
        stderr,
        terminal ? "\rframe %llu of %llu: %llu free, %llu contact or contained, %llu uncertain "
                 : "frame %llu of %llu: %llu free, %llu contact or contained, %llu uncertain\n",
        static_cast<unsigned long long>(done), static_cast<unsigned long long>(scene_.frames),
        static_cast<unsigned long long>(free), static_cast<unsigned long long>(contact + contained),
        static_cast<unsigned long long>(partial + uncertain));
  }

  const RunOptions& options_;
  const Scene& scene_;
  const Stopwatch clock_{};
  const DdsChannel& channel_;  ///< the session's
  const std::unique_ptr<Ros2Flight> ros2_;
  ExerciseClock exercise_;
  double time_s_ = 0;  ///< of the last update
  /// Since the last update's time, and that of the frame's first one.
  Stopwatch update_clock_, frame_clock_;
  const std::vector<Session::OwnMotion> no_motions_;
  spdlog::logger& log_ = wire::program::log("session");
  std::unique_ptr<wire::program::MetricsServer> metrics_;
  std::optional<OutputFile> answers_;
  Session session_;
  std::set<std::uint64_t> began_;  ///< contacts, in updates of this frame
  std::vector<ContactEvent> ended_;
  std::set<BodyId> others_;                                   ///< bodies that it does not move
  std::map<std::pair<BodyId, BodyId>, PairAnswer> answered_;  // in this frame
  Summary summary_;
};

}  // namespace

Outcome run(const RunOptions& options) {
  Stopwatch clock;
  // Nothing was begun yet: whoever stops it need not wait for a long trajectory.
  wire::program::end_on_signals();
  Result<Scene> scene = read_scene(options.scene);
  NEARMESH_RETURN_IF_ERROR(scene);
  wire::program::stop_on_signals();
  if (options.ros2.is_wanted) scene.value().session.contacts = true;
  wire::program::log_fastdds();
  wire::program::log_network(options.channel.transport);
  DdsChannelOptions bus = options.channel;
  if (!scene.value().watches_all) {
    bus.bodies.emplace();
    // Which bodies ROS 2 moves is not known yet: any that may move.
    const bool asks_ros2 = !options.ros2_poses.empty();
    for (const BodyOfScene& body : scene.value().bodies) {
      bus.bodies->push_back(body.name);
      if (!body.trajectory.empty() || (asks_ros2 && !body.fixed_pose))
        bus.moves.push_back(body.name);
    }
  }
  Result<std::unique_ptr<DdsChannel>> channel = DdsChannel::create(bus);
  NEARMESH_RETURN_IF_ERROR(channel);
  const wire::TransportOptions& transport = options.channel.transport;
  spdlog::info("joined domain {}, topics {}/*, transport {}, as peer {}", transport.domain,
               transport.prefix, wire::to_string(transport.transport),
               wire::called(channel.value()->own_id(), wire::name_of_process(transport.name)));
  if (options.wait_recorder_s) {
    NEARMESH_RETURN_IF_ERROR(wait_for_recorder(*channel.value(), options));
    clock = Stopwatch();
  }
  auto ros2 = Ros2Flight::create(options, scene.value());
  NEARMESH_RETURN_IF_ERROR(ros2);
  Flight flight(options, scene.value(), std::move(channel).value(), std::move(ros2).value(), clock);
  NEARMESH_RETURN_IF_ERROR(flight.prepare());
  const Status started = flight.wait_for_start();
  if (!started.is_ok())
    return {started, flight.identity().is_ok() ? 1 : wire::program::kIdentityEnded};
  NEARMESH_RETURN_IF_ERROR(flight.fly());
  NEARMESH_RETURN_IF_ERROR(flight.print_summary());
  flight.keep_detail();
  if (Status identity = flight.identity(); !identity.is_ok())
    return {std::move(identity), wire::program::kIdentityEnded};
  flight.stay();
  return Status::ok();
}
}  // namespace nearmesh::subscriber::program
