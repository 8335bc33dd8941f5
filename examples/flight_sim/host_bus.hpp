// SPDX-License-Identifier: Apache-2.0
#pragma once
// The simulator's own DDS: a participant from its own profiles, a writer of the own aircraft and a
// reader, with a listener, of everybody's.

#include <atomic>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <memory>
#include <string>
#include <vector>

#include "flight.hpp"
#include "flight_sim_types.hpp"

namespace flight_sim {

class HostBus {
 public:
  /// With the identity in folder `security`, unless that is "". Null where the profiles, the
  /// identity or Fast DDS refuse; `why` says so.
  [[nodiscard]] static std::unique_ptr<HostBus> join(const std::string& profiles_file,
                                                     const std::string& profile,
                                                     std::uint32_t domain,
                                                     const std::string& security, std::string& why);
  ~HostBus();
  void publish(const Aircraft& aircraft, std::uint64_t step);
  /// States that came since the last call.
  [[nodiscard]] std::vector<AircraftState> take();

  eprosima::fastdds::dds::DomainParticipant* participant = nullptr;
  eprosima::fastdds::dds::Publisher* publisher = nullptr;
  eprosima::fastdds::dds::Subscriber* subscriber = nullptr;
  eprosima::fastdds::dds::Topic* topic = nullptr;
  eprosima::fastdds::dds::DataWriter* writer = nullptr;
  eprosima::fastdds::dds::DataReader* reader = nullptr;
  struct Listener : eprosima::fastdds::dds::DataReaderListener {
    std::atomic<bool> has_data = false;
    std::atomic<int> peers = 0;
    void on_data_available(eprosima::fastdds::dds::DataReader*) override { has_data = true; }
    void on_subscription_matched(
        eprosima::fastdds::dds::DataReader*,
        const eprosima::fastdds::dds::SubscriptionMatchedStatus& status) override {
      peers = status.current_count;
    }
  } listener;
};

}  // namespace flight_sim
