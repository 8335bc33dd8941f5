// SPDX-License-Identifier: Apache-2.0
// What DDS Security costs: a publisher and a peer as two participants on 127.0.0.1, plain and
// secured in turns. A body is set down at one base vertex of the terrain after the other, and all
// other detail is given up, so each place must be asked for.
//   nearmesh-bench-security TERRAIN.spm BODY.spm DOMAIN
// CSV rows mode,metric,value,unit. Bytes are those of the interface lo, headers included: run it in
// a network namespace of its own (ip netns), where nobody else speaks.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>

#include "core/base/stopwatch.hpp"
#include "idl/dds/fastdds.hpp"
#include "idl/security/security.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "publisher/dds/dds_channel.hpp"
#include "publisher/serve/service.hpp"

using namespace nearmesh;

namespace {

constexpr int kRounds = 5;
constexpr int kPlaces = 80;
constexpr double kDeadline_s = 10;

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "nearmesh-bench-security: %s\n", what.c_str());
  std::exit(1);
}

template <class T>
T value_of(Result<T> result) {
  if (!result.is_ok()) fail(result.status().message());
  return std::move(result).value();
}

// Received by lo since it is there.
double lo_bytes() {
  std::ifstream in("/sys/class/net/lo/statistics/rx_bytes");
  double bytes = 0;
  in >> bytes;
  return bytes;
}

double quantile(std::vector<double>& values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1) + 0.5)];
}

struct Measured {
  std::vector<double> join_ms, answer_ms;
  double join_bytes = 0, answer_bytes = 0, payload_bytes = 0;
};

class Publisher {
 public:
  Publisher(const wire::TransportOptions& transport, const std::vector<std::string>& files) {
    publisher::DdsChannelOptions options;
    options.transport = transport;
    channel_ = value_of(publisher::DdsChannel::create(options));
    service_ = std::make_unique<publisher::Service>(*channel_, wire::make_session_id());
    for (const std::string& file : files)
      if (const Status added = service_->add_model(std::filesystem::path(file).stem().string(),
                                                   value_of(ModelFile::open(file)));
          !added.is_ok())
        fail(added.message());
    service_->announce();
    thread_ = std::thread([this] {
      const Stopwatch clock;
      while (!stop_) {
        for (const std::string& line : service_->step(clock.seconds())) fail(line);
        channel_->wait(0.02);
      }
    });
  }
  ~Publisher() {
    stop_ = true;
    thread_.join();
  }
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

 private:
  std::unique_ptr<publisher::DdsChannel> channel_;
  std::unique_ptr<publisher::Service> service_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

// Updates until every answer is certified: milliseconds.
double certify(subscriber::Session& session, subscriber::BodyId body, const Motion& motion,
               std::uint64_t frame) {
  const Stopwatch clock;
  std::vector<subscriber::Session::OwnMotion> motions{{body, motion}};
  while (clock.seconds() < kDeadline_s) {
    const auto report = value_of(session.update(frame, clock.seconds(), motions, 1));
    motions.clear();
    if (report.all_certified()) return clock.seconds() * 1e3;
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
  fail("no certified answer within " + std::to_string(kDeadline_s) + " s");
}

void fly(const wire::TransportOptions& transport, const std::string& terrain,
         const std::string& body, Measured& measured) {
  subscriber::DdsChannelOptions options;
  options.transport = transport;
  subscriber::SessionOptions session_options;
  session_options.max_held_splits = 1;
  session_options.lookahead_s = 0;
  const double before = lo_bytes();
  const Stopwatch clock;
  subscriber::Session session(value_of(subscriber::DdsChannel::create(options)), session_options);
  const auto stem = [](const std::string& path) {
    return std::filesystem::path(path).stem().string();
  };
  const auto ground = value_of(session.add_body({.name = "ground", .model = stem(terrain)}));
  const auto moved = value_of(session.add_body({.name = "body", .model = stem(body), .own = true}));
  for (const Status& status : {session.place_body(ground, {}), session.watch(ground, moved)})
    if (!status.is_ok()) fail(status.message());
  Motion motion;
  certify(session, moved, motion, 0);
  measured.join_ms.push_back(clock.seconds() * 1e3);
  const double joined = lo_bytes();
  measured.join_bytes += joined - before;
  const std::uint64_t payload = session.stats().batch_bytes;
  const SpmHeader& header = *session.header_of(ground);
  for (std::uint64_t i = 0; i < kPlaces; ++i) {
    const GridPoint& at = header.roots[i % header.roots.size()].position;
    for (std::size_t k = 0; k < 3; ++k)
      motion.pose.translation_m[k] =
          header.grid.origin_m[k] +
          std::ldexp(static_cast<double>(at[static_cast<int>(k)]), header.grid.exponent);
    measured.answer_ms.push_back(certify(session, moved, motion, i + 1));
  }
  measured.answer_bytes += lo_bytes() - joined;
  measured.payload_bytes += static_cast<double>(session.stats().batch_bytes - payload);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: nearmesh-bench-security TERRAIN.spm BODY.spm DOMAIN\n");
    return 2;
  }
  wire::speak_through_transports();
  wire::TransportOptions transport;
  transport.domain = static_cast<std::uint32_t>(std::atoi(argv[3]));
  transport.interface = "127.0.0.1";
  wire::SecurityPlan plan;
  plan.domain = transport.domain;
  plan.identities = {{"publisher", wire::Role::kPublisher}, {"peer", wire::Role::kSubscriber}};
  std::string set = std::filesystem::temp_directory_path().string() + "/nearmesh_bench_XXXXXX";
  if (::mkdtemp(set.data()) == nullptr) fail(set);
  if (const Status made = wire::make_security(set, plan); !made.is_ok()) fail(made.message());
  Measured plain, secured;
  for (int round = 0; round < kRounds; ++round)
    for (Measured* measured : {&plain, &secured}) {
      const bool is_secured = measured == &secured;
      transport.prefix = "nearmesh";
      transport.security = is_secured ? set + "/publisher" : "";
      const Publisher publisher(transport, {argv[1], argv[2]});
      if (is_secured) transport.security = set + "/peer";
      fly(transport, argv[1], argv[2], *measured);
    }
  std::filesystem::remove_all(set);
  std::printf("mode,metric,value,unit\n");
  for (Measured* m : {&plain, &secured}) {
    const char* mode = m == &plain ? "plain" : "secured";
    const auto row = [&](const char* metric, double value, const char* unit) {
      std::printf("%s,%s,%.6g,%s\n", mode, metric, value, unit);
    };
    row("answer_p50", quantile(m->answer_ms, 0.5), "ms");
    row("answer_p99", quantile(m->answer_ms, 0.99), "ms");
    row("join_p50", quantile(m->join_ms, 0.5), "ms");
    row("join_max", quantile(m->join_ms, 1), "ms");
    row("join_bytes", m->join_bytes / kRounds, "bytes");
    row("answer_bytes", m->answer_bytes / (kRounds * kPlaces), "bytes");
    row("answer_payload", m->payload_bytes / (kRounds * kPlaces), "bytes");
  }
  return 0;
}
