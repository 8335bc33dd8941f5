// SPDX-License-Identifier: Apache-2.0
// How a session holds publishers to their word: now and then one is to prove a block that it sent
// (docs/security.md).
#include <utility>

#include "core/base/hash.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// Audits in a row: beyond, a publisher is taken for a liar.
constexpr std::uint32_t kMostUnproved = 3;
/// Then an audit counts as not answered.
constexpr double kAuditPatience_s = 10;

}  // namespace

// Asks for the block of a split that is held, each split as likely as any other. Beside what else
// is open.
void Session::Impl::audit(PeerModel& model) {
  if (options.audit_s <= 0 || model.audit.request != 0 || clock.seconds() < model.audit.due_s)
    return;
  const ActiveMesh& mesh = model.replica->mesh();
  const Publisher* publisher = publisher_of(model.content_hash);
  if (publisher == nullptr || mesh.split_count() == 0) return;
  const auto roots = static_cast<std::uint32_t>(mesh.store().roots().size());
  const VertexId split = mesh.active_at(audits.below(mesh.split_count() + roots));
  if (mesh.store().is_root(split)) return;  // the next update draws again
  model.audit.node = mesh.store().node_of(split);
  send_request(*publisher, kHorizon,
               {.content_hash = model.content_hash,
                .region = {.attach = {model.audit.node}, .region = {}, .max_splits = 0}});
  model.audit.request = last_request;
  model.audit.publisher = publisher->hello.publisher;
  model.audit.sent_s = clock.seconds();
  model.audit.is_answered = false;
}

void Session::Impl::settle_audit(PeerModel& model, FrameReport& report) {
  const bool is_proved = std::exchange(model.audit.is_proved, false);
  if (is_proved) ++stats.audits;
  const bool is_over =
      model.audit.is_answered || clock.seconds() - model.audit.sent_s > kAuditPatience_s;
  if (model.audit.request == 0 || !(is_proved || is_over)) return;
  model.audit.request = 0;
  const auto asked = publishers.find(model.audit.publisher);
  if (is_proved) model.audit.due_s = clock.seconds() + options.audit_s;
  // Who answers nothing at all is slow, or gone.
  const bool is_silent =
      !model.audit.is_answered && asked != publishers.end() && asked->second.lost_requests > 0;
  if (is_proved || is_silent || asked == publishers.end()) {
    model.audit.unproved.erase(model.audit.publisher);
    return;
  }
  if (++model.audit.unproved[asked->first] < kMostUnproved) return;
  model.replica->distrust(asked->first);
  model.forget_cache();
  report.complaints.push_back("model " + model.name + ": publisher " + to_hex(asked->first) +
                              " does not prove what it sent, " + std::to_string(kMostUnproved) +
                              " audits in a row: all detail is given up and it is not asked again");
}

}  // namespace nearmesh::subscriber
