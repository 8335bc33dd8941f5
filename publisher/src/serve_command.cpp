// SPDX-License-Identifier: Apache-2.0
// nearmesh-publisher serve: models to any number of peers, until Ctrl-C.
#include <spdlog/spdlog.h>

#include <filesystem>
#include <memory>
#include <random>

#include "commands.hpp"
#include "nearmesh/core/base/resources.hpp"
#include "nearmesh/core/base/stopwatch.hpp"
#include "nearmesh/publisher/dds_channel.hpp"
#include "nearmesh/publisher/service.hpp"

namespace nearmesh::publisher {
namespace {

struct Options {
  std::vector<std::string> files;
  DdsChannelOptions channel;
};

Status serve(const Options& options) {
  auto channel = DdsChannel::create(options.channel);
  if (!channel.is_ok()) return channel.status();
  std::random_device random;
  const wire::SessionId session = wire::SessionId{random()} << 32 | random();
  Service service(*channel.value(), session);
  for (const std::string& path : options.files) {
    Result<ModelFile> file = ModelFile::open(path);
    if (!file.is_ok()) return file.status();
    const SpmHeader& header = file.value().header();
    spdlog::info("serving {}: {} faces, {} splits, header {} bytes", path, header.face_count,
                 header.split_count(), file.value().header_bytes().size());
    NEARMESH_RETURN_IF_ERROR(
        service.add_model(std::filesystem::path(path).stem().string(), std::move(file).value()));
  }
  service.announce();
  spdlog::info("ready on domain {}, topics {}/*", options.channel.transport.domain,
               options.channel.transport.prefix);

  const Stopwatch clock;
  double next_status_s = 10;
  std::uint64_t reported_requests = 0;
  while (stop_requested == 0) {
    for (const std::string& line : service.step(clock.seconds())) spdlog::warn("{}", line);
    for (const std::string& line : channel.value()->take_complaints()) spdlog::warn("{}", line);
    if (clock.seconds() >= next_status_s) {
      next_status_s += 10;
      const ServiceStats& stats = service.stats();
      if (stats.requests != reported_requests)
        spdlog::info(
            "{} peers, {} requests ({} refused), {} batches, {} bytes sent, {:.0f} MB resident",
            stats.peers, stats.requests, stats.refused, stats.batches, stats.bytes,
            static_cast<double>(resident_memory_bytes()) / 1e6);
      reported_requests = stats.requests;
    }
    channel.value()->wait(0.02);
  }
  const ServiceStats& stats = service.stats();
  spdlog::info("stopping: {} requests ({} refused), {} batches, {} bytes sent", stats.requests,
               stats.refused, stats.batches, stats.bytes);
  return Status::ok();
}

}  // namespace

void add_serve_command(CLI::App& app, std::function<Status()>& chosen) {
  const auto options = std::make_shared<Options>();
  CLI::App* command =
      app.add_subcommand("serve", "Serve models until Ctrl-C; a model's name is its file's name.");
  command->add_option("models", options->files, ".spm files")->required();
  command->add_option("--domain", options->channel.transport.domain, "DDS domain")
      ->capture_default_str()
      ->check(CLI::Range(0, 232));
  command
      ->add_option("--prefix", options->channel.transport.prefix,
                   "First part of every topic's name")
      ->capture_default_str();
  command->add_option(
      "--interface", options->channel.transport.interface,
      "Use one network interface only, by address or name; 127.0.0.1 needs no network");
  command->add_option(
      "--peer", options->channel.transport.initial_peers,
      "Address to look for peers at, where multicast does not get through; repeatable");
  command->callback([options, &chosen] { chosen = [options] { return serve(*options); }; });
}

}  // namespace nearmesh::publisher
