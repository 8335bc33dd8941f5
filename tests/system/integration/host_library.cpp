// SPDX-License-Identifier: Apache-2.0
// A host's shared library, a plug-in say, that links nearmesh and exports two functions of its own.

#include <chrono>

#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/wait_ready.hpp"

/// 1 when two touching bodies of the model come to be certified, 0 when they do not or the file
/// cannot be read.
extern "C" __attribute__((visibility("default"))) int host_library_certifies(
    const char* model_file) {
  using namespace nearmesh;
  auto file = ModelFile::open(model_file);
  if (!file.is_ok()) return 0;
  auto channel = std::make_unique<subscriber::LocalChannel>();
  if (!channel->add_model("sphere", std::move(file).value()).is_ok()) return 0;
  subscriber::Session session(std::move(channel));
  const auto left = session.add_body({.name = "left", .model = "sphere", .own = true}).value();
  const auto right = session.add_body({.name = "right", .model = "sphere", .own = true}).value();
  if (!session.watch(left, right).is_ok()) return 0;
  Motion beside;
  beside.pose.translation_m = {1.98, 0.1, 0.05};
  const auto ready = subscriber::wait_ready(session, left, 60, {{left, {}}, {right, beside}});
  return ready.is_ok() && ready.value().readiness.stage == subscriber::ReadyStage::kCertified;
}

/// How many publishers a channel of its own hears of until the first comes.
extern "C" __attribute__((visibility("default"))) int host_library_hears(int domain,
                                                                         double timeout_s) {
  nearmesh::subscriber::DdsChannelOptions options;
  options.transport.domain = static_cast<std::uint32_t>(domain);
  options.transport.interface = "127.0.0.1";
  const auto channel = nearmesh::subscriber::DdsChannel::create(options);
  if (!channel.is_ok()) return 0;
  std::size_t heard = 0;
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + std::chrono::duration<double>(timeout_s);
  while (heard == 0 && Clock::now() < end) {
    channel.value()->wait(0.05);
    heard += channel.value()->take().hellos.size();
  }
  return static_cast<int>(heard);
}
