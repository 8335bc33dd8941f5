// SPDX-License-Identifier: Apache-2.0
// nearmesh-network-peers: many peers in one process, for nearmesh-network. They share a
// participant, and have of their own a session, the writer of their subscriptions and the reader of
// their batches; they send neither poses nor reports. Each flies along the same trajectory from
// another place on it. When all are ready it prints "ready", flies until SIGINT, and prints one
// JSON line.

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "core/base/hash.hpp"
#include "core/base/resources.hpp"
#include "core/base/stopwatch.hpp"
#include "idl/dds/bus.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/endpoints.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "trajectory.hpp"

namespace {

using namespace nearmesh;
using test::read_trajectory;

volatile std::sig_atomic_t stop_requested = 0;
void request_stop(int) { stop_requested = 1; }

/// What came to any peer of the process, to find what came to several at about the same time.
struct Received {
  std::uint64_t digest = 0;
  double at_s = 0;
  std::size_t bytes = 0;
};

class LightBus;

class LightChannel final : public subscriber::Channel {
 public:
  explicit LightChannel(LightBus& bus);
  wire::SessionId own_id() const override { return own_id_; }
  void send(const wire::RegionSubscription& subscription) override;
  void send(const wire::BodyPoses& /*poses*/) override {}
  void send(const wire::BodyDirectory& /*directory*/) override {}
  void send(const wire::ContactReport& /*report*/) override {}
  Inbox take() override;

 private:
  LightBus& bus_;
  const wire::SessionId own_id_ = wire::make_session_id();
  wire::Writer<wire::RegionSubscription>& writer_;
  wire::Reader<wire::SplitBatchMessage>& reader_;
  std::size_t hellos_ = 0, headers_ = 0;  ///< taken so far
};

/// The shared part. Threads: one.
class LightBus {
 public:
  explicit LightBus(const wire::TransportOptions& transport) {
    bus = require(wire::Bus::open({.transport = transport}, mailbox));
    require(hello_reader.open(*bus));
    require(header_reader.open(*bus));
  }
  template <class T>
  static T require(Result<T> result) {
    if (!result.is_ok()) throw std::runtime_error(result.status().message());
    return std::move(result).value();
  }
  static void require(const Status& status) {
    if (!status.is_ok()) throw std::runtime_error(status.message());
  }
  void receive() {
    while (hello_reader.drain(
        1000, [&](wire::Hello&& hello, const wire::Handle& writer, wire::Microseconds) {
          publisher = writer;
          hellos.push_back(std::move(hello));
        })) {
    }
    while (header_reader.drain(
        1000, [&](wire::MeshHeader&& header, const wire::Handle&, wire::Microseconds) {
          headers.push_back(std::move(header));
        })) {
    }
    for (const std::string& line : mailbox.take_complaints())
      std::fprintf(stderr, "%s\n", line.c_str());
  }

  wire::Mailbox mailbox;
  wire::Reader<wire::Hello> hello_reader{mailbox};
  wire::Reader<wire::MeshHeader> header_reader{mailbox};
  /// Of the peers; must outlive the bus.
  std::deque<wire::Writer<wire::RegionSubscription>> writers;
  std::deque<wire::Reader<wire::SplitBatchMessage>> readers;
  wire::Handle publisher;  ///< its writer of hellos
  std::vector<wire::Hello> hellos;
  std::vector<wire::MeshHeader> headers;
  std::vector<Received> received;
  Stopwatch clock;
  std::unique_ptr<wire::Bus> bus;
};

LightChannel::LightChannel(LightBus& bus)
    : bus_(bus),
      writer_(bus.writers.emplace_back(bus.mailbox)),
      reader_(bus.readers.emplace_back(bus.mailbox)) {
  LightBus::require(reader_.open(*bus.bus, wire::partition_of(own_id_)));
  LightBus::require(writer_.open(*bus.bus));
}

void LightChannel::send(const wire::RegionSubscription& subscription) {
  // What cannot be taken is asked for again.
  static_cast<void>(writer_.write(subscription));
}

subscriber::Channel::Inbox LightChannel::take() {
  Inbox inbox;
  if (writer_.listener().is_matched_with_participant_of(bus_.publisher)) {
    for (; hellos_ < bus_.hellos.size(); ++hellos_) inbox.hellos.push_back(bus_.hellos[hellos_]);
    for (; hellos_ > 0 && headers_ < bus_.headers.size(); ++headers_)
      inbox.headers.push_back({bus_.hellos.front().publisher, bus_.headers[headers_]});
  }
  static_cast<void>(reader_.drain(
      1000, [&](wire::SplitBatchMessage&& batch, const wire::Handle&, wire::Microseconds) {
        for (wire::SplitBatchMessage& one : take_apart(std::move(batch)))
          inbox.batches.push_back(std::move(one));
      }));
  if (inbox.batches.empty()) return inbox;
  wire::RegionSubscription credit;
  credit.peer = own_id_;
  credit.publisher = inbox.batches.back().publisher;
  credit.acknowledged_sequence = inbox.batches.back().sequence;
  credit.window_bytes = subscriber::SessionOptions{}.window_bytes;
  send(credit);
  for (const wire::SplitBatchMessage& batch : inbox.batches)
    bus_.received.push_back({hash_bytes(batch.bytes), bus_.clock.seconds(), batch.bytes.size()});
  return inbox;
}

struct Options {
  wire::TransportOptions transport;
  std::string trajectory;
  std::size_t peers = 125, first = 0, of = 125;
  double rate_hz = 2;
  double apart_m = 0;
};

/// Bytes that some other peer of the process had been sent within the last second.
std::uint64_t repeated_bytes(const std::vector<Received>& received) {
  std::map<std::uint64_t, double> seen;
  std::uint64_t repeated = 0;
  for (const Received& one : received) {
    const auto [at, is_new] = seen.try_emplace(one.digest, one.at_s);
    if (!is_new && one.at_s - at->second < 1) repeated += one.bytes;
    at->second = one.at_s;
  }
  return repeated;
}

int fly(const Options& options) {
  LightBus bus(options.transport);
  const std::vector<Motion> motions = read_trajectory(options.trajectory, options.rate_hz);
  std::vector<std::unique_ptr<subscriber::Session>> sessions;
  subscriber::BodyId aircraft;
  for (std::size_t i = 0; i < options.peers; ++i) {
    auto& session = sessions.emplace_back(std::make_unique<subscriber::Session>(
        std::make_unique<LightChannel>(bus),
        subscriber::SessionOptions{.lookahead_s = 0.3, .publish_reports = false}));
    const auto check = [](const Status& status) {
      if (!status.is_ok()) throw std::runtime_error(status.message());
    };
    const auto ground = session->add_body({.name = "ground", .model = "terrain"});
    const auto own = session->add_body({.name = "aircraft", .model = "aircraft", .own = true});
    check(ground.status());
    check(own.status());
    check(session->place_body(ground.value(), {}));
    check(session->watch(ground.value(), own.value()));
    aircraft = own.value();  // the same in all
  }
  const auto motion_of = [&](std::size_t peer, std::uint64_t frame) {
    const std::size_t lead = (options.first + peer) * motions.size() / options.of;
    Motion motion = motions[(lead + frame) % motions.size()];
    motion.pose.translation_m[1] += options.apart_m * static_cast<double>(options.first + peer);
    return motion;
  };
  std::uint64_t frames = 0, answers = 0, certified = 0, late = 0;
  Stopwatch start;
  double ready_s = 0;
  std::vector<bool> done(sessions.size());
  const auto update_all = [&](std::uint64_t frame) {
    bus.receive();
    for (std::size_t i = 0; i < sessions.size(); ++i) {
      if (done[i]) continue;
      const auto report =
          LightBus::require(sessions[i]->update(frame, static_cast<double>(frame) / options.rate_hz,
                                                {{aircraft, motion_of(i, frame)}}, 1));
      done[i] = report.all_certified();
    }
    return static_cast<std::size_t>(std::count(done.begin(), done.end(), true));
  };
  while (update_all(0) < sessions.size()) {
    if (start.seconds() > 100)
      throw std::runtime_error("not all peers had a certified answer within 100 s");
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  ready_s = start.seconds();
  std::printf("ready\n");
  std::fflush(stdout);
  bus.received.clear();
  Stopwatch clock;
  for (std::uint64_t frame = 1; stop_requested == 0; ++frame) {
    const double end_s = static_cast<double>(frame) / options.rate_hz;
    done.assign(sessions.size(), false);
    std::size_t count = 0;
    do {
      count = update_all(frame);
      std::this_thread::sleep_for(std::chrono::milliseconds(count == sessions.size() ? 20 : 5));
    } while (clock.seconds() < end_s);
    ++frames;
    answers += sessions.size();
    certified += count;
    late = std::max<std::uint64_t>(late, sessions.size() - count);
  }
  subscriber::SessionStats sum;
  for (const auto& session : sessions) {
    sum.batches += session->stats().batches;
    sum.batch_bytes += session->stats().batch_bytes;
    sum.requests += session->stats().requests;
  }
  std::uint64_t bytes = 0;
  for (const Received& one : bus.received) bytes += one.bytes;
  std::printf("%s\n", nlohmann::ordered_json{{"peers", sessions.size()},
                                             {"frames", frames},
                                             {"seconds", clock.seconds()},
                                             {"ready_s", ready_s},
                                             {"answers", answers},
                                             {"certified", certified},
                                             {"worst_frame_uncertified", late},
                                             {"batches", sum.batches},
                                             {"batch_bytes", sum.batch_bytes},
                                             {"requests", sum.requests},
                                             {"flight_bytes", bytes},
                                             {"repeated_bytes", repeated_bytes(bus.received)},
                                             {"memory_bytes", resident_memory_bytes()}}
                          .dump()
                          .c_str());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Many light peers in one process", "nearmesh-network-peers"};
  Options options;
  app.add_option("trajectory", options.trajectory, "CSV of an aircraft's poses")->required();
  app.add_option("--peers", options.peers, "How many here")->capture_default_str();
  app.add_option("--first", options.first, "How many before them, in other processes");
  app.add_option("--of", options.of, "How many in all")->capture_default_str();
  app.add_option("--apart", options.apart_m, "Metres to the side of the one before")
      ->capture_default_str();
  app.add_option("--rate", options.rate_hz, "Frames a second")->capture_default_str();
  app.add_option("--domain", options.transport.domain, "DDS domain")->required();
  CLI11_PARSE(app, argc, argv);
  std::signal(SIGINT, request_stop);
  try {
    return fly(options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-network-peers: %s\n", error.what());
    return 1;
  }
}
