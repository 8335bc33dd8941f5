// SPDX-License-Identifier: Apache-2.0
#pragma once
// From what the table of topics promises to QoS. For the rooms named dds alone. Both sides take
// theirs from here, so they match.

#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>

#include <algorithm>

#include "fastdds_api.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::wire {

/// Names the flow controller of paced topics; Fast DDS keeps the pointer.
inline constexpr char kPacedFlow[] = "nearmesh_header";

[[nodiscard]] inline fdds::ReliabilityQosPolicyKind reliability_of(const Delivery& delivery) {
  return delivery.is_reliable ? fdds::RELIABLE_RELIABILITY_QOS : fdds::BEST_EFFORT_RELIABILITY_QOS;
}
[[nodiscard]] inline fdds::DurabilityQosPolicyKind durability_of(const Delivery& delivery) {
  return delivery.is_latched ? fdds::TRANSIENT_LOCAL_DURABILITY_QOS : fdds::VOLATILE_DURABILITY_QOS;
}

/// What readers and writers share.
template <class EndpointQos>
void apply_delivery(const Delivery& delivery, EndpointQos& qos) {
  qos.reliability().kind = reliability_of(delivery);
  qos.durability().kind = durability_of(delivery);
  qos.history().kind =
      delivery.keeps_all ? fdds::KEEP_ALL_HISTORY_QOS : fdds::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = delivery.depth;
  // Instances without limit: their slots are not reliably recycled in 2.9, and a long-lived process
  // would go deaf to the peer after the last slot (default 10). The depth bounds what each holds.
  qos.resource_limits().max_instances = 0;
  qos.resource_limits().max_samples_per_instance = 0;
  qos.resource_limits().max_samples = 0;
  qos.resource_limits().allocated_samples = 0;
  // Not DYNAMIC_*: there one dispose wedges a reliable reader for good.
  qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.data_sharing().off();  // leaves files behind when a process is killed
}

/// Where the delivery is paced, the participant must have the flow controller kPacedFlow.
[[nodiscard]] inline fdds::DataWriterQos writer_qos(const Delivery& delivery, double heartbeat_s) {
  fdds::DataWriterQos qos;
  apply_delivery(delivery, qos);
  if (delivery.keeps_all) {
    qos.resource_limits().max_instances = 1;
    qos.resource_limits().max_samples_per_instance = delivery.depth;
    qos.resource_limits().max_samples = delivery.depth;
  }
  // Never block the caller; a write that cannot be taken is tried again by whoever made it.
  qos.reliability().max_blocking_time = Duration(0, 0);
  if (delivery.is_said_again) qos.reliable_writer_qos().disable_heartbeat_piggyback = true;
  set_heartbeat_period(qos, delivery.is_said_again ? std::max(heartbeat_s, 1.0) : heartbeat_s);
  qos.publish_mode().kind = fdds::SYNCHRONOUS_PUBLISH_MODE;  // the lowest latency
  // Readers beyond these get all.
  if (delivery.is_routed) qos.writer_resource_limits().reader_filters_allocation.maximum = 4096;
  if (delivery.is_paced) {
    qos.publish_mode().kind = fdds::ASYNCHRONOUS_PUBLISH_MODE;
    qos.publish_mode().flow_controller_name = kPacedFlow;
  }
  return qos;
}

/// How a reader hears its topic.
enum class Hearing : std::uint8_t {
  kAsPromised,
  kLatest,  ///< best effort: what is lost is not sent again
  /// A recorder's: all that comes is kept until it is taken, not the latest alone. Writers do not
  /// care: theirs keep the latest, or (keeps_all) do not wait for a best-effort reader.
  kAll,
};

[[nodiscard]] inline fdds::DataReaderQos reader_qos(const Delivery& delivery,
                                                    Hearing hearing = Hearing::kAsPromised) {
  fdds::DataReaderQos qos;
  apply_delivery(delivery, qos);
  if (hearing == Hearing::kAll) qos.history().kind = fdds::KEEP_ALL_HISTORY_QOS;
  if (hearing == Hearing::kLatest || (hearing == Hearing::kAll && delivery.keeps_all))
    qos.reliability().kind = fdds::BEST_EFFORT_RELIABILITY_QOS;
  return qos;
}

}  // namespace nearmesh::wire
