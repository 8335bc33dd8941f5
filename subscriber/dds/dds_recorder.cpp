// SPDX-License-Identifier: Apache-2.0
#include "dds_recorder.hpp"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <new>
#include <numeric>
#include <optional>
#include <thread>
#include <tuple>
#include <utility>

#include "idl/dds/bus.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/endpoint_names.hpp"
#include "idl/dds/listeners.hpp"
#include "idl/dds/rejoin_watch.hpp"
#include "idl/dds/room.hpp"
#include "nearmesh/idl/dds/payload.hpp"
#include "or_no_memory.hpp"
#include "recorder_books.hpp"

namespace nearmesh::subscriber {
namespace {

using wire::Handle;

/// Of one topic, before the others have their turn.
constexpr std::size_t kMaxRecordedAtOnce = 16384;
constexpr std::size_t kMaxWritten = 1024;  ///< before the queue is looked at again
/// For the disk; what comes beyond is dropped and counted.
constexpr std::size_t kMaxWaitingBytes = 64U << 20;
constexpr double kNothingToStore_s = 0.5;
constexpr std::size_t kMaxNames = 65536;        ///< of sessions
constexpr std::size_t kMaxGoneWriters = 16384;  ///< that are remembered: some 3 MB
constexpr wire::TopicPlace kHeldDetail = wire::place_of<wire::HeldDetail>();
/// Whoever says what it holds must be heard from then on: so long after the last writer was found,
/// the other readers have found theirs. Where writers come all the time, it is not waited for
/// longer.
constexpr auto kMatching = std::chrono::milliseconds(500);
constexpr auto kMatchingAtMost = std::chrono::seconds(5);
/// As long as no publisher is found, since one may be there: processes announce themselves each
/// second.
constexpr auto kFindingPublishers = std::chrono::milliseconds(1500);
constexpr auto kBetweenAsking = std::chrono::seconds(2);
/// How late a commit may be noticed to be due.
constexpr auto kDiskWait = std::chrono::milliseconds(100);

/// What the disk thread is to write: a message, or what is known to be missing before it.
struct Entry {
  std::uint32_t topic = 0;
  Handle writer;
  std::string partition;
  RecordedMessage message;
  std::uint64_t missing = 0;  ///< above 0: a gap of so many from message.sequence on; no message
  bool before = false;        ///< of a gap: nothing that was sent while we listened has come yet
  ContentHash content_hash;   ///< of a header, with its name
  std::string model;

  [[nodiscard]] std::size_t bytes() const { return sizeof(Entry) + message.cdr.size(); }
};

/// Counts what is missing of one writer.
struct Sequence {
  std::uint64_t next = 1;
  bool live = false;  ///< what came last was sent while we listened
};

EndpointGuid guid_of(const Handle& writer) {
  EndpointGuid guid{};
  for (std::size_t i = 0; i < guid.size(); ++i) guid[i] = writer.value[i];
  return guid;
}

}  // namespace

std::vector<std::size_t> order_of(const std::vector<SamplePlace>& samples) {
  std::vector<std::size_t> order(samples.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto before = [&](std::size_t a, std::size_t b) {
    return std::tie(samples[a].writer, samples[a].sequence) <
           std::tie(samples[b].writer, samples[b].sequence);
  };
  std::stable_sort(order.begin(), order.end(), before);
  std::vector<std::int64_t> told_ns(samples.size());  // the latest up to each, of its writer
  for (std::size_t i = 0; i < order.size(); ++i) {
    const SamplePlace& sample = samples[order[i]];
    told_ns[order[i]] = sample.source_ns;
    if (i > 0 && samples[order[i - 1]].writer == sample.writer)
      told_ns[order[i]] = std::max(sample.source_ns, told_ns[order[i - 1]]);
  }
  // Those of one time stay by writer and number.
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return told_ns[a] < told_ns[b]; });
  return order;
}

class DdsRecorder::Impl {
 public:
  explicit Impl(const RecorderOptions& options) : options_(options) {}
  ~Impl() { static_cast<void>(finish()); }

  Status start();
  RecorderStats stats() const {
    const std::lock_guard lock(mutex_);
    return stats_;
  }
  std::vector<std::string> take_complaints() { return mailbox_.take_complaints(); }
  Status finish();

 private:
  struct Topic {
    wire::TopicPlace place = 0;
    std::string name;
    std::unique_ptr<wire::ReaderListener> listener;
    wire::fdds::DataReader* reader = nullptr;
    bool (Impl::*drain)(std::uint32_t topic) = nullptr;
    Status (Impl::*open)(Topic& topic) = nullptr;
  };

  Status add_topics();

  // The DDS thread.
  void listen(std::promise<Status> started);
  Status join();
  template <class Message>
  Status open_reader(Topic& topic);
  template <class Message>
  bool drain(std::uint32_t topic);
  [[nodiscard]] bool is_new_name(const Entry& entry);
  void count_gap(const Entry& entry);
  void note_loss(std::uint32_t topic);
  void ask_if_due();
  void push(Entry&& entry);
  std::string partition_of(const Handle& writer);

  // The disk thread.
  void write();
  Status write(const Entry& entry);
  Status begin_part();
  Status make_room();

  const RecorderOptions options_;
  RecordingFacts facts_;
  std::vector<Topic> topics_;
  wire::Mailbox mailbox_;
  std::unique_ptr<wire::Bus> bus_;
  std::atomic<bool> leaving_ = false;
  std::thread dds_thread_, disk_thread_;

  // The DDS thread's own.
  WriterBook<Sequence> sequences_{kMaxGoneWriters};
  LruMap<wire::SessionId, std::string> told_names_{kMaxNames};
  std::int64_t joined_ns_ = 0;
  bool asks_ = false;  ///< all peers what they hold
  bool has_publisher_ = false;
  std::chrono::steady_clock::time_point may_ask_{}, must_ask_{};

  std::mutex partitions_mutex_;
  WriterBook<std::string> partitions_{kMaxGoneWriters};  ///< of writers that have one

  mutable std::mutex mutex_;  ///< what follows; never held during a call of DDS or of the file
  std::condition_variable filled_;
  std::deque<Entry> waiting_;
  std::size_t waiting_bytes_ = 0;
  bool heard_all_ = false;
  RecorderStats stats_;

  // The disk thread's own.
  std::unique_ptr<RecordingWriter> file_;
  std::map<std::pair<std::uint32_t, Handle>, std::uint32_t> writers_;  ///< of the current part
  bool finished_ = false;
  std::vector<Entry> taken_;  ///< room for kMaxWritten, whatever happens
};

Status DdsRecorder::Impl::add_topics() {
  const std::vector<std::string> known = wire::recorded_topics();
  const std::vector<std::string>& wanted = options_.topics.empty() ? known : options_.topics;
  const auto contains = [](const std::vector<std::string>& names, std::string_view name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  for (const std::string& name : wanted)
    if (!contains(known, name)) {
      std::string expected;
      for (const std::string& one : known) expected += (expected.empty() ? "" : ", ") + one;
      return {StatusCode::kInvalidArgument, "topic " + name + ": expected one of " + expected};
    }
  const wire::TopicNames names(options_.transport.prefix);
  wire::for_each_topic([&]<class Message>(const wire::Topic<Message>& topic) {
    if (topic.is_recorded && contains(wanted, topic.name))
      topics_.push_back({wire::place_of<Message>(), names.of<Message>(),
                         std::make_unique<wire::ReaderListener>(mailbox_), nullptr,
                         &Impl::drain<Message>, &Impl::open_reader<Message>});
  });
  return Status::ok();
}

Status DdsRecorder::Impl::start() {
  if (options_.max_bytes != 0 && options_.max_bytes < kMinFileBytes)
    return {StatusCode::kInvalidArgument, "max-size: expected at least " +
                                              std::to_string(kMinFileBytes) + " bytes, found " +
                                              std::to_string(options_.max_bytes)};
  if (options_.split && options_.max_bytes == 0)
    return {StatusCode::kInvalidArgument, "split: expected a max-size to split at"};
  NEARMESH_RETURN_IF_ERROR(wire::check_room(options_.transport));
  NEARMESH_RETURN_IF_ERROR(add_topics());
  facts_ = {wire::make_session_id(), 0, wire::kWireVersion, options_.transport.prefix,
            wire::idl_text()};
  NEARMESH_RETURN_IF_ERROR(begin_part());

  taken_.reserve(kMaxWritten);
  disk_thread_ = std::thread([this] { write(); });
  std::promise<Status> started;
  std::future<Status> outcome = started.get_future();
  dds_thread_ =
      std::thread([this, promise = std::move(started)]() mutable { listen(std::move(promise)); });
  return outcome.get();
}

Status DdsRecorder::Impl::finish() {
  leaving_ = true;
  mailbox_.wake();
  if (dds_thread_.joinable()) dds_thread_.join();
  {
    const std::lock_guard lock(mutex_);
    heard_all_ = true;
  }
  filled_.notify_all();
  if (disk_thread_.joinable()) disk_thread_.join();
  return stats().status;
}

// --- The DDS thread

void DdsRecorder::Impl::listen(std::promise<Status> started) {
  std::optional<wire::RejoinWatch> rejoin_watch;
  const Status joined = or_no_memory([&] {
    rejoin_watch.emplace(mailbox_, options_.transport);
    return join();
  });
  started.set_value(joined);
  if (!joined.is_ok()) return;
  while (!leaving_) {
    static_cast<void>(rejoin_watch->rejoin_if_due(bus_, [this] {
      mailbox_.complain("what was sent before it has joined again is missing");
      return join();
    }));
    if (bus_ == nullptr) {
      mailbox_.wait(kNothingToStore_s);
      continue;
    }
    try {
      if (const Status identity = wire::identity_of(bus_->door().get()); !identity.is_ok()) {
        const std::lock_guard lock(mutex_);
        stats_.identity = identity;
      }
      ask_if_due();
      bool more = false;
      for (std::uint32_t i = 0; i < topics_.size(); ++i) more |= (this->*topics_[i].drain)(i);
      if (!more) mailbox_.wait(kNothingToStore_s);
    } catch (const std::bad_alloc&) {
      mailbox_.complain_of_memory();
      mailbox_.wait(kNothingToStore_s);
    }
  }
  try {
    for (std::uint32_t i = 0; bus_ != nullptr && i < topics_.size(); ++i)
      while ((this->*topics_[i].drain)(i)) {
      }
  } catch (const std::bad_alloc&) {
    mailbox_.complain_of_memory();
  }
  bus_.reset();
}

Status DdsRecorder::Impl::join() {
  wire::BusOptions bus_options;
  bus_options.transport = options_.transport;
  bus_options.on_writer = [this](const wire::BusOptions::Found& found) {
    const std::lock_guard lock(partitions_mutex_);
    if (found.gone) {
      if (partitions_.find(found.endpoint) != nullptr) partitions_.leave(found.endpoint);
    } else if (!found.partition.empty()) {
      partitions_.of(found.endpoint) = found.partition;
      partitions_.come(found.endpoint);
    }
  };
  // Of an earlier bus nobody is told to be gone.
  sequences_.all_leave();
  {
    const std::lock_guard lock(partitions_mutex_);
    partitions_.all_leave();
  }
  auto bus = wire::Bus::open(bus_options, mailbox_);
  NEARMESH_RETURN_IF_ERROR(bus);
  bus_ = std::move(bus).value();
  joined_ns_ = wire::now_us() * 1000;
  for (Topic& topic : topics_) {
    topic.reader = nullptr;
    if (topic.place != kHeldDetail) NEARMESH_RETURN_IF_ERROR((this->*topic.open)(topic));
  }
  asks_ = true;
  has_publisher_ = false;
  may_ask_ = std::chrono::steady_clock::now() + kFindingPublishers;
  must_ask_ = std::chrono::steady_clock::now() + kMatchingAtMost;
  return Status::ok();
}

/// Of detail a peer had been sent, something is missing: what it holds must be known anew.
void DdsRecorder::Impl::note_loss(std::uint32_t topic) {
  asks_ |= topics_[topic].place == wire::place_of<wire::SplitBatchMessage>();
}

/// A recorder says nothing: peers tell what they hold to each reader that is new, so it asks by
/// making its reader anew.
void DdsRecorder::Impl::ask_if_due() {
  if (!asks_ || std::chrono::steady_clock::now() < may_ask_) return;
  asks_ = false;
  may_ask_ = std::chrono::steady_clock::now() + kBetweenAsking;
  for (std::uint32_t i = 0; i < topics_.size(); ++i) {
    Topic& topic = topics_[i];
    if (topic.place != kHeldDetail) continue;
    if (topic.reader != nullptr) {
      while ((this->*topic.drain)(i)) {
      }
      bus_->remove_reader(std::exchange(topic.reader, nullptr));
    }
    if (const Status opened = (this->*topic.open)(topic); !opened.is_ok())
      mailbox_.complain(opened.message());
  }
}

template <class Message>
Status DdsRecorder::Impl::open_reader(Topic& topic) {
  const bool all_partitions = wire::topic_of<Message>().has_partitions;
  auto reader = bus_->reader<Message, wire::RawTypeOf<Message>>(
      *topic.listener, all_partitions ? "*" : "", wire::Hearing::kAll);
  if (reader.is_ok()) topic.reader = reader.value();
  return reader.status();
}

/// Out: true when there may be more.
template <class Message>
bool DdsRecorder::Impl::drain(std::uint32_t topic) {
  using Type = wire::RawTypeOf<Message>;
  if (topics_[topic].reader == nullptr) return false;
  const std::vector<wire::ReaderListener::Match> matches = topics_[topic].listener->take_matches();
  for (const wire::ReaderListener::Match& event : matches)
    if (event.is_gone()) {
      sequences_.leave(event.writer);
    } else {
      sequences_.come(event.writer);
    }
  if (!matches.empty()) {
    const auto found = std::chrono::steady_clock::now() + kMatching;
    const bool is_first_publisher = topics_[topic].place == wire::place_of<wire::Hello>() &&
                                    !std::exchange(has_publisher_, true);
    may_ask_ = is_first_publisher ? found : std::max(may_ask_, std::min(found, must_ask_));
  }
  typename Type::Data data;
  wire::fdds::SampleInfo info;
  std::vector<Entry> taken;
  while (taken.size() < kMaxRecordedAtOnce) {
    data.fault.clear();
    if (!wire::is_ok(topics_[topic].reader->take_next_sample(
            static_cast<typename Type::Sample*>(&data), &info)))
      break;
    Entry& entry = taken.emplace_back();
    entry.topic = topic;
    entry.writer = info.publication_handle;
    entry.partition = partition_of(entry.writer);
    entry.message.sequence = info.sample_identity.sequence_number().to64long();
    entry.message.received_ns = info.reception_timestamp.to_ns();
    entry.message.source_ns = info.source_timestamp.to_ns();
    if (!info.valid_data) continue;  // a dispose, which has a number too
    if constexpr (std::is_same_v<Message, wire::MeshHeader>)
      if (data.fault.empty())
        if (const auto header = decode(data); header.is_ok()) {
          entry.content_hash = header.value().content_hash;
          entry.model = header.value().name;
        }
    if (!data.fault.empty())
      mailbox_.complain(topics_[topic].name + ": sample of " +
                        wire::name_of(entry.writer, mailbox_) +
                        " recorded, but faulty: " + data.fault);
    entry.message.cdr = std::exchange(data.cdr, {});
  }
  // Fast DDS gives one key after the other; the recording is in the order of each writer.
  std::vector<SamplePlace> places;
  places.reserve(taken.size());
  for (const Entry& entry : taken)
    places.push_back({guid_of(entry.writer), entry.message.sequence, entry.message.source_ns});
  for (const std::size_t next : order_of(places)) {
    Entry& entry = taken[next];
    if (wire::kTopicFacts[topics_[topic].place].tells_who) {
      if (is_new_name(entry)) push(std::move(entry));
      continue;
    }
    count_gap(entry);
    if (!entry.message.cdr.empty()) push(std::move(entry));
  }
  return taken.size() == kMaxRecordedAtOnce;
}

/// What a process says of itself each second is recorded where it tells who that is.
bool DdsRecorder::Impl::is_new_name(const Entry& entry) {
  const auto status = wire::decode_payload<wire::ProcessStatus>(entry.message.cdr);
  if (!status.is_ok()) return false;
  return tells_name(told_names_, status.value().session, status.value().name);
}

/// Of a writer that is there already we may get the latest sample of each key, numbered with gaps.
void DdsRecorder::Impl::count_gap(const Entry& entry) {
  Sequence& sequence = sequences_.of(entry.writer);
  const RecordedMessage& message = entry.message;
  if (message.sequence > sequence.next) {
    Entry gap{.topic = entry.topic, .writer = entry.writer, .partition = entry.partition};
    gap.message.sequence = sequence.next;
    gap.message.received_ns = message.received_ns;
    gap.missing = message.sequence - sequence.next;
    gap.before = !sequence.live;
    push(std::move(gap));
    note_loss(entry.topic);
  }
  sequence.live |= message.source_ns >= joined_ns_;
  sequence.next = std::max(sequence.next, message.sequence + 1);
}

std::string DdsRecorder::Impl::partition_of(const Handle& writer) {
  const std::lock_guard lock(partitions_mutex_);
  const std::string* const found = partitions_.find(writer);
  return found == nullptr ? "" : *found;
}

void DdsRecorder::Impl::push(Entry&& entry) {
  {
    const std::lock_guard lock(mutex_);
    if (stats_.ended) return;
    if (entry.missing > 0) {
      (entry.before ? stats_.before : stats_.lost) += entry.missing;
    } else if (waiting_bytes_ + entry.bytes() > kMaxWaitingBytes) {
      // In its place the fact that it is missing, joined to one that waits already.
      ++stats_.dropped;
      note_loss(entry.topic);
      const auto same = std::find_if(waiting_.rbegin(), waiting_.rend(), [&](const Entry& other) {
        return other.writer == entry.writer;
      });
      if (same != waiting_.rend() && same->missing > 0 &&
          same->message.sequence + same->missing == entry.message.sequence) {
        ++same->missing;
        return;
      }
      entry.message.cdr.clear();
      entry.missing = 1;
      entry.content_hash = {};
    } else {
      ++stats_.messages;
      stats_.bytes += entry.message.cdr.size();
    }
    waiting_bytes_ += entry.bytes();
    waiting_.push_back(std::move(entry));
  }
  filled_.notify_one();
}

// --- The disk thread

void DdsRecorder::Impl::write() {
  Status status;
  for (bool ending = false; status.is_ok() && !ending;) {
    taken_.clear();
    {
      std::unique_lock lock(mutex_);
      filled_.wait_for(lock, kDiskWait, [this] { return !waiting_.empty() || heard_all_; });
      ending = heard_all_ && waiting_.empty();
      // A little at a time, so that the limit on what waits holds.
      while (!waiting_.empty() && taken_.size() < kMaxWritten) {
        waiting_bytes_ -= waiting_.front().bytes();
        taken_.push_back(std::move(waiting_.front()));
        waiting_.pop_front();
      }
    }
    status = or_no_memory([this] {
      for (const Entry& entry : taken_) {
        NEARMESH_RETURN_IF_ERROR(write(entry));
        if (finished_) break;
      }
      return file_->commit_if_due();
    });
    const std::lock_guard lock(mutex_);
    stats_.file_bytes = file_->bytes();
    if (finished_) break;
  }
  const Status closed = or_no_memory([this] { return file_->close(); });
  const std::lock_guard lock(mutex_);
  stats_.file_bytes = file_->bytes();
  stats_.status = status.is_ok() ? closed : status;
  stats_.ended = true;
  waiting_.clear();
  waiting_bytes_ = 0;
}

Status DdsRecorder::Impl::begin_part() {
  auto file = RecordingWriter::create(part_path(options_.path, facts_.part), facts_,
                                      options_.commit_period_s);
  NEARMESH_RETURN_IF_ERROR(file);
  file_ = std::move(file).value();
  writers_.clear();
  for (const Topic& topic : topics_)
    if (const auto added =
            file_->add_topic({topic.name, std::string(wire::kTopicFacts[topic.place].type)});
        !added.is_ok())
      return added.status();
  return Status::ok();
}

Status DdsRecorder::Impl::make_room() {
  if (options_.max_bytes == 0 || file_->bytes() < options_.max_bytes) return Status::ok();
  if (!options_.split) {
    finished_ = true;
    return Status::ok();
  }
  NEARMESH_RETURN_IF_ERROR(file_->close());
  ++facts_.part;
  NEARMESH_RETURN_IF_ERROR(begin_part());
  const std::lock_guard lock(mutex_);
  stats_.parts = facts_.part + 1;
  return Status::ok();
}

Status DdsRecorder::Impl::write(const Entry& entry) {
  NEARMESH_RETURN_IF_ERROR(make_room());
  if (finished_) return Status::ok();
  const auto [known, is_new] = writers_.try_emplace({entry.topic, entry.writer}, 0);
  if (is_new) {
    const auto added = file_->add_writer({entry.topic, guid_of(entry.writer), entry.partition});
    NEARMESH_RETURN_IF_ERROR(added);
    known->second = added.value();
    const std::lock_guard lock(mutex_);
    stats_.writers =
        static_cast<std::uint32_t>(std::max<std::size_t>(stats_.writers, writers_.size()));
  }
  if (entry.missing > 0)
    return file_->add_gap(
        {known->second, entry.message.sequence, entry.missing, entry.message.received_ns});
  RecordedMessage message = entry.message;
  message.writer = known->second;
  const Result<std::int64_t> id =
      file_->append(message, wire::record_key(topics_[entry.topic].place, message.cdr));
  NEARMESH_RETURN_IF_ERROR(id);
  if (entry.model.empty()) return Status::ok();
  return file_->add_model({entry.content_hash, entry.model, id.value()});
}

// --- Called by the host

Result<std::unique_ptr<DdsRecorder>> DdsRecorder::create(const RecorderOptions& options) {
  auto impl = std::make_unique<Impl>(options);
  NEARMESH_RETURN_IF_ERROR(impl->start());
  return std::unique_ptr<DdsRecorder>(new DdsRecorder(std::move(impl)));
}

DdsRecorder::DdsRecorder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DdsRecorder::~DdsRecorder() = default;

RecorderStats DdsRecorder::stats() const { return impl_->stats(); }
std::vector<std::string> DdsRecorder::take_complaints() { return impl_->take_complaints(); }
Status DdsRecorder::finish() { return impl_->finish(); }

}  // namespace nearmesh::subscriber
