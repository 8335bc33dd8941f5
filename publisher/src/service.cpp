// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/publisher/service.hpp"

#include <algorithm>

#include "nearmesh/core/base/hash.hpp"
#include "nearmesh/core/demand/answer.hpp"

namespace nearmesh::publisher {
Service::Service(Channel& channel, wire::SessionId session, ServiceOptions options)
    : channel_(channel), session_(session), options_(options) {}

Status Service::add_model(const std::string& name, ModelFile file) {
  NEARMESH_RETURN_IF_ERROR(wire::check_new_model(name, models_.size()));
  for (const auto& [hash, model] : models_)
    if (model->name == name)
      return {StatusCode::kConflict,
              file.path() + ": the name " + name + " is taken by " + model->file.path()};
  const std::uint64_t hash = file.content_hash();
  if (const auto same = models_.find(hash); same != models_.end())
    return {StatusCode::kConflict, file.path() + ": same content as " + same->second->file.path() +
                                       ", which is served as " + same->second->name};
  auto model = std::make_unique<Model>(Model{name, std::move(file)});
  add_answerer(
      hash, [&file = model->file](const RegionRequest& request) { return answer(file, request); });
  models_.emplace(hash, std::move(model));
  return Status::ok();
}

void Service::add_answerer(std::uint64_t content_hash, Answerer answerer) {
  answerers_[content_hash] = std::move(answerer);
}

void Service::announce() {
  wire::Hello hello;
  hello.publisher = session_;
  std::vector<wire::MeshHeader> headers;
  for (const auto& [hash, model] : models_) {
    hello.models.push_back({model->name, hash, model->file.mesh_bytes()});
    const auto bytes = model->file.header_bytes();
    wire::MeshHeader header;
    header.name = model->name;
    header.content_hash = hash;
    header.bytes.assign(bytes.begin(), bytes.end());
    headers.push_back(std::move(header));
  }
  channel_.announce(hello, headers);
}

Result<std::vector<std::vector<std::uint8_t>>> Service::answer(ModelFile& file,
                                                               const RegionRequest& request) {
  NEARMESH_RETURN_IF_ERROR(check_request(file.store(), request));
  return answer_request(file.header(), file.store(), request,
                        [&file](NodeSpan node) { return file.require(node); });
}

void Service::enqueue(Peer& peer, const wire::RegionSubscription& subscription,
                      std::vector<std::vector<std::uint8_t>> batches, bool refused) {
  if (batches.empty()) batches.emplace_back();  // "nothing was needed" is an answer too
  const auto place = std::find_if(peer.queue.begin(), peer.queue.end(), [&](const Waiting& w) {
    return w.priority > subscription.priority;
  });
  std::deque<Waiting> added;
  for (std::size_t i = 0; i < batches.size(); ++i) {
    wire::SplitBatchMessage message;
    message.publisher = session_;
    message.content_hash = subscription.content_hash;
    message.request = subscription.request;
    message.last = i + 1 == batches.size();
    message.refused = refused;
    message.bytes = std::move(batches[i]);
    peer.queued_bytes += message.bytes.size() + kBatchFramingBytes;
    added.push_back({std::move(message), subscription.priority});
  }
  peer.queue.insert(place, std::make_move_iterator(added.begin()),
                    std::make_move_iterator(added.end()));
}

bool Service::send_next(wire::SessionId id, Peer& peer, double now_s) {
  if (peer.queue.empty()) return false;
  wire::SplitBatchMessage& message = peer.queue.front().message;
  const std::size_t bytes = message.bytes.size() + kBatchFramingBytes;
  if (!peer.pacing.may_send(bytes)) return false;
  message.sequence = peer.next_sequence;
  if (!channel_.send(id, message)) return false;
  peer.pacing.sent(peer.next_sequence++, bytes, now_s);
  peer.queued_bytes -= bytes;
  peer.queue.pop_front();
  if (peer.queue.empty() && peer.pacing.may_send(kMaxBatchBytes + kBatchFramingBytes))
    peer.pacing.ran_dry();
  ++stats_.batches;
  stats_.bytes += bytes;
  return true;
}

std::vector<std::string> Service::step(double now_s) {
  std::vector<std::string> complaints;
  const Inbox inbox = channel_.take();
  for (const wire::SessionId id : inbox.lost_peers) peers_.erase(id);
  for (const wire::RegionSubscription& subscription : inbox.subscriptions) {
    if (subscription.publisher != session_) continue;
    Peer& peer = peers_.try_emplace(subscription.peer, options_.pacing).first->second;
    peer.pacing.limit(std::min(subscription.window_bytes, options_.max_window_bytes));
    peer.pacing.acknowledged(subscription.acknowledged_sequence, now_s);
    // Repeats of a request (a writer's history after a rematch) are not answered twice.
    if (subscription.request == 0 || subscription.request <= peer.last_request) continue;
    peer.last_request = subscription.request;
    ++stats_.requests;
    // A request names the peer's frontier as it is now, so it replaces what still waits for that model.
    std::erase_if(peer.queue, [&](const Waiting& waiting) {
      if (waiting.message.content_hash != subscription.content_hash) return false;
      peer.queued_bytes -= waiting.message.bytes.size() + kBatchFramingBytes;
      return true;
    });
    const auto answerer = answerers_.find(subscription.content_hash);
    Result<std::vector<std::vector<std::uint8_t>>> batches =
        peer.queued_bytes > options_.max_queued_bytes
            ? Status{StatusCode::kInvalidArgument, "more than " +
                                                       std::to_string(options_.max_queued_bytes) +
                                                       " bytes wait for this peer"}
        : answerer == answerers_.end()
            ? Status{StatusCode::kNotFound, "no model with that content hash is served here"}
            : answerer->second(subscription.region);
    if (batches.is_ok()) {
      enqueue(peer, subscription, std::move(batches).value(), false);
      continue;
    }
    ++stats_.refused;
    const std::string& why = batches.status().message();
    const std::size_t length = std::min(why.size(), kMaxBatchBytes);
    enqueue(peer, subscription, {{why.begin(), why.begin() + static_cast<std::ptrdiff_t>(length)}},
            true);
    complaints.push_back("request " + std::to_string(subscription.request) + " of peer " +
                         to_hex(subscription.peer) + " refused: " + why);
  }
  for (auto& [id, peer] : peers_) peer.pacing.expire(now_s);
  // In turns, one batch each, so that a peer with much to send delays no other.
  for (bool sent = true; sent;) {
    sent = false;
    for (auto& [id, peer] : peers_) sent = send_next(id, peer, now_s) || sent;
  }
  stats_.peers = peers_.size();
  for (std::string& line : channel_.take_complaints()) complaints.push_back(std::move(line));
  if (!began_s_) began_s_ = now_s;
  for (const std::string& line : complaints) keeper_.note(line, now_s - *began_s_);
  if (keeper_.is_due(now_s - *began_s_)) tell_status(now_s - *began_s_);
  return complaints;
}

void Service::tell_status(double now_s) {
  wire::ProcessStatus status;
  status.session = session_;
  status.is_publisher = true;
  status.peers = static_cast<std::uint32_t>(stats_.peers);
  status.requests = stats_.requests;
  status.refused = stats_.refused;
  status.batches = stats_.batches;
  status.bytes = stats_.bytes;
  for (const auto& [id, peer] : peers_) status.waiting_batches += peer.queue.size();
  for (const auto& [hash, model] : models_) {
    const SpmHeader& header = model->file.header();
    status.models.push_back({model->name, hash, header.face_count, 0, header.split_count()});
  }
  keeper_.complete(status, now_s);
  channel_.tell(status);
  status_ = std::move(status);
}

}  // namespace nearmesh::publisher
