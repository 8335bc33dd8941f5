// SPDX-License-Identifier: Apache-2.0
#pragma once
// Plain structs to generated samples and back. For the rooms named dds alone.
// decode() is where bytes from outside become a message: it trusts nothing and ends with check().

#include "nearmesh/idl/messages/messages.hpp"
#include "nearmesh/idl/nearmesh.h"

namespace nearmesh::wire {

/// Out: every field of `sample` is set. The message should have passed check(): nothing is cut or
/// refused here.
void encode(const Hello& message, wire_types::HelloSample& sample);
void encode(const MeshHeader& message, wire_types::MeshHeaderSample& sample);
void encode(const RegionSubscription& message, wire_types::RegionSubscriptionSample& sample);
void encode(const SplitBatchMessage& message, wire_types::SplitBatchSample& sample);
void encode(const BodyPose& message, wire_types::BodyPoseSample& sample);
void encode(const ContactReport& message, wire_types::ContactReportSample& sample);
void encode(const ProcessStatus& message, wire_types::ProcessStatusSample& sample);
void encode(const Echo& message, wire_types::EchoSample& sample);

/// Errors: kUnsupported for another wire version; kInvalidArgument naming the field that lies
/// outside its limits.
[[nodiscard]] Result<Hello> decode(const wire_types::HelloSample& sample);
[[nodiscard]] Result<MeshHeader> decode(const wire_types::MeshHeaderSample& sample);
[[nodiscard]] Result<RegionSubscription> decode(const wire_types::RegionSubscriptionSample& sample);
[[nodiscard]] Result<SplitBatchMessage> decode(const wire_types::SplitBatchSample& sample);
[[nodiscard]] Result<BodyPose> decode(const wire_types::BodyPoseSample& sample);
[[nodiscard]] Result<ContactReport> decode(const wire_types::ContactReportSample& sample);
[[nodiscard]] Result<ProcessStatus> decode(const wire_types::ProcessStatusSample& sample);
[[nodiscard]] Result<Echo> decode(const wire_types::EchoSample& sample);

}  // namespace nearmesh::wire
