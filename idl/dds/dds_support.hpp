// SPDX-License-Identifier: Apache-2.0
#pragma once
// What both channels need of Fast DDS: joining the bus, entities that are removed again, listeners
// that only wake, and a book of who is who. For the rooms named dds alone.

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/subscriber/SubscriberListener.hpp>
#include <fastdds/dds/topic/ContentFilteredTopic.hpp>
#include <fastdds/dds/topic/Topic.hpp>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "codec.hpp"
#include "fastdds_api.hpp"
#include "mailbox.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "qos.hpp"
#include "told_bodies.hpp"
#include "type_support.hpp"

namespace nearmesh::wire {

class DoorWatch;

using Timestamp = rtps::Time_t;
using Microseconds = std::int64_t;

/// Of a thread of ours, which nothing may leave: what `step` says; kIo where there is no memory for
/// it.
template <class Step>
[[nodiscard]] Status or_no_memory(Step step) {
  try {
    return step();
  } catch (const std::bad_alloc&) {
    return {StatusCode::kIo, "no memory"};
  }
}

/// Since the epoch, by the clock that stamps received samples.
[[nodiscard]] Microseconds now_us();
[[nodiscard]] Microseconds to_us(const Timestamp& time);

/// Of one reader and its Subscriber: wakes, and remembers which writers came and went.
/// on_data_on_readers is taken here so that it does not reach a listener of the host's participant.
/// A writer whose participant falls silent has gone, long before its lease is over, and is found
/// again with the next life sign: discovery forgets nobody meanwhile, so that nothing is told anew.
class ReaderListener : public fdds::SubscriberListener {
 public:
  explicit ReaderListener(Mailbox& mailbox) : mailbox_(mailbox) {}
  /// Of the participant that the reader is on; nullptr: only leases tell who is gone.
  void watch_life_signs(std::shared_ptr<const DoorWatch> door, double silence_s);

  struct Match {
    Handle writer;
    Microseconds when;
    Mover now;  ///< kThere: found; else how it went, kSilent and may be found again

    [[nodiscard]] bool is_gone() const { return now != Mover::kThere; }
  };
  [[nodiscard]] std::vector<Match> take_matches();

  void on_data_on_readers(fdds::Subscriber* subscriber) override;
  void on_data_available(fdds::DataReader* reader) override;
  void on_subscription_matched(fdds::DataReader* reader,
                               const fdds::SubscriptionMatchedStatus& status) override;
  void on_requested_incompatible_qos(fdds::DataReader* reader,
                                     const fdds::RequestedIncompatibleQosStatus& status) override;

 private:
  Mailbox& mailbox_;
  void look_for_life_signs();

  std::mutex mutex_;
  std::vector<Match> matches_;
  std::map<Handle, bool> silent_;  ///< of each writer that is matched
  std::shared_ptr<const DoorWatch> door_;
  double silence_s_ = 0;
  std::chrono::steady_clock::time_point looked_{};
};

/// Of one writer: wakes, and knows the readers that are matched.
class WriterListener : public fdds::DataWriterListener {
 public:
  explicit WriterListener(Mailbox& mailbox) : mailbox_(mailbox) {}

  /// The writer was removed, and another will use this listener.
  void forget_readers();
  /// Whether a reader was matched since the last call.
  [[nodiscard]] bool take_came();
  [[nodiscard]] bool has_readers() const;
  /// Is a reader of the same participant as this endpoint matched?
  [[nodiscard]] bool is_matched_with_participant_of(const Handle& endpoint) const;
  /// Is a reader of any other participant matched?
  [[nodiscard]] bool is_matched_beside_participant_of(const Handle& endpoint) const;

  void on_publication_matched(fdds::DataWriter* writer,
                              const fdds::PublicationMatchedStatus& status) override;
  void on_offered_incompatible_qos(fdds::DataWriter* writer,
                                   const fdds::OfferedIncompatibleQosStatus& status) override;

 private:
  Mailbox& mailbox_;
  mutable std::mutex mutex_;
  std::set<Handle> readers_;
  bool came_ = false;
};

/// Which session speaks through which writer. The first writer that claims a session keeps it, so
/// nobody can speak for, or be lost in the name of, another. Threads: one.
class SessionBook {
 public:
  enum class Claim {
    kNew,    ///< first word of this session
    kKnown,  ///< as before
    kTaken,  ///< the session belongs to another writer, or the writer to another session
    kStale,  ///< received before its writer went: must not bring the session back
  };
  [[nodiscard]] Claim claim(SessionId session, const Handle& writer, Microseconds received);
  /// The session that is lost with this writer.
  [[nodiscard]] std::optional<SessionId> forget(const Handle& writer, Microseconds when);
  /// The writer is found again: what it says from now on counts, whatever the clock says.
  void welcome(const Handle& writer) { gone_.erase(writer); }
  /// The writer that a session speaks through.
  [[nodiscard]] std::optional<Handle> writer_of(SessionId session) const;
  /// Takes back a claim that was new.
  void release(SessionId session);
  [[nodiscard]] std::size_t size() const { return sessions_.size(); }
  /// Forgets everything. Out: the sessions that were known.
  [[nodiscard]] std::vector<SessionId> clear();

 private:
  static constexpr std::size_t kMaxGone = 4096;
  std::map<Handle, SessionId> writers_;
  std::map<SessionId, Handle> sessions_;
  std::map<Handle, Microseconds> gone_;  ///< when; until found again, at most kMaxGone
};

/// What each writer of hellos said last. A reader of Fast DDS remembers what it had of a writer
/// that its lease took, and is not sent it again when the same writer is found again, as after a
/// link was down: what that said last still holds, unless it says something else. Threads: one.
class HelloMemory {
 public:
  void heard(const Hello& hello, const Handle& writer);
  void lost(const Handle& writer);
  /// The writer is matched. Out: what it said last, if it was lost since; nullptr else.
  [[nodiscard]] const Hello* found(const Handle& writer);

 private:
  static constexpr std::size_t kMaxKnown = 256;
  struct Known {
    Hello hello;
    Handle writer;
    bool gone = false;  ///< the writer was lost, and has not been found again
  };
  std::deque<Known> known_;  ///< oldest first
};

/// Notices writers that were matched, but of which nothing comes: discovery gets through, their
/// data does not. Times are of any steady clock. Threads: one.
class SilenceWatch {
 public:
  explicit SilenceWatch(double patience_s) : patience_s_(patience_s) {}
  void matched(const Handle& writer, double now_s);
  void heard(const Handle& writer);
  void gone(const Handle& writer);
  /// Those that have said nothing since they were matched patience_s ago; each once.
  [[nodiscard]] std::vector<Handle> take_silent(double now_s);

 private:
  const double patience_s_;
  std::map<Handle, double> waiting_;  ///< since when
  std::set<Handle> heard_;            ///< may be before the match is told
};
/// What to say of such a writer, behind its name.
inline constexpr const char* kSilentHint =
    " was found and matched, but nothing comes from it: its data does not get through. On one "
    "machine with shared "
    "memory, perhaps of another user: use --transport lan on both sides. Between machines: let UDP "
    "ports from 7400 + "
    "250 x domain on pass the firewall";

struct BusOptions {
  TransportOptions transport;
  fdds::DomainParticipant* host_participant = nullptr;  ///< used as it is, instead of an own one
  std::int32_t header_bytes_per_s = 0;  ///< above 0: makes the flow controller kPacedFlow
  std::optional<TopicNames> names;      ///< where topics are called otherwise than the prefix says
  /// All bodies that the host will ever name, where it knows them: of an own participant others'
  /// doors are told (told_bodies.hpp). More than kMaxToldBodies are not told.
  std::optional<BodyNames> bodies;
  struct Found {
    Handle endpoint;
    std::string topic, partition;  ///< "" for none
    bool gone = false;
  };
  /// Told of every writer elsewhere that is found, before any of its samples comes, or goes; not
  /// with a host's participant. Called by threads of Fast DDS.
  std::function<void(const Found& found)> on_writer;
  /// The same of readers.
  std::function<void(const Found& found)> on_reader;
};

/// To be called before a writer is deleted. Fast DDS before 2.13 resets the samples of a writer
/// that it deletes while a heartbeat may look for gaps between them, and then neither thread ever
/// ends (its pull request 4076).
void drop_samples(fdds::DataWriter& writer);

class DiscoveryListener;

/// A participant, own or the host's, and everything made on it; the destructor removes that, and
/// only that. Threads: one. Listeners must outlive the bus.
class Bus {
 public:
  /// Of an own participant check_room() first (room.hpp), before a thread is made for it.
  /// Errors: kInvalidArgument (prefix, interface, domain, security); kIo when Fast DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<Bus>> open(const BusOptions& options,
                                                         Mailbox& mailbox);
  ~Bus();
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;

  /// A Subscriber or Publisher of its own in the partition ("" for none) with one endpoint of the
  /// message's topic: name, type and QoS are those of the table. Errors: kConflict when the host
  /// has another type or topic under the name; kIo.
  template <class Message, class Type = TypeOf<Message>>
  [[nodiscard]] Result<fdds::DataReader*> reader(ReaderListener& listener,
                                                 const std::string& partition = "",
                                                 Hearing hearing = Hearing::kAsPromised) {
    const auto topic = add_topic<Type>(names_->of<Message>());
    NEARMESH_RETURN_IF_ERROR(topic);
    fdds::TopicDescription* heard = topic.value();
    if (topic_of<Message>().delivery.is_routed && hearing != Hearing::kAll) {
      const auto routed = add_routed(topic.value());
      NEARMESH_RETURN_IF_ERROR(routed);
      heard = routed.value();
    }
    return add_reader(heard, reader_qos(topic_of<Message>().delivery, hearing), listener,
                      partition);
  }
  template <class Message>
  [[nodiscard]] Result<fdds::DataWriter*> writer(WriterListener& listener,
                                                 const std::string& partition = "") {
    const auto topic = add_topic<TypeOf<Message>>(names_->of<Message>());
    NEARMESH_RETURN_IF_ERROR(topic);
    return add_writer(topic.value(), writer_qos(topic_of<Message>().delivery, heartbeat_s_),
                      listener, partition);
  }
  void remove_writer(fdds::DataWriter* writer);
  void remove_reader(fdds::DataReader* reader);
  [[nodiscard]] const TopicNames& names() const { return *names_; }
  /// Poses that this writer tells are of these bodies alone (PoseHearers).
  void tell_moved(const fdds::DataWriter& writer, const std::vector<std::string>& bodies);
  /// Of the participant; nullptr: a host's, without one.
  [[nodiscard]] const std::shared_ptr<DoorWatch>& door() const { return door_; }
  /// Whether a writer or reader of another participant was ever found, since this was opened: one
  /// that only announces itself may not be within reach. True of a host's participant. Any thread.
  [[nodiscard]] bool has_found_others() const;

 private:
  Bus() = default;
  void add_routes();
  template <class Type>
  Result<fdds::Topic*> add_topic(const std::string& name) {
    fdds::TypeSupport type(new Type);
    return add_topic(name, type, [](const fdds::TypeSupport& found) {
      return dynamic_cast<const Type*>(found.get()) != nullptr;
    });
  }
  Result<fdds::Topic*> add_topic(const std::string& name, const fdds::TypeSupport& type,
                                 bool (*is_ours)(const fdds::TypeSupport&));
  Status add_type(const fdds::TypeSupport& type, bool (*is_ours)(const fdds::TypeSupport&));
  Result<fdds::ContentFilteredTopic*> add_routed(fdds::Topic* topic);
  Result<fdds::DataReader*> add_reader(fdds::TopicDescription* topic,
                                       const fdds::DataReaderQos& qos, ReaderListener& listener,
                                       const std::string& partition);
  Result<fdds::DataWriter*> add_writer(fdds::Topic* topic, const fdds::DataWriterQos& qos,
                                       WriterListener& listener, const std::string& partition);

  std::unique_ptr<DiscoveryListener> discovery_;
  fdds::DomainParticipant* participant_ = nullptr;
  bool is_own_ = false;
  std::string refusal_hint_;  ///< for messages, where security is on
  std::vector<fdds::DataWriter*> writers_;
  std::vector<fdds::DataReader*> readers_;
  std::map<std::string, fdds::Topic*> topics_;
  std::vector<fdds::ContentFilteredTopic*> routed_;
  std::vector<std::string> types_;
  std::optional<TopicNames> names_;
  double heartbeat_s_ = 0;
  double silence_s_ = 0;
  std::shared_ptr<DoorWatch> door_;
};

/// Adds to a process's status the name that it was given, and what the door knows.
void tell_of_process(const TransportOptions& options, const DoorWatch* door, ProcessStatus& status);

/// kConflict once this program's own identity does not count any more: then it hears nobody.
[[nodiscard]] Status identity_of(const DoorWatch* door);

/// Short name of a Fast DDS return code, for messages.
[[nodiscard]] const char* name_of(const ReturnCode& code);
/// Do two endpoints belong to one participant?
[[nodiscard]] bool have_one_participant(const Handle& a, const Handle& b);
/// The endpoint's GUID, for messages.
[[nodiscard]] std::string name_of(const Handle& endpoint);
/// What its participant is called, where discovery told it; else "".
[[nodiscard]] std::string participant_name(const Handle& endpoint, const Mailbox& mailbox);
/// The GUID with the name of its participant, where discovery told one.
[[nodiscard]] std::string name_of(const Handle& endpoint, const Mailbox& mailbox);

/// The name of its topic on the bus.
[[nodiscard]] std::string topic_heard_by(const fdds::DataReader& reader);

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
