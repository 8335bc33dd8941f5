// SPDX-License-Identifier: Apache-2.0
// How long a replay takes to begin and to seek in a long session, as CSV; the session is generated.
//   nearmesh-bench-replay [HOURS [RATE_HZ [PEERS]]]
// Wall clock, and processor time of this thread where a column says so. To prepare is to take in
// all batches, which goes on while it plays. A seek is: find the place, read what holds there and
// hand it to an outlet that drops it; the answer is all detail towards a twentieth of the model,
// asked for right after it.

#include <algorithm>
#include <cstdlib>
#include <ctime>

#include "core/base/resources.hpp"
#include "core/base/stopwatch.hpp"
#include "publisher/replay/replay.hpp"
#include "session_hour.hpp"

using namespace nearmesh;

namespace {

class Nowhere final : public publisher::ReplayOutlet {
 public:
  bool publish(std::uint32_t, const std::vector<std::uint8_t>&) override { return true; }
  void withdraw(std::uint32_t, const std::vector<std::uint8_t>&) override {}
  bool take_restart() override { return false; }
  publisher::Inbox take() override { return {}; }
  bool send(wire::SessionId, const wire::SplitBatchMessage&) override { return true; }
  void wait(double) override {}
  std::vector<std::string> take_complaints() override { return {}; }
};

double argument(int argc, char** argv, int at, double otherwise) {
  return argc > at ? std::atof(argv[at]) : otherwise;
}

double processor_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

void print(const char* what, std::vector<double> seconds) {
  std::sort(seconds.begin(), seconds.end());
  std::printf("%s,%.4f,%.4f\n", what, seconds[seconds.size() / 2], seconds.back());
}

}  // namespace

int main(int argc, char** argv) {
  const test::TempFile file(".db3");
  test::HourOptions options;
  options.length_s = 3600 * argument(argc, argv, 1, 1);
  options.rate_hz = argument(argc, argv, 2, 20);
  options.peers = static_cast<std::uint32_t>(argument(argc, argv, 3, 10));
  const test::HourFacts facts = test::write_session_hour(file.path(), options);

  Stopwatch watch;
  double begun_s = processor_s();
  const auto recording = RecordingReader::open(file.path()).value();
  const auto index = publisher::ReplayIndex::build(*recording, {}, {}).value();
  const double open_s = watch.lap(), open_processor_s = processor_s() - begun_s;
  begun_s = processor_s();
  if (!index->take_batches(*recording, facts.batches).is_ok()) return 1;
  const double prepare_s = watch.lap(), prepare_processor_s = processor_s() - begun_s;
  std::printf(
      "messages,%llu\nbatches,%llu\nsplits,%llu\nopen_s,%.3f\nopen_processor_s,%.3f\n"
      "prepare_s,%.3f\nprepare_processor_s,%.3f\nmemory_MB,%.0f\n",
      static_cast<unsigned long long>(facts.messages),
      static_cast<unsigned long long>(facts.batches), static_cast<unsigned long long>(facts.splits),
      open_s, open_processor_s, prepare_s, prepare_processor_s,
      static_cast<double>(resident_memory_bytes()) / 1e6);

  Nowhere outlet;
  publisher::Replay replay(*recording, *index, outlet,
                           publisher::Playhead::create(*recording, {}, 0).value(), true);
  if (!replay.begin().is_ok()) return 1;
  auto& [hash, detail] = *index->details().begin();
  RegionRequest request;
  request.max_splits = kMaxRequestSplits;
  SpmHeader header;
  static_cast<void>(recording->read(1, 2, [&](std::int64_t, const RecordedMessage& message) {
    header =
        decode_header(wire::decode_payload<wire::MeshHeader>(message.cdr).value().bytes).value();
    return true;
  }));
  for (const BaseRoot& root : header.roots)
    if (root.node.size > 1 && request.attach.size() < kMaxAttachNodes)
      request.attach.push_back(root.node);
  Random random(1);
  std::vector<double> seeks_s, answers_s;
  for (int i = 0; i < 100; ++i) {
    const std::int32_t from = static_cast<std::int32_t>(random.below(1 << 20));
    request.region = {GridBox{{{from, 0, 0}}, {{from + (1 << 17), 1 << 20, 1 << 21}}}};
    watch.lap();
    if (!replay.seek(random.between(0, options.length_s), 1).is_ok()) return 1;
    seeks_s.push_back(watch.lap());
    if (!detail.answer(request, replay.playhead().next_id()).is_ok()) return 1;
    answers_s.push_back(watch.lap());
  }
  std::printf("what,median_s,max_s\n");
  print("seek", seeks_s);
  print("answer", answers_s);
  return 0;
}
