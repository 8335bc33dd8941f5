// SPDX-License-Identifier: Apache-2.0
#include "runs.hpp"

#include <unistd.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::test {
namespace {

using nlohmann::json;

constexpr char kAnswers[] = "answers.jsonl";
constexpr std::uint32_t kWindowBytes = 64 * 1024;
constexpr std::size_t kSampleFieldsBytes = 36;  ///< of a batch's sample, beside the batch

std::vector<std::string> on_bus(const Exercise& exercise, std::vector<std::string> words) {
  words.insert(words.end(), {"--domain", std::to_string(exercise.domain), "--transport",
                             wire::to_string(exercise.transport)});
  if (!exercise.interface.empty()) words.insert(words.end(), {"--interface", exercise.interface});
  return words;
}

const char kScene[] =
    "bodies:\n"
    "  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n"
    "  - {name: aircraft1, model: aircraft}\n"
    "moves:\n"
    "  - {body: aircraft1, trajectory: flight1.csv}\n"
    "pairs: [[ground, aircraft1]]\n"
    "budget_ms: 10\n"
    "lookahead_s: 0.3\n"
    "start_timeout_s: 60\n";

// Frames, certified answers and pauses without one, out of the lines that the peer wrote.
void read_answers(const std::string& path, double period_s, FlightResult& result) {
  std::uint64_t pause = 0, longest = 0;
  for (const std::string& text : lines_of(read_text(path))) {
    const json line = json::parse(text);
    if (line.contains("summary")) {
      const json& summary = line.at("summary");
      result.first_certified_s = summary.at("first_certified_s");
      result.batch_bytes = summary.at("batch_bytes");
      result.batches = summary.at("batches");
      result.header_bytes = summary.at("header_bytes");
      result.requests = summary.at("requests");
      continue;
    }
    const std::string status = line.at("status");
    ++result.answers;
    const bool certified = status == "free" || status == "contact";
    result.certified += certified ? 1 : 0;
    result.contacts += status == "contact" ? 1 : 0;
    pause = certified ? 0 : pause + 1;
    longest = std::max(longest, pause);
  }
  result.longest_lag_s = static_cast<double>(longest) * period_s;
}

}  // namespace

std::FILE* open_csv(const std::string& path) {
  std::FILE* out = std::fopen(path.c_str(), "w");
  if (out == nullptr) throw std::runtime_error("cannot write " + path);
  return out;
}

std::unique_ptr<Process> serve(const Lan& lan, const Folder& folder, const Exercise& exercise,
                               std::size_t host) {
  const Lan::Visit visit = lan.visit(host);
  std::vector<std::string> words{"serve"};
  words.insert(words.end(), exercise.models.begin(), exercise.models.end());
  if (!exercise.security.empty())
    words.insert(words.end(), {"--security", exercise.security + "/serve"});
  auto publisher = std::make_unique<Process>(folder, "nearmesh-publisher", on_bus(exercise, words));
  if (!publisher->says("ready on domain"))
    throw std::runtime_error("no publisher: " + publisher->err());
  return publisher;
}

Spent spent_by(const Process& process) {
  const std::string folder = "/proc/" + std::to_string(process.id());
  const std::string stat = read_text(folder + "/stat");
  std::istringstream after_name(stat.substr(stat.rfind(')') + 2));
  std::string skipped;
  for (int i = 3; i < 14; ++i) after_name >> skipped;
  double user = 0, system = 0;
  after_name >> user >> system;
  std::istringstream pages(read_text(folder + "/statm"));
  std::uint64_t size = 0, resident = 0;
  pages >> size >> resident;
  return {(user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK)),
          resident * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE))};
}

void write_flights(const Folder& folder, const Exercise& exercise, int frames, double rate_hz) {
  std::string err;
  if (run(folder, "nearmesh-demo-flights",
          {folder.path(), "--size", std::to_string(exercise.terrain_cells), "--frames",
           std::to_string(frames), "--rate", std::to_string(rate_hz)},
          nullptr, &err) != 0)
    throw std::runtime_error("no flight: " + err);
}

std::unique_ptr<Process> start_flight(const Lan& lan, std::size_t host, const Folder& folder,
                                      const Exercise& exercise, double rate_hz) {
  folder.write("flight.yaml", kScene + ("frame_rate_hz: " + std::to_string(rate_hz)) + "\n");
  const std::string answers = folder.file(kAnswers);
  std::filesystem::remove(answers);
  const Lan::Visit visit = lan.visit(host);
  return std::make_unique<Process>(
      folder, "nearmesh-subscriber",
      on_bus(exercise, {"run", folder.file("flight.yaml"), "--answers", answers}));
}

std::uint64_t count_wrong_answers(const Folder& folder, const Exercise& exercise,
                                  std::uint64_t answers) {
  std::vector<std::string> words{"check"};
  words.insert(words.end(), exercise.models.begin(), exercise.models.end());
  words.insert(words.end(), {"--answers", folder.file(kAnswers)});
  std::string out, err;
  run(folder, "nearmesh-model", words, &out, &err);
  const std::optional<CheckedAnswers> checked = read_checked(out);
  if (!checked || checked->answers != answers)
    throw std::runtime_error("answers were not checked: " + out + err);
  return checked->wrong;
}

FlightResult fly(const Lan& lan, std::size_t host, const Folder& folder, const Exercise& exercise,
                 const FlightOptions& options) {
  FlightResult result;
  write_flights(folder, exercise, options.frames, options.rate_hz);
  const Lan::Counters before = lan.counters(host);
  {
    const auto peer = start_flight(lan, host, folder, exercise, options.rate_hz);
    result.ended = peer->wait(kDeadline_s + 3 * options.frames / options.rate_hz) == 0;
    result.complaint = peer->err();
  }
  const Lan::Counters after = lan.counters(host);
  result.wire = {after.received_bytes - before.received_bytes,
                 after.received_packets - before.received_packets,
                 after.sent_bytes - before.sent_bytes, after.sent_packets - before.sent_packets};
  if (!result.ended) return result;
  read_answers(folder.file(kAnswers), 1 / options.rate_hz, result);
  result.wrong = count_wrong_answers(folder, exercise, result.answers);
  return result;
}

BulkPeer::BulkPeer(const Lan& lan, std::size_t host, const Exercise& exercise) {
  subscriber::DdsChannelOptions options;
  options.transport = wire::preset_of(exercise.transport);
  options.transport.domain = exercise.domain;
  {
    const Lan::Visit visit = lan.visit(host);
    auto made = subscriber::DdsChannel::create(options);
    if (!made.is_ok()) throw std::runtime_error(made.status().message());
    channel_ = std::move(made).value();
  }
  for (const Stopwatch watch; models_.size() < exercise.models.size() || publisher_ == 0;) {
    if (watch.seconds() > kDeadline_s) throw std::runtime_error("headers did not come");
    channel_->wait(0.1);
    const subscriber::Channel::Inbox inbox = channel_->take();
    for (const wire::Hello& hello : inbox.hellos) publisher_ = hello.publisher;
    for (const auto& [publisher, message] : inbox.headers) {
      const SpmHeader header = decode_header(message.bytes).value();
      Model& model = models_[message.name];
      model.content_hash = message.content_hash;
      model.grid_max = static_cast<std::int32_t>((std::int64_t{1} << header.grid.bits) - 1);
      for (const BaseRoot& root : header.roots)
        if (root.node.size > 1) model.roots.push_back(root.node);
      std::sort(model.roots.begin(), model.roots.end());
      model.roots.resize(std::min(model.roots.size(), kMaxAttachNodes));
    }
  }
}

std::uint32_t BulkPeer::request(const std::string& model, std::uint8_t priority,
                                std::uint32_t max_splits) {
  const Model& asked = models_.at(model);
  wire::RegionSubscription subscription;
  subscription.peer = channel_->own_id();
  subscription.publisher = publisher_;
  subscription.window_bytes = kWindowBytes;
  subscription.request = ++requests_;
  subscription.content_hash = asked.content_hash;
  subscription.priority = priority;
  subscription.region.attach = asked.roots;
  subscription.region.region = {
      GridBox{{{0, 0, 0}}, {{asked.grid_max, asked.grid_max, asked.grid_max}}}};
  subscription.region.max_splits = max_splits;
  channel_->send(subscription);
  return requests_;
}

BulkPeer::Taken BulkPeer::take(double seconds) {
  channel_->wait(seconds);
  Taken taken;
  for (const wire::SplitBatchMessage& batch : channel_->take().batches) {
    ++taken.batches;
    taken.bytes += batch.bytes.size();
    taken.sample_bytes += batch.bytes.size() + kSampleFieldsBytes;
    if (batch.last) taken.finished.push_back(batch.request);
  }
  return taken;
}

PipeResult fill_pipe(const Lan& lan, std::size_t host, const Exercise& exercise, double seconds) {
  BulkPeer peer(lan, host, exercise);
  PipeResult result;
  const Lan::Counters before = lan.counters(host), sent_before = lan.counters(0);
  const Stopwatch watch;
  std::uint32_t later = peer.request("terrain", 1, kMaxRequestSplits), now = 0;
  double asked_s = 0;
  while (watch.seconds() < seconds) {
    if (now == 0 && watch.seconds() >= asked_s + 1) {
      asked_s = watch.seconds();
      now = peer.request("aircraft", 0, 100);
    }
    const BulkPeer::Taken taken = peer.take(0.05);
    result.batches += taken.batches;
    result.bytes += taken.bytes;
    result.sample_bytes += taken.sample_bytes;
    for (const std::uint32_t finished : taken.finished) {
      if (finished == later) later = peer.request("terrain", 1, kMaxRequestSplits);
      if (finished != now) continue;
      result.overtakes_s.push_back(watch.seconds() - asked_s);
      now = 0;
    }
  }
  result.seconds = watch.seconds();
  const Lan::Counters after = lan.counters(host);
  result.wire = {after.received_bytes - before.received_bytes,
                 after.received_packets - before.received_packets,
                 after.sent_bytes - before.sent_bytes, after.sent_packets - before.sent_packets};
  result.publisher_sent_bytes = lan.counters(0).sent_bytes - sent_before.sent_bytes;
  std::sort(result.overtakes_s.begin(), result.overtakes_s.end());
  return result;
}

}  // namespace nearmesh::test
