// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/peer/local_channel.hpp"

#include <algorithm>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/stopwatch.hpp"
#include "core/certificate/certificate.hpp"
#include "core/demand/answer.hpp"
#include "frame_budget.hpp"

namespace nearmesh::subscriber {
namespace {

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

LocalChannel::LocalChannel() : mirrors_(std::make_unique<Mirrors>()) {}
LocalChannel::~LocalChannel() = default;

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
      at == models_.end()
          ? Status{StatusCode::kNotFound, "no model with that content hash is served here"}
          : answer_region(at->second.file, subscription.region);
  if (!batches.is_ok())
    return {wire::refusal_message(kPublisher, subscription, batches.status().message())};
  return wire::answer_messages(kPublisher, subscription.request, subscription.content_hash,
                               std::move(batches).value(), true);
}

void LocalChannel::certify(const wire::RegionSubscription& subscription) {
  BegunCertificate begun =
      begin_certificate(kPeer, *subscription.certificate, *mirrors_, [this](const auto& content) {
        const auto model = models_.find(content);
        return model == models_.end() ? nullptr : &model->second.file;
      });
  if (!begun.maker) {
    deliver({wire::redirection_message(kPublisher, subscription, begun.why_not, begun.unknown_state,
                                       begun.wants_regions)});
    return;
  }
  begun_ = std::make_unique<Begun>(Begun{subscription, std::move(*begun.maker)});
  go_on();
}

void LocalChannel::allow(double seconds) {
  constexpr int kPatience = 8;
  allowed_s_ = seconds;
  not_allowed_ = seconds > kLeastTests * test_s_ ? 0 : (not_allowed_ + 1) % kPatience;
  if (begun_) go_on();
}

/// At least one step, where any is allowed.
void LocalChannel::go_on() {
  if (allowed_s_ <= kLeastTests * test_s_ && not_allowed_ != 0) return;
  const Stopwatch watch;
  while (begun_) {
    const double begun_s = watch.seconds(), left_s = allowed_s_ - begun_s;
    const std::uint64_t tests = tests_within(left_s, std::max(test_s_, kTest_s / 4));
    Result<CertificateMaker::Part> part = begun_->maker.next(tests);
    if (!part.is_ok()) {
      deliver({wire::refusal_message(kPublisher, begun_->subscription, part.status().message())});
      begun_.reset();
      return;
    }
    const bool is_last = begun_->maker.is_done();
    deliver(wire::answer_messages(kPublisher, begun_->subscription.request, part.value().content,
                                  std::move(part.value().batches), is_last));
    if (is_last) begun_.reset();
    // Where the work ended before the tests did this says too little, so it falls slowly.
    const double took_s = (watch.seconds() - begun_s) / static_cast<double>(tests);
    test_s_ += (took_s - test_s_) * (took_s > test_s_ ? 0.5 : 1.0 / 16);
    if (watch.seconds() + kLeastTests * test_s_ >= allowed_s_) break;
  }
  allowed_s_ -= watch.seconds();
}

Channel::Inbox LocalChannel::take() { return std::exchange(inbox_, {}); }

}  // namespace nearmesh::subscriber
