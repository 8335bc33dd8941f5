// SPDX-License-Identifier: Apache-2.0
#pragma once
// A topic's writer and reader: messages go in and come out, faults are complained of. For the rooms
// named dds alone.

#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "bus.hpp"
#include "codec.hpp"
#include "dds_time.hpp"
#include "endpoint_names.hpp"
#include "listeners.hpp"
#include "mailbox.hpp"
#include "type_support.hpp"

namespace nearmesh::wire {

enum class WriteResult { kTaken, kFull, kFailed };

/// Tries again for two seconds while `write` finds no room; Fast DDS 2.9 also says so without need.
/// Out: it was taken. Waiting may take a wake-up that was meant for others, so the mailbox is woken
/// again.
template <class Write>
[[nodiscard]] bool write_patiently(const std::string& topic, Mailbox& mailbox, Write write) {
  constexpr std::chrono::seconds kDeadline{2};
  const auto deadline = std::chrono::steady_clock::now() + kDeadline;
  WriteResult result = write();
  if (result != WriteResult::kFull) return result == WriteResult::kTaken;
  for (; result == WriteResult::kFull && std::chrono::steady_clock::now() < deadline;
       result = write())
    mailbox.wait(0.002);
  mailbox.wake();
  if (result == WriteResult::kFull) mailbox.complain(topic + ": not sent: no room for 2 s");
  return result == WriteResult::kTaken;
}

/// A topic's writer with its listener. Make it before the bus that opens it, and let it outlive
/// that. Threads: one.
template <class Message>
class Writer {
 public:
  using Data = typename TypeOf<Message>::Data;

  explicit Writer(Mailbox& mailbox) : mailbox_(mailbox), listener_(mailbox) {}

  /// Errors: as Bus::writer.
  [[nodiscard]] Status open(Bus& bus, const std::string& partition = "") {
    auto made = bus.writer<Message>(listener_, partition);
    writer_ = made.is_ok() ? made.value() : nullptr;
    return made.status();
  }
  [[nodiscard]] bool is_open() const { return writer_ != nullptr; }
  /// Its bus is gone.
  void forget() {
    writer_ = nullptr;
    listener_.forget_readers();
  }
  [[nodiscard]] fdds::DataWriter& endpoint() const { return *writer_; }
  [[nodiscard]] WriterListener& listener() { return listener_; }
  [[nodiscard]] const WriterListener& listener() const { return listener_; }

  [[nodiscard]] WriteResult write(const Message& message) {
    Data data;
    encode(message, data);
    return write_sample(data);
  }
  /// kFull covers every TIMEOUT of Fast DDS 2.9, which also comes spuriously: the sample was not
  /// sent and should be tried again. kFailed leaves a complaint.
  [[nodiscard]] WriteResult write_sample(Data& data) {
    const ReturnCode code = writer_->write(sample_of(data), rtps::c_InstanceHandle_Unknown);
    if (is_ok(code)) return WriteResult::kTaken;
    if (is_timeout(code)) return WriteResult::kFull;
    mailbox_.complain(writer_->get_topic()->get_name() + ": write failed: " + name_of(code));
    return WriteResult::kFailed;
  }
  /// Late joiners shall not get the sample with this key any more.
  void dispose(Data& data) { writer_->dispose(sample_of(data), rtps::c_InstanceHandle_Unknown); }

 private:
  static auto* sample_of(Data& data) {
    return static_cast<typename TypeOf<Message>::Sample*>(&data);
  }

  Mailbox& mailbox_;
  WriterListener listener_;
  fdds::DataWriter* writer_ = nullptr;
};

/// A topic's reader with its listener; as Writer.
template <class Message>
class Reader {
 public:
  explicit Reader(Mailbox& mailbox) : mailbox_(mailbox), listener_(mailbox) {}

  /// Errors: as Bus::reader; then it is not open.
  [[nodiscard]] Status open(Bus& bus, const std::string& partition = "",
                            Hearing hearing = Hearing::kAsPromised) {
    auto made = bus.reader<Message>(listener_, partition, hearing);
    reader_ = made.is_ok() ? made.value() : nullptr;
    return made.status();
  }
  [[nodiscard]] bool is_open() const { return reader_ != nullptr; }
  /// Its bus is gone.
  void forget() {
    reader_ = nullptr;
    (void)listener_.take_matches();
  }
  [[nodiscard]] fdds::DataReader& endpoint() const { return *reader_; }
  /// Which writers came and went since the last call.
  [[nodiscard]] std::vector<ReaderListener::Match> take_matches() {
    return listener_.take_matches();
  }

  /// Takes at most `most` samples. Valid ones go to accept(message, writer, received), the others
  /// leave one complaint each. `heard` (may be empty) is told of every sample's writer. Out: true
  /// when there may be more.
  template <class Accept>
  [[nodiscard]] bool drain(std::size_t most, Accept accept,
                           const std::function<void(const Handle&)>& heard = {}) {
    if (!is_open()) return false;
    typename TypeOf<Message>::Data data;
    fdds::SampleInfo info;
    for (std::size_t i = 0; i < most; ++i) {
      data.fault.clear();
      const ReturnCode code =
          reader_->take_next_sample(static_cast<typename TypeOf<Message>::Sample*>(&data), &info);
      if (!wire::is_ok(code)) return false;
      if (heard) heard(info.publication_handle);
      note_sequence(info);
      if (!info.valid_data) continue;  // a dispose: nothing here depends on it
      std::string fault = data.fault;
      if (fault.empty()) {
        auto message = decode(data);
        if (message.is_ok()) {
          accept(std::move(message).value(), info.publication_handle,
                 to_us(info.reception_timestamp));
          continue;
        }
        fault = message.status().message();
      }
      mailbox_.complain(topic_heard_by(*reader_) + ": sample of " +
                        name_of(info.publication_handle, mailbox_) + " dropped: " + fault);
    }
    return true;
  }
  /// In accept(): so many samples of this writer, between the one before and this one, never came,
  /// or were displaced before they were taken. Where a writer chooses who gets what, also those
  /// that were not for this reader.
  [[nodiscard]] std::uint64_t missed() const { return missed_; }

 private:
  static constexpr std::size_t kMaxWriters = 4096;
  void note_sequence(const fdds::SampleInfo& info) {
    const std::uint64_t now = info.sample_identity.sequence_number().to64long();
    missed_ = 0;
    if (sequences_.size() >= kMaxWriters) sequences_.clear();
    const auto [last, is_first] = sequences_.try_emplace(info.publication_handle, now);
    if (is_first) return;
    if (now > last->second) missed_ = now - last->second - 1;
    last->second = std::max(last->second, now);
  }

  Mailbox& mailbox_;
  ReaderListener listener_;
  fdds::DataReader* reader_ = nullptr;
  std::map<Handle, std::uint64_t> sequences_;  ///< the last, by writer
  std::uint64_t missed_ = 0;
};

}  // namespace nearmesh::wire
