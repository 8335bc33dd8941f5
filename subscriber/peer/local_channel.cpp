// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/peer/local_channel.hpp"

#include <algorithm>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/stopwatch.hpp"
#include "core/certificate/certificate.hpp"
#include "core/demand/answer.hpp"
#include "core/world/content_bytes.hpp"
#include "core/world/world_source.hpp"
#include "frame_budget.hpp"

namespace nearmesh::subscriber {
namespace {

/// Each so manieth call with too little time a step is made all the same.
constexpr int kPatience = 8;

Result<std::vector<std::vector<std::uint8_t>>> answer_region(ModelFile& file,
                                                             const RegionRequest& request) {
  NEARMESH_RETURN_IF_ERROR(check_request(file.store(), request));
  if (request.is_audit()) return file.prove(request.attach.front());
  return answer_request(file.header(), file.store(), request,
                        [&file](NodeSpan node) { return file.require(node); });
}

}  // namespace

/// The publisher's choice of detail, on its way.
struct LocalChannel::Begun {
  wire::RegionSubscription subscription;
  CertificateMaker maker;
};

struct LocalChannel::World {
  std::string name;
  std::unique_ptr<WorldSource> source;
};

/// How long steps take: so much a test, and up to so much more, for a step may end later than its
/// tests.
struct LocalChannel::Pace {
  ExpectedCost test{0.5, 1.0 / 16}, beyond{1, 1.0 / 32};

  /// The shortest.
  [[nodiscard]] double step_s() const { return kLeastTests * test.seconds() + beyond.seconds(); }
  [[nodiscard]] std::uint64_t tests_within(double left_s) const {
    return subscriber::tests_within(left_s - beyond.seconds(),
                                    std::max(test.seconds(), kTest_s / 4));
  }
  /// A step that was interrupted says nothing of those that follow: believed, it would keep them
  /// waiting.
  void note(std::uint64_t tests, double took_s) {
    constexpr double kMostBeyond_s = 1e-3;
    const auto count = static_cast<double>(tests);
    beyond.add(std::clamp(took_s - count * test.seconds(), 0.0, kMostBeyond_s));
    // Too little where the work ended before the tests did: it falls slowly.
    test.add(std::min(took_s / count, 4 * kTest_s));
  }
};

LocalChannel::LocalChannel()
    : mirrors_(std::make_unique<Mirrors>()), pace_(std::make_unique<Pace>()) {}
LocalChannel::~LocalChannel() = default;

Status LocalChannel::add_model(const std::string& name, ModelFile file) {
  NEARMESH_RETURN_IF_ERROR(wire::check_new_model(name, models_.size() + worlds_.size()));
  for (const World& world : worlds_)
    if (world.name == name)
      return {StatusCode::kConflict,
              file.path() + " as " + name + ": the name is taken by a world"};
  for (const auto& [hash, model] : models_)
    if (model.name == name || hash == file.content_hash())
      return {StatusCode::kConflict,
              file.path() + " as " + name + ": " +
                  (model.name == name ? "the name is taken by " : "same content as ") +
                  model.file->path() + ", served as " + model.name};
  const ContentHash hash = file.content_hash();
  models_.emplace(hash, Model{name, std::make_shared<ModelFile>(std::move(file))});
  if (connected_) announce();
  return Status::ok();
}

Status LocalChannel::add_world(const std::string& name, const std::string& folder) {
  NEARMESH_RETURN_IF_ERROR(wire::check_new_model(name, models_.size() + worlds_.size()));
  Result<std::unique_ptr<WorldSource>> opened = WorldSource::open(folder);
  NEARMESH_RETURN_IF_ERROR(opened);
  const auto is_taken = [&](const std::string& other) { return other == name; };
  for (const auto& [hash, model] : models_)
    if (is_taken(model.name))
      return {StatusCode::kConflict, folder + ": the name " + name + " is taken"};
  for (const World& world : worlds_)
    if (is_taken(world.name) || world.source->folder().name() == opened.value()->folder().name())
      return {StatusCode::kConflict,
              folder + " as " + name + ": the name is taken, or the same world is served"};
  worlds_.push_back({name, std::move(opened).value()});
  if (connected_) announce();
  return Status::ok();
}

/// Of a model or a tile; null where there is none, or it cannot be opened: who asks for a region of
/// it is told why.
std::shared_ptr<ModelFile> LocalChannel::file_of(const ContentHash& content) const {
  if (const auto model = models_.find(content); model != models_.end()) return model->second.file;
  for (const World& world : worlds_) {
    if (!world.source->has(content)) continue;
    auto tile = open_tile(*world.source, content);
    return tile.is_ok() ? std::move(tile).value() : nullptr;
  }
  return nullptr;
}

/// What has to be closed for it is not kept open by mirrors.
Result<std::shared_ptr<ModelFile>> LocalChannel::open_tile(WorldSource& world,
                                                           const ContentHash& content) const {
  return world.tile(content, [this](const ContentHash& held) { mirrors_->sleep(held); });
}

Result<std::vector<std::vector<std::uint8_t>>> LocalChannel::answer_of_world(
    const wire::RegionSubscription& subscription) {
  NEARMESH_RETURN_IF_ERROR(check_request(subscription.region));
  const bool wants_bytes = asks_for_content_bytes(subscription.region);
  for (const World& world : worlds_) {
    if (!world.source->has(subscription.content_hash)) continue;
    if (wants_bytes) return world.source->pieces(subscription.content_hash);
    const auto tile = open_tile(*world.source, subscription.content_hash);
    NEARMESH_RETURN_IF_ERROR(tile);
    return answer_region(*tile.value(), subscription.region);
  }
  return Status{StatusCode::kNotFound,
                "no model, tile or page with that content hash is served here"};
}

void LocalChannel::announce() {
  wire::Hello hello;
  hello.publisher = kPublisher;
  inbox_.headers.clear();
  for (const auto& [hash, model] : models_)
    inbox_.headers.push_back(
        {kPublisher, wire::announce_model(model.name, *model.file, {}, {}, hello)});
  for (const World& world : worlds_) {
    const WorldFolder& folder = world.source->folder();
    inbox_.headers.push_back(
        {kPublisher, wire::announce_world(world.name, folder.name(), encode_world(folder.world()),
                                          {}, {}, hello)});
  }
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
  begun_.reset();
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
  if (subscription.certificate) {
    certify(subscription);
  } else {
    deliver(answer(subscription));
  }
}

void LocalChannel::deliver(std::vector<wire::SplitBatchMessage>&& messages) {
  for (wire::SplitBatchMessage& message : messages) {
    message.sequence = ++sequence_;
    inbox_.batches.push_back(std::move(message));
  }
}

std::vector<wire::SplitBatchMessage> LocalChannel::answer(
    const wire::RegionSubscription& subscription) {
  const auto at = models_.find(subscription.content_hash);
  Result<std::vector<std::vector<std::uint8_t>>> batches =
      at == models_.end() ? answer_of_world(subscription)
                          : answer_region(*at->second.file, subscription.region);
  if (!batches.is_ok())
    return {wire::refusal_message(kPublisher, subscription, batches.status().message())};
  return wire::answer_messages(kPublisher, subscription.request, subscription.content_hash,
                               std::move(batches).value(), true,
                               asks_for_content_bytes(subscription.region));
}

void LocalChannel::certify(const wire::RegionSubscription& subscription) {
  BegunCertificate begun =
      begin_certificate(kPeer, *subscription.certificate, *mirrors_,
                        [this](const ContentHash& content) { return file_of(content); });
  if (!begun.maker) {
    deliver({wire::redirection_message(kPublisher, subscription, begun.why_not, begun.content,
                                       begun.wants_regions)});
    return;
  }
  begun_ = std::make_unique<Begun>(Begun{subscription, std::move(*begun.maker)});
  if (allowed_s_ >= pace_->step_s()) go_on();
}

void LocalChannel::allow(double seconds) {
  allowed_s_ = seconds;
  if (!begun_) return;
  if (seconds < pace_->step_s() && ++waited_ < kPatience) return;
  waited_ = 0;
  go_on();
}

double LocalChannel::needs_s() const {
  return begun_ && waited_ + 1 >= kPatience ? pace_->step_s() : 0;
}

/// One step at least.
void LocalChannel::go_on() {
  const Stopwatch watch;
  while (begun_) {
    const double begun_s = watch.seconds();
    const std::uint64_t tests = pace_->tests_within(allowed_s_ - begun_s);
    Result<CertificateMaker::Part> part = begun_->maker.next(tests);
    if (!part.is_ok()) {
      const std::string& why = part.status().message();
      const auto& unreadable = begun_->maker.unreadable();
      deliver({unreadable ? wire::redirection_message(kPublisher, begun_->subscription, why,
                                                      *unreadable, true)
                          : wire::refusal_message(kPublisher, begun_->subscription, why)});
      begun_.reset();
      return;
    }
    const bool is_last = begun_->maker.is_done();
    deliver(wire::answer_messages(kPublisher, begun_->subscription.request, part.value().content,
                                  std::move(part.value().batches), is_last));
    if (is_last) begun_.reset();
    pace_->note(tests, watch.seconds() - begun_s);
    if (watch.seconds() + pace_->step_s() > allowed_s_) break;
  }
  allowed_s_ -= watch.seconds();
}

Channel::Inbox LocalChannel::take() { return std::exchange(inbox_, {}); }

}  // namespace nearmesh::subscriber
