// SPDX-License-Identifier: Apache-2.0
#pragma once
// Topics of ROS 2 on a participant of their own: bytes in and out, nothing of their types known.
// For the rooms named dds alone.

#include <cstdint>
#include <list>
#include <memory>
#include <string>
#include <vector>

#include "idl/dds/door_watch.hpp"
#include "idl/dds/listeners.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber {

/// Samples of a type of ROS 2, as their CDR; the data object is a std::vector of bytes.
class CdrType : public wire::OfEitherVersion<wire::fdds::TopicDataType> {
 public:
  using Data = std::vector<std::uint8_t>;
  /// What a reader takes at most.
  static constexpr std::uint32_t kMaxReadBytes = 256 * 1024;
  explicit CdrType(const std::string& name) { describe(name, kMaxReadBytes, false); }

  void* make_data() override { return new Data; }
  void delete_made(void* data) override { delete static_cast<Data*>(data); }
  std::uint32_t size_of(const void* data) override {
    return static_cast<std::uint32_t>(static_cast<const Data*>(data)->size());
  }
  bool write(const void* data, wire::Payload& payload) override;
  bool read(wire::Payload& payload, void* data) override;
  bool key_of(const void*, wire::Handle&, bool) override { return false; }
};

/// Threads: one.
class Ros2Endpoints {
 public:
  /// What participants of this kind are called, followed by the peer's name: they do not move each
  /// other's bodies.
  static constexpr const char* kNamed = "nearmesh ros2 ";

  explicit Ros2Endpoints(wire::Mailbox& mailbox);
  ~Ros2Endpoints();
  Ros2Endpoints(const Ros2Endpoints&) = delete;
  Ros2Endpoints& operator=(const Ros2Endpoints&) = delete;

  /// Errors: as Ros2Bridge::create.
  [[nodiscard]] Status join(const wire::TransportOptions& transport);

  struct Writer {
    explicit Writer(wire::Mailbox& mailbox) : listener(mailbox) {}
    wire::WriterListener listener;
    wire::fdds::DataWriter* writer = nullptr;
  };
  struct Reader {
    explicit Reader(wire::Mailbox& mailbox) : listener(mailbox) {}
    wire::ReaderListener listener;
    wire::fdds::DataReader* reader = nullptr;
  };
  /// In: the topic and type as ROS 2 writes them, "/tf" and "tf2_msgs/msg/TFMessage". Errors: kIo.
  /// What comes out lives as long as this.
  [[nodiscard]] Result<Writer*> add_writer(const std::string& topic, const std::string& type,
                                           const wire::Delivery& delivery);
  [[nodiscard]] Result<Reader*> add_reader(const std::string& topic, const std::string& type,
                                           const wire::Delivery& delivery);

  /// Out: it was taken.
  bool write(Writer& writer, std::vector<std::uint8_t> cdr);
  /// Takes one sample. Out: false when there is none; `cdr` is empty for one that is to be left
  /// alone: a dispose, or one of our kind's.
  [[nodiscard]] bool take(Reader& reader, std::vector<std::uint8_t>& cdr);

 private:
  class Names;
  wire::fdds::Topic* topic_of(const std::string& topic, const std::string& type);

  wire::Mailbox& mailbox_;
  double heartbeat_s_ = 0.1;
  std::unique_ptr<Names> names_;
  wire::fdds::DomainParticipant* participant_ = nullptr;
  std::list<Writer> writers_;
  std::list<Reader> readers_;
};

}  // namespace nearmesh::subscriber
