// SPDX-License-Identifier: Apache-2.0
// nearmesh-network-publisher DOMAIN ID MODEL...: serves as nearmesh-publisher does, under a number
// of the caller's choice instead of a drawn one, so that who asks whom is known before. Says
// "ready" on standard error; ends with SIGINT.

#include <csignal>
#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <utility>

#include "core/base/stopwatch.hpp"
#include "publisher/dds/dds_channel.hpp"
#include "publisher/serve/service.hpp"

namespace {

using namespace nearmesh;

volatile std::sig_atomic_t stop_requested = 0;
void request_stop(int) { stop_requested = 1; }

template <class T>
T require(Result<T> result) {
  if (!result.is_ok()) throw std::runtime_error(result.status().message());
  return std::move(result).value();
}

void serve(unsigned domain, wire::SessionId id, char** models, int count) {
  publisher::DdsChannelOptions options;
  options.transport.domain = domain;
  const auto channel = require(publisher::DdsChannel::create(options));
  publisher::Service service(*channel, id);
  for (int i = 0; i < count; ++i) {
    const Status added = service.add_model(std::filesystem::path(models[i]).stem().string(),
                                           require(ModelFile::open(models[i])));
    if (!added.is_ok()) throw std::runtime_error(added.message());
  }
  service.announce();
  std::fprintf(stderr, "ready\n");
  for (const Stopwatch clock; stop_requested == 0;) {
    for (const std::string& line : service.step(clock.seconds()))
      std::fprintf(stderr, "%s\n", line.c_str());
    if (!service.is_behind()) channel->wait(0.02);
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGINT, request_stop);
  try {
    if (argc < 4) throw std::runtime_error("expected DOMAIN ID MODEL...");
    serve(static_cast<unsigned>(std::stoul(argv[1])), std::stoull(argv[2]), argv + 3, argc - 3);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-network-publisher: %s\n", error.what());
    return 1;
  }
}
