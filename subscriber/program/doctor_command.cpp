// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber doctor: does this machine reach others? Run it on both ends, or against a
// publisher.
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "commands.hpp"
#include "core/base/counted.hpp"
#include "core/base/hash.hpp"
#include "core/base/stopwatch.hpp"
#include "core/command/json_text.hpp"
#include "doctor_findings.hpp"
#include "idl/dds/fastdds.hpp"
#include "idl/dds/interfaces.hpp"
#include "idl/dds/room.hpp"
#include "idl/messages/process_name.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "subscriber/dds/dds_echo.hpp"
#include "subscriber/dds/dds_monitor.hpp"

namespace nearmesh::subscriber::program {
namespace {

constexpr std::uint32_t kSmallCount = 50, kLargeCount = 3, kProbeCount = 200;
constexpr std::size_t kSmallBytes = 16;
constexpr std::uint64_t kOwnParticipants = 3;
constexpr double kProbePeriod_s = 0.002;
constexpr double kProbeGrace_s = 0.5;  ///< for the last answers
constexpr std::uint64_t kWantedSocketBytes = 4U << 20;

struct Interfaces {
  std::vector<std::string> texts;  ///< "eth0 10.0.0.2, multicast", "lo 127.0.0.1"
  bool reaches_others = false;     ///< one that is up is not loopback
};

Interfaces interfaces() {
  Interfaces found;
  for (const wire::Interface& one : wire::ipv4_interfaces()) {
    found.reaches_others |= one.is_up && !one.is_loopback;
    found.texts.push_back(one.name + " " + one.address + (one.is_up ? "" : ", down") +
                          (one.has_multicast ? ", multicast" : ""));
  }
  return found;
}

std::uint64_t kernel_number(const std::string& path) {
  std::uint64_t value = 0;
  std::ifstream(path) >> value;
  return value;
}

/// Files of Fast DDS in shared memory that this user may not open.
std::vector<std::string> foreign_shared_memory() {
  std::vector<std::string> files;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/dev/shm", error)) {
    const std::string name = entry.path().filename();
    if (name.find("fastrtps_") == std::string::npos &&
        name.find("fast_datasharing") == std::string::npos)
      continue;
    if (::access(entry.path().c_str(), R_OK | W_OK) != 0) files.push_back(name);
  }
  std::sort(files.begin(), files.end());
  return files;
}

class Doctor {
 public:
  explicit Doctor(const DoctorOptions& options) : options_(options) {}

  Status examine() {
    look_at_machine();
    look_at_fastdds();
    if (const Status joined = join(); !joined.is_ok()) {
      if (joined.code() == StatusCode::kInvalidArgument) return joined;  // wrong usage
      wrong("join", joined.message());
      return Status::ok();
    }
    fact("locators", echo_->locators());
    find_others();
    if (other_) test_other();
    // The other doctor may not be through with us yet.
    while (left_s() > 0 && stop_requested == 0 && identity().is_ok())
      poll(std::min(0.05, left_s()));
    look_at_publishers();
    look_at_doors();
    if (is_interrupted()) say_interrupted();
    if (!other_ && publishers_.empty() && !is_interrupted())
      wrong("discovery",
            "nobody was found: run doctor on the other machine at the same time, with "
            "the same --domain and --prefix. If it runs: multicast may not get "
            "through (name the other with --peer), or a firewall blocks UDP ports from " +
                first_port() + " on");
    if (const Status ended = identity(); !ended.is_ok()) wrong("identity", ended.message());
    for (const std::string& line : complaints_) wrong("refusal", line);
    return Status::ok();
  }
  /// Not ok once this program's own identity does not count any more.
  [[nodiscard]] Status identity() const {
    return channel_ == nullptr ? Status::ok() : channel_->identity();
  }

  void print() const {
    if (options_.json) {
      nlohmann::ordered_json json = {{"healthy", is_healthy()},
                                     {"findings", nlohmann::ordered_json::array()}};
      for (const Finding& finding : findings_)
        json["findings"].push_back({{"kind", to_string(finding.kind)},
                                    {"name", finding.name},
                                    {"value", finding.value},
                                    {"text", finding.text}});
      std::printf("%s\n", text_of(json).c_str());
      return;
    }
    for (const Finding& finding : findings_)
      std::printf("%-8s%-16s%s\n",
                  finding.kind == Finding::Kind::kFact ? "" : to_string(finding.kind),
                  finding.name.c_str(), finding.text.c_str());
  }

  [[nodiscard]] bool is_healthy() const {
    return std::none_of(findings_.begin(), findings_.end(),
                        [](const Finding& f) { return f.kind == Finding::Kind::kWrong; });
  }

 private:
  [[nodiscard]] double left_s() const { return options_.seconds - clock_.seconds(); }
  [[nodiscard]] static bool is_interrupted() { return stop_requested != 0; }

  /// That nobody was found counts as wrong all the same: nothing was found to be well.
  void say_interrupted() {
    char text[80];
    std::snprintf(text, sizeof text, "after %.1f of %.1f s", clock_.seconds(), options_.seconds);
    const bool found = other_ || !publishers_.empty();
    add(found ? Finding::Kind::kAdvice : Finding::Kind::kWrong, "interrupted",
        std::string(text) +
            (found ? ": what was measured until then" : ": nobody was found until then"));
  }

  void add(Finding::Kind kind, const std::string& name, const std::string& text,
           nlohmann::ordered_json value = nullptr) {
    findings_.push_back({kind, name, text, std::move(value)});
  }
  void good(const std::string& name, const std::string& text, nlohmann::ordered_json value) {
    add(Finding::Kind::kGood, name, text, std::move(value));
  }
  void wrong(const std::string& name, const std::string& text) {
    add(Finding::Kind::kWrong, name, text);
  }
  /// Of this domain, as DDS counts them.
  [[nodiscard]] std::string first_port() const {
    return std::to_string(7400 + 250 * options_.transport.domain);
  }
  void fact(const std::string& name, const std::vector<std::string>& values) {
    std::string text;
    for (const std::string& value : values) text += (text.empty() ? "" : "; ") + value;
    add(Finding::Kind::kFact, name, text.empty() ? "none" : text, values);
  }

  void look_at_machine() {
    const wire::TransportOptions& transport = options_.transport;
    fact("transport", {std::string(wire::to_string(transport.transport)) + ", domain " +
                       std::to_string(transport.domain) + ", topics " + transport.prefix + "/*"});
    const Interfaces found = interfaces();
    fact("interfaces", found.texts);
    if (!found.reaches_others)
      add(Finding::Kind::kAdvice, "network",
          "no interface but loopback is up: other machines are out of reach");
    if (const std::string line = wire::why_alone(transport, wire::ipv4_interfaces()); !line.empty())
      add(Finding::Kind::kAdvice, "multicast", line);
    for (const char* name : {"rmem_max", "wmem_max"}) {
      const std::uint64_t bytes = kernel_number(std::string("/proc/sys/net/core/") + name);
      if (bytes >= kWantedSocketBytes) {
        good(name, std::to_string(bytes) + " bytes", bytes);
      } else {
        add(Finding::Kind::kAdvice, name,
            std::to_string(bytes) +
                " bytes: bursts overrun a socket and are sent again; sysctl -w "
                "net.core." +
                name + "=" + std::to_string(kWantedSocketBytes),
            bytes);
      }
    }
    look_at_shared_memory();
    const std::vector<std::string> foreign = foreign_shared_memory();
    if (foreign.empty()) return;
    const std::string text = "files of another user in /dev/shm, " + foreign[0] + " the first of " +
                             std::to_string(foreign.size()) +
                             ": processes would match and hear nothing; use --transport lan "
                             "--interface 127.0.0.1 on both sides";
    add(transport.transport == wire::Transport::kSameHost ? Finding::Kind::kWrong
                                                          : Finding::Kind::kAdvice,
        "shared memory", text, foreign);
  }

  void look_at_shared_memory() {
    if (options_.transport.transport != wire::Transport::kSameHost) return;
    const std::uint64_t bytes = wire::free_shared_memory().value_or(0);
    const std::uint64_t wanted = kOwnParticipants * wire::kRoomSharedBytes;
    const std::string text = std::to_string(bytes >> 10) + " KiB free in /dev/shm";
    if (bytes >= wanted)
      good("shared memory", text, bytes);
    else
      add(Finding::Kind::kWrong, "shared memory",
          text + ", each process takes " + std::to_string(wire::kRoomSharedBytes >> 10) +
              ", this one as three: mount -o remount,size=64M /dev/shm; docker run --shm-size",
          bytes);
  }

  void look_at_fastdds() {
    const bool asserts = wire::fastdds_asserts();
    add(asserts ? Finding::Kind::kAdvice : Finding::Kind::kGood, "fast dds",
        std::string(wire::fastdds_version()) +
            (asserts
                 ? ", with live assertions: a fault in it ends the process. The door keeps known "
                   "ones out; a build with -DNDEBUG has none (docs/operate.md)"
                 : ", without assertions"),
        {{"version", wire::fastdds_version()}, {"asserts", asserts}});
  }

  /// Of who told its status while this listened, itself not counted.
  void look_at_doors() {
    if (monitor_ == nullptr) return;
    monitor_->listen(0);
    std::size_t guarded = 0;
    for (const wire::ProcessStatus& process : monitor_->view().processes) {
      guarded += process.has_door ? 1 : 0;
      if (!process.has_door)
        add(Finding::Kind::kAdvice, "door",
            "process " + std::to_string(process.process_id) + " on " + process.host + " (" +
                process.name +
                ") has no door before Fast DDS: one malformed packet may end it; its host adds one "
                "line (docs/embed.md)",
            {{"name", process.name}, {"host", process.host}, {"process_id", process.process_id}});
    }
    if (guarded > 0)
      good("door",
           guarded == 1 ? "1 process checks what comes in"
                        : std::to_string(guarded) + " processes check what comes in",
           guarded);
  }

  Status join() {
    auto echo = DdsEcho::create(options_.transport);
    NEARMESH_RETURN_IF_ERROR(echo);
    echo_ = std::move(echo).value();
    return join_as_peer();
  }

  /// To hear publishers.
  Status join_as_peer() {
    DdsChannelOptions options;
    options.transport = options_.transport;
    options.transport.listen_port = 0;  // the other participant here has it
    // Who only listens is reached by doctors alone: no publisher calls a peer.
    if (options.transport.transport == wire::Transport::kTcp &&
        options.transport.initial_peers.empty())
      return Status::ok();
    auto channel = DdsChannel::create(options);
    NEARMESH_RETURN_IF_ERROR(channel);
    channel_ = std::move(channel).value();
    auto monitor = DdsMonitor::create(options.transport);
    NEARMESH_RETURN_IF_ERROR(monitor);
    monitor_ = std::move(monitor).value();
    return Status::ok();
  }

  /// Takes in what comes for so long, at least once.
  std::vector<wire::Echo> poll(double seconds) {
    std::vector<wire::Echo> taken = echo_->poll(seconds);
    for (const wire::Echo& echo : taken)
      if (!other_) other_ = echo.from;
    Channel::Inbox inbox = channel_ != nullptr ? channel_->take() : Channel::Inbox{};
    for (const wire::Hello& hello : inbox.hellos)
      publishers_.try_emplace(hello.publisher, clock_.seconds(), hello);
    for (const auto& [publisher, header] : inbox.headers)
      headers_.try_emplace(header.content_hash, clock_.seconds(), header.bytes.size());
    for (const auto& lines : {inbox.complaints, echo_->take_complaints()})
      for (const std::string& line : lines)
        if (known_.insert(line).second) complaints_.push_back(line);
    return taken;
  }

  /// Another doctor, for at most half of the time; a publisher alone is worth a fifth.
  void find_others() {
    wire::Echo call;
    call.from = echo_->own_id();
    double called_s = -1;
    std::optional<double> matched_s;
    // Who calls first may be heard before it is matched both ways: what is sent to it then is lost.
    while (!(other_ && echo_->is_matched()) && stop_requested == 0 &&
           clock_.seconds() < options_.seconds / 2 &&
           (other_ || publishers_.empty() || clock_.seconds() < options_.seconds / 5)) {
      if (!other_ && echo_->is_matched()) {
        if (!matched_s) matched_s = clock_.seconds();
        if (clock_.seconds() - called_s > 0.2) {
          called_s = clock_.seconds();
          ++call.number;
          static_cast<void>(echo_->send(call, false));
        }
      }
      static_cast<void>(poll(0.01));
    }
    if (other_ && !matched_s) matched_s = clock_.seconds();  // it called first
    if (matched_s) good("match", "another doctor after " + milliseconds(*matched_s), *matched_s);
    if (matched_s && !other_ && !is_interrupted())
      wrong("data",
            "another doctor was matched, but nothing comes from it: its data does not get "
            "through. On one machine: use --transport lan --interface 127.0.0.1 on both "
            "sides; between machines let UDP ports from " +
                first_port() + " on pass the firewall");
  }

  /// Seconds until this many bytes were back, or nothing.
  std::optional<double> round_trip(std::size_t bytes, double patience_s) {
    wire::Echo echo;
    echo.from = echo_->own_id();
    echo.to = *other_;
    echo.number = ++number_;
    echo.bytes.resize(bytes);
    for (std::size_t i = 0; i < bytes; ++i)
      echo.bytes[i] = static_cast<std::uint8_t>((i * 2654435761U) >> 13);
    const Stopwatch clock;
    bool sent = false;
    while (clock.seconds() < patience_s && stop_requested == 0) {
      sent = sent || echo_->send(echo, false);
      for (const wire::Echo& back : poll(sent ? 0.05 : 0.002))
        if (back.is_reply && back.from == *other_ && back.number == echo.number)
          return back.bytes == echo.bytes ? std::optional(clock.seconds()) : std::nullopt;
    }
    return std::nullopt;
  }

  void test_size(const std::string& name, std::size_t bytes, std::uint32_t count,
                 double patience_s) {
    RoundTrips trips{.name = name, .bytes = bytes, .patience_s = patience_s};
    const Stopwatch clock;
    while (!is_interrupted() && !trips.is_overdue && trips.times_s.size() < count &&
           (trips.times_s.empty() || clock.seconds() < patience_s)) {
      const std::optional<double> time_s = round_trip(bytes, patience_s);
      if (time_s) trips.times_s.push_back(*time_s);
      trips.is_overdue = !time_s;
    }
    trips.is_interrupted = is_interrupted();
    findings_.push_back(finding_of(std::move(trips)));
  }

  /// Kilobytes that nobody repairs, there and back.
  void test_loss() {
    wire::Echo echo;
    echo.from = echo_->own_id();
    echo.to = *other_;
    echo.bytes.assign(kKilobyte, 7);
    const std::uint32_t first = number_ + 1;
    std::set<std::uint32_t> back;
    const auto collect = [&](double seconds) {
      for (const wire::Echo& reply : poll(seconds))
        if (reply.is_reply && reply.from == *other_ && reply.number >= first)
          back.insert(reply.number);
    };
    const Stopwatch clock;
    std::uint32_t sent = 0;
    for (std::uint32_t i = 0; i < kProbeCount && !is_interrupted(); ++i) {
      echo.number = ++number_;
      static_cast<void>(echo_->send(echo, true));
      ++sent;
      const double due_s = (i + 1) * kProbePeriod_s;
      do collect(std::max(0.0, due_s - clock.seconds()));
      while (clock.seconds() < due_s);
    }
    const Stopwatch grace;
    while (back.size() < sent && grace.seconds() < kProbeGrace_s) collect(0.02);
    findings_.push_back(finding_of(Probes{sent, back.size(), is_interrupted()}));
  }

  void test_other() {
    fact("other", {"doctor " + to_hex(*other_)});
    test_size("round trip", kSmallBytes, kSmallCount, 1);
    test_size("1 kB", kKilobyte, kSmallCount, 1);
    test_size("1 MB", kMegabyte, kLargeCount, 3);
    test_loss();
  }

  void look_at_publishers() {
    for (const auto& [id, found] : publishers_) {
      good("publisher",
           wire::called(id, found.second.name) + " after " + milliseconds(found.first) + ", " +
               counted(found.second.models.size(), "model"),
           found.first);
      for (const auto& model : found.second.models) {
        const auto header = headers_.find(model.content_hash);
        if (header == headers_.end()) {
          add(is_interrupted() ? Finding::Kind::kFact : Finding::Kind::kWrong, "header",
              "model " + model.name + ": its header has not come");
        } else {
          good("header",
               "model " + model.name + ", " + std::to_string(header->second.second) +
                   " bytes after " + milliseconds(header->second.first),
               header->second.first);
        }
      }
    }
  }

  const DoctorOptions& options_;
  const Stopwatch clock_;
  std::unique_ptr<DdsChannel> channel_;
  std::unique_ptr<DdsEcho> echo_;
  std::unique_ptr<DdsMonitor> monitor_;
  std::optional<wire::SessionId> other_;
  std::map<wire::SessionId, std::pair<double, wire::Hello>> publishers_;
  std::map<ContentHash, std::pair<double, std::size_t>> headers_;
  std::vector<std::string> complaints_;
  std::set<std::string> known_;
  std::uint32_t number_ = 1000;  ///< above those of calls
  std::vector<Finding> findings_;
};

}  // namespace

Outcome run(const DoctorOptions& options) {
  Doctor doctor(options);
  NEARMESH_RETURN_IF_ERROR(doctor.examine());
  doctor.print();
  if (Status identity = doctor.identity(); !identity.is_ok())
    return {std::move(identity), wire::program::kIdentityEnded};
  if (doctor.is_healthy()) return Status::ok();
  return Status{StatusCode::kNotFound, "something is wrong, see above"};
}

}  // namespace nearmesh::subscriber::program
