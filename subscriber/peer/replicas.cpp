// SPDX-License-Identifier: Apache-2.0
#include "replicas.hpp"

#include <utility>

#include "core/base/digest.hpp"
#include "core/base/hash.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh::subscriber {
PeerModel& ReplicaSet::add(const std::string& name) {
  PeerModel& model = models_[name];
  model.name = name;
  model.left = 0;
  return model;
}

std::vector<ContentHash> ReplicaSet::leave(PeerModel& model) {
  std::vector<ContentHash> gone;
  if (!model.is_held()) {
    gone.push_back(model.content_hash);
    drop(model);
    return gone;
  }
  model.left = ++models_left_;
  std::map<std::uint64_t, PeerModel*> unused;  // by turn
  for (auto& [name, other] : models_)
    if (other.left != 0) unused.emplace(other.left, &other);
  for (auto at = unused.begin(); unused.size() > wire::kMaxModels && at != unused.end();) {
    if (at->second->cache.has_news) {  // that no file has yet, and updates do not wait for disks
      ++at;
      continue;
    }
    gone.push_back(at->second->content_hash);
    drop(*at->second);
    at = unused.erase(at);
  }
  return gone;
}

/// Its header waits for bodies that may come back: nobody sends it again.
void ReplicaSet::drop(PeerModel& model) {
  std::vector<std::string> none;
  static_cast<void>(assign(model, {}, none));
  remove(std::string(model.name));
}

PeerModel* ReplicaSet::find(const std::string& name) {
  const auto at = models_.find(name);
  return at == models_.end() ? nullptr : &at->second;
}

PeerModel* ReplicaSet::find(const ContentHash& content_hash) {
  const auto at = by_content_.lower_bound({content_hash, {}});
  const bool is_found = at != by_content_.end() && at->first.first == content_hash;
  return is_found ? at->second : nullptr;
}

void ReplicaSet::remove(const std::string& name) {
  const auto at = models_.find(name);
  if (at == models_.end()) return;
  note_gone(at->second);
  by_content_.erase({at->second.content_hash, name});
  models_.erase(at);
}

/// Tiles come and go as bodies move: who has lied of one is not asked again when it comes back, and
/// what was not proved of it counts then.
void ReplicaSet::note_gone(const PeerModel& model) {
  if (!model.is_ready()) return;
  begins_in_ = ++last_era_;
  for (const wire::SessionId publisher : model.replica->distrusted())
    distrusted_.put({model.content_hash, publisher}, {});
  if (model.audit.request != 0 || !model.audit.unproved.empty())
    gone_audits_.put(model.content_hash, model.audit);
}

void ReplicaSet::note_unread(const wire::SplitBatchMessage& message) {
  PeerModel::Audit* audit = gone_audits_.use(message.content_hash);
  if (audit != nullptr && audit->is_answered_by(message)) audit->request = 0;
}

void ReplicaSet::note_given_up() {
  for (auto& [name, model] : models_) {
    if (!model.is_ready()) continue;
    const std::uint32_t before = std::exchange(model.noted_give_ups, model.replica->give_ups());
    if (std::exchange(model.lacks_batches, false) || before != model.noted_give_ups)
      model.era = ++last_era_;
  }
}

std::size_t ReplicaSet::assign(PeerModel& model, const ContentHash& content,
                               std::vector<std::string>& complaints) {
  if (model.content_hash == content) return 0;
  if (model.is_held()) keep_header(model.header);  // the content may come back
  note_gone(model);
  by_content_.erase({model.content_hash, model.name});
  if (content.is_set()) by_content_.emplace(std::pair(content, model.name), &model);
  PeerModel anew;
  anew.name = std::move(model.name);
  anew.content_hash = content;
  anew.pinned = model.pinned;
  anew.conflict = std::move(model.conflict);
  anew.left = model.left;
  anew.world_before = model.world ? std::move(model.world) : std::move(model.world_before);
  if (model.coming.content == content) anew.coming = std::move(model.coming);
  model = std::move(anew);
  const auto at = unclaimed_.find(content);
  if (at == unclaimed_.end()) return 0;
  const Channel::Header header = at->second.header;
  drop_spare(at);
  return take_header(header, complaints);
}

void ReplicaSet::expect(PeerModel& model, const ContentHash& coming) {
  if (model.coming.content != coming) model.coming = {.content = coming, .world = {}};
}

void ReplicaSet::prepare_coming() {
  for (auto& [name, model] : models_) {
    PeerModel::Coming& coming = model.coming;
    if (!coming.content.is_set() || coming.world) continue;
    const auto spare = unclaimed_.find(coming.content);
    if (spare == unclaimed_.end()) continue;
    const std::vector<std::uint8_t>& bytes = spare->second.header.message.bytes;
    if (!is_world_record(bytes)) continue;
    // One that is none is complained of once it is taken.
    if (auto world = PeerWorld::from_record(coming.content, bytes); world.is_ok())
      coming.world = std::move(world).value();
  }
}

PeerWorld* ReplicaSet::find_coming(const ContentHash& content) {
  for (auto& [name, model] : models_)
    if (model.coming.world && model.coming.content == content) return &*model.coming.world;
  return nullptr;
}

void ReplicaSet::drop_spare(std::map<ContentHash, Spare>::iterator spare) {
  unclaimed_bytes_ -= spare->second.header.message.bytes.size();
  unclaimed_.erase(spare);
}

bool ReplicaSet::has_room_for(const wire::MeshHeader& header) const {
  return unclaimed_bytes_ + header.bytes.size() <= kMaxSpareHeaderBytes &&
         unclaimed_.size() < wire::kMaxModels;
}

void ReplicaSet::make_room_for(const wire::MeshHeader& header,
                               const std::function<bool(const ContentHash&)>& is_served) {
  if (is_refused(header.content_hash) || unclaimed_.contains(header.content_hash) ||
      find(header.content_hash) != nullptr)
    return;
  while (!has_room_for(header)) {
    auto first = unclaimed_.end();
    for (auto at = unclaimed_.begin(); at != unclaimed_.end(); ++at)
      if ((first == unclaimed_.end() || at->second.came < first->second.came) &&
          !is_served(at->first))
        first = at;
    if (first == unclaimed_.end()) return;
    drop_spare(first);
  }
}

/// Beyond the limit only of names we use, that may come to stand for it.
void ReplicaSet::keep_header(const Channel::Header& header) {
  const wire::MeshHeader& message = header.message;
  if (const auto at = unclaimed_.find(message.content_hash); at != unclaimed_.end()) drop_spare(at);
  const bool is_named = find(message.name) != nullptr && unclaimed_.size() < 2 * wire::kMaxModels;
  if (!has_room_for(message) && !is_named) return;
  unclaimed_bytes_ += message.bytes.size();
  unclaimed_.emplace(message.content_hash, Spare{header, ++spares_that_came_});
}

/// Of that content for certain: else it befell the header on its way.
void ReplicaSet::refuse(const PeerModel& model, const Channel::Header& header, const Status& why,
                        std::vector<std::string>& complaints) {
  const ContentHash& content = header.message.content_hash;
  const bool contradicts = why.code() == StatusCode::kCorrupt;
  const bool is_final =
      (contradicts || model.is_tile) && digest_of(header.message.bytes) == content;
  if (is_final) {
    refused_.put(content, {});
    ++refused_count_;
  }
  complaints.push_back("model " + model.name + ": publisher " + to_hex(header.publisher) +
                       (!is_final
                            ? ": "
                            : (contradicts ? " contradicts itself, its content " : ": content ") +
                                  to_hex(content) + " is not taken: ") +
                       why.message());
}

std::size_t ReplicaSet::take_header(const Channel::Header& header,
                                    std::vector<std::string>& complaints) {
  const wire::MeshHeader& message = header.message;
  if (is_refused(message.content_hash)) return 0;
  PeerModel* model = find(message.content_hash);
  if (model == nullptr) {
    keep_header(header);
    return 0;
  }
  if (model->is_held()) return 0;
  if (is_world_record(message.bytes)) {
    Result<PeerWorld> world = PeerWorld::from_record(message.content_hash, message.bytes);
    if (!world.is_ok()) {
      refuse(*model, header, world.status(), complaints);
      return 0;
    }
    model->world = std::move(world).value();
    if (model->coming.world && model->coming.content == message.content_hash)
      model->world = std::exchange(model->coming.world, std::nullopt);
    if (model->world_before)
      model->world->keep_pages_of(*std::exchange(model->world_before, std::nullopt));
    if (model->world->root() != nullptr) model->bounds = model->world->bounds();
    model->header = header;
    return message.bytes.size();
  }
  Result<Replica> replica = Replica::from_header(message.bytes, &tables_);
  if (!replica.is_ok()) {
    refuse(*model, header, replica.status(), complaints);
    return 0;
  }
  model->world_before.reset();
  model->replica = std::move(replica).value();
  distrusted_.for_each([&](const auto& its, std::monostate) {
    if (its.first == message.content_hash) model->replica->distrust(its.second);
  });
  if (auto audit = gone_audits_.extract(message.content_hash)) model->audit = *std::move(audit);
  model->noted_give_ups = model->replica->give_ups();  // nothing was here
  model->bounds = ModelBounds(model->replica->header().grid, model->replica->store());
  model->header = header;
  model->era = begins_in_;
  return message.bytes.size();
}

namespace {

/// As the publisher of batches out of the cache; no publisher has it.
constexpr wire::SessionId kFromCache = 0;

void complain(PeerModel& model, wire::SessionId publisher, const Replica::Taken& taken,
              std::vector<std::string>& complaints) {
  if (taken.contradicts && taken.rests_on_kept) {
    complaints.push_back("model " + model.name +
                         ": detail out of the cache and what came contradict each other, all is "
                         "forgotten: " +
                         taken.status.message());
    return;
  }
  if (!taken.contradicts && !model.damaged.insert(publisher).second) return;
  complaints.push_back(
      "model " + model.name + ": " +
      (taken.contradicts && taken.liar == 0 ? "one of several publishers"
                                            : "publisher " + to_hex(publisher)) +
      (taken.contradicts
           ? " contradicts the model, its detail is forgotten and it is not asked again: "
           : " sent what came damaged, it is dropped and asked for again: ") +
      taken.status.message());
}

}  // namespace

bool ReplicaSet::apply_one(FrameReport& report) {
  for (auto& [name, model] : models_) {
    if (!model.is_ready() || model.waiting.empty()) continue;
    WaitingBatches::Batch batch = model.waiting.take();
    const bool is_cached = batch.publisher == kFromCache;
    const Replica::Taken taken = is_cached ? model.replica->take_kept(batch.bytes)
                                           : model.replica->take(batch.bytes, batch.publisher);
    report.load_s += taken.times.load_s;
    report.refine_s += taken.times.refine_s;
    report.tree_s += taken.times.tree_s;
    model.audit.is_proved |= batch.publisher == model.audit.publisher &&
                             std::find(taken.audited.begin(), taken.audited.end(),
                                       model.audit.node) != taken.audited.end();
    if (!taken.status.is_ok())
      complain(model, taken.contradicts ? taken.liar : batch.publisher, taken, report.complaints);
    if (taken.contradicts) model.forget_cache();
    if (taken.status.is_ok() && !cache_folder_.empty() && !is_audit_piece(batch.bytes))
      model.cache.keep(std::move(batch.bytes), !is_cached);
    return true;
  }
  return false;
}

void PeerModel::Cache::keep(std::vector<std::uint8_t>&& batch, bool is_new) {
  if (bytes + batch.size() > kMaxCachedBytes || batches.size() == kMaxCachedBatches) return;
  bytes += batch.size();
  has_news |= is_new;
  batches.push_back(std::move(batch));
}

void ReplicaSet::read_caches(std::vector<std::string>& complaints) {
  if (cache_folder_.empty()) return;
  for (auto& [name, model] : models_) {
    if (!model.is_ready() || std::exchange(model.cache.is_read, true)) continue;
    Result<std::optional<Batches>> read = read_cached(cache_folder_, model.content_hash);
    if (!read.is_ok()) {
      complaints.push_back("model " + name + ": the cache is not used: " + read.status().message());
    } else if (read.value()) {
      for (std::vector<std::uint8_t>& batch : *read.value())
        static_cast<void>(model.waiting.add({kFromCache, std::move(batch)}));
    }
  }
}

Status ReplicaSet::write_caches() {
  Status status;
  if (cache_folder_.empty()) return status;
  for (auto& [name, model] : models_) {
    if (!std::exchange(model.cache.has_news, false)) continue;
    const Status written = write_cached(cache_folder_, model.content_hash, model.cache.batches);
    if (!written.is_ok()) status = written;
  }
  return status;
}

}  // namespace nearmesh::subscriber
