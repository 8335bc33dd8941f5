// SPDX-License-Identifier: Apache-2.0
// nearmesh-network-mean-peer: one peer that misbehaves in one way until SIGINT, for
// nearmesh-network. It speaks DDS without the channel, which would not let it. Prints "ready" when
// the publisher can hear it, at the end one JSON line of what it sent.

#include <sched.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "core/base/stopwatch.hpp"
#include "dice.hpp"
#include "held_whole.hpp"
#include "idl/dds/bus.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/endpoints.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "nearmesh/core/spm/detail/header.hpp"

namespace {

using namespace nearmesh;

volatile std::sig_atomic_t stop_requested = 0;
void request_stop(int) { stop_requested = 1; }

constexpr double kReadyDeadline_s = 60;
constexpr std::uint32_t kWindowBytes = 256 * 1024;

template <class T>
T require(Result<T> result) {
  if (!result.is_ok()) throw std::runtime_error(result.status().message());
  return std::move(result).value();
}
void require(const Status& status) {
  if (!status.is_ok()) throw std::runtime_error(status.message());
}

/// It stands for another machine: what it computes itself shall cost the others nothing. Where they
/// run in real time, so does it, below them, or a busy machine would make it harmless.
void yield_to_the_others() {
  const sched_param lowest{.sched_priority = 1};
  if (::sched_getscheduler(0) == SCHED_OTHER) {
    static_cast<void>(::nice(19));
  } else {
    static_cast<void>(::sched_setscheduler(0, SCHED_RR, &lowest));
  }
}

struct Options {
  wire::TransportOptions transport;
  std::string kind;
  double rate_hz = 0;  ///< messages a second, where the kind has no pace of its own
};

/// The endpoints of a peer, and more: it also hears what others ask, and can publish what is not
/// its to publish.
class MeanPeer {
 public:
  explicit MeanPeer(const Options& options) : options_(options) {
    bus_ = require(wire::Bus::open({.transport = options.transport}, mailbox_));
    require(batches_.open(*bus_, wire::partition_of(own_id_)));
    require(hellos_.open(*bus_));
    require(headers_.open(*bus_));
    if (options.kind == "thief") require(others_.open(*bus_));  // a secured bus allows no peer that
    require(asks_.open(*bus_));
  }

  void join() {
    for (const Stopwatch watch; !terrain_.is_set() || !aircraft_.is_set() ||
                                !asks_.listener().is_matched_with_participant_of(publisher_);
         mailbox_.wait(0.02)) {
      if (watch.seconds() > kReadyDeadline_s) throw std::runtime_error("no publisher was found");
      static_cast<void>(hellos_.drain(
          100, [&](wire::Hello&& hello, const wire::Handle& writer, wire::Microseconds) {
            publisher_ = writer;
            hello_ = std::move(hello);
          }));
      static_cast<void>(headers_.drain(
          100, [&](wire::MeshHeader&& message, const wire::Handle&, wire::Microseconds) {
            if (message.name == "aircraft") aircraft_ = message.content_hash;
            if (message.name != "terrain") return;
            const SpmHeader header = require(decode_header(message.bytes));
            base_ = positions_of_base(header);
            whole_ = test::held_whole(header);
            terrain_ = message.content_hash;
            grid_max_ = static_cast<std::int32_t>((std::int64_t{1} << header.grid.bits) - 1);
            for (const BaseRoot& root : header.roots)
              if (root.node.size > 1) roots_.push_back(root.node);
            std::sort(roots_.begin(), roots_.end());
            roots_.resize(std::min(roots_.size(), kMaxAttachNodes));
          }));
    }
  }

  void run() {
    if (options_.kind == "everything") return ask_for_everything(0);
    if (options_.kind == "slow") return ask_for_everything(1000);
    const std::map<std::string, void (MeanPeer::*)()> paced{
        {"flood", &MeanPeer::ask_small},
        {"flood-large", &MeanPeer::ask_large},
        {"nowhere", &MeanPeer::ask_for_what_is_not},
        {"certificates", &MeanPeer::ask_for_certificates},
        {"holder", &MeanPeer::say_what_is_not_held},
        {"thief", &MeanPeer::pose_as_others},
        {"inventor", &MeanPeer::invent_peers}};
    const auto act = paced.at(options_.kind);
    const Stopwatch clock;
    for (std::uint64_t done = 0; stop_requested == 0;) {
      const auto due = static_cast<std::uint64_t>(clock.seconds() * options_.rate_hz);
      for (; done < due; ++done) (this->*act)();
      take_batches();
      mailbox_.wait(0.001);
    }
  }

  [[nodiscard]] nlohmann::ordered_json told() const {
    return {{"sent", sent_}, {"received", received_}, {"received_bytes", received_bytes_}};
  }

 private:
  [[nodiscard]] wire::RegionSubscription request() {
    wire::RegionSubscription message;
    message.peer = own_id_;
    message.publisher = hello_.publisher;
    message.request = ++requests_;
    message.content_hash = terrain_;
    message.acknowledged_sequence = acknowledged_;
    message.window_bytes = kWindowBytes;
    message.region.attach = roots_;
    message.region.region = {GridBox{{{0, 0, 0}}, {{grid_max_, grid_max_, grid_max_}}}};
    message.region.max_splits = kMaxRequestSplits;
    return message;
  }
  void send(const wire::RegionSubscription& message) {
    if (asks_.write(message) == wire::WriteResult::kTaken) ++sent_;
  }
  /// Out: a request was answered in full. Takes at most `most` batches.
  bool take_batches(std::size_t most = 1000) {
    bool finished = false;
    static_cast<void>(batches_.drain(
        most, [&](wire::SplitBatchMessage&& batch, const wire::Handle&, wire::Microseconds) {
          ++received_;
          received_bytes_ += sample_bytes(batch);
          acknowledged_ = last_sequence(batch);
          finished = finished || batch.last;
        }));
    return finished;
  }
  void acknowledge() {
    wire::RegionSubscription credit = request();
    --requests_;
    credit.request = 0;
    credit.region = {};
    send(credit);
  }

  /// The whole model again and again, each time as soon as the last has come; at most so many bytes
  /// a second are taken (0: all).
  void ask_for_everything(double bytes_per_s) {
    const Stopwatch clock;
    send(request());
    while (stop_requested == 0) {
      mailbox_.wait(0.02);
      if (bytes_per_s > 0 && static_cast<double>(received_bytes_) > bytes_per_s * clock.seconds())
        continue;
      const std::uint64_t before = received_;
      const bool finished = take_batches(bytes_per_s > 0 ? 1 : 1000);
      if (finished) send(request());
      if (received_ != before && !finished) acknowledge();
    }
  }
  void ask_small() {
    wire::RegionSubscription message = request();
    message.region.attach.resize(1);
    message.region.max_splits = 20;
    send(message);
  }
  void ask_large() { send(request()); }
  void ask_for_what_is_not() {
    wire::RegionSubscription message = request();
    switch (requests_ % 4) {
      case 0:  // no such model
        message.content_hash.low += 1 + requests_;
        break;
      case 1:  // no such vertex
        message.region.attach = {{VertexId{0x7fffff00U}, 100}};
        break;
      case 2:  // no node of the forest
        message.region.attach = {{VertexId{1}, 3}};
        break;
      default:  // nothing is there
        message.region.region = {GridBox{{{-500, -500, -500}}, {{-400, -400, -400}}}};
    }
    send(message);
  }

  /// An aircraft at some place over the terrain, flying somewhere, of a peer that holds nothing
  /// yet.
  [[nodiscard]] wire::RegionSubscription certificate() {
    wire::RegionSubscription message = request();
    message.content_hash = {};
    message.region = {};
    CertificateRequest& asked = message.certificate.emplace();
    asked.horizon_s = 1;
    asked.margin_m = 10;
    asked.models = {{.content = terrain_, .held = {}}, {.content = aircraft_, .held = {}}};
    for (int i = 0; i < kPairs; ++i) {
      CertificateRequest::Pair& pair = asked.pairs.emplace_back();
      pair.b = 1;
      const auto& from = base_[dice_.below(base_.size())];
      const auto& to = base_[dice_.below(base_.size())];
      for (std::size_t k = 0; k < 3; ++k) {
        const double share = dice_.between(0, 1);
        pair.translation_m[k] = static_cast<float>(from[k] + share * (to[k] - from[k]));
        pair.linear_velocity_mps[k] = static_cast<float>(dice_.between(-100, 100));
      }
    }
    return message;
  }
  void ask_for_certificates() { send(certificate()); }
  /// All of the terrain, in another state each time.
  void say_what_is_not_held() {
    wire::RegionSubscription message = certificate();
    CertificateRequest::Model& terrain = message.certificate->models.front();
    terrain.state = ++states_;
    terrain.held = whole_;
    send(message);
  }

  /// Asks and acknowledges as peers that it hears, and announces and sends as the publisher that it
  /// hears.
  void pose_as_others() {
    static_cast<void>(others_.drain(100, [&](wire::RegionSubscription&& heard, const wire::Handle&,
                                             wire::Microseconds) {
      if (heard.peer == own_id_ || victims_.size() >= kMaxVictims || victims_.contains(heard.peer))
        return;
      auto& victim = victims_[heard.peer];
      victim = std::make_unique<wire::Writer<wire::SplitBatchMessage>>(mailbox_);
      require(victim->open(*bus_, wire::partition_of(heard.peer)));
    }));
    if (victims_.empty()) return;
    if (hello_writer_ == nullptr) {
      hello_writer_ = std::make_unique<wire::Writer<wire::Hello>>(mailbox_);
      require(hello_writer_->open(*bus_));
    }
    const auto victim =
        std::next(victims_.begin(), static_cast<std::ptrdiff_t>(sent_ % victims_.size()));
    wire::RegionSubscription message = request();
    message.peer = victim->first;
    message.request = 0xfffffff0U;  // what the victim asks later would be a repeat
    message.acknowledged_sequence = 0xfffffff0U;
    send(message);
    wire::SplitBatchMessage batch;
    batch.publisher = hello_.publisher;
    batch.content_hash = terrain_;
    batch.sequence = static_cast<std::uint32_t>(sent_);
    batch.last = true;
    batch.bytes.assign(kMaxSealedBytes, static_cast<std::uint8_t>(sent_));
    for (std::uint32_t guess = 1; guess < 4; ++guess) {
      batch.request = guess;
      static_cast<void>(victim->second->write(batch));
    }
    if (sent_ % 100 == 0) static_cast<void>(hello_writer_->write(hello_));
  }
  void invent_peers() {
    wire::RegionSubscription message = request();
    message.peer = wire::make_session_id();
    send(message);
  }

  /// Metres, of the vertices that are there from the start.
  static std::vector<std::array<double, 3>> positions_of_base(const SpmHeader& header) {
    std::vector<std::array<double, 3>> places;
    for (const BaseRoot& root : header.roots) {
      std::array<double, 3>& place = places.emplace_back(header.grid.origin_m);
      for (std::size_t k = 0; k < 3; ++k)
        place[k] += std::ldexp(root.position[static_cast<int>(k)], header.grid.exponent);
    }
    return places;
  }

  static constexpr std::size_t kMaxVictims = 32;
  static constexpr int kPairs = 4;
  const Options options_;
  const wire::SessionId own_id_ = wire::make_session_id();
  wire::Mailbox mailbox_;
  wire::Reader<wire::SplitBatchMessage> batches_{mailbox_};
  wire::Reader<wire::Hello> hellos_{mailbox_};
  wire::Reader<wire::MeshHeader> headers_{mailbox_};
  wire::Reader<wire::RegionSubscription> others_{mailbox_};
  wire::Writer<wire::RegionSubscription> asks_{mailbox_};
  std::unique_ptr<wire::Writer<wire::Hello>> hello_writer_;
  std::map<wire::SessionId, std::unique_ptr<wire::Writer<wire::SplitBatchMessage>>> victims_;
  wire::Handle publisher_;
  wire::Hello hello_;
  ContentHash terrain_, aircraft_;
  std::vector<std::array<double, 3>> base_;  ///< of the terrain
  std::vector<std::uint8_t> whole_;          ///< what says that it is held
  test::Dice dice_{1};
  std::uint64_t states_ = 0;
  std::vector<NodeSpan> roots_;
  std::int32_t grid_max_ = 0;
  std::uint32_t requests_ = 0, acknowledged_ = 0;
  std::uint64_t sent_ = 0, received_ = 0, received_bytes_ = 0;
  std::unique_ptr<wire::Bus> bus_;
};

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"A peer that misbehaves", "nearmesh-network-mean-peer"};
  Options options;
  app.add_option("kind", options.kind, "How")
      ->required()
      ->check(CLI::IsMember({"everything", "slow", "flood", "flood-large", "nowhere",
                             "certificates", "holder", "thief", "inventor"}));
  app.add_option("--rate", options.rate_hz,
                 "Messages a second, where the kind has no pace of its own")
      ->capture_default_str();
  app.add_option("--domain", options.transport.domain, "DDS domain")->required();
  app.add_option("--security", options.transport.security, "Folder of its identity");
  CLI11_PARSE(app, argc, argv);
  std::signal(SIGINT, request_stop);
  yield_to_the_others();
  try {
    MeanPeer peer(options);
    peer.join();
    std::printf("ready\n");
    std::fflush(stdout);
    peer.run();
    std::printf("%s\n", peer.told().dump().c_str());
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-network-mean-peer: %s\n", error.what());
    return 1;
  }
}
