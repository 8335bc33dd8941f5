// SPDX-License-Identifier: Apache-2.0
#include "service.hpp"

#include <algorithm>
#include <utility>

#include "core/base/hash.hpp"
#include "core/demand/answer.hpp"
#include "core/world/content_bytes.hpp"
#include "idl/messages/contents.hpp"
#include "idl/messages/process_name.hpp"

namespace nearmesh::publisher {
namespace {

/// Of one step(), before whoever calls it may look at something else.
constexpr int kMaxTurns = 128;
/// Sent before requests are looked at again.
constexpr int kMaxSent = 64;
/// Answers that are being collected at a time, since each may take some 20 MB for it; and mirrors
/// that are being made of peers' words, some 50 MB.
constexpr std::size_t kMaxCollecting = 8, kMaxMaking = 2;
constexpr std::size_t kMaxRivals = 256;
/// Requests of a peer that are not answered in full, before those for parts of worlds replace one
/// another.
constexpr std::size_t kMaxOpenOfPeer = 128;
/// How often an answer that was begun may give way to another of the same model: faster than any
/// peer's frames.
constexpr double kRestart_s = 0.01;
constexpr int kRestartsAtOnce = 10;
/// Nodes that are done in a turn to make a mirror of a peer's word, or of what it was before it
/// slept: some 0.2 ms, as other turns.
constexpr std::size_t kToldATurn = 256;
/// What a round of a certificate takes: a look, and each test. Most take a twentieth of other
/// turns, so ten of them in a row are as much as one of a peer that asks for everything.
constexpr double kLook_s = 1e-5, kTest_s = 1e-7;
/// To make a batch and send it.
constexpr double kBatch_s = 5e-5;
/// So much time a node passes before the next word of the peer counts, whether or not it was true,
/// or one of its mirrors wakes, and so much may be owed. In such turns a split takes 0.8 to 0.9 us
/// to be read, done and put into a tree, and up to 2 us where the file was not read so far
/// (medians, models of 256 to 261,000 splits); a node with half-spaces takes 0.4 us, and 1.9 with
/// eight. So the price is no less than the cost, and one peer's words take less than half of the
/// time. As much as is taken of one model may be owed, 0.5 s: who holds 20,000 splits may say so 25
/// times a second, and does not wait.
constexpr double kToldNode_s = 2e-6, kToldAtOnce_s = kToldNode_s * MirrorMaker::kMostHeld;

/// Whether a request asks for detail of this content.
bool is_about(const wire::RegionSubscription& asked, const ContentHash& content) {
  if (!asked.certificate) return asked.content_hash == content;
  const auto& models = asked.certificate->models;
  return std::any_of(models.begin(), models.end(),
                     [&](const auto& model) { return model.content == content; });
}

}  // namespace

Service::Service(Channel& channel, wire::SessionId session, ServiceOptions options)
    : channel_(channel), session_(session), options_(options) {}

Status Service::check_new(const std::string& name, const std::string& path,
                          const ContentHash& content, const ContentHash& replaces) const {
  NEARMESH_RETURN_IF_ERROR(wire::check_new_model(name, models_.size() + worlds_.size()));
  if (replaces == content)
    return {StatusCode::kInvalidArgument,
            path + ": its content is " + to_hex(content) + " itself, which it cannot replace"};
  const auto check = [&](const ContentHash& its, const std::string& its_name,
                         const std::string& its_path) -> Status {
    if (its_name == name)
      return {StatusCode::kConflict, path + ": the name " + name + " is taken by " + its_path};
    if (its == content)
      return {StatusCode::kConflict,
              path + ": same content as " + its_path + ", which is served as " + its_name};
    return Status::ok();
  };
  for (const auto& [its, model] : models_)
    NEARMESH_RETURN_IF_ERROR(check(its, model->name, model->file.path()));
  for (const auto& [its, world] : worlds_)
    NEARMESH_RETURN_IF_ERROR(check(its, world.name, world.path));
  return Status::ok();
}

Status Service::add_model(const std::string& name, ModelFile file, ContentHash replaces,
                          const wire::Epoch& epoch) {
  const ContentHash hash = file.content_hash();
  NEARMESH_RETURN_IF_ERROR(check_new(name, file.path(), hash, replaces));
  auto model = std::make_shared<Model>(Model{name, std::move(file), replaces, epoch});
  answerers_[hash] = [&file = model->file](const RegionRequest& request) {
    return answer(file, request);
  };
  by_region_.erase(hash);
  models_.emplace(hash, std::move(model));
  return Status::ok();
}

Status Service::add_world(const std::string& name, const std::string& folder, ContentHash replaces,
                          const wire::Epoch& epoch) {
  Result<std::unique_ptr<WorldSource>> source = WorldSource::open(folder);
  NEARMESH_RETURN_IF_ERROR(source);
  const ContentHash hash = source.value()->folder().name();
  NEARMESH_RETURN_IF_ERROR(check_new(name, folder, hash, replaces));
  worlds_.emplace(hash, World{name, folder, std::move(source).value(), replaces, epoch});
  return Status::ok();
}

void Service::add_answerer(const ContentHash& content_hash, Answerer answerer) {
  answerers_[content_hash] = std::move(answerer);
  by_region_.insert(content_hash);
}

void Service::announce() {
  hello_ = {.publisher = session_};
  std::vector<wire::MeshHeader> headers;
  for (const auto& [hash, model] : models_)
    headers.push_back(
        wire::announce_model(model->name, model->file, model->replaces, model->epoch, hello_));
  for (const auto& [hash, world] : worlds_)
    headers.push_back(wire::announce_world(world.name, hash,
                                           encode_world(world.source->folder().world()),
                                           world.replaces, world.epoch, hello_));
  channel_.announce(hello_, headers);
}

Result<Service::Parts> Service::answer(ModelFile& file, const RegionRequest& request) {
  NEARMESH_RETURN_IF_ERROR(check_request(file.store(), request));
  if (request.is_audit())
    return Parts([&file, node = request.attach.front()]() -> Result<Part> {
      auto pieces = file.prove(node);
      NEARMESH_RETURN_IF_ERROR(pieces);
      return Part{file.content_hash(), std::move(pieces).value(), true};
    });
  auto maker = std::make_shared<AnswerMaker>(file.header(), file.store(), request,
                                             [&file](NodeSpan node) { return file.require(node); });
  return Parts([maker, content = file.content_hash()]() -> Result<Part> {
    auto batches = maker->next();
    NEARMESH_RETURN_IF_ERROR(batches);
    return Part{content, std::move(batches).value(), maker->is_done()};
  });
}

/// Null where it is of none that is served.
WorldSource* Service::world_with(const ContentHash& content) const {
  for (const auto& [hash, world] : worlds_)
    if (world.source->has(content)) return world.source.get();
  return nullptr;
}

/// Of a model, or a tile, which stays open as long as somebody has it; null where peers are to ask
/// for regions, or it cannot be opened: who asks for a region of it is told why.
std::shared_ptr<ModelFile> Service::file_of(const ContentHash& content) {
  if (by_region_.contains(content)) return nullptr;
  if (const auto model = models_.find(content); model != models_.end())
    return {model->second, &model->second->file};
  WorldSource* world = world_with(content);
  if (world == nullptr) return nullptr;
  auto tile = open_tile(*world, content);
  return tile.is_ok() ? std::move(tile).value() : nullptr;
}

/// What has to be closed for it is not kept open by mirrors.
Result<std::shared_ptr<ModelFile>> Service::open_tile(WorldSource& world,
                                                      const ContentHash& content) {
  return world.tile(content, [this](const ContentHash& held) { mirrors_.sleep(held); });
}

Result<Service::Parts> Service::answer(WorldSource& world, const wire::RegionSubscription& asked) {
  if (asks_for_content_bytes(asked.region)) {
    auto pieces = world.pieces(asked.content_hash);
    NEARMESH_RETURN_IF_ERROR(pieces);
    return Parts([pieces = std::move(pieces).value(),
                  content = asked.content_hash]() mutable -> Result<Part> {
      return Part{content, std::move(pieces), true, true};
    });
  }
  auto tile = open_tile(world, asked.content_hash);
  NEARMESH_RETURN_IF_ERROR(tile);
  auto parts = answer(*tile.value(), asked.region);
  NEARMESH_RETURN_IF_ERROR(parts);
  // The tile stays open until its answer is made.
  return Parts([open = std::move(tile).value(), its = std::move(parts).value()] { return its(); });
}

Service::Kind Service::kind_of(const wire::RegionSubscription& request) {
  if (request.certificate) return Kind::kCertificate;
  return request.region.is_audit() ? Kind::kAudit : Kind::kRegion;
}

void Service::take_requests(double now_s) {
  Inbox inbox = channel_.take();
  for (const wire::SessionId id : inbox.lost_peers) {
    peers_.erase(id);
    mirrors_.forget(id);
  }
  take_rivals(inbox);
  for (wire::RegionSubscription& subscription : inbox.subscriptions) {
    if (subscription.publisher != session_) continue;
    Peer& peer = peers_.try_emplace(subscription.peer, options_.pacing).first->second;
    peer.pacing.limit(std::min(subscription.window_bytes, options_.max_window_bytes));
    peer.pacing.acknowledged(subscription.acknowledged_sequence, now_s);
    // Repeats of a request (a writer's history after a rematch) are not answered twice.
    if (subscription.request == 0 || subscription.request <= peer.last_request) continue;
    peer.last_request = subscription.request;
    ++stats_.requests;
    const Kind kind = kind_of(subscription);
    // A request names the peer's unresolved nodes, or says what it holds, as that is now: it
    // replaces what is open and what waits for its models. Audits stand apart.
    std::erase_if(peer.queue, [&](Waiting& waiting) {
      if ((waiting.kind == Kind::kAudit) != (kind == Kind::kAudit) ||
          !is_about(subscription, waiting.message.content_hash))
        return false;
      if (waiting.kind != Kind::kCertificate || !waiting.message.last) return true;
      waiting.message.bytes.clear();  // for its other models it ends what was asked, all the same
      return false;
    });
    const ContentHash& content = subscription.content_hash;
    const bool stands_alone =
        answerers_.contains(content) ||
        (peer.open.size() < kMaxOpenOfPeer && !subscription.certificate && world_with(content));
    const ContentHash hash = stands_alone ? content : ContentHash{};
    Open& open = peer.open[{hash, kind}];
    // What is begun anew again and again would keep the publisher busy for nothing.
    double restarts_s = open.restarts_s;
    if (open.parts)
      restarts_s = std::max(restarts_s, now_s - kRestartsAtOnce * kRestart_s) + kRestart_s;
    const bool makes_mirrors = this->makes_mirrors(subscription);
    const double may_begin_s =
        makes_mirrors ? std::max(restarts_s, peer.told_s - kToldAtOnce_s) : restarts_s;
    open = Open{.subscription = std::move(subscription),
                .parts = {},
                .makes_mirrors = makes_mirrors,
                .kind = kind,
                .may_begin_s = may_begin_s,
                .restarts_s = restarts_s};
  }
}

/// Of what its peer says that it holds, or of what slept.
bool Service::makes_mirrors(const wire::RegionSubscription& asked) const {
  if (!asked.certificate) return false;
  const auto& models = asked.certificate->models;
  return std::any_of(models.begin(), models.end(), [&](const auto& model) {
    return !model.held.empty() || mirrors_.is_asleep(asked.peer, model.content);
  });
}

void Service::take_rivals(const Inbox& inbox) {
  for (const wire::SessionId id : inbox.lost_rivals) rivals_.erase(id);
  for (const wire::Hello& hello : inbox.rivals)
    if (hello.publisher != session_ &&
        (rivals_.size() < kMaxRivals || rivals_.contains(hello.publisher)))
      rivals_[hello.publisher] = hello;
  has_news_of_rivals_ = has_news_of_rivals_ || !inbox.lost_rivals.empty() || !inbox.rivals.empty();
}

/// One line for each rival and name, when it begins. Peers that hold one content do not take
/// another for it, so all must know.
void Service::find_conflicts(std::vector<std::string>& lines) {
  if (!std::exchange(has_news_of_rivals_, false)) return;
  std::set<std::string> found;
  for (const auto& [name, hash, mesh_bytes, replaces, epoch] : hello_.models) {
    std::vector<wire::Offer> all{{.publisher = session_, .content = hash, .replaces = replaces}};
    all.front().epoch = epoch;
    for (const auto& [id, rival] : rivals_) wire::add_offer(rival, name, all);
    const std::vector<wire::Offer> offers = wire::of_epoch(all, epoch.number);
    const std::vector<ContentHash> standing = wire::standing(offers);
    const auto stands = [&standing](const ContentHash& content) {
      return std::find(standing.begin(), standing.end(), content) != standing.end();
    };
    const std::string here = "model " + name + ": publisher ";
    for (const wire::Offer& theirs : offers) {
      const std::string who = here + wire::called(theirs.publisher, theirs.name);
      if (theirs.content == hash || !stands(theirs.content)) continue;
      if (stands(hash))
        found.insert(who + " serves other content, " + to_hex(theirs.content) +
                     ", under this name, here it is " + to_hex(hash) + "; " +
                     wire::kConflictAdvice);
      else if (theirs.replaces == hash)
        found.insert(who + " replaces content " + to_hex(hash) + ", which is served here, by " +
                     to_hex(theirs.content) + "; peers go over to it: stop this one");
    }
    for (const wire::Offer& theirs : all)
      if (theirs.epoch.number > epoch.number && theirs.content != hash)
        found.insert(here + wire::called(theirs.publisher, theirs.name) + " serves epoch " +
                     std::to_string(theirs.epoch.number) + ", content " + to_hex(theirs.content) +
                     ": peers go over to it at " + std::to_string(theirs.epoch.from_s) +
                     " s of the exercise");
  }
  std::set_difference(found.begin(), found.end(), conflicts_.begin(), conflicts_.end(),
                      std::back_inserter(lines));
  conflicts_ = std::move(found);
}

/// The end when its queue is full enough at that urgency, or nothing is open that may go on, or
/// begin where there is room for it.
Service::OpenRequests::iterator Service::most_urgent(Peer& peer, const Room& room) const {
  const auto rank = [](const Open& open) {
    return std::pair(open.subscription.priority, open.subscription.request);
  };
  auto found = peer.open.end();
  for (auto at = peer.open.begin(); at != peer.open.end(); ++at) {
    const Open& open = at->second;
    const bool has_room = open.makes_mirrors ? room.for_mirror : room.for_answer;
    if (open.may_begin_s > now_s_ || !(has_room || open.parts)) continue;
    if (found == peer.open.end() || rank(open) < rank(found->second)) found = at;
  }
  if (found == peer.open.end()) return found;
  std::size_t queued_bytes = 0;
  for (const Waiting& waiting : peer.queue)
    if (waiting.priority <= found->second.subscription.priority)
      queued_bytes += sample_bytes(waiting.message) + kBatchFramingBytes;
  if (queued_bytes < kEnoughQueuedBytes) return found;
  // An answer that is being collected goes on all the same: it adds nothing to the queue until it
  // is through, and others wait for its place.
  return std::find_if(peer.open.begin(), peer.open.end(), [this](const auto& entry) {
    const Open& open = entry.second;
    return (open.is_collecting || open.is_making) && open.may_begin_s <= now_s_;
  });
}

/// Who has had least of the time, of those who wait for something, and its request.
std::optional<Service::Turn> Service::next_in_turn() {
  std::size_t collecting = 0, making = 0;
  for (const auto& [id, peer] : peers_)
    for (const auto& [key, open] : peer.open) {
      collecting += open.is_collecting ? 1 : 0;
      making += open.is_making ? 1 : 0;
    }
  const auto had = [this](const Peer& peer) {
    return std::pair(std::max(peer.served_s, served_s_), peer.last_turn);
  };
  std::optional<Turn> next;
  for (auto at = peers_.begin(); at != peers_.end(); ++at) {
    Peer& peer = at->second;
    if (peer.open.empty() || (next && had(next->peer->second) <= had(peer))) continue;
    const auto open = most_urgent(peer, {collecting < kMaxCollecting, making < kMaxMaking});
    if (open != peer.open.end()) next = Turn{at, open};
  }
  return next;
}

/// One part of the request.
void Service::serve(const Turn& turn, double now_s, std::vector<std::string>& lines) {
  const wire::SessionId id = turn.peer->first;
  Peer& peer = turn.peer->second;
  peer.last_turn = ++turns_;
  served_s_ = std::max(served_s_, peer.served_s);
  peer.served_s = served_s_ + kTurn_s;  // where nothing is known of what it takes
  const auto at = turn.open;
  Open& open = at->second;
  Status fault;
  if (!open.parts) {
    Result<Parts> parts = begin(id, peer, open);
    if (parts.is_ok()) {
      open.parts = std::move(parts).value();
      open.subscription.region = {};  // the parts have it
    } else {
      fault = parts.status();
    }
  }
  if (fault.is_ok()) {
    Result<Part> part = open.parts();
    if (part.is_ok() && part.value().instead) {
      enqueue(peer, open, {std::move(*part.value().instead)});
      peer.open.erase(at);
      return;
    }
    if (part.is_ok()) {
      std::size_t batches = part.value().batches.size();
      for (const Part::Other& other : part.value().others) batches += other.batches.size();
      peer.served_s = served_s_ + part.value().took_s + kBatch_s * static_cast<double>(batches);
      const bool last = part.value().last;
      open.is_making = part.value().is_of_mirror;
      open.is_collecting = !last && !open.is_making && batches == 0;
      enqueue(peer, open, messages_of(open.subscription.request, std::move(part).value()));
      if (last) peer.open.erase(at);
      return;
    }
    fault = part.status();
  }
  refuse(id, peer, open, fault.message(), now_s, lines);
  peer.open.erase(at);
}

std::vector<wire::SplitBatchMessage> Service::messages_of(std::uint32_t request,
                                                          Part&& part) const {
  std::vector<wire::SplitBatchMessage> messages =
      wire::answer_messages(session_, request, part.content, std::move(part.batches),
                            part.last && part.others.empty(), part.are_pieces);
  for (std::size_t i = 0; i < part.others.size(); ++i)
    for (wire::SplitBatchMessage& message : wire::answer_messages(
             session_, request, part.others[i].content, std::move(part.others[i].batches),
             part.last && i + 1 == part.others.size()))
      messages.push_back(std::move(message));
  return messages;
}

Result<Service::Parts> Service::begin(wire::SessionId id, Peer& peer, const Open& open) {
  const wire::RegionSubscription& asked = open.subscription;
  if (open.kind == Kind::kCertificate) return certify(id, peer, asked);
  if (const auto answerer = answerers_.find(asked.content_hash); answerer != answerers_.end())
    return answerer->second(asked.region);
  if (WorldSource* world = world_with(asked.content_hash)) return answer(*world, asked);
  return Status{StatusCode::kNotFound,
                "no model, tile or page with that content hash is served here"};
}

/// The parts are kept beside the request, with the peer, and are gone with both.
Service::Parts Service::certify(wire::SessionId id, Peer& peer,
                                const wire::RegionSubscription& asked) {
  struct Certifying {
    CertificateBeginner beginner;
    std::optional<CertificateMaker> maker;
  };
  auto its = std::make_shared<Certifying>(
      Certifying{{id, *asked.certificate, mirrors_,
                  [this](const ContentHash& content) { return file_of(content); }},
                 std::nullopt});
  return Parts([this, &peer, &asked, its]() -> Result<Part> {
    if (!its->maker) {
      const std::size_t told_before = its->beginner.told_nodes();
      std::optional<BegunCertificate> begun = its->beginner.next(kToldATurn);
      peer.told_s = std::max(peer.told_s, now_s_) +
                    kToldNode_s * static_cast<double>(its->beginner.told_nodes() - told_before);
      if (!begun)
        return Part{.is_of_mirror = its->beginner.is_making(),
                    .took_s = its->beginner.told_nodes() > told_before ? kTurn_s : kLook_s};
      if (!begun->maker)
        return Part{.instead = wire::redirection_message(session_, asked, begun->why_not,
                                                         begun->content, begun->wants_regions)};
      its->maker = std::move(begun->maker);
    }
    const std::uint64_t work_before = its->maker->work();
    // What is sent of all models goes out together, so that they share samples.
    Part part;
    do {
      auto made = its->maker->next();
      if (!made.is_ok() && its->maker->unreadable())
        return Part{.instead = wire::redirection_message(session_, asked, made.status().message(),
                                                         *its->maker->unreadable(), true)};
      NEARMESH_RETURN_IF_ERROR(made);
      if (part.batches.empty()) {
        part.content = made.value().content;
        part.batches = std::move(made.value().batches);
      } else if (!made.value().batches.empty()) {
        part.others.push_back({made.value().content, std::move(made.value().batches)});
      }
    } while (its->maker->is_sending());
    part.last = its->maker->is_done();
    part.took_s = kLook_s + kTest_s * static_cast<double>(its->maker->work() - work_before);
    return part;
  });
}

void Service::refuse(wire::SessionId id, Peer& peer, const Open& open, const std::string& why,
                     double now_s, std::vector<std::string>& lines) {
  const wire::RegionSubscription& request = open.subscription;
  ++stats_.refused;
  enqueue(peer, open, {wire::refusal_message(session_, request, why)});
  if (peer.unsaid_refusals && now_s < peer.said_refusal_s + kRefusalPeriod_s) {
    ++*peer.unsaid_refusals;
    return;
  }
  const std::uint64_t unsaid = peer.unsaid_refusals.value_or(0);
  lines.push_back("request " + std::to_string(request.request) + " of peer " +
                  wire::called(id, channel_.name_of(id)) + " refused: " + why +
                  (unsaid > 0 ? " (and " + std::to_string(unsaid) + " before it)" : ""));
  peer.said_refusal_s = now_s;
  peer.unsaid_refusals = 0;
}

void Service::enqueue(Peer& peer, const Open& open, std::vector<wire::SplitBatchMessage> messages) {
  const std::uint8_t priority = open.subscription.priority;
  const auto place = std::find_if(peer.queue.begin(), peer.queue.end(),
                                  [&](const Waiting& w) { return w.priority > priority; });
  std::deque<Waiting> added;
  for (wire::SplitBatchMessage& message : messages)
    added.push_back({std::move(message), priority, open.kind});
  peer.queue.insert(place, std::make_move_iterator(added.begin()),
                    std::make_move_iterator(added.end()));
}

/// One datagram: a batch, and those of the same answer after it that have room in it.
bool Service::send_next(wire::SessionId id, Peer& peer, double now_s) {
  std::deque<Waiting>& queue = peer.queue;
  if (queue.empty()) return false;
  const auto framed = [](const wire::SplitBatchMessage& message) {
    return sample_bytes(message) + kBatchFramingBytes;
  };
  if (!peer.pacing.may_send(framed(queue.front().message))) return false;
  Waiting next = std::move(queue.front());
  queue.pop_front();
  while (!queue.empty() && join(next.message, queue.front().message)) queue.pop_front();
  const std::size_t bytes = framed(next.message);
  next.message.sequence = peer.next_sequence;
  if (!peer.pacing.may_send(bytes) || !channel_.send(id, next.message)) {
    // Each by itself again: another request may replace some of them.
    std::vector<wire::SplitBatchMessage> apart = take_apart(std::move(next.message));
    for (auto message = apart.rbegin(); message != apart.rend(); ++message)
      queue.push_front({std::move(*message), next.priority, next.kind});
    return false;
  }
  const std::uint32_t sequence = last_sequence(next.message);
  stats_.batches += sequence + 1 - peer.next_sequence;
  stats_.bytes += bytes;
  peer.pacing.sent(sequence, bytes, now_s);
  peer.next_sequence = sequence + 1;
  if (queue.empty() && peer.pacing.may_send(kMaxBatchBytes + kBatchFramingBytes))
    peer.pacing.ran_dry();
  return true;
}

/// In turns, one batch each, so that a peer with much to send delays no other. Out: something was
/// sent.
bool Service::send(double now_s) {
  int count = 0;
  for (bool sent = true; sent && count < kMaxSent;) {
    sent = false;
    for (auto& [id, peer] : peers_) {
      if (!send_next(id, peer, now_s)) continue;
      sent = true;
      ++count;
    }
  }
  return count > 0;
}

std::vector<std::string> Service::step(double now_s) {
  std::vector<std::string> complaints;
  now_s_ = now_s;
  for (auto& [id, peer] : peers_) peer.pacing.expire(now_s);
  is_behind_ = true;
  for (int turn = 0; turn < kMaxTurns && is_behind_; ++turn) {
    take_requests(now_s);  // before each turn: what came now may have waited least, but is due
    const std::optional<Turn> next = next_in_turn();
    if (next) serve(*next, now_s, complaints);
    is_behind_ = send(now_s) || next;
  }
  stats_.peers = peers_.size();
  find_conflicts(complaints);
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
  for (const auto& [hash, world] : worlds_)
    status.models.push_back({world.name, hash, world.source->folder().world().faces, 0, 0});
  for (const std::string& line : conflicts_) keeper_.note(line, now_s);  // as long as it lasts
  keeper_.complete(status, now_s);
  channel_.tell(status);
  status_ = std::move(status);
}

}  // namespace nearmesh::publisher
