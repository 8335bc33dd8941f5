// SPDX-License-Identifier: Apache-2.0
#include "replay_index.hpp"

#include <algorithm>
#include <new>
#include <optional>

#include "core/base/hash.hpp"
#include "nearmesh/idl/dds/payload.hpp"

namespace nearmesh::publisher {
namespace {

/// The topic of a recorded one that a recorder hears and a replay says again.
std::optional<wire::TopicPlace> played(const wire::RecordedSamples& samples, std::uint32_t topic) {
  const std::optional<wire::TopicPlace> place = samples.place_of(topic);
  return place && wire::kTopicFacts[*place].is_recorded && !wire::kTopicFacts[*place].tells_who
             ? place
             : std::nullopt;
}

Status check_topics(const RecordingReader& recording, const wire::RecordedSamples& samples,
                    const std::vector<std::string>& wanted) {
  std::set<std::string_view> names;
  for (std::uint32_t topic = 0; topic < recording.topics().size(); ++topic)
    if (const auto place = played(samples, topic)) names.insert(wire::kTopicFacts[*place].name);
  std::string known;
  for (const std::string_view name : names) known.append(known.empty() ? "" : ", ").append(name);
  for (const std::string& name : wanted)
    if (!names.contains(name))
      return {StatusCode::kNotFound,
              "topic " + name + ": not in the recording, which has " + known};
  return Status::ok();
}

}  // namespace

Result<std::unique_ptr<ReplayIndex>> ReplayIndex::build(
    RecordingReader& recording, const std::vector<std::string>& topics,
    const std::function<bool(double share)>& progress) {
  const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(recording);
  NEARMESH_RETURN_IF_ERROR(samples);
  if (recording.message_count() == 0)
    return Status{StatusCode::kInvalidArgument, "the recording holds no messages"};
  std::unique_ptr<ReplayIndex> index(new ReplayIndex);
  NEARMESH_RETURN_IF_ERROR(index->add_streams(recording, samples.value(), topics));
  try {
    // Headers first: of batches that came before theirs nothing shall be lost.
    if (index->plays_batches_)
      for (const RecordedModel& model : recording.models())
        NEARMESH_RETURN_IF_ERROR(recording.read(model.message, model.message + 1,
                                                [&](std::int64_t, const RecordedMessage& message) {
                                                  index->add_detail(message);
                                                  return true;
                                                }));
    NEARMESH_RETURN_IF_ERROR(index->read_keys(recording, progress));
  } catch (const std::bad_alloc&) {  // models span all ids that a header announces
    return Status{StatusCode::kIo, "no memory for the models of the recording"};
  }
  index->sort();
  return index;
}

Status ReplayIndex::read_keys(RecordingReader& recording,
                              const std::function<bool(double)>& progress) {
  // Requests before the batches that answer them.
  for (const bool batches : {false, true})
    for (std::uint32_t key = 0; key < recording.keys().size(); ++key) {
      const std::uint32_t stream = stream_of_writer_[recording.keys()[key].writer];
      if (stream == kNotPlayed || streams_[stream].carries<wire::SplitBatchMessage>() != batches)
        continue;
      NEARMESH_RETURN_IF_ERROR(read_key(recording, key));
      if (progress &&
          !progress((batches ? 0.5 : 0) +
                    0.5 * static_cast<double>(key) / static_cast<double>(recording.keys().size())))
        return Status::ok();
    }
  return Status::ok();
}

Status ReplayIndex::read_key(RecordingReader& recording, std::uint32_t key) {
  const RecordedKey& recorded = recording.keys()[key];
  const std::uint32_t stream = stream_of_writer_[recorded.writer];
  const Result<std::vector<std::int64_t>> ids = recording.ids_of(key);
  NEARMESH_RETURN_IF_ERROR(ids);
  const bool is_of_part = streams_[stream].carries<wire::BodyPoses>() ||
                          streams_[stream].carries<wire::BodyDirectory>() ||
                          streams_[stream].carries<wire::WatchedBodies>();
  auto next = ids.value().begin();
  bool is_told = false;
  while (next != ids.value().end() && !is_told) {
    const std::int64_t id = *next++;
    NEARMESH_RETURN_IF_ERROR(
        recording.read(id, id + 1, [&](std::int64_t, const RecordedMessage& message) {
          take(id, message);
          return true;
        }));
    // All are of one part, and of one peer: the first that is not faulty tells of which. Where each
    // is, nothing holds.
    is_told = is_of_part && latches_.contains({stream, recorded.name});
  }
  if (is_told) {
    Latch& latch = latches_[{stream, recorded.name}];
    latch.insert(latch.end(), next, ids.value().end());
  }
  return Status::ok();
}

/// Of one thing several keys may tell, in any order.
void ReplayIndex::sort() {
  for (auto& [key, ids] : latches_) std::sort(ids.begin(), ids.end());
  for (auto& [key, requests] : requests_)
    std::sort(requests.begin(), requests.end(),
              [](const Request& a, const Request& b) { return a.id < b.id; });
  std::sort(batches_.begin(), batches_.end());
}

Status ReplayIndex::take_batches(RecordingReader& recording, std::size_t most) {
  try {
    for (; most > 0 && !batches_.empty(); --most) {
      const std::int64_t id = batches_.front();
      batches_.pop_front();
      NEARMESH_RETURN_IF_ERROR(
          recording.read(id, id + 1, [&](std::int64_t, const RecordedMessage& message) {
            auto sample = wire::decode_payload<wire::SplitBatchMessage>(message.cdr);
            if (!sample.is_ok()) return true;
            for (const wire::SplitBatchMessage& batch : take_apart(std::move(sample).value()))
              // What is wrong with it was wrong when it was sent; peers dropped it too.
              if (const auto at = details_.find(batch.content_hash); at != details_.end())
                static_cast<void>(at->second.add(id, batch.bytes));
            return true;
          }));
    }
  } catch (const std::bad_alloc&) {
    return {StatusCode::kIo, "no memory for the models of the recording"};
  }
  return Status::ok();
}

Status ReplayIndex::add_streams(const RecordingReader& recording,
                                const wire::RecordedSamples& samples,
                                const std::vector<std::string>& topics) {
  NEARMESH_RETURN_IF_ERROR(check_topics(recording, samples, topics));
  const auto is_wanted = [&](wire::TopicPlace topic) {
    return topics.empty() ||
           std::find(topics.begin(), topics.end(), wire::kTopicFacts[topic].name) != topics.end();
  };
  plays_batches_ = is_wanted(wire::place_of<wire::SplitBatchMessage>());
  std::map<std::tuple<std::uint32_t, EndpointGuid, std::string>, std::uint32_t> known;
  for (const RecordedWriter& writer : recording.writers()) {
    const std::optional<wire::TopicPlace> topic = played(samples, writer.topic);
    if (!topic || !is_wanted(*topic)) {
      stream_of_writer_.push_back(kNotPlayed);
      continue;
    }
    const auto [at, is_new] = known.try_emplace({writer.topic, writer.guid, writer.partition},
                                                static_cast<std::uint32_t>(streams_.size()));
    if (is_new) streams_.push_back({*topic, writer.partition});
    stream_of_writer_.push_back(at->second);
  }
  return Status::ok();
}

/// Of what is renewed all the time (contact reports) nothing holds.
void ReplayIndex::take(std::int64_t id, const RecordedMessage& message) {
  const std::uint32_t at = stream_of_writer_[message.writer];
  if (at == kNotPlayed) return;
  const ReplayStream& stream = streams_[at];
  if (stream.carries<wire::Hello>()) {
    take_hello(id, message);
  } else if (stream.carries<wire::MeshHeader>()) {
    if (const auto header = wire::decode_payload<wire::MeshHeader>(message.cdr); header.is_ok())
      latches_[{at, to_hex(header.value().content_hash)}].push_back(id);
    add_detail(message);
  } else if (stream.carries<wire::RegionSubscription>()) {
    const auto asked = wire::decode_payload<wire::RegionSubscription>(message.cdr);
    if (!asked.is_ok()) return;
    peers_.insert(asked.value().peer);
    if (asked.value().request != 0)
      requests_[{wire::partition_of(asked.value().peer), asked.value().content_hash}].push_back(
          {.id = id, .number = asked.value().request});
  } else if (stream.carries<wire::SplitBatchMessage>()) {
    take_batch(id, at, message);
  } else if (stream.carries<wire::BodyPoses>()) {
    take_part<wire::BodyPoses>(id, at, message);
  } else if (stream.carries<wire::BodyDirectory>()) {
    take_part<wire::BodyDirectory>(id, at, message);
  } else if (stream.carries<wire::WatchedBodies>()) {
    take_part<wire::WatchedBodies>(id, at, message);
  }
}

template <class Message>
void ReplayIndex::take_part(std::int64_t id, std::uint32_t stream, const RecordedMessage& message) {
  const auto told = wire::decode_payload<Message>(message.cdr);
  if (!told.is_ok()) return;
  peers_.insert(told.value().peer);
  latches_[{stream, wire::topic_of<Message>().key(told.value())}].push_back(id);
}

void ReplayIndex::take_hello(std::int64_t id, const RecordedMessage& message) {
  const auto hello = wire::decode_payload<wire::Hello>(message.cdr);
  if (!hello.is_ok()) return;
  const wire::SessionId publisher = hello.value().publisher;
  publishers_.insert(publisher);
  std::uint32_t& stream = stream_of_writer_[message.writer];
  stream = hello_stream_.try_emplace(publisher, stream).first->second;
  latches_[{stream, wire::partition_of(publisher)}].push_back(id);
}

void ReplayIndex::add_detail(const RecordedMessage& message) {
  const auto header = wire::decode_payload<wire::MeshHeader>(message.cdr);
  if (!plays_batches_ || !header.is_ok() || details_.contains(header.value().content_hash)) return;
  if (auto decoded = decode_header(header.value().bytes, &tables_); decoded.is_ok())
    details_.emplace(header.value().content_hash, std::move(decoded).value());
}

void ReplayIndex::take_batch(std::int64_t id, std::uint32_t stream,
                             const RecordedMessage& message) {
  auto sample = wire::decode_payload<wire::SplitBatchMessage>(message.cdr);
  if (!sample.is_ok()) return;
  bool has_detail = false;
  for (const wire::SplitBatchMessage& sent : take_apart(std::move(sample).value())) {
    note_answered(id, stream, sent);
    has_detail |= !sent.refused && !sent.is_piece && !sent.bytes.empty() &&
                  details_.contains(sent.content_hash);
  }
  if (has_detail) batches_.push_back(id);
}

void ReplayIndex::note_answered(std::int64_t id, std::uint32_t stream,
                                const wire::SplitBatchMessage& sent) {
  // What was asked of several models at once is under none.
  for (const ContentHash& content : {sent.content_hash, ContentHash{}}) {
    const auto asked = requests_.find({streams_[stream].partition, content});
    if (!sent.last || asked == requests_.end()) continue;
    const auto request =
        std::lower_bound(asked->second.begin(), asked->second.end(), sent.request,
                         [](const Request& r, std::uint32_t number) { return r.number < number; });
    if (request != asked->second.end() && request->number == sent.request) request->answered = id;
  }
}

std::vector<std::int64_t> ReplayIndex::latched(std::int64_t end) const {
  std::vector<std::int64_t> found;
  for (const auto& [key, ids] : latches_)
    if (const auto after = std::lower_bound(ids.begin(), ids.end(), end); after != ids.begin())
      found.push_back(*(after - 1));
  for (const auto& [key, requests] : requests_) {
    const auto after =
        std::partition_point(requests.begin(), requests.end(),
                             [end](const Request& request) { return request.id < end; });
    if (after == requests.begin()) continue;
    const Request& last = *(after - 1);
    if (last.answered == 0 || last.answered >= end) found.push_back(last.id);
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::vector<std::int64_t> ReplayIndex::not_yet(std::int64_t end, std::int64_t later) const {
  std::vector<std::int64_t> found;
  for (const auto& [key, ids] : latches_)
    if (ids.front() >= end && ids.front() < later) found.push_back(ids.front());
  return found;
}

}  // namespace nearmesh::publisher
