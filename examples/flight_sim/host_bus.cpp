// SPDX-License-Identifier: Apache-2.0
#include "host_bus.hpp"

#include <algorithm>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>

#include "nearmesh/idl/dds/door.hpp"
#include "nearmesh/idl/dds/identity.hpp"

namespace flight_sim {

namespace fdds = eprosima::fastdds::dds;

/// Fast DDS 2 has a class of return codes, 3 has numbers; what is made of nothing is "ok" in both.
const decltype(std::declval<fdds::DataReader&>().take_next_sample(nullptr, nullptr)) kOk{};

std::unique_ptr<HostBus> HostBus::join(const std::string& profiles_file, const std::string& profile,
                                       std::uint32_t domain, const std::string& security,
                                       std::string& why) {
  auto* factory = fdds::DomainParticipantFactory::get_instance();
  if (factory->load_XML_profiles_file(profiles_file) != kOk) {
    why = profiles_file + ": not a file of Fast DDS profiles";
    return nullptr;
  }
  auto bus = std::make_unique<HostBus>();
  fdds::DomainParticipantQos qos;
  factory->get_participant_qos_from_profile(profile, qos);
  if (!security.empty()) {
    const nearmesh::Status added = nearmesh::wire::add_identity(qos, security, domain);
    if (!added.is_ok()) {
      why = added.message();
      return nullptr;
    }
  }
  nearmesh::wire::add_door(qos);  // what comes in is checked before Fast DDS reads it
  bus->participant = factory->create_participant(domain, qos);
  if (bus->participant == nullptr) {
    why = profiles_file + ": no participant from profile " + profile;
    return nullptr;
  }
  const fdds::TypeSupport type(new AircraftStatePubSubType);
  bus->participant->register_type(type);
  bus->topic = bus->participant->create_topic("flight_sim/state", type.get_type_name(),
                                              fdds::TOPIC_QOS_DEFAULT);
  bus->publisher = bus->participant->create_publisher(fdds::PUBLISHER_QOS_DEFAULT);
  bus->subscriber = bus->participant->create_subscriber(fdds::SUBSCRIBER_QOS_DEFAULT);
  if (bus->topic != nullptr && bus->publisher != nullptr && bus->subscriber != nullptr) {
    bus->writer = bus->publisher->create_datawriter_with_profile(bus->topic, "state");
    bus->reader =
        bus->subscriber->create_datareader_with_profile(bus->topic, "state", &bus->listener);
  }
  if (bus->writer != nullptr && bus->reader != nullptr) return bus;
  why = "Fast DDS could not make the topic flight_sim/state: profiles from " + profiles_file +
        (security.empty() ? "" : ", permissions from " + security);
  return nullptr;
}

HostBus::~HostBus() {
  if (participant == nullptr) return;
  if (writer != nullptr) publisher->delete_datawriter(writer);
  if (reader != nullptr) subscriber->delete_datareader(reader);
  if (publisher != nullptr) participant->delete_publisher(publisher);
  if (subscriber != nullptr) participant->delete_subscriber(subscriber);
  if (topic != nullptr) participant->delete_topic(topic);
  fdds::DomainParticipantFactory::get_instance()->delete_participant(participant);
}

void HostBus::publish(const Aircraft& aircraft, std::uint64_t step) {
  AircraftState state;
  state.name(aircraft.name);
  state.step(step);
  Vector::Map(state.position_m().data()) = aircraft.pose.translation();
  Vector::Map(state.velocity_mps().data()) = aircraft.velocity_mps;
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor>::Map(state.rotation().data()) =
      aircraft.pose.linear();
  writer->write(&state);
}

std::vector<AircraftState> HostBus::take() {
  std::vector<AircraftState> states;
  if (!listener.has_data.exchange(false)) return states;
  AircraftState state;
  fdds::SampleInfo info;
  while (reader->take_next_sample(&state, &info) == kOk)
    if (info.valid_data) states.push_back(state);
  return states;
}

}  // namespace flight_sim
