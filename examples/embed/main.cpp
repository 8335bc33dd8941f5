// SPDX-License-Identifier: Apache-2.0
// The smallest embedding: a host that asks, in its own loop, whether two of its bodies touch.
// Run beside `nearmesh-publisher serve sphere.spm`; see README.md in this folder.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

using namespace nearmesh::subscriber;

int main(int argc, char** argv) {
  DdsChannelOptions options;  // or give it your own DomainParticipant: options.participant = ...
  options.transport.domain = argc > 1 ? static_cast<std::uint32_t>(std::atoi(argv[1])) : 0;
  if (argc > 2) options.transport.interface = argv[2];
  auto channel = DdsChannel::create(options);
  if (!channel.is_ok()) {
    std::fprintf(stderr, "%s\n", channel.status().message().c_str());
    return 1;
  }
  Session session(std::move(channel).value());
  const auto anvil = session.add_body({.name = "anvil", .model = "sphere", .own = true}).value();
  const auto hammer = session.add_body({.name = "hammer", .model = "sphere", .own = true}).value();
  if (!session.watch(anvil, hammer).is_ok()) return 1;

  const double heights_m[] = {3.0, 2.5, 1.99, 1.0};  // between the centres of two unit spheres
  std::string said;                                  // what an operator was told last
  for (int step = 0; step < 4; ++step) {
    nearmesh::Motion here, above;
    above.pose.translation_m = {0.01, 0.02, heights_m[step]};
    for (int tries = 0; tries < 5000;
         ++tries) {  // a simulator would simply go on with its next frame
      const auto report = session.update(static_cast<std::uint64_t>(step), step,
                                         {{anvil, here}, {hammer, above}}, 0.005);
      if (!report.is_ok()) return 1;
      const PairAnswer& pair = *report.value().find(anvil, hammer);
      if (!pair.reason.empty() && pair.reason != said)
        std::fprintf(stderr, "waiting: %s\n", (said = pair.reason).c_str());
      const auto& answer = pair.answer;
      if (nearmesh::is_certified(answer.status)) {
        std::printf("height %.2f m: %s, %zu touching face pairs\n", heights_m[step],
                    nearmesh::to_string(answer.status), answer.pairs.size());
        break;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }
  if (std::fflush(stdout) != 0) return std::perror("standard output"), 1;  // a full disk, say
  return 0;
}
