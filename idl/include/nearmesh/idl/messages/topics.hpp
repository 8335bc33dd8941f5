// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Names on the bus. No Fast DDS here.
// Every topic but hello carries the wire version, so that layouts of two versions never meet. Hello
// does not: a publisher of another version must be heard in order to be refused loudly.

#include <optional>
#include <string>
#include <string_view>

#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::wire {

struct TopicNames {
  explicit TopicNames(std::string_view prefix);
  std::string hello, mesh_header, region_subscription, split_batch, body_pose, contact_report;
  std::string process_status;
  std::string echo, probe;  ///< of a self-test: reliable, best effort
};

/// Names of the generated types, as they are announced.
inline constexpr std::string_view kHelloType = "nearmesh::wire_types::HelloSample";
inline constexpr std::string_view kMeshHeaderType = "nearmesh::wire_types::MeshHeaderSample";
inline constexpr std::string_view kRegionSubscriptionType =
    "nearmesh::wire_types::RegionSubscriptionSample";
inline constexpr std::string_view kSplitBatchType = "nearmesh::wire_types::SplitBatchSample";
inline constexpr std::string_view kBodyPoseType = "nearmesh::wire_types::BodyPoseSample";
inline constexpr std::string_view kContactReportType = "nearmesh::wire_types::ContactReportSample";
inline constexpr std::string_view kProcessStatusType = "nearmesh::wire_types::ProcessStatusSample";
inline constexpr std::string_view kEchoType = "nearmesh::wire_types::EchoSample";

/// The partition in which one peer's batches travel: 16 hexadecimal digits.
[[nodiscard]] std::string partition_of(SessionId peer);

/// DDS stays silent when two programs use one topic with different types, or topics of different
/// wire versions. Returns one line about a remote endpoint that cannot talk to us, or nothing when
/// it can or is none of ours.
[[nodiscard]] std::optional<std::string> judge_remote_endpoint(std::string_view prefix,
                                                               std::string_view topic,
                                                               std::string_view type);

/// A fresh session id, never 0: 64 bits from the operating system.
[[nodiscard]] SessionId make_session_id();

/// Errors: kInvalidArgument unless the prefix is 1 to 100 of [A-Za-z0-9_/-] without '/' at an end.
[[nodiscard]] Status check_prefix(std::string_view prefix);

}  // namespace nearmesh::wire
