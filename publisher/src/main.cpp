// SPDX-License-Identifier: Apache-2.0
// nearmesh-publisher: serves progressive models to any number of peers over DDS.

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <exception>
#include <filesystem>
#include <functional>
#include <random>

#include "commands.hpp"
#include "nearmesh/core/base/resources.hpp"
#include "nearmesh/core/base/stopwatch.hpp"
#include "nearmesh/publisher/dds_channel.hpp"
#include "nearmesh/publisher/service.hpp"

namespace {

volatile std::sig_atomic_t stop_requested = 0;
void request_stop(int) { stop_requested = 1; }

struct Options {
  std::vector<std::string> files;
  nearmesh::publisher::DdsChannelOptions channel;
};

nearmesh::Status serve(const Options& options) {
  using namespace nearmesh;
  auto channel = publisher::DdsChannel::create(options.channel);
  if (!channel.is_ok()) return channel.status();
  std::random_device random;
  const wire::SessionId session = wire::SessionId{random()} << 32 | random();
  publisher::Service service(*channel.value(), session);
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
      const publisher::ServiceStats& stats = service.stats();
      if (stats.requests != reported_requests)
        spdlog::info(
            "{} peers, {} requests ({} refused), {} batches, {} bytes sent, {:.0f} MB resident",
            stats.peers, stats.requests, stats.refused, stats.batches, stats.bytes,
            static_cast<double>(resident_memory_bytes()) / 1e6);
      reported_requests = stats.requests;
    }
    channel.value()->wait(0.02);
  }
  const publisher::ServiceStats& stats = service.stats();
  spdlog::info("stopping: {} requests ({} refused), {} batches, {} bytes sent", stats.requests,
               stats.refused, stats.batches, stats.bytes);
  return Status::ok();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Serves nearmesh models (.spm) to peers over DDS.", "nearmesh-publisher"};
  app.require_subcommand(1);
  Options options;
  CLI::App* command =
      app.add_subcommand("serve", "Serve models until Ctrl-C; a model's name is its file's name.");
  command->add_option("models", options.files, ".spm files")->required();
  command->add_option("--domain", options.channel.transport.domain, "DDS domain")
      ->capture_default_str()
      ->check(CLI::Range(0, 232));
  command
      ->add_option("--prefix", options.channel.transport.prefix, "First part of every topic's name")
      ->capture_default_str();
  command->add_option(
      "--interface", options.channel.transport.interface,
      "Use one network interface only, by address or name; 127.0.0.1 needs no network");
  command->add_option("--security", options.channel.transport.security,
                      "Folder of this program's identity, made by make-security");
  command->add_option(
      "--peer", options.channel.transport.initial_peers,
      "Address to look for peers at, where multicast does not get through; repeatable");
  std::function<nearmesh::Status()> chosen;
  command->callback([&] { chosen = [&] { return serve(options); }; });
  nearmesh::publisher::add_security_commands(app, chosen);
  try {
    spdlog::set_default_logger(spdlog::stderr_color_mt("nearmesh-publisher"));
    spdlog::set_pattern("%H:%M:%S %n %^%l%$: %v");
    app.parse(argc, argv);
    std::signal(SIGINT, request_stop);
    std::signal(SIGTERM, request_stop);
    const nearmesh::Status status = chosen();
    if (status.is_ok()) return 0;
    spdlog::error("{}", status.message());
    return 1;
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-publisher: %s\n", error.what());
    return 1;
  }
}
