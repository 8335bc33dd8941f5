// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber: its verbs, their flags and their help. Each is a thin user of the subscriber
// library.

#include <CLI/CLI.hpp>
#include <array>
#include <memory>

#include "commands.hpp"
#include "core/command/run_program.hpp"
#include "idl/program/command.hpp"
#include "idl/program/logging.hpp"
#include "idl/program/metrics.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber::program {
namespace {

/// Loggers (--log LOGGER=LEVEL), beside Fast DDS's.
constexpr std::array<const char*, 2> kRooms{"session", "record"};

/// How to join the bus, and what to log, as settings (--config, --print-config). Call last, when
/// the command has its other options; the transport must live as long as the command.
void add_transport_options(CLI::App& command, wire::TransportOptions& transport) {
  const auto settings = std::make_shared<wire::program::Settings>();
  wire::program::add_transport_settings(*settings, transport);
  wire::program::add_bus_flags(command, settings, transport, {kRooms.begin(), kRooms.end()});
}

constexpr const char* kRecording = "Recording (.db3, the first of its files, or .mcap)";
constexpr const char* kRos2Group = "ROS 2 (docs/ros2.md)";
/// What CLI11 gives for a flag that came without a value.
constexpr const char* kNoNumber = "true";

void add_ros2_options(CLI::App& command, Ros2Showing& options, const char* frame_help) {
  command
      .add_flag("--ros2", options.is_wanted,
                "Show bodies, contacts and meshes to ROS 2's tools: /tf, /nearmesh/contacts, "
                "/nearmesh/mesh")
      ->group(kRos2Group);
  command.add_option("--ros2-frame", options.frame, frame_help)
      ->capture_default_str()
      ->group(kRos2Group);
  command
      .add_option("--ros2-domain", options.domain,
                  "ROS_DOMAIN_ID of the others (default: the bus's domain)")
      ->check(CLI::Range(0, 232))
      ->group(kRos2Group);
}

/// Of a verb that ends by itself: who interrupts it shall not wait for that.
template <class Options>
Outcome run_to_its_end(const Options& options) {
  wire::program::end_on_signals();
  return run(options);
}

void add_run_command(CLI::App& app, Action& chosen) {
  CLI::App* command =
      app.add_subcommand("run", "Fly a scene (docs/scene.md) and answer every frame.");
  const auto options = std::make_shared<RunOptions>();
  command->add_option("scene", options->scene, "Scene file (YAML)");
  command->add_option("--answers", options->answers, "Also write the JSON lines to this file");
  command->add_flag("--json", options->json,
                    "Print one JSON line per answer, and one with the summary");
  const auto wait_s = std::make_shared<std::string>();
  CLI::Option* waits =
      command
          ->add_flag("--wait-recorder", *wait_s,
                     "Begin when nearmesh-subscriber record listens; with =SECONDS fail when none "
                     "came by then. Ctrl-C ends")
          ->option_text("[=SECONDS]")
          ->check(CLI::Validator(
              [](const std::string& text) {
                double seconds = 0;
                const bool is_right = text == kNoNumber ||
                                      (CLI::detail::lexical_cast(text, seconds) && !(seconds < 0));
                return is_right ? std::string() : "expected seconds, at least 0, found " + text;
              },
              "NONNEGATIVE"));
  add_ros2_options(*command, options->ros2,
                   "The frame that all poses are in, those shown and those taken");
  command
      ->add_option(
          "--ros2-poses", options->ros2_poses,
          "Bodies of the scene that ROS 2 moves: BODY or BODY=FRAME by /tf, BODY=/TOPIC by "
          "PoseStamped; several with commas")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->group(kRos2Group);
  const auto settings = std::make_shared<wire::program::Settings>();
  wire::program::add_transport_settings(*settings, options->channel.transport);
  wire::program::add_metrics_setting(*settings, options->metrics);
  wire::program::add_bus_flags(*command, settings, options->channel.transport,
                               {kRooms.begin(), kRooms.end()});
  end_help(*command, {"nearmesh-subscriber run scene.yaml --answers answers.jsonl",
                      "nearmesh-subscriber run scene.yaml --wait-recorder=30 --interface eth0"});
  command->callback([options, waits, wait_s, &chosen] {
    if (options->scene.empty()) throw CLI::RequiredError("scene");
    if (waits->count() > 0)
      options->wait_recorder_s = *wait_s == kNoNumber ? 0 : std::stod(*wait_s);
    chosen = [options] { return run(*options); };
  });
}

void add_record_command(CLI::App& app, Action& chosen) {
  CLI::App* command =
      app.add_subcommand("record", "Record all that is said on the bus, until Ctrl-C.");
  const auto options = std::make_shared<RecorderOptions>();
  command->add_option("-o,--output", options->path, "File to create (.db3, SQLite)")->required();
  command
      ->add_option("--topics", options->topics,
                   "Only these: " + CLI::detail::join(wire::recorded_topics(), ", "))
      ->delimiter(',');
  command
      ->add_option("--max-size", options->max_bytes,
                   "End at this size of the file, in bytes or as 100MB")
      ->transform(CLI::AsSizeValue(true));
  command->add_flag(
      "--split", options->split,
      "At --max-size go on in the next file: after flight.db3 in flight_1.db3, and so on");
  add_transport_options(*command, options->transport);
  end_help(*command, {"nearmesh-subscriber record -o flight.db3",
                      "nearmesh-subscriber record -o flight.db3 --max-size 1GB --split"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

void add_info_command(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "info",
      "Tell what is in a recording: who took part, models, samples by topic, answers by status.");
  const auto options = std::make_shared<InfoOptions>();
  command->add_option("recording", options->path, kRecording)->required();
  command->add_flag("--json", options->json, "Print one JSON object");
  end_help(*command, {"nearmesh-subscriber info flight.db3"});
  command->callback(
      [options, &chosen] { chosen = [options] { return run_to_its_end(*options); }; });
}

void add_verify_command(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "verify", "Compute each answer of a recording again, offline, and compare.");
  const auto options = std::make_shared<VerifyOptions>();
  command->add_option("recording", options->path, kRecording)->required();
  command
      ->add_option("--threads", options->threads,
                   "Threads, over which the recorded peers are spread")
      ->capture_default_str()
      ->check(CLI::Range(1, 256));
  command->add_option("--models", options->models,
                      "Folder with .spm files: from them peers are taken up again where the "
                      "recording lacks batches, as when the recorder came late");
  command->add_flag(
      "--allow-unproved", options->allow_unproved,
      "End with 0 also where answers could not be proved or reports are missing, if none "
      "is different");
  command->add_flag("--json", options->json, "Print one JSON object");
  end_help(*command, {"nearmesh-subscriber verify flight.db3 --models models"},
           "Exit codes. 0: every answer was proved. 1: answers are different, a report of what is "
           "free by bounds is wrong, a promise was broken, or the recording cannot be read. 2: "
           "wrong usage. 3: none is different, but some could not be proved. 4: none is different, "
           "but reports are malformed or missing, or there is none at all.");
  command->callback(
      [options, &chosen] { chosen = [options] { return run_to_its_end(*options); }; });
}

void add_export_command(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "export",
      "Write a recording for programs of others: .mcap for viewers of robotics, .glb as "
      "an animation; or a moment of it as a mesh file, .ply or .glb.");
  const auto options = std::make_shared<ExportOptions>();
  command->add_option("recording", options->session, kRecording)->required();
  command
      ->add_option("--time", options->time_s,
                   "Only the moment of an answer: the last one until so many seconds after the "
                   "first message, "
                   "or one in contact where there was one in the second before (default: the whole "
                   "recording)")
      ->check(CLI::NonNegativeNumber);
  command->add_option(
      "--peer", options->peer,
      "The peer to look at: its id as info lists it, or how that begins (default: one in contact)");
  command->add_option("--body", options->body,
                      "With --time: the body to look at (default: the first of the answer)");
  command->add_option(
      "--other", options->other,
      "With --time: the body that it is looked at against (default: the other of the answer)");
  command->add_option(
      "--models", options->models,
      "Without --time: folder with .spm files, for peers of which the recording lacks batches");
  command->add_option("-o,--output", options->out, "File to write, .mcap, .glb or .ply")
      ->required()
      ->check([](const std::string& path) {
        return path.ends_with(".mcap") || path.ends_with(".ply") || path.ends_with(".glb")
                   ? std::string()
                   : path + ": expected a name that ends with .mcap, .glb or .ply";
      });
  end_help(*command,
           {"nearmesh-subscriber export flight.db3 -o flight.mcap",
            "nearmesh-subscriber export flight.db3 --time 12.5 --body hull -o hull.glb"},
           "An .mcap file holds the whole recording, so info, verify and replay read it; and what "
           "ROS 2's tools draw: /tf, contacts, meshes, clearances. Colours of vertices in .glb and "
           ".ply: blue: exact (grey: of the other body); yellow to red: eps, a bound of the "
           "distance to the full mesh, from 1/8192 to 1/8 of the model's size; magenta: contact. "
           "How to open them in Foxglove, MeshLab, ParaView and Blender: docs/sessions.md.");
  command->callback([options, &chosen] {
    if (options->out.ends_with(".ply") && !options->time_s)
      throw CLI::RequiredError("a .ply file holds one moment: --time");
    chosen = [options] { return run_to_its_end(*options); };
  });
}

void add_report_command(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "report", "Write a recording as one page of HTML: a moving picture of it, and charts.");
  const auto options = std::make_shared<ReportOptions>();
  command->add_option("recording", options->session, kRecording)->required();
  command->add_option("-o,--output", options->folder, "Folder for index.html; made if need be")
      ->required();
  end_help(*command, {"nearmesh-subscriber report flight.db3 -o report"});
  command->callback(
      [options, &chosen] { chosen = [options] { return run_to_its_end(*options); }; });
}

void add_watch_command(CLI::App& app, Action& chosen) {
  const auto options = std::make_shared<WatchOptions>();
  CLI::App* command = app.add_subcommand(
      "watch",
      "Show the bus as it is now in a browser, or to ROS 2's tools: what each peer holds and "
      "answers, until Ctrl-C.");
  command->add_option("--http", options->http,
                      "Where the page is: PORT (on this machine alone) or ADDRESS:PORT");
  command->add_option("--models", options->models,
                      "Folder with .spm files: from them peers are taken up that began before this "
                      "program");
  command
      ->add_option(
          "--max-size", options->max_bytes,
          "Forget what was heard until then, and begin anew, where it takes so much of the "
          "disk, in bytes or as 100MB; in memory it takes about as much")
      ->transform(CLI::AsSizeValue(true))
      ->capture_default_str();
  add_ros2_options(*command, options->ros2, "The frame in which all is shown");
  add_transport_options(*command, options->transport);
  end_help(*command, {"nearmesh-subscriber watch --http 8642",
                      "nearmesh-subscriber watch --http 192.0.2.7:8642 --models models"});
  command->callback([options, &chosen] {
    if (options->http.empty() && !options->ros2.is_wanted)
      throw CLI::RequiredError("--http or --ros2");
    chosen = [options] { return run(*options); };
  });
}

void add_status_command(CLI::App& app, Action& chosen) {
  const auto options = std::make_shared<StatusOptions>();
  CLI::App* command = app.add_subcommand(
      "status", "Show publishers, peers, what they hold and how they do, and what is refused.");
  command->add_option("--seconds", options->seconds, "How long to listen")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 3600.0));
  command->add_flag("--watch", options->watch, "Go on until Ctrl-C, and print each --seconds");
  command->add_flag("--regions", options->regions,
                    "Also hear what each peer answers and asks: where its bodies meet, how far off "
                    "each answer may be and since when, what it lacks");
  command->add_flag("--json", options->json, "Print one JSON object a line instead of text");
  add_transport_options(*command, options->transport);
  end_help(*command, {"nearmesh-subscriber status",
                      "nearmesh-subscriber status --watch --regions --interface eth0"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

void add_doctor_command(CLI::App& app, Action& chosen) {
  const auto options = std::make_shared<DoctorOptions>();
  CLI::App* command = app.add_subcommand(
      "doctor",
      "Test the way to others for ten seconds: run it on both machines, or against a "
      "publisher.");
  command->add_option("--seconds", options->seconds, "How long to test")
      ->capture_default_str()
      ->check(CLI::Range(2.0, 600.0));
  command->add_flag("--json", options->json, "Print one JSON object");
  add_transport_options(*command, options->transport);
  end_help(*command, {"nearmesh-subscriber doctor --interface eth0"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

}  // namespace
}  // namespace nearmesh::subscriber::program

int main(int argc, char** argv) {
  using namespace nearmesh::subscriber::program;
  nearmesh::wire::program::
      stop_on_signals();  // first: whoever stops it while it starts shall see it end well
  CLI::App app{
      "A nearmesh peer: answers, frame by frame, whether bodies touch. Also records, proves and "
      "shows "
      "what is on the bus.",
      "nearmesh-subscriber"};
  app.require_subcommand(1);
  nearmesh::Action chosen;
  add_run_command(app, chosen);
  add_record_command(app, chosen);
  add_info_command(app, chosen);
  add_verify_command(app, chosen);
  add_export_command(app, chosen);
  add_report_command(app, chosen);
  add_watch_command(app, chosen);
  add_status_command(app, chosen);
  add_doctor_command(app, chosen);
  nearmesh::wire::program::begin_logging(app.get_name());
  return nearmesh::run_program(
      app, argc, argv, [&chosen] { return chosen(); }, nearmesh::wire::program::dds_versions(),
      " 5: this program's identity was revoked or has expired. `verify` has more of its own.");
}
