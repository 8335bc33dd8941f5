// SPDX-License-Identifier: Apache-2.0
// The channel of a session on DDS, where the build has it.
#include <limits>
#include <utility>

#include "session.hpp"
#ifdef NEARMESH_C_WITH_DDS
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#endif

namespace nearmesh::c {

#ifdef NEARMESH_C_WITH_DDS
namespace {

constexpr double kLongest_s = 86400;

void take_text(const char* given, std::string& option) {
  if (given != nullptr) option = given;
}

Status take_seconds(double given, const char* name, double& option) {
  NEARMESH_RETURN_IF_ERROR(check_number(given, 0, kLongest_s, name));
  if (given != 0) option = given;
  return Status::ok();
}

Result<wire::TransportOptions> transport_of(const nearmesh_dds_options& read) {
  const char* called = read.transport == nullptr ? "lan" : read.transport;
  const std::optional<wire::Transport> transport = wire::transport_of(called);
  if (!transport)
    return Status{StatusCode::kInvalidArgument,
                  std::string("transport is '") + called +
                      "', expected lan, thin, tcp, udp-only or same-host"};
  wire::TransportOptions options = wire::preset_of(*transport);
  take_text(read.name, options.name);
  take_text(read.prefix, options.prefix);
  take_text(read.network_interface, options.interface);
  take_text(read.security, options.security);
  take_text(read.discovery_server, options.discovery_server);
  NEARMESH_RETURN_IF_ERROR(
      check_array(read.initial_peers, read.initial_peer_count, "initial_peers"));
  for (std::size_t i = 0; i < read.initial_peer_count; ++i) {
    NEARMESH_RETURN_IF_ERROR(check_given(read.initial_peers[i], "a text of initial_peers"));
    options.initial_peers.emplace_back(read.initial_peers[i]);
  }
  options.domain = read.domain;
  NEARMESH_RETURN_IF_ERROR(
      check_number(read.listen_port, 0, std::numeric_limits<std::uint16_t>::max(), "listen_port"));
  options.listen_port = static_cast<std::uint16_t>(read.listen_port);
  if (read.participants_per_peer != 0) options.participants_per_peer = read.participants_per_peer;
  NEARMESH_RETURN_IF_ERROR(take_seconds(read.lease_s, "lease_s", options.lease_s));
  NEARMESH_RETURN_IF_ERROR(take_seconds(read.silence_s, "silence_s", options.silence_s));
  NEARMESH_RETURN_IF_ERROR(
      take_seconds(read.announcement_s, "announcement_s", options.announcement_s));
  NEARMESH_RETURN_IF_ERROR(
      take_seconds(read.identity_period_s, "identity_period_s", options.identity_period_s));
  NEARMESH_RETURN_IF_ERROR(take_seconds(read.heartbeat_s, "heartbeat_s", options.heartbeat_s));
  return options;
}

}  // namespace

Result<std::unique_ptr<subscriber::Channel>> make_dds_channel(const nearmesh_dds_options* given) {
  nearmesh_dds_options read{};
  NEARMESH_RETURN_IF_ERROR(read_options(given, "nearmesh_dds_options", read));
  const Result<wire::TransportOptions> transport = transport_of(read);
  NEARMESH_RETURN_IF_ERROR(transport);
  subscriber::DdsChannelOptions options;
  options.transport = transport.value();
  Result<std::unique_ptr<subscriber::DdsChannel>> channel = subscriber::DdsChannel::create(options);
  NEARMESH_RETURN_IF_ERROR(channel);
  return std::unique_ptr<subscriber::Channel>(std::move(channel).value());
}
#else
Result<std::unique_ptr<subscriber::Channel>> make_dds_channel(const nearmesh_dds_options*) {
  return Status{
      StatusCode::kUnsupported,
      "this libnearmesh was built without DDS (NEARMESH_WITH_DDS=OFF); a local session is "
      "fed from .spm files"};
}
#endif

}  // namespace nearmesh::c

nearmesh_status nearmesh_dds_options_init(nearmesh_dds_options* options, size_t size) noexcept {
  return nearmesh::c::init_options(options, size, nearmesh_dds_options{});
}
