// SPDX-License-Identifier: Apache-2.0
#pragma once
// A participant with an identity.

#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"

namespace nearmesh::wire {

/// Names the plug-ins of DDS Security and the identity's files (options.security, not ""). They are checked first, since
/// Fast DDS says "refused" and no more. Errors: kInvalidArgument with the first fault.
[[nodiscard]] Status set_security(const TransportOptions& options,
                                  eprosima::fastdds::dds::DomainParticipantQos& qos);

}  // namespace nearmesh::wire
