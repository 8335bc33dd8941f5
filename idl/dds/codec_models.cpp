// SPDX-License-Identifier: Apache-2.0
// Of codec.hpp: what there is of models, who asks for what, what is sent and held of it.
#include <algorithm>
#include <span>
#include <string>
#include <utility>

#include "codec.hpp"
#include "codec_fields.hpp"
#include "core/base/packed_bytes.hpp"
#include "core/spm/packed_certificate.hpp"
#include "core/spm/packed_region.hpp"
#include "idl/messages/process_name.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh::wire {

namespace {

constexpr std::uint8_t kFlagLast = 1;
constexpr std::uint8_t kFlagRefused = 2;
constexpr std::uint8_t kFlagWantsHeld = 4;
constexpr std::uint8_t kFlagWantsRegions = 8;
constexpr std::uint8_t kFlagPiece = 16;
constexpr std::uint8_t kFlagJoined = 32;
constexpr std::size_t kWordsPerNode = 2;

using BatchSize = std::uint16_t;
static_assert(sizeof(BatchSize) == kJoinSizeBytes &&
              sizeof(ContentHash) + sizeof(BatchSize) == kJoinBytes);

// Of batches that share a sample: the first one's size and bytes, then content, size and bytes of
// each other one.
Octets joined_bytes(const SplitBatchMessage& message) {
  Packer out;
  const auto put = [&out](const Octets& batch) {
    out.put(static_cast<BatchSize>(batch.size()));
    out.bytes.insert(out.bytes.end(), batch.begin(), batch.end());
  };
  put(message.bytes);
  for (const SplitBatchMessage::Joined& next : message.joined) {
    out.put(next.content_hash.high);
    out.put(next.content_hash.low);
    put(next.bytes);
  }
  return std::move(out.bytes);
}

Status split_joined(const Octets& bytes, SplitBatchMessage& message) {
  Unpacker in(bytes);
  const auto get = [&in](Octets& batch) {
    BatchSize size = 0;
    in.get(size);
    const std::span<const std::uint8_t> own = in.take(size);
    batch.assign(own.begin(), own.end());
  };
  get(message.bytes);
  while (!in.is_whole() && !in.has_failed()) {
    SplitBatchMessage::Joined next;
    in.get(next.content_hash.high);
    in.get(next.content_hash.low);
    get(next.bytes);
    message.joined.push_back(std::move(next));
  }
  if (in.has_failed() || message.joined.empty())
    return malformed("joined batches: " + std::to_string(bytes.size()) +
                     " bytes end inside a batch, or hold no second one");
  return Status::ok();
}

}  // namespace

void encode(const Hello& message, wire_types::HelloSample& sample) {
  sample.wire_version(message.wire_version);
  sample.publisher(message.publisher);
  sample.name(message.name.c_str());
  sample.names().clear();
  sample.content_hashes().clear();
  sample.mesh_bytes().clear();
  sample.replaced_hashes().clear();
  sample.epochs().clear();
  sample.epochs_from_s().clear();
  const bool has_epochs = std::any_of(message.models.begin(), message.models.end(),
                                      [](const auto& model) { return model.epoch.number != 0; });
  for (const Hello::Model& model : message.models) {
    if (has_epochs) {
      sample.epochs().push_back(model.epoch.number);
      sample.epochs_from_s().push_back(model.epoch.from_s);
    }
    append_line(model.name, sample.names());
    append_content(model.content_hash, sample.content_hashes());
    sample.mesh_bytes().push_back(model.mesh_bytes);
    append_content(model.replaces, sample.replaced_hashes());
  }
}

Result<Hello> decode(const wire_types::HelloSample& sample) {
  Hello message;
  message.wire_version = sample.wire_version();
  message.publisher = sample.publisher();
  message.name = shown_name(sample.name().to_string());
  const std::size_t count = sample.mesh_bytes().size();
  if (count > kMaxModels || sample.content_hashes().size() != kWordsPerContent * count ||
      sample.replaced_hashes().size() != kWordsPerContent * count ||
      sample.epochs().size() != sample.epochs_from_s().size() ||
      (!sample.epochs().empty() && sample.epochs().size() != count) ||
      sample.names().size() > kMaxModels * (kMaxNameBytes + 1))
    return malformed("models: lists of " + std::to_string(sample.content_hashes().size()) +
                     " words of hashes, " + std::to_string(sample.replaced_hashes().size()) +
                     " of replaced ones, " + std::to_string(sample.epochs().size()) + " epochs, " +
                     std::to_string(count) + " sizes and " + std::to_string(sample.names().size()) +
                     " bytes of names do not belong together");
  const auto names = split_lines(sample.names(), count, count, "model names");
  NEARMESH_RETURN_IF_ERROR(names);
  message.models.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    message.models[i].name = names.value()[i];
    message.models[i].content_hash = content_at(sample.content_hashes(), i);
    message.models[i].mesh_bytes = sample.mesh_bytes()[i];
    message.models[i].replaces = content_at(sample.replaced_hashes(), i);
    if (!sample.epochs().empty())
      message.models[i].epoch = {sample.epochs()[i], sample.epochs_from_s()[i]};
  }
  return checked(std::move(message));
}

void encode(const MeshHeader& message, wire_types::MeshHeaderSample& sample) {
  sample.wire_version(message.wire_version);
  sample.content_hash(words_of(message.content_hash));
  sample.name(message.name.c_str());
  sample.bytes(message.bytes);
}

Result<MeshHeader> decode(const wire_types::MeshHeaderSample& sample) {
  MeshHeader message;
  message.wire_version = sample.wire_version();
  message.content_hash = content_at(sample.content_hash(), 0);
  message.name = sample.name().to_string();
  message.bytes = sample.bytes();
  return checked(std::move(message));
}

void encode(const RegionSubscription& message, wire_types::RegionSubscriptionSample& sample) {
  sample.wire_version(message.wire_version);
  sample.priority(message.priority);
  sample.request(message.request);
  sample.peer(message.peer);
  sample.content_hash(words_of(message.content_hash));
  sample.publisher(message.publisher);
  sample.acknowledged_sequence(message.acknowledged_sequence);
  sample.window_bytes(message.window_bytes);
  sample.max_splits(message.region.max_splits);
  sample.attach().clear();
  for (const NodeSpan& node : message.region.attach) {
    sample.attach().push_back(node.first.value);
    sample.attach().push_back(node.size);
  }
  PackedRegion region = pack_region(message.region.region);
  sample.region_origin(region.origin);
  sample.region_shift(region.shift);
  sample.region_radius(region.radius);
  sample.region_parts(std::move(region.parts));
  sample.certificate(message.certificate ? pack_certificate(*message.certificate) : Octets());
}

Result<RegionSubscription> decode(const wire_types::RegionSubscriptionSample& sample) {
  RegionSubscription message;
  message.wire_version = sample.wire_version();
  message.priority = sample.priority();
  message.request = sample.request();
  message.peer = sample.peer();
  message.content_hash = content_at(sample.content_hash(), 0);
  message.publisher = sample.publisher();
  message.acknowledged_sequence = sample.acknowledged_sequence();
  message.window_bytes = sample.window_bytes();
  message.region.max_splits = sample.max_splits();
  const auto& attach = sample.attach();
  NEARMESH_RETURN_IF_ERROR(check_words(attach.size(), kWordsPerNode, kMaxAttachNodes, "attach"));
  for (std::size_t i = 0; i < attach.size(); i += kWordsPerNode)
    message.region.attach.push_back({VertexId{attach[i]}, attach[i + 1]});
  Result<std::vector<RegionPart>> region =
      unpack_region({sample.region_origin(), sample.region_shift(), sample.region_radius(),
                     sample.region_parts()});
  NEARMESH_RETURN_IF_ERROR(region);
  message.region.region = std::move(region).value();
  if (!sample.certificate().empty()) {
    auto certificate = unpack_certificate(sample.certificate());
    NEARMESH_RETURN_IF_ERROR(certificate);
    message.certificate = std::move(certificate).value();
  }
  return checked(std::move(message));
}

void encode(const SplitBatchMessage& message, wire_types::SplitBatchSample& sample) {
  sample.wire_version(message.wire_version);
  sample.flags(static_cast<std::uint8_t>(
      (message.last ? kFlagLast : 0) | (message.refused ? kFlagRefused : 0) |
      (message.wants_held ? kFlagWantsHeld : 0) | (message.wants_regions ? kFlagWantsRegions : 0) |
      (message.is_piece ? kFlagPiece : 0) | (message.joined.empty() ? 0 : kFlagJoined)));
  sample.request(message.request);
  sample.publisher(message.publisher);
  sample.content_hash(words_of(message.content_hash));
  sample.sequence_number(message.sequence);
  if (message.joined.empty())
    sample.bytes(message.bytes);
  else
    sample.bytes(joined_bytes(message));
}

Result<SplitBatchMessage> decode(const wire_types::SplitBatchSample& sample) {
  SplitBatchMessage message;
  message.wire_version = sample.wire_version();
  NEARMESH_RETURN_IF_ERROR(check_bits(
      sample.flags(),
      kFlagLast | kFlagRefused | kFlagWantsHeld | kFlagWantsRegions | kFlagPiece | kFlagJoined,
      "flags"));
  message.last = (sample.flags() & kFlagLast) != 0;
  message.refused = (sample.flags() & kFlagRefused) != 0;
  message.wants_held = (sample.flags() & kFlagWantsHeld) != 0;
  message.wants_regions = (sample.flags() & kFlagWantsRegions) != 0;
  message.is_piece = (sample.flags() & kFlagPiece) != 0;
  message.request = sample.request();
  message.publisher = sample.publisher();
  message.content_hash = content_at(sample.content_hash(), 0);
  message.sequence = sample.sequence_number();
  if ((sample.flags() & kFlagJoined) != 0)
    NEARMESH_RETURN_IF_ERROR(split_joined(sample.bytes(), message));
  else
    message.bytes = sample.bytes();
  return checked(std::move(message));
}

void encode(const HeldDetail& message, wire_types::HeldDetailSample& sample) {
  sample.wire_version(message.wire_version);
  sample.applied_batches(message.applied_batches);
  sample.peer(message.peer);
  sample.content_hash(words_of(message.content_hash));
  sample.model(message.model.c_str());
  sample.last_request(message.last_request);
  sample.era(message.era);
  sample.state_digest(message.state_digest);
  sample.box_digest(message.box_digest);
  sample.heard_publishers().clear();
  sample.heard_sequences().clear();
  for (const HeldDetail::Heard& heard : message.heard) {
    sample.heard_publishers().push_back(heard.publisher);
    sample.heard_sequences().push_back(heard.sequence);
  }
  sample.nodes(message.nodes);
}

Result<HeldDetail> decode(const wire_types::HeldDetailSample& sample) {
  HeldDetail message;
  message.wire_version = sample.wire_version();
  message.applied_batches = sample.applied_batches();
  message.peer = sample.peer();
  message.content_hash = content_at(sample.content_hash(), 0);
  message.model = sample.model().to_string();
  message.last_request = sample.last_request();
  message.era = sample.era();
  message.state_digest = sample.state_digest();
  message.box_digest = sample.box_digest();
  const std::size_t count = sample.heard_publishers().size();
  if (count > kMaxHeardPublishers || sample.heard_sequences().size() != count)
    return malformed("heard: lists that do not belong together");
  for (std::size_t i = 0; i < count; ++i)
    message.heard.push_back({sample.heard_publishers()[i], sample.heard_sequences()[i]});
  message.nodes = sample.nodes();
  return checked(std::move(message));
}

}  // namespace nearmesh::wire
