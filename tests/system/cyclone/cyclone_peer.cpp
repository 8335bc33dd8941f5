// SPDX-License-Identifier: Apache-2.0
// nearmesh-cyclone-peer DOMAIN PREFIX WIRE_VERSION PEER REQUESTS: a peer made with Eclipse Cyclone
// DDS from nearmesh.idl alone; it shares no line with the project. Waits for the publisher and its
// header, sends the requests one after the other, and prints what it received, one line a sample:
//   hello PUBLISHER NAMES_HEX HASHES...   header HASH NAME BYTES_HEX
//   batch PUBLISHER HASH REQUEST SEQUENCE FLAGS BYTES_HEX
// REQUESTS is a file with a line for each request: publisher, content hash, request, priority,
// acknowledged sequence, window, most splits, count of attach words, they, count of part words,
// they. Ends with 1 after 30 s without an answer.

#include <dds/dds.h>

#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "nearmesh.h"

namespace {

using Hello = nearmesh_wire_types_HelloSample;
using Header = nearmesh_wire_types_MeshHeaderSample;
using Subscription = nearmesh_wire_types_RegionSubscriptionSample;
using Batch = nearmesh_wire_types_SplitBatchSample;

constexpr int kLast = 1;
constexpr std::chrono::seconds kDeadline{30};
constexpr std::chrono::milliseconds kRepeatAfter{500};

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "nearmesh-cyclone-peer: %s\n", what.c_str());
  std::exit(1);
}

dds_entity_t made(dds_entity_t entity, const char* what) {
  if (entity < 0) fail(std::string(what) + ": " + dds_strretcode(-entity));
  return entity;
}

std::string hex(const dds_sequence_octet& bytes) {
  std::string text;
  char two[3];
  for (std::uint32_t i = 0; i < bytes._length; ++i) {
    std::snprintf(two, sizeof two, "%02x", bytes._buffer[i]);
    text += two;
  }
  return text;
}

// The QoS that the project's readers and writers state, by hand.
class Qos {
 public:
  Qos(dds_durability_kind_t durability, dds_history_kind_t history, int depth)
      : qos_(dds_create_qos()) {
    dds_qset_reliability(qos_, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_durability(qos_, durability);
    dds_qset_history(qos_, history, depth);
  }
  ~Qos() { dds_delete_qos(qos_); }
  Qos(const Qos&) = delete;
  Qos& operator=(const Qos&) = delete;
  [[nodiscard]] dds_qos_t* get() const { return qos_; }

 private:
  dds_qos_t* qos_;
};

// Takes all samples of one reader; on_sample(const Sample&) for each with data.
template <class Sample, class OnSample>
void take(dds_entity_t reader, OnSample on_sample) {
  void* samples[1] = {nullptr};
  dds_sample_info_t info[1];
  while (dds_take(reader, samples, info, 1, 1) > 0) {
    if (info[0].valid_data) on_sample(*static_cast<const Sample*>(samples[0]));
    dds_return_loan(reader, samples, 1);
  }
}

// One line of the file of requests.
struct Request {
  Subscription message{};
  std::vector<std::uint32_t> attach;
  std::vector<std::uint8_t> region_parts;
};

std::vector<Request> read_requests(const char* path, std::uint64_t peer, std::uint16_t version) {
  std::ifstream in(path);
  std::vector<Request> requests;
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    Request& request = requests.emplace_back();
    Subscription& message = request.message;
    unsigned priority = 0;
    std::size_t count = 0;
    message.wire_version = version;
    message.peer = peer;
    words >> message.publisher >> message.content_hash[0] >> message.content_hash[1] >>
        message.request >> priority >> message.acknowledged_sequence >> message.window_bytes >>
        message.max_splits >> count;
    message.priority = static_cast<std::uint8_t>(priority);
    request.attach.resize(count);
    for (std::uint32_t& word : request.attach) words >> word;
    for (std::int32_t& cells : message.region_origin) words >> cells;
    unsigned shift = 0;
    words >> shift >> message.region_radius >> count;
    message.region_shift = static_cast<std::uint8_t>(shift);
    request.region_parts.resize(count);
    for (std::uint8_t& byte : request.region_parts) {
      unsigned number = 0;
      words >> number;
      byte = static_cast<std::uint8_t>(number);
    }
    if (!words) fail(std::string(path) + ": malformed line");
  }
  return requests;
}

class Peer {
 public:
  Peer(dds_domainid_t domain, const std::string& prefix, const std::string& version,
       const std::string& partition)
      : participant_(made(dds_create_participant(domain, nullptr, nullptr), "participant")) {
    const std::string versioned = prefix + "/v" + version + "/";
    const Qos latest(DDS_DURABILITY_TRANSIENT_LOCAL, DDS_HISTORY_KEEP_LAST, 1);
    const Qos stream(DDS_DURABILITY_VOLATILE, DDS_HISTORY_KEEP_ALL, 0);
    const Qos requests(DDS_DURABILITY_VOLATILE, DDS_HISTORY_KEEP_LAST, 256);
    hellos_ = reader(participant_, nearmesh_wire_types_HelloSample_desc, prefix + "/hello", latest);
    headers_ = reader(participant_, nearmesh_wire_types_MeshHeaderSample_desc,
                      versioned + "mesh_header", latest);
    const Qos own(DDS_DURABILITY_VOLATILE, DDS_HISTORY_KEEP_ALL, 0);
    const char* names[] = {partition.c_str()};
    dds_qset_partition(own.get(), 1, names);
    const dds_entity_t group =
        made(dds_create_subscriber(participant_, own.get(), nullptr), "subscriber");
    batches_ =
        reader(group, nearmesh_wire_types_SplitBatchSample_desc, versioned + "split_batch", stream);
    const dds_entity_t topic =
        made(dds_create_topic(participant_, &nearmesh_wire_types_RegionSubscriptionSample_desc,
                              (versioned + "region_subscription").c_str(), nullptr, nullptr),
             "topic");
    subscriptions_ =
        made(dds_create_writer(participant_, topic, requests.get(), nullptr), "writer");
  }
  ~Peer() { dds_delete(participant_); }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  // Waits for a hello, as many headers, and readers of what we write.
  void find_publisher() {
    std::size_t models = 1, headers = 0, hellos = 0;
    await("a publisher", [&] {
      take<Hello>(hellos_, [&](const Hello& hello) {
        std::printf("hello %" PRIu64 " %s", hello.publisher, hex(hello.names).c_str());
        for (std::uint32_t i = 0; i < hello.content_hashes._length; ++i)
          std::printf(" %" PRIu64, hello.content_hashes._buffer[i]);
        std::printf("\n");
        models = hello.mesh_bytes._length;
        ++hellos;
      });
      take<Header>(headers_, [&](const Header& header) {
        std::printf("header %" PRIu64 " %" PRIu64 " %s %s\n", header.content_hash[0],
                    header.content_hash[1], header.name, hex(header.bytes).c_str());
        ++headers;
      });
      dds_publication_matched_status_t matched{};
      dds_get_publication_matched_status(subscriptions_, &matched);
      return hellos > 0 && headers >= models && matched.current_count > 0;
    });
  }

  // A first word, with credit alone, makes the publisher open our partition. Asked before that is
  // found, it would answer what a volatile reader never hears. Said again while nothing comes,
  // since it may not have found our writer yet.
  void introduce(const Request& request) {
    Subscription credit = request.message;
    credit.request = 0;
    auto next_write = std::chrono::steady_clock::now();
    await("a writer in our partition", [&] {
      if (std::chrono::steady_clock::now() >= next_write) {
        write(credit);
        next_write += kRepeatAfter;
      }
      dds_subscription_matched_status_t matched{};
      dds_get_subscription_matched_status(batches_, &matched);
      return matched.current_count > 0;
    });
  }

  void ask(Request& request) {
    Subscription& message = request.message;
    message.attach._length = message.attach._maximum =
        static_cast<std::uint32_t>(request.attach.size());
    message.attach._buffer = request.attach.data();
    message.region_parts._length = message.region_parts._maximum =
        static_cast<std::uint32_t>(request.region_parts.size());
    message.region_parts._buffer = request.region_parts.data();
    write(message);
    bool complete = false;
    await("batches of request " + std::to_string(message.request), [&] {
      take<Batch>(batches_, [&](const Batch& batch) {
        std::printf("batch %" PRIu64 " %" PRIu64 " %" PRIu64 " %u %u %u %s\n", batch.publisher,
                    batch.content_hash[0], batch.content_hash[1], batch.request,
                    batch.sequence_number, batch.flags, hex(batch.bytes).c_str());
        complete |= batch.request == message.request && (batch.flags & kLast) != 0;
      });
      return complete;
    });
  }

 private:
  void write(const Subscription& message) const {
    if (const dds_return_t code = dds_write(subscriptions_, &message); code != DDS_RETCODE_OK)
      fail(std::string("write: ") + dds_strretcode(-code));
  }

  dds_entity_t reader(dds_entity_t parent, const dds_topic_descriptor_t& type,
                      const std::string& name, const Qos& qos) const {
    const dds_entity_t topic =
        made(dds_create_topic(participant_, &type, name.c_str(), nullptr, nullptr), "topic");
    return made(dds_create_reader(parent, topic, qos.get(), nullptr), "reader");
  }

  template <class Done>
  static void await(const std::string& what, Done done) {
    const auto end = std::chrono::steady_clock::now() + kDeadline;
    while (!done()) {
      if (std::chrono::steady_clock::now() > end) fail("waited in vain for " + what);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  }

  dds_entity_t participant_, hellos_ = 0, headers_ = 0, batches_ = 0, subscriptions_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6) {
    std::fprintf(stderr, "usage: nearmesh-cyclone-peer DOMAIN PREFIX WIRE_VERSION PEER REQUESTS\n");
    return 2;
  }
  const std::string partition = argv[4];
  Peer peer(static_cast<dds_domainid_t>(std::atoi(argv[1])), argv[2], argv[3], partition);
  peer.find_publisher();
  std::vector<Request> requests =
      read_requests(argv[5], std::strtoull(partition.c_str(), nullptr, 16),
                    static_cast<std::uint16_t>(std::atoi(argv[3])));
  if (!requests.empty()) peer.introduce(requests.front());
  for (Request& request : requests) peer.ask(request);
  return 0;
}
