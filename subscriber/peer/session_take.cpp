// SPDX-License-Identifier: Apache-2.0
// What a session takes in: who serves what, headers, batches, poses of others.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "content_choice.hpp"
#include "core/base/hash.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::size_t kMaxRefusedOf = 256;

}  // namespace

void Session::Impl::take_inbox(FrameReport& report) {
  Channel::Inbox inbox = channel->take();
  std::move(heard_by_host.begin(), heard_by_host.end(), std::back_inserter(inbox.poses));
  heard_by_host.clear();
  std::vector<std::string>& complaints = report.complaints;
  complaints.insert(complaints.end(), inbox.complaints.begin(), inbox.complaints.end());
  for (const wire::SessionId id : inbox.lost_publishers) {
    publishers.erase(id);
    // Whoever serves next is asked anew.
    std::erase_if(outstanding, [id](const auto& open) { return open.second.publisher == id; });
    has_news = true;
  }
  for (const wire::Hello& hello : inbox.hellos) take_hello(hello);
  note_epochs();
  // Not before all who came and went are known: one that was lost may be there again.
  if (std::exchange(has_news, false)) settle_contents(complaints);
  stats.refused_headers += inbox.refused_headers;
  stats.refused_poses += inbox.refused_poses;
  for (const Channel::Header& header : inbox.headers) take_header(header, complaints);
  is_dropping = false;
  for (wire::SplitBatchMessage& batch : inbox.batches) take_batch(std::move(batch), report);
  if (inbox.recorder_came) note_recorder();
  take_bodies(inbox, report);
  take_poses(inbox, complaints);
  take_wishes(inbox);
}

/// Who asks for discovery later, or declares a body no more, is told of those that came before.
void Session::Impl::take_bodies(const Channel::Inbox& inbox, FrameReport& report) {
  if (inbox.are_all_bodies) {
    std::set<std::string> all;
    for (const auto& [entry, is_gone] : inbox.bodies) all.insert(entry.name);
    for (const auto& [name, entry] : std::map(told_bodies))
      if (!all.contains(name)) lose_told(name, report);
  }
  for (const auto& [entry, is_gone] : inbox.bodies) {
    if (is_gone) {
      lose_told(entry.name, report);
      continue;
    }
    told_bodies.insert_or_assign(entry.name, entry);
    if (discovers) take_body(entry, report);
  }
  if (!discovers || !std::exchange(looks_at_told, false)) return;
  for (const auto& [name, entry] : told_bodies)
    if (!named.contains(name)) take_body(entry, report);
}

/// Its mover moves it no more.
void Session::Impl::lose_told(const std::string& name, FrameReport& report) {
  told_bodies.erase(name);
  const auto at = named.find(name);
  if (at == named.end() || !find(at->second)->is_discovered) return;
  report.went.push_back(at->second);
  remove_body(*find(at->second));
}

/// What the host declared stays as it is.
void Session::Impl::take_body(const wire::BodyDirectory::Body& entry, FrameReport& report) {
  if (const auto at = named.find(entry.name); at != named.end()) {
    Body& body = *find(at->second);
    const bool is_same = entry.solid == body.solid && entry.group == body.company.group &&
                         entry.mask == body.company.mask && entry.model == body.model->name &&
                         (!entry.content.is_set() || entry.content == body.model->pinned);
    if (!body.is_discovered || is_same) return;
    report.went.push_back(body.id);
    remove_body(body);
  }
  const auto added = add_body({.name = entry.name,
                               .model = entry.model,
                               .solid = entry.solid,
                               .content = entry.content,
                               .group = entry.group,
                               .mask = entry.mask});
  if (!added.is_ok()) {
    report.complaints.push_back("not discovered: " + added.status().message());
    return;
  }
  find(added.value())->is_discovered = true;
  report.came.push_back(added.value());
}

/// Of movers that no body here is of any more: there are many in weeks.
void Session::Impl::forget_gone_movers() {
  constexpr std::size_t kMaxMovers = 4096;
  if (last_pose_samples.size() <= kMaxMovers && last_promises.size() <= kMaxMovers) return;
  std::set<wire::SessionId> movers;
  for (const Body* body : present) {
    movers.insert(body->posed_by);
    for (const auto& promise : body->promises)
      if (promise) movers.insert(promise->peer);
  }
  const auto is_gone = [&](const auto& entry) { return !movers.contains(entry.first); };
  std::erase_if(last_pose_samples, is_gone);
  std::erase_if(last_promises, is_gone);
}

/// Others may go on from it with their own clocks, and one word must not take these beyond all
/// times.
void Session::Impl::hear_time(double said_s, const std::string& body,
                              std::vector<std::string>& complaints) {
  if (std::abs(said_s) <= wire::kMaxFollowed_s) {
    heard_time_s = std::max(heard_time_s.value_or(said_s), said_s);
    return;
  }
  if (++stats.strange_times > 1) return;
  complaints.push_back("of body " + body + " is said where it is at " + std::to_string(said_s) +
                       " s: expected a time of the exercise within " +
                       std::to_string(wire::kMaxFollowed_s) +
                       " s of 0, no clock goes on from this one; this is said once");
}

void Session::Impl::take_poses(const Channel::Inbox& inbox, std::vector<std::string>& complaints) {
  for (const wire::BodyPose& pose : inbox.poses) {
    hear_time(pose.time_s, pose.body, complaints);
    if (pose.sequence != 0 && !pose.is_near) {
      HeardSamples& heard = last_pose_samples[pose.peer];
      if (is_after(pose.sequence, heard.last)) {
        const std::uint32_t before = pose.sequence == 1 ? 0xffffffffU : pose.sequence - 1;
        if (heard.last != 0 && heard.last != before) heard.lost = before;
        heard.last = pose.sequence;
      }
    }
    if (pose.links > 1) {
      take_link(pose, complaints);
    } else {
      take_pose(pose, complaints);
    }
  }
  take_promises(inbox, complaints);
  forget_gone_movers();
  for (const auto& [name, mover] : inbox.movers)
    if (const auto at = named.find(name); at != named.end()) take_mover(*find(at->second), mover);
  if (!inbox.are_all_movers) return;
  for (Body* body : present) {
    const bool is_of_bus = body->posed_by != 0 || body->promiser != wire::Mover::kNone;
    if (is_of_bus && !inbox.movers.contains(body->name)) take_mover(*body, wire::Mover::kLeft);
  }
}

void Session::Impl::take_mover(Body& body, wire::Mover mover) {
  if (body.own || body.is_placed) return;
  if (mover != wire::Mover::kThere) forget_robot(body);
  if (body.stamp.mover != wire::Mover::kNone) body.stamp.mover = mover;
  if (body.promiser != wire::Mover::kNone) body.promiser = mover;
}

void Session::Impl::take_pose(const wire::BodyPose& pose, std::vector<std::string>& complaints) {
  const auto at = named.find(pose.body);
  if (at == named.end()) return;
  Body& body = *find(at->second);
  if (body.own) {
    if (!std::exchange(body.contested, true))
      complaints.push_back("another peer also moves body " + pose.body + "; its poses are ignored");
    return;
  }
  if (body.stamp.mover != wire::Mover::kNone && !body.is_placed &&
      pose.time_s < body.stamp.time_s && !std::exchange(body.has_gone_back, true))
    complaints.push_back("the time of body " + pose.body + "'s poses went back from " +
                         std::to_string(body.stamp.time_s) + " to " + std::to_string(pose.time_s) +
                         " s; this is said once");
  // Whoever has the name now may have promised nothing.
  const std::optional<wire::BodyPromise>& promise = body.promises[0];
  if (promise && pose.peer != 0 && !is_promise_of(*promise, pose.peer, pose.number)) {
    body.promises = {};
    body.promiser = wire::Mover::kNone;
  }
  body.motion = Motion{pose.pose, pose.linear_velocity_mps, pose.angular_velocity_radps};
  body.is_placed = false;
  body.is_new_to_bounds = true;
  body.stamp.mover = wire::Mover::kThere;
  body.stamp.time_s = pose.time_s;
  body.posed_by = pose.peer;
  body.mover = pose.sequence != 0 && !pose.is_near ? pose.peer : 0;
  body.number = pose.number;
  body.heard_robot = pose.links > 1 ? std::optional(pose.first_link) : std::nullopt;
  body.pose_sequence = pose.sequence;
  body.is_near_pose = pose.is_near;
}

/// As if none had come.
void Session::Impl::forget_pose(Body& body) {
  body.motion.reset();
  body.stamp.mover = wire::Mover::kNone;
  body.posed_by = body.mover = 0;
  body.pose_sequence = 0;
}

void Session::Impl::take_hello(const wire::Hello& hello) {
  const bool has_come = !publishers.contains(hello.publisher);
  Publisher& publisher = publishers[hello.publisher];
  publisher.hello = hello;
  publisher.announced.clear();
  for (const auto& model : hello.models) publisher.announced.insert(model.content_hash);
  // What the others have not answered may be asked of it. It counts as lost, and how often it was:
  // who comes again and again would have it begun anew each time.
  for (auto& [content, open] : outstanding) {
    if (!has_come || !publisher.announces(content)) continue;
    const auto asked = publishers.find(open.publisher);
    if (clock.seconds() - open.heard_s >= options.request_timeout_s ||
        (asked != publishers.end() && asked->second.lost_requests > 0))
      open.patience_s = 0;
  }
  publisher.lost_requests = 0;
  publisher.by_region.clear();
  has_news = true;
}

/// Anybody can write a header; it counts from who serves that content.
void Session::Impl::take_header(const Channel::Header& header,
                                std::vector<std::string>& complaints) {
  const auto publisher = publishers.find(header.publisher);
  if (publisher != publishers.end() && publisher->second.serves(header.message.content_hash)) {
    const std::uint64_t refused_before = replicas.refused_count();
    replicas.make_room_for(header.message, [this](const ContentHash& content) {
      return std::any_of(publishers.begin(), publishers.end(),
                         [&](const auto& entry) { return entry.second.announces(content); });
    });
    stats.header_bytes += replicas.take_header(header, complaints);
    has_news |= replicas.refused_count() != refused_before;  // another content may be taken now
    return;
  }
  ++stats.refused_headers;
  if (refused_of.size() < kMaxRefusedOf && refused_of.insert(header.publisher).second)
    complaints.push_back("header of content " + to_hex(header.message.content_hash) + " from " +
                         to_hex(header.publisher) +
                         " does not count: nobody of that name announces that content");
}

/// In the frame in which one begins, or its time has gone back before that.
void Session::Impl::note_epochs() {
  std::size_t begun = 0;
  for (const auto& [id, publisher] : publishers)
    for (const wire::Hello::Model& model : publisher.hello.models)
      begun += model.epoch.number != 0 && model.epoch.has_begun(time_s) ? 1 : 0;
  // Of one that nobody serves any more only who holds it knows.
  for (const auto& [name, model] : replicas.all())
    begun += model.epoch.number != 0 && model.epoch.has_begun(time_s) ? 1 : 0;
  has_news |= std::exchange(begun_epochs, begun) != begun;
}

/// What each model's name stands for, by all that publishers say now.
void Session::Impl::settle_contents(std::vector<std::string>& complaints) {
  for (auto& [name, model] : replicas.all()) {
    if (model.is_tile) continue;
    std::vector<wire::Offer> offers;
    for (const auto& [id, publisher] : publishers) wire::add_offer(publisher.hello, name, offers);
    std::string untaken;
    std::erase_if(offers, [&](const wire::Offer& offer) {
      if (!replicas.is_refused(offer.content)) return false;
      untaken = "publisher " + to_hex(offer.publisher) + " serves content " +
                to_hex(offer.content) + ", which contradicts itself and is not taken";
      return true;
    });
    const ContentHash before = model.content_hash;
    ContentChoice choice = choose_content({.pinned = model.pinned,
                                           .held = model.is_held() ? before : ContentHash{},
                                           .epoch = model.epoch},
                                          offers, time_s);
    if (!choice.change.empty())
      complaints.push_back("model " + name + ": " + choice.change + "; starting again with it");
    if (model.is_held() && model.pinned.is_set() && before != model.pinned)
      complaints.push_back("model " + name + ": content " + to_hex(model.pinned) +
                           " is pinned now; content " + to_hex(before) + " is dropped");
    const std::uint64_t refused_before = replicas.refused_count();
    stats.header_bytes += replicas.assign(model, choice.content, complaints);
    model.epoch = choice.epoch;
    ReplicaSet::expect(model, choice.coming);
    has_news |= replicas.refused_count() != refused_before;
    if (choice.mesh_bytes != 0) model.mesh_bytes = choice.mesh_bytes;
    if (choice.conflict.empty()) choice.conflict = std::move(untaken);
    if (!choice.conflict.empty() && choice.conflict != model.conflict)
      complaints.push_back("model " + name + ": " + choice.conflict);
    model.conflict = std::move(choice.conflict);
  }
}

void Session::Impl::take_batch(wire::SplitBatchMessage&& message, FrameReport& report) {
  // What one that was lost meanwhile sent is good all the same.
  if (const auto at = publishers.find(message.publisher); at != publishers.end()) {
    Publisher& publisher = at->second;
    publisher.lost_requests = 0;
    if (message.sequence > publisher.received_sequence + 1)
      stats.sequence_gaps += message.sequence - publisher.received_sequence - 1;
    publisher.received_sequence = std::max(publisher.received_sequence, message.sequence);
  }
  asked_publishers.hear(message);
  ++stats.batches;
  stats.batch_bytes += message.bytes.size();
  if (message.wants_held || message.wants_regions) {
    take_redirection(message);
    return;
  }
  PeerModel* model = replicas.find(message.content_hash);
  if (model == nullptr) replicas.note_unread(message);
  const bool is_of_audit = model != nullptr && model->audit.is_answered_by(message);
  if (is_of_audit) {
    stats.audit_bytes += message.bytes.size();
    model->audit.is_answered |= message.last;
  }
  if (message.refused) {
    // Another request stays open until its time-out, so that a refusal is not asked for every
    // frame.
    if (!is_of_audit && std::none_of(outstanding.begin(), outstanding.end(), [&](const auto& open) {
          return open.second.is_answered_by(message);
        }))
      return;
    ++refused;
    take_refused_certificate(message);
    report.complaints.push_back("publisher refused request " + std::to_string(message.request) +
                                ": " + std::string(message.bytes.begin(), message.bytes.end()));
    return;
  }
  if (message.is_piece) {
    take_piece(message, report);
    return;
  }
  bool is_chosen = false;
  for (auto& [content, open] : outstanding) {
    if (!open.is_answered_by(message)) continue;
    open.heard_s = clock.seconds();
    is_chosen = open.is_certificate;
  }
  if (message.last) close_request(message);
  if (model == nullptr || message.bytes.empty()) return;
  if (asked_about.find({message.content_hash, message.publisher}) == nullptr) {
    // Of others recorders count none.
    model->lacks_batches |= asked_publishers.has(message.publisher);
    if (unasked_of.size() < kMaxRefusedOf && unasked_of.insert(message.publisher).second)
      report.complaints.push_back("model " + model->name + ": publisher " +
                                  to_hex(message.publisher) +
                                  " sends detail that it was not asked for; it is dropped, this is "
                                  "said once");
    return;
  }
  model->tells_held |= !is_chosen && !is_audit_piece(message.bytes);
  if (model->waiting.add({message.publisher, std::move(message.bytes)})) return;
  model->lacks_batches = true;
  if (!std::exchange(is_dropping, true))
    report.complaints.push_back("model " + model->name + ": more than " +
                                std::to_string(WaitingBatches::kMostOfOne) +
                                " batches of publisher " + to_hex(message.publisher) +
                                " wait to be applied; further ones are dropped");
}

void Session::Impl::close_request(const wire::SplitBatchMessage& message) {
  const auto closed = std::erase_if(
      outstanding, [&](const auto& open) { return open.second.is_answered_by(message); });
  if (closed == 0) return;
  for (auto& [bodies_of, pair] : pairs)
    if (pair.asked.request == message.request) pair.asked.is_answered = true;
  for (auto& [place, pair] : tile_pairs)
    if (pair.asked.request == message.request) pair.asked.is_answered = true;
}

/// The publisher cannot answer what it was asked; it says how to ask.
void Session::Impl::take_redirection(const wire::SplitBatchMessage& message) {
  const auto publisher = publishers.find(message.publisher);
  for (auto at = outstanding.begin(); at != outstanding.end();) {
    if (!at->second.is_answered_by(message)) {
      ++at;
      continue;
    }
    // Who has forgotten one state has forgotten them all.
    if (PeerModel* model = replicas.find(at->first); model != nullptr && message.wants_held)
      model->tells_held = true;
    const bool is_meant = !message.content_hash.is_set() || at->first == message.content_hash;
    if (publisher != publishers.end() && is_meant &&
        (message.wants_regions || (message.wants_held && at->second.has_told_held)))
      publisher->second.by_region.insert(at->first);
    at = outstanding.erase(at);
  }
}

}  // namespace nearmesh::subscriber
