// SPDX-License-Identifier: Apache-2.0
// Choosing, testing and doing half-edge collapses: the inner loop.
#include "simplifier.hpp"

namespace nearmesh::simplification {

std::uint32_t Simplifier::next_stamp() {
  if (stamp_ > kNone - 8) {
    for (Vertex& v : vertices_) v.mark = 0;
    stamp_ = 0;
  }
  return stamp_ += 4;
}

/// Neighbours of u in the order of its faces. Leaves in their marks stamp_ + number of shared faces
/// (3 = more).
void Simplifier::gather_ring(std::uint32_t u, std::vector<std::uint32_t>& ring) {
  ring.clear();
  const std::uint32_t stamp = next_stamp();
  const Vertex& v = vertices_[u];
  work_ += v.count;
  for (const std::uint32_t* it = faces_begin(v); it != faces_end(v); ++it)
    for (const std::uint32_t x : faces_[*it].corner) {
      if (x == u) continue;
      std::uint32_t& mark = vertices_[x].mark;
      if (mark < stamp) {
        mark = stamp + 1;
        ring.push_back(x);
      } else if (mark < stamp + 3) {
        ++mark;
      }
    }
}

void Simplifier::gather_ring(std::uint32_t u, Ring& ring) {
  gather_ring(u, ring_);
  ring.entries.clear();
  ring.borders = 0;
  ring.is_manifold = true;
  for (const std::uint32_t x : ring_) {
    const std::uint32_t faces = vertices_[x].mark - stamp_;
    ring.entries.push_back({x, faces});
    ring.borders += faces == 1;
    ring.is_manifold &= faces <= 2;
  }
  ring.is_manifold &= ring.borders == 0 || ring.borders == 2;
}

Vec3 Simplifier::normal_of(const Face& f) const {
  const Vertex& v = vertices_[f.corner[0]];
  return cross(between(v, vertices_[f.corner[1]]), between(v, vertices_[f.corner[2]]));
}

/// How far the surface moves, and how large the merged node's box would be. What meets a body asks
/// for the nodes whose boxes it meets, and as in trees built for rays the area of their sides says
/// how many these will be. Both count for the fourth root of the area that moves. For all of it a
/// peak of few faces would be cheap to cut off, however high; for none of it large clusters would
/// grow as fast as small ones.
double Simplifier::cost_of(std::uint32_t u, std::uint32_t s) const {
  const Cluster& from = clusters_[u];
  GridBox box = from.box;
  box.add(clusters_[s].box);
  Vec3 side;
  for (int k = 0; k < 3; ++k)
    side[static_cast<std::size_t>(k)] = static_cast<double>(box.hi[k]) - box.lo[k];
  const double area = side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
  const Vec3 d = between(vertices_[u], vertices_[s]);
  return from.factor * (error_weight_ * from.quadric.error(d) +
                        from.quadric.total_weight() * (area + kLengthWeight * dot(d, d)));
}

void Simplifier::set_choice(std::uint32_t u, const Choice& choice) {
  if (choice.value == Choice::kNever) {
    queue_.remove(u);
    return;
  }
  vertices_[u].is_stale = 0;
  choice_[u] = choice.low();
  queue_.set(choice.key(u));
}

/// Queues u's cheapest collapse, or takes u out if it has no neighbour.
void Simplifier::choose(std::uint32_t u) {
  gather_ring(u, ring_);
  choose_among(u, ring_);
}

void Simplifier::choose_among(std::uint32_t u, std::span<const std::uint32_t> ring) {
  Choice best;
  for (const std::uint32_t x : ring) {
    if (is_fixed(vertices_[x])) continue;
    best.value = std::min(best.value, choice_between(u, x).value);
  }
  set_choice(u, best);
}

Choice Simplifier::choice_between(std::uint32_t u, std::uint32_t x) const {
  return {cost_of(u, x), std::max<std::uint32_t>(vertices_[u].depth, vertices_[x].depth), x, false};
}

/// The same for the cheapest after the present one, which turned out illegal.
void Simplifier::choose_next(std::uint32_t u) {
  const std::uint64_t present = choice_of(u).value | 1U;
  gather_ring(u, ring_);
  Choice best;
  for (const std::uint32_t x : ring_) {
    if (is_fixed(vertices_[x])) continue;
    const double cost = cost_of(u, x);
    const std::uint32_t depth = std::max(vertices_[u].depth, vertices_[x].depth);
    for (const bool is_dear : {false, true}) {
      const Choice choice(is_dear ? cost * kDearFactor : cost, depth, x, is_dear);
      if (choice.value > present) best.value = std::min(best.value, choice.value | 1U);
    }
  }
  set_choice(u, best);
}

/// The same for x, a neighbour of s, after u went into s. Of x's collapses only those to u and s
/// have changed: that to u is gone, and that to s is new, or has become dearer (its box has grown)
/// and deeper. So what x would choose is no better than before, or it is s; and where it was u or
/// s, another look can wait until its turn comes.
void Simplifier::choose_again(std::uint32_t x, std::uint32_t u, std::uint32_t s) {
  if (is_fixed(vertices_[x])) return;
  if (!queue_.contains(x)) return choose(x);
  const Choice present = choice_of(x);
  if (present.is_second()) return choose(x);
  if (!is_fixed(vertices_[s]))
    if (const Choice to_s = choice_between(x, s); to_s.value <= present.value)
      return set_choice(x, to_s);
  if (present.partner() == u || present.partner() == s) vertices_[x].is_stale = 1;
}

/// Lets a vertex that was crowded and is no more take part again.
void Simplifier::choose_around(std::uint32_t thinned) {
  Vertex& v = vertices_[thinned];
  forget_vanished(v);
  v.is_crowded = 0;
  if (is_fixed(v)) return;
  gather_ring(thinned, ring_s_left_);
  for (const std::uint32_t x : ring_s_left_) {
    if (is_fixed(vertices_[x])) continue;
    if (!queue_.contains(x))
      choose(x);
    else if (const Choice to = choice_between(x, thinned); to.value < choice_of(x).value)
      set_choice(x, to);
  }
  choose_among(thinned, ring_s_left_);
}

void Simplifier::collapse_edges(Rule rule, std::uint32_t limit, std::vector<std::uint32_t>* ranks) {
  for (std::uint32_t u = 0; u < vertices_.size(); ++u)
    if (vertices_[u].count > 0 && !is_fixed(vertices_[u])) choose(u);
  effort_ = 0;
  while (!is_done() && faces_left_ > pause_faces_ && !queue_.is_empty() &&
         effort_ <= kPatience * (faces_in_ + 64)) {
    const auto u = static_cast<std::uint32_t>(queue_.top());
    const auto rank = static_cast<std::uint32_t>(queue_.top() >> 32);
    if (rank > limit) break;
    if (vertices_[u].is_stale) {
      choose(u);
      continue;
    }
    const Choice choice = choice_of(u);
    if (!is_legal(u, choice, rule)) {
      effort_ += vertices_[u].count + vertices_[choice.partner()].count;
      choose_next(u);
      continue;
    }
    collapse(u, choice.partner());
    if (ranks != nullptr) ranks->push_back(rank);
    const std::uint32_t s = choice.partner();
    for (const std::uint32_t x : ring_s_left_) choose_again(x, u, s);
    for (const std::uint32_t x : left_alone_)
      if (!is_fixed(vertices_[x])) choose(x);
    if (!is_fixed(vertices_[s])) choose_among(s, ring_s_left_);
    for (; !thinned_.empty(); thinned_.pop_back()) choose_around(thinned_.back());
    report_progress();
  }
}

/// Every face has two corners that are crowded, or two that are not, so one of the two turns always
/// takes some. What is crowded never takes in what is not: that would cost as many faces each time,
/// whereas two crowded ones merge at once.
void Simplifier::collapse_crowded() {
  for (std::uint64_t before = 0; !is_done() && before != faces_left_;) {
    before = faces_left_;
    for (Vertex& v : vertices_)
      if (v.is_crowded) forget_vanished(v);
    among_crowded_ = true;
    collapse_edges(Rule::kNothing);
    among_crowded_ = false;
    for (std::uint32_t u = 0; u < vertices_.size(); ++u) {
      Vertex& v = vertices_[u];
      queue_.remove(u);
      v.is_crowded = v.first != kNone && v.count > kCrowd;
      if (v.is_crowded) v.capacity = v.count;
    }
    collapse_edges(Rule::kNothing);
  }
}

bool Simplifier::is_legal(std::uint32_t u, const Choice& choice, Rule rule) {
  if (rule == Rule::kNothing) return true;
  const std::uint32_t s = choice.partner();
  bool is_tetrahedron = false;
  const bool keeps = keeps_topology(u, s, is_tetrahedron);
  if (!keeps && !choice.is_dear()) return false;
  if (is_tetrahedron || rule == Rule::kNoNormals) return true;
  // What is dear is granted one fault of the two.
  const bool may_turn = rule == Rule::kNoOriginalNormal || (choice.is_dear() && keeps);
  const Vertex& v = vertices_[u];
  return std::all_of(faces_begin(v), faces_end(v), [&](std::uint32_t face) {
    return keeps_normal(faces_[face], u, s, may_turn);
  });
}

/// The link condition; where an end is not manifold, only that no two faces become one. The last
/// four faces of a closed component may fold up, so that small components vanish when their turn
/// comes.
bool Simplifier::keeps_topology(std::uint32_t u, std::uint32_t s, bool& is_tetrahedron) {
  gather_ring(u, ring_u_);
  const std::uint32_t shared = vertices_[s].mark - stamp_;
  gather_ring(s, ring_s_);
  const auto is_near_s = [&](std::uint32_t x) { return vertices_[x].mark > stamp_; };

  if (ring_u_.is_manifold && ring_s_.is_manifold) {
    if (shared == 2 && ring_u_.borders > 0 && ring_s_.borders > 0) return false;
    std::uint32_t common = 0;
    for (const Ring::Entry& e : ring_u_.entries) common += e.vertex != s && is_near_s(e.vertex);
    if (common > shared) return false;
  }
  const Vertex &v = vertices_[u], &kept = vertices_[s];
  for (const std::uint32_t* it = faces_begin(v); it != faces_end(v); ++it) {
    const Face& f = faces_[*it];
    const int at = f.corner[0] == u ? 0 : f.corner[1] == u ? 1 : 2;
    const std::uint32_t a = f.corner[(at + 1) % 3], b = f.corner[(at + 2) % 3];
    if (a == s || b == s || !is_near_s(a) || !is_near_s(b)) continue;
    work_ += kept.count;
    for (const std::uint32_t* other = faces_begin(kept); other != faces_end(kept); ++other) {
      const auto& c = faces_[*other].corner;
      if (std::find(c.begin(), c.end(), a) == c.end() ||
          std::find(c.begin(), c.end(), b) == c.end())
        continue;
      if (shared != 2 || v.count != 3 || kept.count != 3 || vertices_[a].count != 3 ||
          vertices_[b].count != 3)
        return false;
      is_tetrahedron = true;
    }
  }
  return true;
}

bool Simplifier::keeps_normal(const Face& f, std::uint32_t u, std::uint32_t s,
                              bool may_turn) const {
  const int at = f.corner[0] == u ? 0 : f.corner[1] == u ? 1 : 2;
  const std::uint32_t a = f.corner[(at + 1) % 3], b = f.corner[(at + 2) % 3];
  if (a == s || b == s) return true;  // vanishes
  const Vertex &va = vertices_[a], &vb = vertices_[b];
  const Vec3 before = cross(between(vertices_[u], va), between(vertices_[u], vb));
  const Vec3 after = cross(between(vertices_[s], va), between(vertices_[s], vb));
  const double before2 = dot(before, before), after2 = dot(after, after);
  if (after2 == 0) return before2 == 0;
  if (before2 > 0) {
    const double turn = dot(before, after);
    if (turn <= 0 || turn * turn < kLeastCosine * kLeastCosine * before2 * after2) return false;
  }
  if (!may_turn && f.normal != 0) {
    const Vec3 original = unpack_normal(f.normal);
    const double turn = dot(original, after);
    constexpr double kLeast2 = kLeastCosineToInput * kLeastCosineToInput;
    if (turn <= 0 || turn * turn < kLeast2 * dot(original, original) * after2) return false;
  }
  return true;
}

/// Merges u into s. Leaves in ring_s_left_ the neighbours of s, and in left_alone_ what was one and
/// lost its last face with s.
void Simplifier::collapse(std::uint32_t u, std::uint32_t s) {
  const Vec3 d = between(vertices_[s], vertices_[u]);
  clusters_[s].add(clusters_[u], {-d[0], -d[1], -d[2]});
  move_faces(u, s);
  remove_vertex(u, s);
  gather_ring(s, ring_s_left_);
  if (Vertex& kept = vertices_[s]; kept.count > kCrowd && !kept.is_crowded) {
    kept.is_crowded = 1;
    kept.capacity = kept.count;
    queue_.remove(s);
  }
  left_alone_.clear();
  for (const std::uint32_t x : thirds_)
    if (vertices_[x].mark <= stamp_) {
      vertices_[x].mark = stamp_ + 1;
      left_alone_.push_back(x);
    }
}

void Simplifier::move_faces(std::uint32_t u, std::uint32_t s) {
  merged_.clear();
  thirds_.clear();
  Vertex &removed = vertices_[u], &kept = vertices_[s];
  work_ += removed.count + kept.count;
  for (std::uint32_t i = 0; i < removed.count; ++i) {
    const std::uint32_t face = pool_[removed.first + i];
    Face& f = faces_[face];
    const bool vanishes = f.corner[0] == s || f.corner[1] == s || f.corner[2] == s;
    if (!vanishes) {
      for (std::uint32_t& c : f.corner)
        if (c == u) c = s;
      merged_.push_back(face);
      continue;
    }
    for (const std::uint32_t c : f.corner)
      if (c != u && c != s) {
        drop_face(c, face);
        thirds_.push_back(c);
      }
    f.corner = {kNone, kNone, kNone};
    --faces_left_;
  }
  for (std::uint32_t i = 0; i < kept.count; ++i) {
    const std::uint32_t face = pool_[kept.first + i];
    if (faces_[face].corner[0] != kNone) merged_.push_back(face);
  }
  store_slice(kept, removed, merged_);
}

void Simplifier::remove_vertex(std::uint32_t u, std::uint32_t s) {
  Vertex &removed = vertices_[u], &kept = vertices_[s];
  kept.depth = (std::max(kept.depth, removed.depth) + 1U) & Vertex::kMostDepth;
  removed.first = kNone;
  removed.count = removed.capacity = 0;
  queue_.remove(u);
  collapses_.push_back({input_number_[u], input_number_[s]});
}

void Simplifier::drop_face(std::uint32_t vertex, std::uint32_t face) {
  Vertex& v = vertices_[vertex];
  if (v.is_crowded && !among_crowded_) {
    if (--v.count == kCrowd / 2) thinned_.push_back(vertex);
    return;
  }
  work_ += v.count;
  std::uint32_t* slice = &pool_[v.first];
  std::uint32_t* last = slice + v.count - 1;
  *std::find(slice, last, face) = *last;
  --v.count;
}

/// Gives `to` these faces, in its own slice, in that of `from` (which is given up), or in a new
/// one.
void Simplifier::store_slice(Vertex& to, Vertex& from, const std::vector<std::uint32_t>& faces) {
  const auto count = static_cast<std::uint32_t>(faces.size());
  if (count > to.capacity && count <= from.capacity) {
    to.first = from.first;
    to.capacity = from.capacity;
  } else if (count > to.capacity) {
    to.count = from.count = 0;
    if (pool_.size() + count > pool_limit_) compact_pool();
    to.first = static_cast<std::uint32_t>(pool_.size());
    to.capacity = count;
    pool_.resize(pool_.size() + count);
  }
  to.count = count;
  std::copy(faces.begin(), faces.end(), pool_.begin() + to.first);
}

void Simplifier::compact_pool() {
  std::vector<std::uint32_t> pool;
  pool.reserve(pool_limit_);
  for (Vertex& v : vertices_) {
    if (v.first == kNone) continue;
    forget_vanished(v);
    const auto first = static_cast<std::uint32_t>(pool.size());
    pool.insert(pool.end(), pool_.begin() + v.first, pool_.begin() + v.first + v.count);
    v.first = first;
    v.capacity = v.count;
  }
  pool_ = std::move(pool);
}

/// Of a crowded vertex's slice keeps what is left.
void Simplifier::forget_vanished(Vertex& v) {
  if (!v.is_crowded || among_crowded_ || v.count == v.capacity) return;
  work_ += v.capacity;
  const auto begin = pool_.begin() + v.first;
  const auto end = std::remove_if(begin, begin + v.capacity, [this](std::uint32_t face) {
    return faces_[face].corner[0] == kNone;
  });
  NEARMESH_ASSERT(end - begin == static_cast<std::ptrdiff_t>(v.count));
  v.capacity = v.count;
}

void Simplifier::report_progress() {
  if (!on_progress_) return;
  const double share = static_cast<double>(faces_in_ - faces_left_) /
                       static_cast<double>(faces_in_ - std::min(target_faces_, faces_in_ - 1));
  if (share < next_report_) return;
  on_progress_(std::min(share, 1.0));
  next_report_ = share + 0.01;
}

}  // namespace nearmesh::simplification
