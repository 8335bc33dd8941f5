// SPDX-License-Identifier: Apache-2.0
// Bodies that are worlds. Before pairs are answered, each pair with a world gives way to pairs with
// those of its tiles that boxes do not prove apart from the other body, now or within the
// look-ahead (join_tiles); these take turns, ask for detail and are answered as others are. Then
// their answers become that of the pair (fold_worlds; tile_sum.hpp says why it is right).
#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "core/base/counted.hpp"
#include "core/base/hash.hpp"
#include "core/geometry/motion_bounds.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "pair_readiness.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// So many pages and headers are asked for at a time.
constexpr std::size_t kMostAsked = 32;

std::string place_of(const WorldEntry& tile) {
  return "tile " + to_hex(tile.content) + " at (" + std::to_string(tile.place[0]) + ", " +
         std::to_string(tile.place[1]) + ", " + std::to_string(tile.place[2]) + ")";
}

/// Patches of another tile; none is of both.
void append(const Contacts& tile, Contacts& sum) {
  const auto first = static_cast<std::uint32_t>(sum.segments.size());
  sum.segments.insert(sum.segments.end(), tile.segments.begin(), tile.segments.end());
  for (const ContactPatch& patch : tile.patches) {
    sum.patches.push_back(patch);
    sum.patches.back().first += first;
  }
  sum.position_error_m = std::max(sum.position_error_m, tile.position_error_m);
  sum.pair_total += tile.pair_total;
  sum.truncated |= tile.truncated;
}

}  // namespace

/// Whoever serves the world serves its parts.
void Session::Impl::note_part(const ContentHash& part, const ContentHash& of_world) {
  for (auto& [id, publisher] : publishers)
    if (publisher.announces(of_world)) publisher.parts.insert(part);
}

void Session::Impl::want_bytes(const ContentHash& content, const ContentHash& of_world,
                               bool is_page) {
  note_part(content, of_world);
  WantedBytes& wanted =
      wanted_bytes.try_emplace(content, WantedBytes{ContentReader(content)}).first->second;
  wanted.of_world = of_world;
  wanted.is_page = is_page;
  wanted.wanted_in = updates;
}

/// Whether a page or header may be expected.
std::string Session::Impl::who_gives(const ContentHash& content) {
  const Publisher* publisher = publisher_of(content);
  if (publisher == nullptr)
    return publishers.empty() ? "no publisher is there" : "no publisher that is there serves it";
  if (publisher->lost_requests > 0)
    return "publisher " + called_of(*publisher) + " has not answered " +
           counted(publisher->lost_requests, "request") + " in a row";
  return "publisher " + called_of(*publisher) + " is asked for it";
}

/// Tiles stand for the pairs of worlds in `listed` from here to put_folded().
void Session::Impl::join_tiles(FrameReport& report) {
  world_pairs.clear();
  for (auto& [id, publisher] : publishers) publisher.parts.clear();
  for (const auto& [name, model] : replicas.all())
    if (model.world && model.world->wants_root())
      want_bytes(model.world->record().root, model.world->name(), true);
  replicas.prepare_coming();
  for (const auto& [name, model] : replicas.all())
    if (model.coming.world && model.coming.world->wants_root())
      want_bytes(model.coming.world->record().root, model.coming.content, true);
  std::erase_if(listed, [this](Pair* pair) {
    if (!pair->a->model->world && !pair->b->model->world) return false;
    world_pairs.push_back({.pair = pair});
    return true;
  });
  for (WorldPair& found : world_pairs) {
    const Pair& pair = *found.pair;
    found.first = listed.size();
    if (const Status status = find_tiles(found); !status.is_ok()) found.reason = status.message();
    if (!found.reason.empty()) {
      found.around = {};
      continue;
    }
    const bool is_a = pair.a->model->world.has_value();
    const Body& world = is_a ? *pair.a : *pair.b;
    for (const MissingPage& page : found.around.near.missing)
      want_bytes(page.entry.content, world.model->content_hash, true);
    for (const WorldEntry& entry : found.around.near.tiles) {
      std::string why_not;
      Body* tile = tile_body(world, entry, why_not, report.complaints);
      if (tile == nullptr) {
        found.not_here.push_back(entry);
        found.why_not_here.push_back(std::move(why_not));
        continue;
      }
      const PairKey key = std::minmax(pair.a->id.value, pair.b->id.value);
      Pair& its = tile_pairs[{key, entry}];
      its.is_of_tile = true;
      // The same tile of another state of the world may stand elsewhere.
      if (std::exchange(its.of_world, world.model->content_hash) != world.model->content_hash)
        its.certified.reset();
      its.a = is_a ? tile : pair.a;
      its.b = is_a ? pair.b : tile;
      its.near_in = updates;
      listed.push_back(&its);
    }
  }
  want_probed(report);
  leave_tiles();
}

namespace {

constexpr double kRoundUp = 1 + 0x1p-40;

/// How fast a world and another body come together at most, what posing them rounds, and how far
/// they may have gone since their poses. As safe_horizon_s() counts.
struct Approach {
  double speed_mps = 0, rounding_m = 0, gone_m = 0;

  Approach(const Body& world, double age_world_s, const Body& other, double age_other_s) {
    const Grid grid = world_grid(world.model->world->record());
    const int lattice = lattice_exponent(grid, other.grid());
    add(grid, world.model->world->box(), *world.motion, age_world_s, lattice);
    add(other.grid(), other.model->replica->store().whole_box(), *other.motion, age_other_s,
        lattice);
  }
  /// So far apart they cannot meet for so long.
  [[nodiscard]] double needed_m(double duration_s) const {
    return ((rounding_m + gone_m) * kRoundUp + speed_mps * kRoundUp * duration_s) * kRoundUp;
  }
  /// For so long what is so far apart cannot meet.
  [[nodiscard]] double safe_s(double apart_m) const {
    if (speed_mps == 0) return std::numeric_limits<double>::infinity();
    return std::max(0.0, apart_m - (rounding_m + gone_m) * kRoundUp) / (speed_mps * kRoundUp);
  }

 private:
  void add(const Grid& grid, const GridBox& box, const Motion& motion, double age_s, int lattice) {
    const double reach = reach_m(grid, box), speed = speed_bound_mps(motion, reach);
    speed_mps += speed;
    if (speed > 0) gone_m += speed * std::abs(age_s) * kRoundUp;
    rounding_m += 2 * posing_error_m(motion, reach, 0, grid, lattice);
  }
};

}  // namespace

/// Which tiles may be near, or why that is not known.
Status Session::Impl::find_tiles(WorldPair& found) {
  const Pair& pair = *found.pair;
  const bool is_a = pair.a->model->world.has_value();
  const Body &world = is_a ? *pair.a : *pair.b, &other = is_a ? *pair.b : *pair.a;
  const auto because = [&found](std::string why) {
    found.reason = std::move(why);
    return Status::ok();
  };
  if (other.model->world)
    return because("bodies " + world.name + " and " + other.name +
                   " are worlds, of which none is asked against another");
  if (world.solid)
    return because("body " + world.name +
                   " is a world: whether something is inside cannot be told");
  for (const Body* body : {&world, &other})
    if (std::string why = why_unknown(*body); !why.empty()) return because(std::move(why));
  if (std::string why = why_not_ready(other); !why.empty()) return because(std::move(why));
  PeerWorld& tiles = *world.model->world;
  const Approach approach(world, wire::age_s(stamp_of(world), time_s), other,
                          wire::age_s(stamp_of(other), time_s));
  const double cell_m = std::ldexp(1.0, other.grid().exponent);
  // What find_tiles_around() takes off again is added, so that all else is apart for the whole
  // look-ahead.
  const double around_m = approach.needed_m(horizon_s()) + options.margin_m +
                          4 * std::ldexp(1.0, tiles.record().lattice.exponent);
  found.reach_cells = static_cast<std::uint32_t>(
      std::min(std::ceil(around_m * (1 + 0x1p-16) / cell_m) + 8, 4294967295.0));
  Result<TilesAround> around = tiles_around(tiles, world, other, found.reach_cells);
  NEARMESH_RETURN_IF_ERROR(around);
  found.around = std::move(around).value();
  fetch_coming(world, other, found.reach_cells);
  return Status::ok();
}

/// Of a state of a world, in the place of the body that is that world. Precondition: the state's
/// root page is here.
Result<TilesAround> Session::Impl::tiles_around(PeerWorld& tiles, const Body& world,
                                                const Body& other,
                                                std::uint32_t reach_cells) const {
  const Result<PosedPair> posed =
      pose_pair(world_grid(tiles.record()), world.motion->pose, world.name, other.grid(),
                other.motion->pose, other.name);
  NEARMESH_RETURN_IF_ERROR(posed);
  return tiles.tiles_around(make_relative_frame(posed.value().a, posed.value().b),
                            other.model->replica->store().whole_box(), reach_cells, time_s);
}

/// Pages near that the next epoch's world has instead: when it begins they are here.
void Session::Impl::fetch_coming(const Body& world, const Body& other, std::uint32_t reach_cells) {
  std::optional<PeerWorld>& coming = world.model->coming.world;
  if (!coming || coming->root() == nullptr) return;
  const auto around = tiles_around(*coming, world, other, reach_cells);
  if (!around.is_ok()) return;
  for (const MissingPage& page : around.value().near.missing)
    if (!world.model->world->has_page(page.entry.content))
      want_bytes(page.entry.content, world.model->coming.content, true);
}

/// A tile in its place, once its header is here; else null, and why.
Body* Session::Impl::tile_body(const Body& world, const WorldEntry& entry, std::string& why_not,
                               std::vector<std::string>& complaints) {
  const ContentHash& content = entry.content;
  note_part(content, world.model->content_hash);
  PeerModel* model = replicas.find(content);
  if (model == nullptr) {
    // Longer than names from outside may be: no body shall have the model of a tile.
    model = &replicas.add(world.model->name + " tile " + to_hex(content) + ", first of world " +
                          to_hex(world.model->content_hash));
    if (!model->content_hash.is_set()) {
      model->is_tile = true;
      static_cast<void>(replicas.assign(*model, content, complaints));
      model->is_tile = true;
      model->of_world = world.model->name;
    }
  }
  if (model->content_hash != content || model->world) {
    why_not = "its name stands for another content";
    return nullptr;
  }
  if (replicas.is_refused(content)) {
    why_not = "its header is not taken, as was said";
    return nullptr;
  }
  Body& body = tile_bodies[{world.id.value, entry}];
  body.needed_s = time_s;
  body.model = model;
  if (!model->is_ready()) {
    want_bytes(content, world.model->content_hash, false);
    why_not = "its header has not come, " + who_gives(content);
    return nullptr;
  }
  if (const Status status =
          check_tile_grid(model->replica->header().grid, world.model->world->record());
      !status.is_ok()) {
    why_not = status.message();
    return nullptr;
  }
  // Anew each time: the world may be another one by now, with the same tile in another place.
  body.tile_grid = world.model->world->record().grid_at(entry);
  if (body.name.empty()) body.name = world.name + ", " + place_of(entry);
  body.id = world.id;
  body.own = world.own;
  body.is_placed = world.is_placed;
  body.stamp = world.stamp;
  body.motion = world.motion;
  return &body;
}

/// What is near nothing now, and was not for long.
void Session::Impl::leave_tiles() {
  std::erase_if(tile_pairs, [this](const auto& entry) { return entry.second.near_in != updates; });
  std::erase_if(wanted_bytes,
                [this](const auto& entry) { return entry.second.wanted_in != updates; });
  const auto is_unused = [this](const auto& entry) {
    return std::abs(time_s - entry.second.needed_s) > kUnused_s;
  };
  if (std::erase_if(tile_bodies, is_unused) > 0) {
    std::set<const PeerModel*> used;
    for (const auto& [key, body] : tile_bodies) used.insert(body.model);
    for (const auto& [id, body] : bodies) used.insert(body.model);
    std::vector<std::string> unused;
    for (const auto& [name, model] : replicas.all())
      if (model.is_tile && !used.contains(&model)) unused.push_back(name);
    for (const std::string& name : unused) {
      outstanding.erase(replicas.find(name)->content_hash);
      replicas.remove(name);
    }
  }
  // Pages may come without a tile: where none is near, and of a world whose tiles are gone already.
  for (auto& [name, model] : replicas.all()) {
    if (model.world) model.world->give_up(time_s, kUnused_s);
    if (model.coming.world) model.coming.world->give_up(time_s, kUnused_s);
  }
}

/// The tiles of its pairs, and its own. Their replicas stay for a while.
void Session::Impl::forget_tiles(const Body& body) {
  world_pairs.clear();
  std::erase_if(tile_pairs, [&](const auto& entry) {
    const PairKey& key = entry.first.first;
    return key.first == body.id.value || key.second == body.id.value;
  });
  listed.clear();
}

/// Those first that were lost least often: what nobody answers would have all places, again and
/// again.
void Session::Impl::ask_for_bytes() {
  std::size_t open_count = 0;
  std::vector<std::pair<std::uint32_t, ContentHash>> due;  // and how often it was lost in a row
  for (const auto& [content, wanted] : wanted_bytes) {
    const auto open = outstanding.find(content);
    if (open == outstanding.end()) {
      due.emplace_back(0, content);
    } else if (is_lost(open->second)) {
      count_lost(open->second);
      due.emplace_back(open->second.lost_before + 1, content);
    } else {
      ++open_count;
    }
  }
  std::sort(due.begin(), due.end());
  for (const auto& [lost, content] : due) {
    if (open_count >= kMostAsked) return;
    const Publisher* publisher = publisher_of(content);
    if (publisher == nullptr) continue;
    // Of what another sent nobody knows whether it is true, and the next would be blamed for it.
    WantedBytes& wanted = wanted_bytes.at(content);
    if (std::exchange(wanted.asked, publisher->hello.publisher) != publisher->hello.publisher)
      wanted.reader = ContentReader(content);
    send_request(*publisher, kNeededNow,
                 {.content_hash = content, .region = content_bytes_request()});
    ++stats.requests;
    ++open_count;
    open_request(content, *publisher, {.priority = kNeededNow});
  }
}

/// A piece of what ask_for_bytes() asks. Of who was not asked it counts for nothing: others could
/// have the bytes begun anew, or the publisher taken for a liar.
void Session::Impl::take_piece(const wire::SplitBatchMessage& message, FrameReport& report) {
  const auto open = outstanding.find(message.content_hash);
  const bool is_open = open != outstanding.end() && open->second.is_answered_by(message);
  if (is_open) open->second.heard_s = clock.seconds();
  const auto at = wanted_bytes.find(message.content_hash);
  // What comes late, of a request that was made again since, is as good.
  if (at == wanted_bytes.end() || at->second.asked != message.publisher) {
    if (is_open && message.last) outstanding.erase(open);
    return;
  }
  const auto piece = unseal_batch(message.content_hash, message.bytes);
  auto bytes = piece.is_ok() ? at->second.reader.take(piece.value())
                             : Result<std::optional<std::vector<std::uint8_t>>>(piece.status());
  if (!bytes.is_ok()) {
    // Asked for again when the request's time is up, of another where there is one.
    report.complaints.push_back("publisher " + to_hex(message.publisher) + ": " +
                                bytes.status().message());
    if (const auto liar = publishers.find(message.publisher); liar != publishers.end())
      ++liar->second.lost_requests;
    return;
  }
  if (is_open && message.last) outstanding.erase(open);
  if (!bytes.value()) return;
  const WantedBytes wanted = std::move(at->second);
  wanted_bytes.erase(at);
  if (!wanted.is_page) {
    stats.header_bytes += replicas.take_header({message.publisher,
                                                {.name = "tile",
                                                 .content_hash = message.content_hash,
                                                 .bytes = std::move(*bytes.value())}},
                                               report.complaints);
    return;
  }
  if (PeerWorld* coming = replicas.find_coming(wanted.of_world)) {
    static_cast<void>(coming->take_page(message.content_hash, *bytes.value()));
    return;
  }
  PeerModel* model = replicas.find(wanted.of_world);
  if (model == nullptr || !model->world) return;
  if (model->world->take_page(message.content_hash, *bytes.value()))
    model->bounds = model->world->bounds();
}

/// Before what is held changes, since the reports name it.
void Session::Impl::fold_worlds(std::uint64_t frame, FrameReport& report) {
  for (WorldPair& found : world_pairs) {
    fold_world(found, report);
    const PairAnswer& result = found.answer;
    Pair& pair = *found.pair;
    report.answers_digest = mix(report.answers_digest ^ found.digest);
    report.pairs_put_off += result.put_off ? 1 : 0;
    pair.is_put_off = result.put_off;
    if (!result.put_off) pair.last = readiness_of(result, pair.names());
    if (options.publish_reports)
      report_pair(pair, result, {frame, found.digest}, result.asked ? &found.told : nullptr);
  }
}

/// In the place of their tiles' answers, which tell what is to be asked for until then.
void Session::Impl::put_folded(FrameReport& report) {
  if (world_pairs.empty()) return;
  report.answers.resize(world_pairs.front().first);
  for (WorldPair& found : world_pairs) report.answers.push_back(std::move(found.answer));
  std::sort(report.answers.begin(), report.answers.end(),
            [](const PairAnswer& one, const PairAnswer& two) {
              return std::minmax(one.a, one.b) < std::minmax(two.a, two.b);
            });
  listed.clear();
  world_pairs.clear();
}

namespace {

/// The swept answer about a world, tile by tile.
class SweptWorld {
 public:
  /// In: how long what is not among the tiles cannot be met; whether something is not here.
  SweptWorld(double duration_s, double rest_safe_s, bool lacks_any)
      : duration_s_(duration_s), first_unknown_s_(lacks_any ? 0 : rest_safe_s) {
    sum_.free_until_s = std::min(duration_s, first_unknown_s_);
  }
  /// `missing`: of the other body.
  void add(const SweptAnswer& tile, std::vector<NodeSpan> SweptAnswer::*missing) {
    sum_.free_until_s = std::min(sum_.free_until_s, tile.free_until_s);
    sum_.hit_s = std::min(sum_.hit_s, tile.hit_s);
    sum_.exhausted |= tile.exhausted;
    add_sorted(sum_.*missing, tile.*missing);
    if (tile.status != AnswerStatus::kFree && tile.status != AnswerStatus::kContact)
      first_unknown_s_ = std::min(first_unknown_s_, tile.free_until_s);
  }
  void add_unknown() { first_unknown_s_ = sum_.free_until_s = 0; }
  [[nodiscard]] SweptAnswer sum() && {
    if (sum_.hit_s < std::numeric_limits<double>::infinity()) {
      sum_.status =
          first_unknown_s_ >= sum_.hit_s ? AnswerStatus::kContact : AnswerStatus::kPartial;
    } else {
      sum_.status =
          first_unknown_s_ >= duration_s_ ? AnswerStatus::kFree : AnswerStatus::kUncertain;
    }
    return std::move(sum_);
  }

 private:
  double duration_s_;
  double first_unknown_s_;  // before it nothing that is not known could touch
  SweptAnswer sum_;
};

}  // namespace

void Session::Impl::fold_world(WorldPair& found, const FrameReport& report) {
  const Pair& pair = *found.pair;
  const bool is_a = pair.a->model->world.has_value();
  const Body &world = is_a ? *pair.a : *pair.b, &other = is_a ? *pair.b : *pair.a;
  PairAnswer& result = found.answer;
  result.a = pair.a->id;
  result.b = pair.b->id;
  result.content_a = pair.a->model->content_hash;
  result.content_b = pair.b->model->content_hash;
  result.age_a_s = wire::age_s(stamp_of(*pair.a), time_s);
  result.age_b_s = wire::age_s(stamp_of(*pair.b), time_s);
  result.answer = nothing_known();
  found.digest = digest(result.answer);
  result.reason = found.reason;
  if (result.reason.empty()) {
    result.asked = true;
    result.pose_a = pair.a->motion->pose;
    result.pose_b = pair.b->motion->pose;
    WorldAnswer& about = result.world.emplace();
    about.world = world.model->content_hash;
    for (const MissingPage& page : found.around.near.missing)
      about.missing_pages.push_back(page.entry.content);
    wire::ContactReport::World& rests_on = found.told;
    rests_on = {.is_a = is_a,
                .reach_cells = found.reach_cells,
                .tiles = {},
                .missing_pages = about.missing_pages};
    std::sort(rests_on.missing_pages.begin(), rests_on.missing_pages.end());
    rests_on.missing_pages.erase(
        std::unique(rests_on.missing_pages.begin(), rests_on.missing_pages.end()),
        rests_on.missing_pages.end());

    const Approach approach(world, is_a ? result.age_a_s : result.age_b_s, other,
                            is_a ? result.age_b_s : result.age_a_s);
    double safe_s = approach.safe_s(found.around.rest_m);
    TileSum tiles({is_a, options.clearance, options.any, options.max_pairs}, about.world,
                  found.around);
    SweptWorld swept(options.sweep_s, safe_s,
                     !found.around.near.missing.empty() || !found.not_here.empty());
    bool is_any_asked = found.around.near.tiles.size() == found.not_here.size();
    std::size_t put_off_count = 0, next_not_here = 0, next = found.first;
    std::string awaited;
    const auto await = [&awaited](const std::string& what) {
      if (!what.empty()) awaited += (awaited.empty() ? "" : "; ") + what;
    };
    for (const WorldEntry& entry : found.around.near.tiles) {
      NearTile& tile = about.tiles.emplace_back();
      tile.tile = {entry.content, entry.place};
      wire::ContactReport::World::Tile& its_told = rests_on.tiles.emplace_back();
      if (next_not_here < found.not_here.size() && found.not_here[next_not_here] == entry) {
        await(place_of(entry) + ": " + found.why_not_here[next_not_here++]);
        tiles.add_unknown(entry);
        continue;
      }
      const Pair& its_pair = *listed[next];
      const PairAnswer& its = report.answers[next++];
      tile.is_here = true;
      tile.asked = its.asked;
      tile.status = its.answer.status;
      is_any_asked |= its.asked;
      if (its.swept) {
        swept.add(*its.swept, is_a ? &SweptAnswer::missing_b : &SweptAnswer::missing_a);
      } else {
        swept.add_unknown();
      }
      if (!its.asked) {
        ++put_off_count;
        if (!its.put_off) await(place_of(entry) + ": " + its.reason);
        tiles.add_unknown(entry);
        continue;
      }
      const PeerModel& model = *(is_a ? its_pair.a : its_pair.b)->model;
      its_told = {true, model.replica->mesh().state_hash(), model.replica->taken_batches(),
                  model.era};
      const Answer& part = its.answer;
      tile.pairs = tiles.add(entry, part);
      tile.missing = is_a ? part.missing_a : part.missing_b;
      if (!its.awaited.empty()) await(place_of(entry) + ": " + its.awaited);
      if (is_certified(part.status) && part.pair_total == 0)
        safe_s = std::min(safe_s, its.safe_horizon_s);
      if (its.contacts) {
        if (!result.contacts) result.contacts.emplace();
        append(*its.contacts, *result.contacts);
      }
    }
    if (const auto& pages = found.around.near.missing; !pages.empty())
      await(counted(pages.size(), "page") + " of world " + world.model->name + " not here yet, " +
            who_gives(pages.front().entry.content));
    if (put_off_count > 0 && is_any_asked) await(counted(put_off_count, "tile") + " not asked");
    result.answer = tiles.finish();
    found.digest = tiles.digest();
    if (!is_certified(result.answer.status)) {
      result.awaited = std::move(awaited);
    } else if (result.answer.pair_total == 0) {
      result.safe_horizon_s = options.clearance == Clearance::kNone ? 0 : safe_s;
    }
    if (options.sweep_s > 0 && is_any_asked) result.swept = std::move(swept).sum();
    if (!is_any_asked) {
      result.answer = nothing_known();
      found.digest = digest(result.answer);
      result.asked = false;
      result.put_off = true;
      result.reason = kOutOfBudget;
      result.awaited.clear();
    }
  }
}

}  // namespace nearmesh::subscriber
