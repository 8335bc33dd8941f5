// SPDX-License-Identifier: Apache-2.0
#pragma once
// QoS of every topic, with a reason each. For the rooms named dds alone. Both sides take theirs from
// here, so they match.

#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>

namespace nearmesh::wire {

namespace fdds = eprosima::fastdds::dds;

/// Unacknowledged batches a publisher keeps for one peer: more than the credit window ever lets
/// out.
inline constexpr int kBatchHistory = 256;
/// Subscriptions of one peer that may wait unread.
inline constexpr int kSubscriptionHistory = 256;
/// Names the flow controller of mesh headers; Fast DDS keeps the pointer.
inline constexpr char kHeaderFlow[] = "nearmesh_header";

struct Delivery {
  fdds::HistoryQosPolicyKind history;
  int depth;  ///< samples per key; for KEEP_ALL in total
  fdds::DurabilityQosPolicyKind durability;
};

/// What each topic promises. All are RELIABLE: a lost datagram is repaired within a heartbeat.

/// Latest state of each publisher; whoever joins later gets it too.
inline constexpr Delivery kHelloDelivery{fdds::KEEP_LAST_HISTORY_QOS, 1,
                                         fdds::TRANSIENT_LOCAL_DURABILITY_QOS};
/// Immutable per content hash; whoever joins later gets it too.
inline constexpr Delivery kMeshHeaderDelivery{fdds::KEEP_LAST_HISTORY_QOS, 1,
                                              fdds::TRANSIENT_LOCAL_DURABILITY_QOS};
/// A stream of requests. Not durable: a restarted publisher must not answer old requests.
/// KEEP_LAST, so that a frozen publisher does not stop requests to the others; what it displaces is
/// asked for again.
inline constexpr Delivery kRegionSubscriptionDelivery{
    fdds::KEEP_LAST_HISTORY_QOS, kSubscriptionHistory, fdds::VOLATILE_DURABILITY_QOS};
/// A stream to one peer through its own writer: KEEP_ALL can stall nobody else, loses nothing, and
/// a full history is seen at once as "cannot be taken now".
inline constexpr Delivery kSplitBatchDelivery{fdds::KEEP_ALL_HISTORY_QOS, kBatchHistory,
                                              fdds::VOLATILE_DURABILITY_QOS};
/// Latest pose of each body; whoever joins later learns of bodies at rest. KEEP_LAST: one frozen
/// reader must not stop the others.
inline constexpr Delivery kBodyPoseDelivery{fdds::KEEP_LAST_HISTORY_QOS, 1,
                                            fdds::TRANSIENT_LOCAL_DURABILITY_QOS};
/// Latest answer for each pair, renewed every frame: nothing to keep for latecomers.
inline constexpr Delivery kContactReportDelivery{fdds::KEEP_LAST_HISTORY_QOS, 1,
                                                 fdds::VOLATILE_DURABILITY_QOS};
/// What each process said last of itself; who asks later gets it at once.
inline constexpr Delivery kProcessStatusDelivery{fdds::KEEP_LAST_HISTORY_QOS, 1,
                                                 fdds::TRANSIENT_LOCAL_DURABILITY_QOS};
/// A self-test's samples, each once.
inline constexpr Delivery kEchoDelivery{fdds::KEEP_LAST_HISTORY_QOS, 64,
                                        fdds::VOLATILE_DURABILITY_QOS};

/// What readers and writers share.
template <class EndpointQos>
void apply_delivery(const Delivery& delivery, EndpointQos& qos) {
  qos.reliability().kind = fdds::RELIABLE_RELIABILITY_QOS;
  qos.durability().kind = delivery.durability;
  qos.history().kind = delivery.history;
  qos.history().depth = delivery.depth;
  // Instances without limit: their slots are not reliably recycled in 2.9, and a long-lived process
  // would go deaf to the peer after the last slot (default 10). The depth bounds what each holds.
  qos.resource_limits().max_instances = 0;
  qos.resource_limits().max_samples_per_instance = 0;
  qos.resource_limits().max_samples = 0;
  qos.resource_limits().allocated_samples = 0;
  // Not DYNAMIC_*: there one dispose wedges a reliable reader for good.
  qos.endpoint().history_memory_policy =
      eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.data_sharing().off();  // leaves files behind when a process is killed
}

[[nodiscard]] inline fdds::DataWriterQos writer_qos(const Delivery& delivery, double heartbeat_s) {
  fdds::DataWriterQos qos;
  apply_delivery(delivery, qos);
  if (delivery.history == fdds::KEEP_ALL_HISTORY_QOS) {
    qos.resource_limits().max_instances = 1;
    qos.resource_limits().max_samples_per_instance = delivery.depth;
    qos.resource_limits().max_samples = delivery.depth;
  }
  // Never block the caller; a write that cannot be taken is tried again by whoever made it.
  qos.reliability().max_blocking_time = eprosima::fastrtps::Duration_t(0, 0);
  qos.reliable_writer_qos().times.heartbeatPeriod = eprosima::fastrtps::Duration_t(heartbeat_s);
  qos.publish_mode().kind = fdds::SYNCHRONOUS_PUBLISH_MODE;  // the lowest latency
  return qos;
}

/// Headers can be a megabyte, and many latecomers may ask at once: paced, so that the burst does
/// not drown the link and its own repairs. The participant must have the flow controller
/// kHeaderFlow.
[[nodiscard]] inline fdds::DataWriterQos mesh_header_writer_qos(double heartbeat_s) {
  fdds::DataWriterQos qos = writer_qos(kMeshHeaderDelivery, heartbeat_s);
  qos.publish_mode().kind = fdds::ASYNCHRONOUS_PUBLISH_MODE;
  qos.publish_mode().flow_controller_name = kHeaderFlow;
  return qos;
}

[[nodiscard]] inline fdds::DataReaderQos reader_qos(const Delivery& delivery) {
  fdds::DataReaderQos qos;
  apply_delivery(delivery, qos);
  return qos;
}

}  // namespace nearmesh::wire
