// SPDX-License-Identifier: Apache-2.0
// FlightGear as a peer: its aircraft, told by its own generic protocol, over nearmesh's terrain.
// What nearmesh answers is shown in FlightGear, and where it is told to, the aircraft is put where
// it may be. See README.md in this folder.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <map>
#include <set>
#include <thread>

#include "geodesy.hpp"
#include "link.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

namespace {

using namespace flightgear;
namespace nm = nearmesh::subscriber;

enum class OnContact { kShow, kHold, kPush };
enum class OnUncertain { kShow, kHold };

struct Options {
  nearmesh::wire::TransportOptions transport;
  std::vector<double> origin;
  std::string terrain = "terrain", aircraft = "aircraft", callsign = "flightgear";
  std::uint16_t port = 5560;
  OnContact on_contact = OnContact::kShow;
  OnUncertain on_uncertain = OnUncertain::kShow;
  double seconds = 0;
  bool wait_recorder = false;
};

constexpr double kFrame_s = 0.1;     ///< a frame without a line from FlightGear
constexpr double kBudget_s = 0.01;   ///< of an update
constexpr double kMaxPoseAge_s = 1;  ///< without a line so long nothing is certified
/// Beyond the certified way out, since a place is rounded on its way.
constexpr double kSkin_m = 0.05;
constexpr double kMostTurnStep_s = 0.5;
constexpr double kHardlyMoves_mps = 1e-9;
constexpr double kSayStep_s = 1;  ///< between two lines for the pilot
constexpr int kMostLines = 1000;  ///< that are read before the next update

volatile std::sig_atomic_t stop_requested = 0;

/// The exercise's clock: here that of the machines, which must be set alike.
double exercise_time_s() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// What an update says of the own aircraft.
struct Verdict {
  enum class State { kFree, kContact, kUncertain } state = State::kFree;
  std::string with, why;  ///< the other body; why nothing is certified
  std::uint64_t face_pairs = 0;
  double clearance_m = 1e9, depth_m = 0;  ///< of what is near, and of the terrain in any case
  /// In contact: how the aircraft gets out, if that is known.
  std::optional<Vector> way_out_m;
};

/// Contact goes first: what touches does touch, whatever else is unknown.
Verdict judge(const nm::FrameReport& report, const nm::Session& session, nm::BodyId own) {
  Verdict verdict;
  const auto uncertain = [&](const std::string& with, const std::string& why) {
    if (verdict.state != Verdict::State::kFree) return;
    verdict.state = Verdict::State::kUncertain;
    verdict.with = with;
    verdict.why = why;
  };
  Vector out_m{};
  bool knows_out = true;
  for (const nm::PairAnswer& pair : report.answers) {
    if (pair.a != own && pair.b != own) continue;
    const std::string with = session.name_of(pair.a == own ? pair.b : pair.a);
    const nearmesh::Answer& answer = pair.answer;
    if (answer.pair_total > 0 || answer.status == nearmesh::AnswerStatus::kContained) {
      if (verdict.state != Verdict::State::kContact) verdict.with = with;
      verdict.state = Verdict::State::kContact;
      verdict.face_pairs += answer.pair_total;
      const bool has_end = pair.depth && std::isfinite(pair.depth->at_most_m);
      knows_out = knows_out && has_end;
      if (!has_end) continue;
      verdict.depth_m = std::max(verdict.depth_m, pair.depth->at_most_m);
      const double to_own = pair.b == own ? 1 : -1;  // the answer moves B
      for (std::size_t k = 0; k < 3; ++k)
        out_m[k] += to_own * (pair.depth->separation_m[k] + kSkin_m * pair.depth->direction[k]);
    } else if (nearmesh::is_certified(answer.status)) {
      verdict.clearance_m = std::min(verdict.clearance_m, answer.clearance_m);
    } else {
      uncertain(with, pair.reason.empty() ? pair.awaited : pair.reason);
    }
  }
  for (const nm::UnknownBody& unknown : report.unknown)
    uncertain(session.name_of(unknown.body), unknown.reason);
  if (verdict.state != Verdict::State::kFree) verdict.clearance_m = 0;
  if (verdict.state == Verdict::State::kContact && knows_out) verdict.way_out_m = out_m;
  return verdict;
}

const char* to_string(Verdict::State state) {
  switch (state) {
    case Verdict::State::kFree:
      return "free";
    case Verdict::State::kContact:
      return "contact";
    case Verdict::State::kUncertain:
      break;
  }
  return "uncertain";
}

std::string line_of(const Verdict& verdict) {
  std::string line = std::string("nearmesh: ") + to_string(verdict.state);
  return verdict.with.empty() ? line : line + " with " + verdict.with;
}

/// Makes motions of states, which come one after the other.
class Mover {
 public:
  explicit Mover(const SceneFrame& frame) : frame_(frame) {}

  nearmesh::Motion motion_of(const AircraftState& state) {
    nearmesh::Motion motion;
    motion.pose.translation_m = frame_.to_scene_m(state.place);
    motion.pose.rotation =
        frame_.turn(state.place, attitude_of(state.roll_deg, state.pitch_deg, state.heading_deg));
    // While FlightGear is paused it still tells its speed.
    const double step_s = state.elapsed_s - elapsed_s_;
    if (step_s > 0)
      motion.linear_velocity_mps = frame_.turn(state.place, state.north_east_down_mps);
    if (step_s > 0 && step_s <= kMostTurnStep_s)
      motion.angular_velocity_radps =
          nearmesh::motion_between(pose_, motion.pose, step_s).angular_velocity_radps;
    // Never at rest: who says nothing more shall not be taken for one who stays where he is.
    if (nearmesh::is_at_rest(motion)) motion.linear_velocity_mps[2] = kHardlyMoves_mps;
    elapsed_s_ = state.elapsed_s;
    pose_ = motion.pose;
    return motion;
  }

 private:
  const SceneFrame& frame_;
  double elapsed_s_ = 1e300;  ///< of the state before
  nearmesh::Pose pose_;
};

struct Summary {
  std::uint64_t states = 0, refused = 0, free = 0, contact = 0, uncertain = 0, held = 0, pushed = 0;
};

/// Shows answers, and puts the aircraft where it may be.
class Cockpit {
 public:
  Cockpit(const Options& options, const SceneFrame& frame, Link& link, Summary& summary)
      : options_(options), frame_(frame), link_(link), summary_(summary) {}

  /// `told`: where the aircraft is, if FlightGear told it for this frame.
  void use(const Verdict& verdict, const std::optional<Vector>& told_m, double now_s) {
    link_.show({.status = to_string(verdict.state),
                .with = verdict.with,
                .face_pairs = verdict.face_pairs,
                .clearance_m = verdict.clearance_m,
                .depth_m = verdict.depth_m});
    const std::string line = line_of(verdict);
    if (line != said_ && now_s - said_s_ >= kSayStep_s) {
      link_.say(line);
      said_ = line;
      said_s_ = now_s;
    }
    if (line != printed_) {
      printed_ = line;
      print(verdict);
    }
    if (told_m) move(verdict, *told_m);
  }

 private:
  void print(const Verdict& verdict) const {
    std::printf("%s", printed_.c_str());
    if (!verdict.why.empty()) std::printf(": %s", verdict.why.c_str());
    if (verdict.state == Verdict::State::kContact)
      std::printf(": %llu pairs of faces", static_cast<unsigned long long>(verdict.face_pairs));
    if (verdict.way_out_m) std::printf(", at most %.3f m deep", verdict.depth_m);
    std::printf("\n");
    std::fflush(stdout);
  }
  void move(const Verdict& verdict, const Vector& at_m) {
    switch (verdict.state) {
      case Verdict::State::kFree:
        ++summary_.free;
        free_m_ = at_m;
        return;
      case Verdict::State::kContact:
        ++summary_.contact;
        if (options_.on_contact == OnContact::kPush && verdict.way_out_m) {
          Vector to_m = at_m;
          for (std::size_t k = 0; k < 3; ++k) to_m[k] += (*verdict.way_out_m)[k];
          link_.put(frame_.to_place(to_m));
          ++summary_.pushed;
        } else if (options_.on_contact != OnContact::kShow) {
          hold();
        }
        return;
      case Verdict::State::kUncertain:
        ++summary_.uncertain;
        if (options_.on_uncertain == OnUncertain::kHold) hold();
    }
  }
  /// Back to where it was certified free last.
  void hold() {
    if (!free_m_) return;
    link_.put(frame_.to_place(*free_m_));
    ++summary_.held;
  }

  const Options& options_;
  const SceneFrame& frame_;
  Link& link_;
  Summary& summary_;
  std::optional<Vector> free_m_;
  std::string said_, printed_;
  double said_s_ = 0;
};

int fail(const std::string& message) {
  std::fprintf(stderr, "flightgear: %s\n", message.c_str());
  return 1;
}

/// The newest state that has come, waiting for one so long at most.
std::optional<AircraftState> take_state(Link& link, double seconds, std::set<std::string>& said,
                                        Summary& summary) {
  std::optional<AircraftState> newest;
  std::optional<std::string> line = link.take(seconds);
  for (int taken = 0; line && taken < kMostLines; ++taken, line = link.take(0)) {
    std::string why;
    const std::optional<AircraftState> state = parse_state(*line, why);
    if (!state) {
      ++summary.refused;
      constexpr std::size_t kMostSaid = 20;
      if (said.size() < kMostSaid && said.insert(why).second)
        std::fprintf(stderr, "flightgear: refused: %s\n", why.c_str());
    } else if (state->flies) {
      ++summary.states;
      newest = state;
    }
  }
  return newest;
}

int run(Options options) {
  std::string why;
  const std::unique_ptr<Link> link = Link::open(options.port, why);
  if (link == nullptr) return fail(why);
  const SceneFrame frame(
      {options.origin[0], options.origin[1], options.origin.size() > 2 ? options.origin[2] : 0});

  nm::DdsChannelOptions bus;
  options.transport.name = options.callsign;  // what operators see
  bus.transport = options.transport;
  auto channel = nm::DdsChannel::create(bus);
  if (!channel.is_ok()) return fail(channel.status().message());
  std::printf("aircraft %s, states at UDP port %u\n", options.callsign.c_str(), options.port);
  std::fflush(stdout);
  while (options.wait_recorder && !channel.value()->has_recorder() && stop_requested == 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  nm::Session session(std::move(channel).value(), {.max_pose_age_s = kMaxPoseAge_s, .depth = true});
  const auto ground = session.add_body({.name = "terrain", .model = options.terrain});
  if (!ground.is_ok()) return fail(ground.status().message());
  if (const auto placed = session.place_body(ground.value(), {}); !placed.is_ok())
    return fail(placed.message());
  // FlightGear may fall silent while this program goes on.
  const auto own = session.add_body({.name = options.callsign,
                                     .model = options.aircraft,
                                     .own = true,
                                     .max_pose_age_s = kMaxPoseAge_s});
  if (!own.is_ok()) return fail(own.status().message());
  if (const auto watched = session.watch(ground.value(), own.value()); !watched.is_ok())
    return fail(watched.message());
  session.watch_all();
  session.discover_bodies();  // other people's aircraft

  Summary summary;
  Mover mover(frame);
  Cockpit cockpit(options, frame, *link, summary);
  std::set<std::string> said;
  const double begin_s = exercise_time_s();
  std::uint64_t number = 0;
  double time_s = begin_s;  // of the frame
  bool is_certified = false;
  while (stop_requested == 0 &&
         (options.seconds == 0 || exercise_time_s() - begin_s < options.seconds)) {
    const auto state = take_state(*link, is_certified ? 0.02 : 0.002, said, summary);
    // A state begins a frame; until the next one it is asked again while detail is on its way.
    if (state || exercise_time_s() - time_s > kFrame_s) {
      ++number;
      time_s = exercise_time_s();
    } else if (is_certified) {
      continue;
    }
    std::vector<nm::Session::OwnMotion> motions;
    if (state) motions.push_back({own.value(), mover.motion_of(*state)});
    const auto report = session.update(number, time_s, motions, kBudget_s);
    if (!report.is_ok()) return fail(report.status().message());
    for (const std::string& complaint : report.value().complaints)
      if (said.insert(complaint).second)  // they come as often as their cause
        std::fprintf(stderr, "flightgear: nearmesh: %s\n", complaint.c_str());
    const Verdict verdict = judge(report.value(), session, own.value());
    is_certified = report.value().all_certified();
    cockpit.use(verdict,
                state ? std::optional(motions.front().motion.pose.translation_m) : std::nullopt,
                exercise_time_s());
  }
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf(
      "%s: %llu states, %llu refused; %llu free, %llu contact, %llu uncertain; %llu held, %llu "
      "pushed out\n",
      options.callsign.c_str(), count(summary.states), count(summary.refused), count(summary.free),
      count(summary.contact), count(summary.uncertain), count(summary.held), count(summary.pushed));
  if (std::fflush(stdout) != 0) return std::perror("standard output"), 1;  // a full disk, say
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Flies FlightGear's aircraft over nearmesh's terrain, and shows there what touches. Needs a "
      "nearmesh-publisher, and FlightGear with the protocols in examples/flightgear."};
  app.set_version_flag("--version", "flightgear of nearmesh " NEARMESH_VERSION);
  Options options;
  app.add_option("--origin", options.origin,
                 "LAT,LON[,HEIGHT] where the terrain's origin is: degrees, metres above the "
                 "ellipsoid")
      ->delimiter(',')
      ->expected(2, 3)
      ->required();
  app.option_defaults()->always_capture_default();
  app.add_option("--domain", options.transport.domain, "DDS domain")->check(CLI::Range(0, 232));
  app.add_option("--interface", options.transport.interface, "for DDS: a name or an address");
  app.add_option("--prefix", options.transport.prefix, "of DDS topics");
  app.add_option("--terrain", options.terrain, "model of the ground");
  app.add_option("--aircraft", options.aircraft, "model of the aircraft: x to its nose, z up");
  app.add_option("--callsign", options.callsign, "name of the aircraft on the bus");
  app.add_option("--port", options.port, "the first of four UDP ports on this machine")
      ->check(CLI::Range(1024, 65000));
  app.add_option("--on-contact", options.on_contact,
                 "show; hold (back to where it was certified free last); push (out along the "
                 "answer's depth)")
      ->transform(CLI::CheckedTransformer(std::map<std::string, OnContact>{
          {"show", OnContact::kShow}, {"hold", OnContact::kHold}, {"push", OnContact::kPush}}))
      ->default_str("show");
  app.add_option("--on-uncertain", options.on_uncertain, "show; hold")
      ->transform(CLI::CheckedTransformer(std::map<std::string, OnUncertain>{
          {"show", OnUncertain::kShow}, {"hold", OnUncertain::kHold}}))
      ->default_str("show");
  app.add_option("--seconds", options.seconds, "end after so long; 0: at Ctrl-C")
      ->check(CLI::Range(0.0, 1e6));
  app.add_flag("--wait-recorder", options.wait_recorder,
               "begin when nearmesh-subscriber record listens");
  try {
    app.parse(argc, argv);
    if (std::abs(options.origin[0]) > 90 || std::abs(options.origin[1]) > 180)
      throw CLI::ValidationError("--origin", "latitude within 90 degrees, longitude within 180");
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  std::signal(SIGINT, [](int) { stop_requested = 1; });
  std::signal(SIGTERM, [](int) { stop_requested = 1; });
  return run(options);
}
