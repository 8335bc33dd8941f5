// SPDX-License-Identifier: Apache-2.0
#include "replicas.hpp"

#include "core/base/hash.hpp"

namespace nearmesh::subscriber {
PeerModel& ReplicaSet::add(const std::string& name) {
  PeerModel& model = models_[name];
  model.name = name;
  return model;
}

PeerModel* ReplicaSet::find(const std::string& name) {
  const auto at = models_.find(name);
  return at == models_.end() ? nullptr : &at->second;
}

PeerModel* ReplicaSet::find(const ContentHash& content_hash) {
  for (auto& [name, model] : models_)
    if (model.content_hash == content_hash && content_hash.is_set()) return &model;
  return nullptr;
}

std::size_t ReplicaSet::announce(const wire::Hello& hello, std::vector<std::string>& complaints) {
  std::size_t header_bytes = 0;
  for (const wire::Hello::Model& served : hello.models) {
    PeerModel* model = find(served.name);
    if (model == nullptr || model->content_hash == served.content_hash) continue;
    if (model->content_hash.is_set()) {
      complaints.push_back("model " + served.name + ": publisher " + to_hex(hello.publisher) +
                           " announces content " + to_hex(served.content_hash) +
                           ", before it was " + to_hex(model->content_hash) +
                           "; starting again with the new content");
      const std::string name = model->name;
      *model = PeerModel{.name = name};
    }
    model->content_hash = served.content_hash;
    model->mesh_bytes = served.mesh_bytes;
    if (const auto at = unclaimed_.find(served.content_hash); at != unclaimed_.end()) {
      const wire::MeshHeader message = std::move(at->second);
      unclaimed_bytes_ -= message.bytes.size();
      unclaimed_.erase(at);
      header_bytes += take_header(message, complaints);
    }
  }
  return header_bytes;
}

std::size_t ReplicaSet::announce_new(const wire::Hello& hello,
                                     std::vector<std::string>& complaints) {
  wire::Hello news{.publisher = hello.publisher};
  for (const wire::Hello::Model& served : hello.models)
    if (const PeerModel* model = find(served.name);
        model != nullptr && !model->content_hash.is_set())
      news.models.push_back(served);
  return announce(news, complaints);
}

/// Beyond the limit only of names we use, whose hello is on its way.
void ReplicaSet::keep_header(const wire::MeshHeader& message) {
  if (const auto at = unclaimed_.find(message.content_hash); at != unclaimed_.end()) {
    unclaimed_bytes_ -= at->second.bytes.size();
    unclaimed_.erase(at);
  }
  const bool has_room = unclaimed_bytes_ + message.bytes.size() <= kMaxSpareHeaderBytes;
  const bool is_named = find(message.name) != nullptr && unclaimed_.size() < 2 * wire::kMaxModels;
  if (!(has_room && unclaimed_.size() < wire::kMaxModels) && !is_named) return;
  unclaimed_bytes_ += message.bytes.size();
  unclaimed_.emplace(message.content_hash, message);
}

std::size_t ReplicaSet::take_header(const wire::MeshHeader& message,
                                    std::vector<std::string>& complaints) {
  PeerModel* model = find(message.content_hash);
  if (model == nullptr) {
    keep_header(message);
    return 0;
  }
  if (model->is_ready()) return 0;
  Result<Replica> replica = Replica::from_header(message.bytes);
  if (!replica.is_ok()) {
    complaints.push_back("model " + model->name + ": " + replica.status().message());
    return 0;
  }
  model->replica = std::move(replica).value();
  return message.bytes.size();
}

bool ReplicaSet::apply_one(FrameReport& report) {
  for (auto& [name, model] : models_) {
    if (!model.is_ready() || model.waiting.empty()) continue;
    const Replica::Taken taken = model.replica->take(model.waiting.front());
    model.waiting.pop_front();
    report.load_s += taken.times.load_s;
    report.refine_s += taken.times.refine_s;
    report.tree_s += taken.times.tree_s;
    if (!taken.status.is_ok())
      report.complaints.push_back("model " + name + ": " + taken.status.message());
    return true;
  }
  return false;
}

}  // namespace nearmesh::subscriber
