// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/peer/local_channel.hpp"

#include <utility>

#include "core/base/float_guard.hpp"
#include "core/demand/answer.hpp"

namespace nearmesh::subscriber {
namespace {

Result<std::vector<std::vector<std::uint8_t>>> answer(ModelFile& file,
                                                      const RegionRequest& request) {
  NEARMESH_RETURN_IF_ERROR(check_request(file.store(), request));
  if (request.is_audit()) return file.prove(request.attach.front());
  return answer_request(file.header(), file.store(), request,
                        [&file](NodeSpan node) { return file.require(node); });
}

}  // namespace

Status LocalChannel::add_model(const std::string& name, ModelFile file) {
  NEARMESH_RETURN_IF_ERROR(wire::check_new_model(name, models_.size()));
  for (const auto& [hash, model] : models_)
    if (model.name == name || hash == file.content_hash())
      return {StatusCode::kConflict,
              file.path() + " as " + name + ": " +
                  (model.name == name ? "the name is taken by " : "same content as ") +
                  model.file.path() + ", served as " + model.name};
  const ContentHash hash = file.content_hash();
  models_.emplace(hash, Model{name, std::move(file)});
  if (connected_) announce();
  return Status::ok();
}

void LocalChannel::announce() {
  wire::Hello hello;
  hello.publisher = kPublisher;
  inbox_.headers.clear();
  for (const auto& [hash, model] : models_)
    inbox_.headers.push_back({kPublisher, wire::announce_model(model.name, model.file, {}, hello)});
  inbox_.hellos.assign(1, std::move(hello));
}

void LocalChannel::set_connected(bool connected) {
  if (std::exchange(connected_, connected) == connected) return;
  if (connected) {
    sequence_ = 0;  // a publisher that was lost comes back as a new one
    announce();
    return;
  }
  inbox_ = {};
  inbox_.lost_publishers.push_back(kPublisher);
  for (const std::string& body : delivered_) inbox_.movers[body] = wire::Mover::kLeft;
}

Status LocalChannel::deliver(const wire::BodyPose& pose) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(wire::check(pose));
  if (!connected_) return Status::ok();
  inbox_.poses.push_back(pose);
  inbox_.movers[pose.body] = wire::Mover::kThere;
  delivered_.insert(pose.body);
  return Status::ok();
}

void LocalChannel::send(const wire::RegionSubscription& subscription) {
  // Whoever returns credit alone asks for nothing: there is no link here to overrun.
  if (!connected_ || subscription.request == 0) return;
  const auto at = models_.find(subscription.content_hash);
  Result<std::vector<std::vector<std::uint8_t>>> batches =
      at == models_.end()
          ? Status{StatusCode::kNotFound, "no model with that content hash is served here"}
          : answer(at->second.file, subscription.region);
  std::vector<wire::SplitBatchMessage> messages;
  if (batches.is_ok())
    messages = wire::answer_messages(kPublisher, subscription, std::move(batches).value(), true);
  else
    messages.push_back(wire::refusal_message(kPublisher, subscription, batches.status().message()));
  for (wire::SplitBatchMessage& message : messages) {
    message.sequence = ++sequence_;
    inbox_.batches.push_back(std::move(message));
  }
}

Channel::Inbox LocalChannel::take() { return std::exchange(inbox_, {}); }

}  // namespace nearmesh::subscriber
