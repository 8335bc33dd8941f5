// SPDX-License-Identifier: Apache-2.0
// nearmesh-publisher serve: models to any number of peers, until Ctrl-C.
#include <spdlog/spdlog.h>

#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "core/base/resources.hpp"
#include "core/base/stopwatch.hpp"
#include "idl/program/logging.hpp"
#include "idl/program/metrics.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "publisher/dds/dds_channel.hpp"
#include "publisher/serve/service.hpp"

namespace nearmesh::publisher::program {
namespace {

Status add_models(const ServeOptions& options, Service& service) {
  for (const std::string& path : options.models) {
    Result<ModelFile> file = ModelFile::open(path);
    NEARMESH_RETURN_IF_ERROR(file);
    const SpmHeader& header = file.value().header();
    spdlog::info("serving {}: {} faces, {} splits, header {} bytes", path, header.face_count,
                 header.split_count(), file.value().header_bytes().size());
    NEARMESH_RETURN_IF_ERROR(
        service.add_model(std::filesystem::path(path).stem().string(), std::move(file).value()));
  }
  return Status::ok();
}

}  // namespace

Status run(const ServeOptions& options) {
  std::unique_ptr<wire::program::MetricsServer> metrics;
  if (!options.metrics.empty()) {
    auto server = wire::program::MetricsServer::start(options.metrics);
    NEARMESH_RETURN_IF_ERROR(server);
    metrics = std::move(server).value();
  }
  wire::program::log_fastdds();
  auto channel = DdsChannel::create(options.channel);
  NEARMESH_RETURN_IF_ERROR(channel);
  Service service(*channel.value(), wire::make_session_id());
  NEARMESH_RETURN_IF_ERROR(add_models(options, service));
  service.announce();
  spdlog::info("ready on domain {}, topics {}/*, transport {}", options.channel.transport.domain,
               options.channel.transport.prefix,
               wire::to_string(options.channel.transport.transport));

  spdlog::logger& log = wire::program::log("service");
  const Stopwatch clock;
  double next_status_s = 10;
  std::uint64_t reported_requests = 0;
  while (stop_requested == 0) {
    for (const std::string& line : service.step(clock.seconds())) log.warn("{}", line);
    const ServiceStats& stats = service.stats();
    if (metrics != nullptr) metrics->set(service.status());
    if (clock.seconds() >= next_status_s) {
      next_status_s += 10;
      if (stats.requests != reported_requests)
        log.info(
            "{} peers, {} requests ({} refused), {} batches, {} bytes sent, {:.0f} MB resident",
            stats.peers, stats.requests, stats.refused, stats.batches, stats.bytes,
            static_cast<double>(resident_memory_bytes()) / 1e6);
      reported_requests = stats.requests;
    }
    if (!service.is_behind()) channel.value()->wait(0.02);
  }
  const ServiceStats& stats = service.stats();
  spdlog::info("stopping: {} requests ({} refused), {} batches, {} bytes sent", stats.requests,
               stats.refused, stats.batches, stats.bytes);
  return Status::ok();
}

}  // namespace nearmesh::publisher::program
