// SPDX-License-Identifier: Apache-2.0
// nearmesh-publisher serve: models to any number of peers, until Ctrl-C.
#include <spdlog/spdlog.h>

#include <charconv>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "commands.hpp"
#include "core/base/counted.hpp"
#include "core/base/hash.hpp"
#include "core/base/resources.hpp"
#include "core/base/stopwatch.hpp"
#include "core/world/world_folder.hpp"
#include "idl/messages/process_name.hpp"
#include "idl/program/logging.hpp"
#include "idl/program/metrics.hpp"
#include "nearmesh/core/base/parse_content_hash.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "publisher/dds/dds_channel.hpp"
#include "publisher/serve/checked_model.hpp"
#include "publisher/serve/service.hpp"

namespace nearmesh::publisher::program {
namespace {

/// What a model takes the place of, and from when on.
struct Replaced {
  ContentHash content;
  wire::Epoch epoch;
};

/// "EPOCH:TIME".
std::optional<wire::Epoch> read_epoch(std::string_view text) {
  wire::Epoch epoch;
  const char* const end = text.data() + text.size();
  const auto number = std::from_chars(text.data(), end, epoch.number);
  if (number.ec != std::errc() || epoch.number == 0 || number.ptr == end || *number.ptr != ':')
    return std::nullopt;
  const auto time = std::from_chars(number.ptr + 1, end, epoch.from_s);
  if (time.ec != std::errc() || time.ptr != end || !wire::is_time(epoch.from_s))
    return std::nullopt;
  return epoch;
}

/// By the model's name, from "MODEL=CONTENT" or "MODEL=CONTENT@EPOCH:TIME".
Result<std::map<std::string, Replaced>> read_replaces(const std::vector<std::string>& pairs) {
  std::map<std::string, Replaced> replaces;
  for (const std::string& pair : pairs) {
    const std::size_t at = pair.rfind('=');
    if (at == std::string::npos)
      return Status{StatusCode::kInvalidArgument,
                    "replaces: expected MODEL=CONTENT, found '" + pair + "'"};
    Replaced replaced;
    std::string_view text = std::string_view(pair).substr(at + 1);
    if (const std::size_t sign = text.find('@'); sign != std::string_view::npos) {
      const auto epoch = read_epoch(text.substr(sign + 1));
      if (!epoch)
        return Status{StatusCode::kInvalidArgument,
                      "replaces: " + pair +
                          ": expected MODEL=CONTENT@EPOCH:TIME, an epoch from 1 and seconds on the "
                          "exercise's clock"};
      replaced.epoch = *epoch;
      text = text.substr(0, sign);
    }
    const Result<ContentHash> content = parse_content_hash(text);
    if (!content.is_ok())
      return Status{content.status().code(),
                    "replaces: " + pair + ": " + content.status().message()};
    replaced.content = content.value();
    if (!replaces.emplace(pair.substr(0, at), replaced).second)
      return Status{StatusCode::kConflict, "replaces: " + pair.substr(0, at) + " is named twice"};
  }
  return replaces;
}

/// What is served under a name, looked through.
struct Served {
  std::string path, name;
  Replaced replaced;
  std::optional<ModelFile> model;  ///< none: a world
};

Result<Served> look_through(const std::string& path) {
  std::error_code error;
  if (std::filesystem::exists(WorldFolder::record_path(path), error)) {
    const Result<WorldFolder> folder = WorldFolder::open(path);
    NEARMESH_RETURN_IF_ERROR(folder);
    const WorldRecord& world = folder.value().world();
    spdlog::info("serving world {}: content {}, {} faces in {} tiles", path,
                 to_hex(folder.value().name()), world.faces, world.tiles);
    return Served{.path = path, .name = name_of_folder(path)};
  }
  Result<ModelFile> file = open_checked(path);
  NEARMESH_RETURN_IF_ERROR(file);
  const SpmHeader& header = file.value().header();
  spdlog::info("serving {}: content {}, {} faces, {} splits, header {} bytes", path,
               to_hex(file.value().content_hash()), header.face_count, header.split_count(),
               file.value().header_bytes().size());
  return Served{.path = path,
                .name = std::filesystem::path(path).stem().string(),
                .model = std::move(file).value()};
}

Result<std::vector<Served>> look_through(const ServeOptions& options) {
  Result<std::map<std::string, Replaced>> replaces = read_replaces(options.replaces);
  NEARMESH_RETURN_IF_ERROR(replaces);
  std::vector<Served> all;
  for (const std::string& path : options.models) {
    Result<Served> one = look_through(path);
    NEARMESH_RETURN_IF_ERROR(one);
    if (const auto found = replaces.value().extract(one.value().name))
      one.value().replaced = found.mapped();
    all.push_back(std::move(one).value());
  }
  if (!replaces.value().empty())
    return Status{StatusCode::kNotFound,
                  "replaces: no model " + replaces.value().begin()->first + " is served here"};
  return all;
}

Status add(Served&& one, Service& service) {
  const auto& [content, epoch] = one.replaced;
  if (!one.model) return service.add_world(one.name, one.path, content, epoch);
  return service.add_model(one.name, *std::move(one.model), content, epoch);
}

}  // namespace

Outcome run(const ServeOptions& options) {
  std::unique_ptr<wire::program::MetricsServer> metrics;
  if (!options.metrics.empty()) {
    auto server = wire::program::MetricsServer::start(options.metrics);
    NEARMESH_RETURN_IF_ERROR(server);
    metrics = std::move(server).value();
  }
  wire::program::log_fastdds();
  wire::program::log_network(options.channel.transport);
  // Before the bus is joined: of a large model it takes long the first time, and whoever stops it
  // need not wait for that.
  wire::program::end_on_signals();
  Result<std::vector<Served>> served = look_through(options);
  NEARMESH_RETURN_IF_ERROR(served);
  wire::program::stop_on_signals();
  auto channel = DdsChannel::create(options.channel);
  NEARMESH_RETURN_IF_ERROR(channel);
  const wire::SessionId session = wire::make_session_id();
  Service service(*channel.value(), session);
  for (Served& one : served.value()) NEARMESH_RETURN_IF_ERROR(add(std::move(one), service));
  service.announce();
  const wire::TransportOptions& transport = options.channel.transport;
  spdlog::info("ready on domain {}, topics {}/*, transport {}, as publisher {}", transport.domain,
               transport.prefix, wire::to_string(transport.transport),
               wire::called(session, wire::name_of_process(transport.name)));

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
        log.info("{}, {} ({} refused), {} batches, {} bytes sent, {:.0f} MB resident",
                 counted(stats.peers, "peer"), counted(stats.requests, "request"), stats.refused,
                 stats.batches, stats.bytes, static_cast<double>(resident_memory_bytes()) / 1e6);
      reported_requests = stats.requests;
    }
    if (Status identity = channel.value()->identity(); !identity.is_ok())
      return {std::move(identity), wire::program::kIdentityEnded};
    if (!service.is_behind()) channel.value()->wait(0.02);
  }
  const ServiceStats& stats = service.stats();
  spdlog::info("stopping: {} ({} refused), {} batches, {} bytes sent",
               counted(stats.requests, "request"), stats.refused, stats.batches, stats.bytes);
  return Status::ok();
}

}  // namespace nearmesh::publisher::program
