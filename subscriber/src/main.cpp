// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber: a peer that flies its bodies along trajectories and answers, frame by frame, what touches.
// A thin user of the subscriber library.

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <exception>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "commands.hpp"
#include "nearmesh/core/base/hash.hpp"
#include "nearmesh/core/base/resources.hpp"
#include "nearmesh/core/base/stopwatch.hpp"
#include "nearmesh/core/query/contacts_json.hpp"
#include "nearmesh/subscriber/dds_channel.hpp"
#include "scene.hpp"

namespace nearmesh::subscriber {

volatile std::sig_atomic_t stop_requested = 0;

namespace {

void request_stop(int) { stop_requested = 1; }

struct Options {
  std::string scene, answers;
  DdsChannelOptions channel;
  bool json = false;
};

// Milliseconds of one phase, frame by frame.
class Timings {
 public:
  void add(double seconds) { ms_.push_back(seconds * 1e3); }
  [[nodiscard]] double quantile(double q) {
    if (ms_.empty()) return 0;
    std::sort(ms_.begin(), ms_.end());
    return ms_[static_cast<std::size_t>(q * static_cast<double>(ms_.size() - 1) + 0.5)];
  }

 private:
  std::vector<double> ms_;
};

struct Summary {
  std::array<std::uint64_t, 5> by_status{};
  std::uint64_t frames = 0, contact_pairs = 0;
  Timings load, refine, tree, query;
  double first_certified_s = -1, seconds = 0;
  SessionStats stats;
};

nlohmann::ordered_json to_json(std::uint64_t frame, const PairAnswer& pair, const Scene& scene) {
  const auto body_of = [&](const std::string& name) {
    const auto at = std::find_if(scene.bodies.begin(), scene.bodies.end(),
                                 [&](const SceneBody& b) { return b.name == name; });
    return at == scene.bodies.end() ? SceneBody{} : *at;
  };
  const auto pose = [](const Pose& p) {
    std::vector<double> x(p.rotation.begin(), p.rotation.end());
    x.insert(x.end(), p.translation_m.begin(), p.translation_m.end());
    return x;
  };
  const auto finite = [](double x) -> nlohmann::ordered_json {
    if (std::isfinite(x)) return x;
    return nullptr;
  };
  const Answer& answer = pair.answer;
  nlohmann::ordered_json line = {{"frame", frame},
                                 {"a", pair.body_a},
                                 {"b", pair.body_b},
                                 {"model_a", body_of(pair.body_a).model},
                                 {"model_b", body_of(pair.body_b).model},
                                 {"solid_a", body_of(pair.body_a).solid},
                                 {"solid_b", body_of(pair.body_b).solid},
                                 {"status", to_string(answer.status)},
                                 {"pairs", answer.pair_total},
                                 {"pairs_digest", std::to_string(digest(answer.pairs))},
                                 {"digest", to_hex(digest(answer))},
                                 {"clearance_m", finite(answer.clearance_m)},
                                 {"uncertainty_m", finite(answer.uncertainty_m)},
                                 {"safe_horizon_s", finite(pair.safe_horizon_s)},
                                 {"missing", answer.missing_a.size() + answer.missing_b.size()},
                                 {"pose_a", pose(pair.pose_a)},
                                 {"pose_b", pose(pair.pose_b)}};
  if (answer.status == AnswerStatus::kContained) line["contained"] = to_string(answer.contained);
  if (pair.swept) {
    line["swept_status"] = to_string(pair.swept->status);
    line["free_until_s"] = pair.swept->free_until_s;
    line["hit_s"] = finite(pair.swept->hit_s);
  }
  if (!pair.reason.empty()) line["reason"] = pair.reason;
  if (pair.contacts) {
    line["patches"] = pair.contacts->patches;
    line["position_error_m"] = pair.contacts->position_error_m;
  }
  return line;
}

nlohmann::ordered_json to_json(Summary& s) {
  const auto phase = [](Timings& t) {
    return nlohmann::ordered_json{{"median_ms", t.quantile(0.5)}, {"p99_ms", t.quantile(0.99)}};
  };
  return {{"summary",
           {{"frames", s.frames},
            {"free", s.by_status[0]},
            {"contact", s.by_status[1]},
            {"partial", s.by_status[2]},
            {"uncertain", s.by_status[3]},
            {"contained", s.by_status[4]},
            {"contact_pairs", s.contact_pairs},
            {"received_bytes", s.stats.batch_bytes + s.stats.header_bytes},
            {"batch_bytes", s.stats.batch_bytes},
            {"header_bytes", s.stats.header_bytes},
            {"batches", s.stats.batches},
            {"requests", s.stats.requests},
            {"sequence_gaps", s.stats.sequence_gaps},
            {"mesh_bytes", s.stats.mesh_bytes},
            {"refine", phase(s.refine)},
            {"tree", phase(s.tree)},
            {"query", phase(s.query)},
            {"load", phase(s.load)},
            {"held_splits", s.stats.held_splits},
            {"slots", s.stats.slots},
            {"exact_faces", s.stats.exact_faces},
            {"tree_bytes", s.stats.tree_bytes},
            {"first_certified_s", s.first_certified_s},
            {"seconds", s.seconds},
            {"peak_memory_bytes", peak_memory_bytes()}}}};
}

void print_text(Summary& s) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  const auto& [free, contact, partial, uncertain, contained] = s.by_status;
  std::printf("  answers       %llu free, %llu contact, %llu partial, %llu uncertain", count(free),
              count(contact), count(partial), count(uncertain));
  if (contained > 0) std::printf(", %llu contained", count(contained));
  std::printf("; %llu touching face pairs\n", count(s.contact_pairs));
  std::printf(
      "  received      %llu bytes of %llu (%.2f %%): headers %llu, %llu batches %llu; %llu "
      "requests\n",
      count(s.stats.batch_bytes + s.stats.header_bytes), count(s.stats.mesh_bytes),
      s.stats.mesh_bytes > 0
          ? 100.0 * static_cast<double>(s.stats.batch_bytes + s.stats.header_bytes) /
                static_cast<double>(s.stats.mesh_bytes)
          : 0.0,
      count(s.stats.header_bytes), count(s.stats.batches), count(s.stats.batch_bytes),
      count(s.stats.requests));
  std::printf(
      "  per frame     T_R %.3f / %.3f   T_B %.3f / %.3f   T_Q %.3f / %.3f   T_L %.3f / %.3f ms "
      "(median / 99 %%)\n",
      s.refine.quantile(0.5), s.refine.quantile(0.99), s.tree.quantile(0.5), s.tree.quantile(0.99),
      s.query.quantile(0.5), s.query.quantile(0.99), s.load.quantile(0.5), s.load.quantile(0.99));
  std::printf(
      "  held          %llu splits in %llu slots, %llu exact faces, tree %.2f MB; peak memory %.0f "
      "MB\n",
      count(s.stats.held_splits), count(s.stats.slots), count(s.stats.exact_faces),
      static_cast<double>(s.stats.tree_bytes) / 1e6,
      static_cast<double>(peak_memory_bytes()) / 1e6);
  std::printf("  first         certified answer %.3f s after the start; %llu frames in %.1f s\n",
              s.first_certified_s, count(s.frames), s.seconds);
}

// One peer, from the scene to the summary.
class Flight {
 public:
  /// `clock` runs since the program's start.
  Flight(const Options& options, const Scene& scene, std::unique_ptr<Channel> channel,
         Stopwatch clock)
      : options_(options),
        scene_(scene),
        clock_(clock),
        session_(std::move(channel), scene.session) {}

  Status prepare() {
    if (!options_.answers.empty()) {
      answers_.open(options_.answers);
      if (!answers_) return {StatusCode::kIo, options_.answers + ": cannot create"};
    }
    for (const SceneBody& body : scene_.bodies) {
      NEARMESH_RETURN_IF_ERROR(
          session_.add_body(body.name, body.model, !body.trajectory.empty(), body.solid));
      if (body.fixed_pose)
        NEARMESH_RETURN_IF_ERROR(session_.place_body(body.name, *body.fixed_pose));
    }
    for (const auto& [a, b] : scene_.pairs) NEARMESH_RETURN_IF_ERROR(session_.watch(a, b));
    return Status::ok();
  }

  // Holds the first frame until publishers and other peers have been heard, so that all start together.
  Status wait_for_start() {
    std::string reason;
    for (bool asked = false; stop_requested == 0; asked = true) {
      Result<FrameReport> report = session_.update(0, 0, asked ? no_motions_ : motions(0), 1);
      if (!report.is_ok()) return report.status();
      NEARMESH_RETURN_IF_ERROR(check_solids());
      log(report.value());
      note_certified(report.value());
      if (report.value().all_certified()) return Status::ok();
      for (const PairAnswer& pair : report.value().answers)
        if (!pair.reason.empty()) reason = pair.reason;
      if (clock_.seconds() > scene_.start_timeout_s)
        return {StatusCode::kNotFound,
                "no certified answer within " + std::to_string(scene_.start_timeout_s) + " s: " +
                    (reason.empty() ? "detail is missing and no publisher sends it" : reason)};
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return Status::ok();
  }

  Status fly() {
    const double period_s = 1 / scene_.frame_rate_hz;
    const Stopwatch clock;
    for (std::uint64_t frame = 0; frame < scene_.frames && stop_requested == 0; ++frame) {
      const double end_s = static_cast<double>(frame + 1) * period_s;
      NEARMESH_RETURN_IF_ERROR(fly_frame(frame, end_s, clock));
      show_progress(frame + 1);
      while (clock.seconds() < end_s && stop_requested == 0)
        std::this_thread::sleep_for(
            std::chrono::duration<double>(std::min(0.01, std::max(0.0, end_s - clock.seconds()))));
    }
    summary_.seconds = clock.seconds();
    summary_.stats = session_.stats();
    return Status::ok();
  }

  void print_summary() {
    if (::isatty(STDERR_FILENO) != 0) std::fprintf(stderr, "\r%40s\r", "");
    if (options_.json) {
      std::printf("%s\n", to_json(summary_).dump().c_str());
    } else {
      print_text(summary_);
    }
    if (answers_.is_open()) answers_ << to_json(summary_).dump() << '\n';
  }

 private:
  std::vector<Session::OwnMotion> motions(std::uint64_t frame) const {
    std::vector<Session::OwnMotion> all;
    for (const SceneBody& body : scene_.bodies) {
      if (body.trajectory.empty()) continue;
      const std::size_t at = std::min<std::size_t>(frame, body.trajectory.size() - 1);
      all.push_back({body.name, body.trajectory[at]});
    }
    return all;
  }

  // A mistake in the scene that shows when headers come, or when a publisher changes a model.
  [[nodiscard]] Status check_solids() const {
    for (const SceneBody& body : scene_.bodies)
      if (const SpmHeader* header = session_.header_of(body.name); body.solid && header != nullptr)
        NEARMESH_RETURN_IF_ERROR(check_solid(*header, body.name));
    return Status::ok();
  }

  // Asks again within the frame while detail is on its way and time is left; the last answers count.
  Status fly_frame(std::uint64_t frame, double end_s, const Stopwatch& clock) {
    double load_s = 0, refine_s = 0, tree_s = 0, query_s = 0;
    for (bool again = false;; again = true) {
      Result<FrameReport> result = session_.update(
          frame, clock.seconds(), again ? no_motions_ : motions(frame), scene_.budget_s);
      if (!result.is_ok()) return result.status();
      NEARMESH_RETURN_IF_ERROR(check_solids());
      const FrameReport& report = result.value();
      log(report);
      note_certified(report);
      load_s += report.load_s;
      refine_s += report.refine_s;
      tree_s += report.tree_s;
      query_s += report.query_s;
      const bool more_time = clock.seconds() + 0.002 < end_s - 0.25 / scene_.frame_rate_hz;
      if (report.all_certified() || !more_time || stop_requested != 0) {
        record(frame, report);
        break;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    summary_.load.add(load_s);
    summary_.refine.add(refine_s);
    summary_.tree.add(tree_s);
    summary_.query.add(query_s);
    ++summary_.frames;
    return Status::ok();
  }

  void record(std::uint64_t frame, const FrameReport& report) {
    for (const PairAnswer& pair : report.answers) {
      ++summary_.by_status[static_cast<std::size_t>(pair.answer.status)];
      summary_.contact_pairs += pair.answer.pair_total;
      if (!options_.json && !answers_.is_open()) continue;
      const std::string line = to_json(frame, pair, scene_).dump();
      if (options_.json) std::printf("%s\n", line.c_str());
      if (answers_.is_open()) answers_ << line << '\n';
    }
  }

  void note_certified(const FrameReport& report) {
    if (summary_.first_certified_s >= 0) return;
    for (const PairAnswer& pair : report.answers)
      if (is_certified(pair.answer.status)) {
        summary_.first_certified_s = clock_.seconds();
        return;
      }
  }

  static void log(const FrameReport& report) {
    for (const std::string& line : report.complaints) spdlog::warn("{}", line);
  }

  void show_progress(std::uint64_t done) const {
    const bool terminal = ::isatty(STDERR_FILENO) != 0;
    if (!terminal && done % std::max<std::uint64_t>(1, scene_.frames / 4) != 0) return;
    const auto& [free, contact, partial, uncertain, contained] = summary_.by_status;
    std::fprintf(
        stderr,
        terminal ? "\rframe %llu of %llu: %llu free, %llu contact or contained, %llu uncertain "
                 : "frame %llu of %llu: %llu free, %llu contact or contained, %llu uncertain\n",
        static_cast<unsigned long long>(done), static_cast<unsigned long long>(scene_.frames),
        static_cast<unsigned long long>(free), static_cast<unsigned long long>(contact + contained),
        static_cast<unsigned long long>(partial + uncertain));
  }

  const Options& options_;
  const Scene& scene_;
  const Stopwatch clock_;
  const std::vector<Session::OwnMotion> no_motions_;
  std::ofstream answers_;
  Session session_;
  Summary summary_;
};

Status run(const Options& options) {
  const Stopwatch clock;
  const Result<Scene> scene = read_scene(options.scene);
  if (!scene.is_ok()) return scene.status();
  Result<std::unique_ptr<DdsChannel>> channel = DdsChannel::create(options.channel);
  if (!channel.is_ok()) return channel.status();
  Flight flight(options, scene.value(), std::move(channel).value(), clock);
  NEARMESH_RETURN_IF_ERROR(flight.prepare());
  NEARMESH_RETURN_IF_ERROR(flight.wait_for_start());
  NEARMESH_RETURN_IF_ERROR(flight.fly());
  flight.print_summary();
  return Status::ok();
}

}  // namespace

void add_transport_options(CLI::App& command, wire::TransportOptions& transport) {
  command.add_option("--domain", transport.domain, "DDS domain")
      ->capture_default_str()
      ->check(CLI::Range(0, 232));
  command.add_option("--prefix", transport.prefix, "First part of every topic's name")
      ->capture_default_str();
  command.add_option(
      "--interface", transport.interface,
      "Use one network interface only, by address or name; 127.0.0.1 needs no network");
  command.add_option("--security", transport.security,
                     "Folder of this program's identity, made by nearmesh-publisher make-security");
  command.add_option(
      "--peer", transport.initial_peers,
      "Address to look for publishers at, where multicast does not get through; repeatable");
}

}  // namespace nearmesh::subscriber

int main(int argc, char** argv) {
  CLI::App app{
      "A nearmesh peer: answers frame by frame whether bodies touch, and records sessions.",
      "nearmesh-subscriber"};
  app.require_subcommand(1);
  nearmesh::subscriber::Options options;
  CLI::App* command =
      app.add_subcommand("run", "Fly a scene (docs/scene.md) and answer every frame.");
  command->add_option("scene", options.scene, "Scene file (YAML)")->required();
  nearmesh::subscriber::add_transport_options(*command, options.channel.transport);
  command->add_option("--answers", options.answers, "Also write the JSON lines to this file");
  command->add_flag("--json", options.json,
                    "Print one JSON line per answer, and one with the summary");
  std::function<nearmesh::Status()> chosen;
  command->callback([&] { chosen = [&] { return nearmesh::subscriber::run(options); }; });
  nearmesh::subscriber::add_record_command(app, chosen);
  nearmesh::subscriber::add_info_command(app, chosen);
  nearmesh::subscriber::add_verify_command(app, chosen);
  try {
    spdlog::set_default_logger(spdlog::stderr_color_mt("nearmesh-subscriber"));
    spdlog::set_pattern("%H:%M:%S %n %^%l%$: %v");
    app.parse(argc, argv);
    std::signal(SIGINT, nearmesh::subscriber::request_stop);
    std::signal(SIGTERM, nearmesh::subscriber::request_stop);
    const nearmesh::Status status = chosen();
    if (status.is_ok()) return 0;
    spdlog::error("{}", status.message());
    return 1;
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-subscriber: %s\n", error.what());
    return 1;
  }
}
