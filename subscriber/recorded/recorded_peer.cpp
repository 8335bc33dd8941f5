// SPDX-License-Identifier: Apache-2.0
#include "recorded_peer.hpp"

#include <algorithm>
#include <array>
#include <tuple>

#include "core/base/hash.hpp"
#include "core/replica/held_nodes.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber {
namespace {

/// Batches, requests and what the peer said it held come to a recorder by different ways, some
/// milliseconds apart: so many batches, and so many rounds, are enough for the one to be found in
/// the other.
constexpr std::size_t kLatest = 1024;
constexpr std::size_t kMaxComplaints = 16;

}  // namespace

bool RecordedPeer::Numbers::follow(const Batch& batch) {
  Heard& last = heard[batch.publisher];
  // A publisher that lost the peer for a while counts from 1 again; requests only go up.
  const bool again = batch.sequence <= last.sequence;
  if (again && batch.request <= last.request) return false;  // heard before
  // Of which model the missing ones were is unknown: from here on none is complete.
  whole &= batch.sequence == (again ? 0 : last.sequence) + 1;
  last = {batch.sequence, std::max(batch.request, last.request)};
  return whole;
}

void RecordedPeer::Stretch::follow(const Batch& batch, const ContentHash& content_hash) {
  if (!numbers.whole || !numbers.follow(batch)) return;
  if (batch.content_hash != content_hash || batch.bytes == nullptr) return;
  ++received;
  waiting.push_back(batch);
}

/// Of what had come by then nothing is missing.
bool RecordedPeer::Stretch::has_heard(const wire::HeldDetail& told) const {
  return numbers.whole && std::all_of(told.heard.begin(), told.heard.end(), [&](const auto& last) {
           const auto at = numbers.heard.find(last.publisher);
           if (at == numbers.heard.end()) return last.sequence == 0;
           return at->second.sequence >= last.sequence || at->second.request > told.last_request;
         });
}

RecordedPeer::Stream& RecordedPeer::stream_of(const ContentHash& content_hash) {
  Stream& stream = streams_[content_hash];
  if (stream.empty()) stream.push_back({.held = std::nullopt, .numbers = from_start_});
  return stream;
}

/// A stretch that goes on past the begin of the next, of the same era, makes that one needless.
void RecordedPeer::drop_followed(Stream& stream) {
  for (std::size_t i = 0; i + 1 < stream.size();) {
    const Stretch &one = stream[i], &next = stream[i + 1];
    if (one.era == next.era && one.end() >= next.first && next.held && one.has_heard(*next.held)) {
      stream.erase(stream.begin() + static_cast<std::ptrdiff_t>(i + 1));
    } else {
      ++i;
    }
  }
}

/// What it sent before the request may have been recorded before it, too.
void RecordedPeer::note_asked(wire::SessionId publisher, std::uint32_t since_request) {
  if (!asked_.note(publisher)) return;
  for (Batch& batch : std::exchange(unasked_, {})) {
    if (batch.publisher != publisher) {
      unasked_.push_back(std::move(batch));
    } else if (batch.request >= since_request) {
      follow(std::move(batch));
    }
  }
}

void RecordedPeer::take(const wire::RegionSubscription& asked) {
  note_asked(asked.publisher, asked.request);
}

void RecordedPeer::take(wire::SplitBatchMessage&& message) {
  asked_.hear(message);
  Batch batch{message.publisher, message.sequence, message.request, message.content_hash, nullptr};
  // Else the peer does not take it in either.
  if (!message.refused && !message.is_piece && !message.bytes.empty()) {
    ++batches_;
    batch.bytes = std::make_shared<const std::vector<std::uint8_t>>(std::move(message.bytes));
  }
  if (asked_.has(batch.publisher)) {
    follow(std::move(batch));
    return;
  }
  unasked_.push_back(std::move(batch));
  if (unasked_.size() > kLatest) unasked_.pop_front();
}

void RecordedPeer::follow(Batch&& batch) {
  if (batch.bytes != nullptr) stream_of(batch.content_hash);
  for (auto& [content_hash, stream] : streams_) {
    for (Stretch& stretch : stream) stretch.follow(batch, content_hash);
    drop_followed(stream);
  }
  if (from_start_.whole) static_cast<void>(from_start_.follow(batch));
  latest_.push_back(std::move(batch));
  if (latest_.size() > kLatest) latest_.pop_front();
}

void RecordedPeer::take(wire::HeldDetail&& held) {
  for (const wire::HeldDetail::Heard& heard : held.heard) note_asked(heard.publisher, 0);
  Stream& stream = stream_of(held.content_hash);
  if (held.era < stream.back().era) return;
  if (held.era == stream.back().era && stream.back().end() >= held.applied_batches &&
      stream.back().has_heard(held))
    return;
  Stretch next{.held = std::nullopt, .numbers = {}, .era = held.era, .first = held.applied_batches};
  for (const wire::HeldDetail::Heard& heard : held.heard)
    next.numbers.heard[heard.publisher] = {heard.sequence, held.last_request};
  for (const Batch& batch : latest_) next.follow(batch, held.content_hash);
  next.held = std::move(held);
  stream.push_back(std::move(next));
}

void RecordedPeer::work(const ModelSources& sources, bool final) {
  for (auto& [content_hash, stream] : streams_)
    for (std::size_t i = 0; i + 1 < stream.size(); ++i)
      if (++stream[i].rounds > kPatientRounds) stream[i].numbers.whole = false;
  for (; !reports_.empty(); reports_.pop_front()) {
    const RecordedReport& report = reports_.front();
    if (std::exchange(waits_, report.id) != report.id) waited_rounds_ = 0;
    bool waits = false;
    const Standing standing = look(report.message, sources, final, waits);
    if (waits) {
      ++waited_rounds_;
      return;
    }
    visit(report, standing);
  }
}

/// `waits`: what it needs may still come.
RecordedPeer::Standing RecordedPeer::look(const wire::ContactReport& report,
                                          const ModelSources& sources, bool final, bool& waits) {
  if (!why_stale(report).empty()) return Standing::kStale;
  if (report.put_off) return Standing::kPutOff;
  if (!report.asked) return Standing::kNotAsked;
  const auto reach_body = [&](const wire::ContactReport::Asked& asked) {
    return reach({asked.content_hash, asked.applied_batches, asked.era}, sources, final);
  };
  if (!report.world && (sources.world(report.a.content_hash) != nullptr ||
                        sources.world(report.b.content_hash) != nullptr))
    return Standing::kLacking;  // more was near than a report holds
  std::array<Reach, 2> reached{Reach::kThere, Reach::kThere};
  if (report.world) {
    reached[0] = reach_body(report.world->is_a ? report.b : report.a);
    if (reached[0] == Reach::kThere) reached[1] = reach_world(report, sources, final);
    if (reached[0] == Reach::kNoFile)
      ++wanted_[(report.world->is_a ? report.b : report.a).content_hash].reports;
  } else {
    reached = {reach_body(report.a), reach_body(report.b)};
    for (std::size_t i = 0; i < 2; ++i)
      if (reached[i] == Reach::kNoFile && reached[1 - i] != Reach::kNever &&
          (i == 0 || reached[0] != reached[1] || report.a.content_hash != report.b.content_hash))
        ++wanted_[(i == 0 ? report.a : report.b).content_hash].reports;
  }
  const auto has = [&](Reach one) { return reached[0] == one || reached[1] == one; };
  if (has(Reach::kNever)) return Standing::kLacking;
  if (has(Reach::kGaveUp)) return Standing::kGaveUp;
  if (has(Reach::kNoFile)) return Standing::kNoFile;
  waits = has(Reach::kNotYet);
  return Standing::kReached;
}

/// Takes in batches up to what the report has.
RecordedPeer::Reach RecordedPeer::reach(const Wanted& wanted, const ModelSources& sources,
                                        bool final) {
  Stream& stream = stream_of(wanted.content);
  for (;; stream.pop_front()) {
    Stretch& stretch = stream.front();
    if (wanted.era < stretch.era) return Reach::kGaveUp;
    if (wanted.era > stretch.era) {
      const bool is_told = stream.size() > 1 && stream[1].era <= wanted.era;
      if (!is_told) {
        const bool may_come = stream.size() == 1 && !final && !is_past_patience();
        return may_come ? Reach::kNotYet : Reach::kGaveUp;
      }
      hand_over(stream, wanted.content, sources);
      continue;
    }
    const bool goes_on = stretch.numbers.whole && !final;
    if (wanted.applied_batches <= stretch.end()) {
      if (wanted.applied_batches < stretch.first) return Reach::kNever;
      const Reach begun = begin(stretch, wanted.content, sources);
      if (begun == Reach::kNotYet && !goes_on) return Reach::kNever;
      if (begun != Reach::kThere) return begun;
      for (; stretch.taken() < wanted.applied_batches; stretch.waiting.pop_front())
        // The peer went on too where one was wrong.
        static_cast<void>(stretch.replica->take(*stretch.waiting.front().bytes,
                                                stretch.waiting.front().publisher));
      return Reach::kThere;
    }
    if (goes_on) return Reach::kNotYet;
    if (stream.size() == 1 || stream[1].era != wanted.era ||
        wanted.applied_batches < stream[1].first)
      return Reach::kNever;
  }
}

/// Where detail was given up, what was held before has all that is held then: so the next stretch
/// begins without a file.
void RecordedPeer::hand_over(Stream& stream, const ContentHash& content,
                             const ModelSources& sources) {
  Stretch &before = stream[0], &next = stream[1];
  if (next.replica || next.failed || !next.held) return;
  if (begin(before, content, sources) != Reach::kThere) return;
  for (; !before.waiting.empty() && before.taken() < next.first; before.waiting.pop_front())
    static_cast<void>(
        before.replica->take(*before.waiting.front().bytes, before.waiting.front().publisher));
  const auto lacks = [&](NodeSpan node) {
    return before.replica->store().split_of(node).is_valid()
               ? Status::ok()
               : Status{StatusCode::kNotFound, to_string(node)};
  };
  const Result<SplitBatch> batch = held_batch(before.replica->store(), lacks, next.held->nodes);
  if (!batch.is_ok()) return;
  next.replica.emplace(before.replica->header());
  if (!take_up(next, batch).is_ok()) next.replica.reset();  // with the file it may be
}

/// The other body of the report is there.
RecordedPeer::Reach RecordedPeer::reach_world(const wire::ContactReport& report,
                                              const ModelSources& sources, bool final) {
  const Reach found = find_tiles(report, sources);
  if (found == Reach::kNotYet && (final || is_past_patience())) {
    want_world((report.world->is_a ? report.a : report.b).content_hash, sources);
    return Reach::kNoFile;
  }
  if (found != Reach::kThere) return found;
  Reach worst = Reach::kThere;
  for (std::size_t i = 0; i < world_.tiles.size(); ++i) {
    const wire::ContactReport::World::Tile& tile = report.world->tiles[i];
    if (!tile.asked) continue;
    const Reach one =
        reach({world_.tiles[i].entry->content, tile.applied_batches, tile.era}, sources, final);
    if (one == Reach::kNoFile)
      want_world((report.world->is_a ? report.a : report.b).content_hash, sources);
    if (one == Reach::kThere) continue;
    // What will never be there counts before what is not there yet.
    if (worst == Reach::kThere || worst == Reach::kNotYet || one == Reach::kNever) worst = one;
  }
  return worst;
}

void RecordedPeer::want_world(const ContentHash& content, const ModelSources& sources) {
  WantedModel& wanted = wanted_[content];
  wanted.name = sources.name_of_world(content);
  ++wanted.reports;
}

/// Which tiles the answer is about. kNotYet: for want of its record or a page.
RecordedPeer::Reach RecordedPeer::find_tiles(const wire::ContactReport& report,
                                             const ModelSources& sources) {
  world_ = {};
  const wire::ContactReport::World& told = *report.world;
  const auto& [its, other] =
      told.is_a ? std::tie(report.a, report.b) : std::tie(report.b, report.a);
  const WorldRecord* record = sources.world(its.content_hash);
  if (record == nullptr) return Reach::kNotYet;
  bool lacks_page = false;
  const auto find_page = [&](const ContentHash& content) -> const WorldPage* {
    if (const WorldPage* page = sources.page(content)) return page;
    const auto known = pages_.find(content);
    if (known != pages_.end()) return &known->second;
    std::optional<WorldPage> page =
        sources.files == nullptr ? std::nullopt : sources.files->page(content);
    if (page) return &pages_.emplace(content, std::move(*page)).first->second;
    lacks_page = true;
    return nullptr;
  };
  const PageOf page_of = [&](const WorldEntry& entry, int level) -> Result<const WorldPage*> {
    const bool is_missing =
        std::binary_search(told.missing_pages.begin(), told.missing_pages.end(), entry.content);
    const WorldPage* page = is_missing ? nullptr : find_page(entry.content);
    if (page != nullptr) NEARMESH_RETURN_IF_ERROR(check_page(*page, entry, level));
    return page;
  };
  world_.record = record;
  const WorldPage* root = find_page(record->root);
  if (root == nullptr) return Reach::kNotYet;
  const Grid grid = world_grid(*record);
  const Replica& body = replica(other.content_hash);
  const Result<PosedPair> posed =
      pose_pair(grid, its.pose, "world", body.header().grid, other.pose, "body");
  if (!posed.is_ok() || root->level != record->root_level) return Reach::kThere;
  Result<TilesAround> around = find_tiles_around(
      *record, *root, page_of, make_relative_frame(posed.value().a, posed.value().b),
      body.store().whole_box(), told.reach_cells);
  if (lacks_page) return Reach::kNotYet;
  if (!around.is_ok()) return Reach::kThere;
  world_.around = std::move(around).value();
  world_.is_found = true;
  // As many as were told, or it is shown to be wrong.
  if (world_.around.near.tiles.size() != told.tiles.size()) return Reach::kThere;
  for (std::size_t i = 0; i < told.tiles.size(); ++i) {
    const WorldEntry& entry = world_.around.near.tiles[i];
    world_.tiles.push_back({&entry, told.tiles[i].asked, record->grid_at(entry)});
  }
  return Reach::kThere;
}

/// Makes the replica at the stretch's begin.
RecordedPeer::Reach RecordedPeer::begin(Stretch& stretch, const ContentHash& content_hash,
                                        const ModelSources& sources) {
  if (stretch.replica) return Reach::kThere;
  if (stretch.failed) return Reach::kNever;
  if (stretch.no_file) return Reach::kNoFile;
  std::optional<SpmHeader> header = sources.header(content_hash);
  if (!stretch.held) {
    if (!header && sources.files != nullptr)
      static_cast<void>(
          sources.files->lend(content_hash, [&](ModelFile& file) { header = file.header(); }));
    if (!header) return Reach::kNotYet;
    stretch.replica.emplace(std::move(*header));
    return Reach::kThere;
  }
  const wire::HeldDetail& held = *stretch.held;
  Status status;
  const bool has_file =
      sources.files != nullptr && sources.files->lend(content_hash, [&](ModelFile& file) {
        stretch.replica.emplace(file.header());
        status = take_up(
            stretch,
            held_batch(
                file.store(), [&](NodeSpan node) { return file.require(node); }, held.nodes));
      });
  if (!has_file) {
    // A peer that held nothing is taken up without a file.
    const auto lacks = [](NodeSpan node) { return Status{StatusCode::kNotFound, to_string(node)}; };
    if (header) stretch.replica.emplace(std::move(*header));
    const Result<SplitBatch> batch = stretch.replica
                                         ? held_batch(stretch.replica->store(), lacks, held.nodes)
                                         : Status{StatusCode::kNotFound, "no header"};
    if (batch.status().code() == StatusCode::kNotFound) {
      stretch.replica.reset();
      stretch.no_file = true;
      wanted_[content_hash].name = held.model;
      return Reach::kNoFile;
    }
    status = take_up(stretch, batch);
  }
  if (status.is_ok()) return Reach::kThere;
  stretch.failed = true;
  stretch.replica.reset();
  if (complaints_.size() < kMaxComplaints)
    complaints_.push_back("peer " + wire::partition_of(held.peer) + ", model " + held.model +
                          " after " + std::to_string(held.applied_batches) +
                          " batches: " + status.message());
  return Reach::kNever;
}

Status RecordedPeer::take_up(Stretch& stretch, const Result<SplitBatch>& batch) {
  NEARMESH_RETURN_IF_ERROR(batch);
  NEARMESH_RETURN_IF_ERROR(stretch.replica->take(batch.value()).status);
  stretch.before = stretch.first - stretch.replica->taken_batches();
  const std::uint64_t state = stretch.replica->mesh().state_hash();
  if (state != stretch.held->state_digest)
    return {StatusCode::kConflict, "the peer said that it held state " +
                                       to_hex(stretch.held->state_digest) +
                                       ", what it listed gives " + to_hex(state)};
  if (held_nodes(*stretch.replica).box_digest != stretch.held->box_digest)
    return {StatusCode::kConflict,
            "the peer held boxes that are not the file's, as one does that a replay served"};
  return Status::ok();
}

const Replica& RecordedPeer::replica(const ContentHash& content) const {
  return *streams_.at(content).front().replica;
}

bool RecordedPeer::is_rebuilt(const wire::ContactReport& report, Standing standing) const {
  return standing == Standing::kReached && !report.world && why_not_rebuilt(report).empty();
}

std::string RecordedPeer::why_not_rebuilt(const wire::ContactReport& report) const {
  const auto look = [&](const std::string& name, const ContentHash& content, std::uint32_t applied,
                        std::uint64_t digest) -> std::string {
    const Stretch& stretch = streams_.at(content).front();
    const std::uint64_t state = stretch.replica->mesh().state_hash();
    // More where reports came out of order.
    if (stretch.taken() == applied && state == digest) return {};
    return "model of " + name + " after " + std::to_string(applied) + " batches: recorded state " +
           to_hex(digest) + ", found " +
           (stretch.taken() == applied
                ? to_hex(state)
                : std::to_string(stretch.taken()) + " batches taken in before");
  };
  for (const auto& [asked, body, is_a] : {std::tuple(&report.a, &report.body_a, true),
                                          std::tuple(&report.b, &report.body_b, false)}) {
    if (report.world && report.world->is_a == is_a) continue;
    std::string why = look(*body, asked->content_hash, asked->applied_batches, asked->state_digest);
    if (!why.empty()) return why;
  }
  if (!report.world) return {};
  const std::string& world = report.world->is_a ? report.body_a : report.body_b;
  if (!world_.is_found)
    return "of world " + world + ": its pages, or the poses, contradict each other";
  if (world_.tiles.size() != report.world->tiles.size())
    return "of world " + world + " " + std::to_string(report.world->tiles.size()) +
           " tiles were told, its pages list " + std::to_string(world_.around.near.tiles.size()) +
           " there";
  for (std::size_t i = 0; i < world_.tiles.size(); ++i) {
    const wire::ContactReport::World::Tile& told = report.world->tiles[i];
    if (!told.asked) continue;
    const ContentHash& content = world_.tiles[i].entry->content;
    std::string why =
        look(world + ", tile " + to_hex(content), content, told.applied_batches, told.state_digest);
    if (!why.empty()) return why;
    if (const Status fits = check_tile_grid(replica(content).header().grid, *world_.record);
        !fits.is_ok())
      return "of world " + world + ", tile " + to_hex(content) + ": " + fits.message();
  }
  return {};
}

namespace {

AnswerOptions bounded(const wire::ContactReport& report, const AnswerOptions& options) {
  AnswerOptions bounded = options;
  if (report.cut) bounded.max_tests = std::min(bounded.max_tests, kCutTests);
  return bounded;
}

}  // namespace

Result<Answered> RecordedPeer::ask(const wire::ContactReport& report,
                                   const AnswerOptions& options) const {
  const auto body = [this](const wire::ContactReport::Asked& asked, const std::string& name) {
    return AskedBody{replica(asked.content_hash).view(), Motion{.pose = asked.pose}, name,
                     asked.solid};
  };
  return answer(body(report.a, report.body_a), body(report.b, report.body_b),
                bounded(report, options));
}

Result<Answered> RecordedPeer::ask_tile(const wire::ContactReport& report, const AskedTile& tile,
                                        const AnswerOptions& options) const {
  const auto body = [&](const wire::ContactReport::Asked& asked, const std::string& name,
                        bool is_a) {
    if (is_a == report.world->is_a)
      return AskedBody{tile.view(replica(tile.entry->content)), Motion{.pose = asked.pose}, name};
    return AskedBody{replica(asked.content_hash).view(), Motion{.pose = asked.pose}, name,
                     asked.solid};
  };
  return answer(body(report.a, report.body_a, true), body(report.b, report.body_b, false),
                bounded(report, options));
}

}  // namespace nearmesh::subscriber
