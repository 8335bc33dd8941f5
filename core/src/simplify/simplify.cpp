// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/simplify/simplify.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "quadric.hpp"
#include "vertex_queue.hpp"

namespace nearmesh {
namespace {

constexpr std::uint32_t kNone = 0xffffffffU;

/// Weight of the planes that hold a border in place, against 1 for the faces. (Of 1 to 1000,
/// measured on open vehicles: from 100 on the borders keep so many faces that the surface between
/// them suffers.)
constexpr double kBorderWeight = 10;
/// A collapse that breaks the topology costs this much more, that is, waits until it is eight times
/// nearer than one that does not. Forbidding it altogether grinds down whatever is well connected
/// before it touches debris: five times the error on a truck of 59 components; manifold meshes are
/// the same either way.
constexpr double kBreakingFactor = 64;
/// Cost of a collapse's length on a surface of no error: the shortest goes first there, so that
/// flat places are thinned evenly. Equals an error of sqrt(1e-7) of the length: never felt on a
/// curved surface.
constexpr double kLengthWeight = 1e-7;
/// A face may turn by 78 degrees in one collapse, and by 60 since the input.
constexpr double kLeastCosine = 0.2;
constexpr double kLeastCosineToInput = 0.5;

/// What a collapse must respect; each rule is tried only when the one before it allows nothing
/// more.
enum class Rule : std::uint8_t {
  kAll,
  kNoOriginalNormal,  ///< turns may add up
  kNoNormals,         ///< faces may flip; breaking the topology stays dear
  kNothing,           ///< nothing is tested
};
constexpr std::array<Rule, 4> kRules = {Rule::kAll, Rule::kNoOriginalNormal, Rule::kNoNormals,
                                        Rule::kNothing};
/// A rule is also given up once collapses refused in vain have looked at this many faces for each
/// face of the input. Only tangles (random corners: every vertex soon has thousands of neighbours)
/// come near; surfaces need less than 1.
constexpr std::uint64_t kPatience = 200;

/// 32 bytes. Faces of a vertex: a slice of one pool.
struct Vertex {
  std::array<std::int32_t, 3> p{};
  std::uint32_t first = 0;     ///< in the pool; kNone once the vertex has been removed
  std::uint32_t count = 0;     ///< faces
  std::uint32_t capacity = 0;  ///< of the slice
  std::uint32_t mark = 0;      ///< scratch of gather_ring
  std::uint32_t depth = 0;     ///< of the merge tree below, a collapse being one level
};

/// 16 bytes. `normal` is that of the input face, 3 x 10 bits, 0 where it had none.
struct Face {
  std::array<std::uint32_t, 3> corner{kNone, kNone, kNone};  ///< kNone when the face has vanished
  std::uint32_t normal = 0;
};

/// Neighbours of a vertex and how often each occurs in its faces (3 = thrice or more).
struct Ring {
  struct Entry {
    std::uint32_t vertex, faces;
  };
  std::vector<Entry> entries;
  std::uint32_t borders = 0;  ///< entries of one face
  bool is_manifold = true;    ///< at most two faces an edge, at most one gap
};

Vec3 between(const Vertex& from, const Vertex& to) {
  // Differences of coordinates in [0, 2^31) fit 32 bits, so this is exact.
  return {static_cast<double>(to.p[0] - from.p[0]), static_cast<double>(to.p[1] - from.p[1]),
          static_cast<double>(to.p[2] - from.p[2])};
}

std::uint32_t pack_normal(const Vec3& n) {
  const double length = std::sqrt(dot(n, n));
  if (length == 0) return 0;
  std::uint32_t packed = 0;
  for (int k = 0; k < 3; ++k)
    packed = packed << 10 | static_cast<std::uint32_t>(std::floor(n[k] / length * 511 + 512.5));
  return packed;
}
Vec3 unpack_normal(std::uint32_t packed) {
  Vec3 n;
  for (int k = 0; k < 3; ++k) n[k] = static_cast<double>(packed >> (20 - 10 * k) & 1023U) - 512;
  return n;
}

/// 21 bits an axis interleaved: neighbours in this order are neighbours in memory.
std::uint64_t morton_code(const std::array<std::int32_t, 3>& p, int shift) {
  std::uint64_t code = 0;
  for (int k = 0; k < 3; ++k) {
    std::uint64_t x = static_cast<std::uint64_t>(p[k]) >> shift & 0x1fffffU;
    x = (x | x << 32) & 0x1f00000000ffffULL;
    x = (x | x << 16) & 0x1f0000ff0000ffULL;
    x = (x | x << 8) & 0x100f00f00f00f00fULL;
    x = (x | x << 4) & 0x10c30c30c30c30c3ULL;
    x = (x | x << 2) & 0x1249249249249249ULL;
    code |= x << k;
  }
  return code;
}

/// Leading bits of a cost that take part in the order: 11 of exponent, the rest of mantissa.
constexpr int kCostBits = 18;
constexpr std::uint32_t kMaxDepth = (1U << (32 - kCostBits)) - 1;

std::uint32_t rank_of(double cost, std::uint32_t depth) {
  const auto bits =
      static_cast<std::uint32_t>(std::bit_cast<std::uint64_t>(cost) >> (63 - kCostBits));
  return bits << (32 - kCostBits) | std::min(depth, kMaxDepth);
}

/// A way for a vertex to go: cheapest first, ties to the shallower pair, then to the lower partner.
/// All in one number: 32 bits of rank, 30 of partner, may it break the topology, was another tried
/// before.
struct Choice {
  static constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();
  std::uint64_t value = kNever;

  Choice() = default;
  Choice(double cost, std::uint32_t depth, std::uint32_t partner, bool may_break)
      : value(std::uint64_t{rank_of(cost, depth)} << 32 | partner << 2 |
              std::uint64_t{may_break} << 1) {}
  Choice(std::uint64_t key, std::uint32_t low) : value((key >> 32 << 32) | low) {}

  [[nodiscard]] std::uint64_t key(std::uint32_t vertex) const {
    return (value >> 32 << 32) | vertex;
  }
  [[nodiscard]] std::uint32_t low() const { return static_cast<std::uint32_t>(value); }
  [[nodiscard]] std::uint32_t partner() const { return low() >> 2; }
  [[nodiscard]] bool may_break() const { return (value & 2) != 0; }
  [[nodiscard]] bool is_second() const { return (value & 1) != 0; }
};
constexpr std::size_t kMaxVertices = std::size_t{1} << 30;

class Simplifier {
 public:
  Simplifier(const GridMesh& mesh, const SimplifyOptions& options)
      : options_(options),
        target_faces_(options.base_faces),
        queue_(static_cast<std::uint32_t>(mesh.positions.size())) {
    place_vertices(mesh);
    place_faces(mesh);
    link_faces();
    add_quadrics();
    log_.collapses.reserve(mesh.positions.size());
  }

  [[nodiscard]] bool is_done() const { return faces_left_ <= target_faces_; }

  void collapse_edges(Rule rule);
  void merge_isolated();
  [[nodiscard]] CollapseLog take_log() {
    log_.base_faces = faces_left_;
    return std::move(log_);
  }

 private:
  /// What merge_range leaves over of a range of vertices in Morton order.
  struct Range {
    std::uint32_t isolated = kNone;            ///< one vertex without faces, or none
    std::size_t base_begin = 0, base_end = 0;  ///< in base_
  };

  // Input, in the order it is needed.
  void place_vertices(const GridMesh& mesh);
  void place_faces(const GridMesh& mesh);
  void link_faces();
  void add_quadrics();

  // Adjacency.
  [[nodiscard]] const std::uint32_t* faces_begin(const Vertex& v) const {
    return &pool_[0] + v.first;
  }
  [[nodiscard]] const std::uint32_t* faces_end(const Vertex& v) const {
    return &pool_[0] + v.first + v.count;
  }
  std::uint32_t next_stamp();
  void gather_ring(std::uint32_t u, std::vector<std::uint32_t>& ring);
  void gather_ring(std::uint32_t u, Ring& ring);
  [[nodiscard]] Vec3 normal_of(const Face& f) const;

  // Choosing.
  [[nodiscard]] double cost_of(std::uint32_t u, std::uint32_t s) const;
  [[nodiscard]] Choice choice_of(std::uint32_t u) const { return {queue_.key(u), choice_[u]}; }
  void choose(std::uint32_t u);
  void choose_next(std::uint32_t u);
  void choose_again(std::uint32_t x, std::uint32_t u, std::uint32_t s);
  void set_choice(std::uint32_t u, const Choice& choice);
  [[nodiscard]] bool is_legal(std::uint32_t u, const Choice& choice, Rule rule);
  [[nodiscard]] bool keeps_topology(std::uint32_t u, std::uint32_t s, bool& is_tetrahedron);
  [[nodiscard]] bool keeps_normal(const Face& f, std::uint32_t u, std::uint32_t s, Rule rule) const;

  // Doing.
  void collapse(std::uint32_t u, std::uint32_t s);
  void move_faces(std::uint32_t u, std::uint32_t s);
  void remove_vertex(std::uint32_t u, std::uint32_t s);
  void drop_face(std::uint32_t vertex, std::uint32_t face);
  void store_slice(Vertex& to, Vertex& from, const std::vector<std::uint32_t>& faces);
  void compact_pool();
  void report_progress();

  // Vertices without faces.
  Range merge_range(const std::vector<std::uint64_t>& codes, std::size_t begin, std::size_t end);
  [[nodiscard]] std::uint32_t nearest_base(std::uint32_t v, std::size_t begin,
                                           std::size_t end) const;

  const SimplifyOptions& options_;
  std::uint64_t target_faces_;
  std::uint64_t faces_in_ = 0, faces_left_ = 0;
  std::uint64_t effort_ = 0;  ///< faces looked at for collapses that were refused
  double next_report_ = 0;
  int code_shift_ = 0;

  std::vector<std::uint32_t> input_number_;  ///< of each vertex: here they are in Morton order
  std::vector<Vertex> vertices_;
  std::vector<Face> faces_;
  std::vector<std::uint32_t> pool_;
  std::size_t pool_limit_ = 0;
  std::vector<Quadric> quadrics_;
  VertexQueue queue_;                  ///< key: rank of the vertex's Choice, then the vertex
  std::vector<std::uint32_t> choice_;  ///< low half of that Choice
  std::uint32_t stamp_ = 0;

  std::vector<std::uint32_t> ring_, changed_, merged_, thirds_;  // scratch
  Ring ring_u_, ring_s_;
  std::vector<std::uint32_t> live_, base_;
  CollapseLog log_;
};

void Simplifier::place_vertices(const GridMesh& mesh) {
  const std::size_t count = mesh.positions.size();
  std::int32_t greatest = 0;
  for (const GridPoint& p : mesh.positions) greatest = std::max({greatest, p[0], p[1], p[2]});
  code_shift_ =
      std::max(0, static_cast<int>(std::bit_width(static_cast<std::uint32_t>(greatest))) - 21);

  std::vector<std::pair<std::uint64_t, std::uint32_t>> order(count);
  for (std::uint32_t i = 0; i < count; ++i)
    order[i] = {morton_code(mesh.positions[i].v, code_shift_), i};
  std::sort(order.begin(), order.end());

  input_number_.resize(count);
  vertices_.resize(count);
  choice_.assign(count, kNone);
  for (std::size_t i = 0; i < count; ++i) {
    input_number_[i] = order[i].second;
    vertices_[i].p = mesh.positions[order[i].second].v;
  }
}

void Simplifier::place_faces(const GridMesh& mesh) {
  std::vector<std::uint32_t> place(vertices_.size());
  for (std::uint32_t i = 0; i < vertices_.size(); ++i) place[input_number_[i]] = i;
  // Counting sort by least corner; the input's order breaks ties.
  const auto least = [&](const std::array<std::uint32_t, 3>& f) {
    return std::min({place[f[0]], place[f[1]], place[f[2]]});
  };
  const auto is_proper = [](const std::array<std::uint32_t, 3>& f) {
    return f[0] != f[1] && f[1] != f[2] && f[2] != f[0];
  };
  std::vector<std::uint32_t> start(vertices_.size() + 1, 0);
  for (const auto& f : mesh.faces)
    if (is_proper(f)) ++start[least(f) + 1];
  for (std::size_t i = 1; i < start.size(); ++i) start[i] += start[i - 1];
  faces_.resize(start.back());
  for (const auto& f : mesh.faces) {
    if (!is_proper(f)) continue;
    Face& face = faces_[start[least(f)]++];
    for (int k = 0; k < 3; ++k) face.corner[k] = place[f[k]];
    face.normal = pack_normal(normal_of(face));
  }
  faces_in_ = faces_left_ = faces_.size();
}

void Simplifier::link_faces() {
  for (const Face& f : faces_)
    for (const std::uint32_t c : f.corner) ++vertices_[c].capacity;
  std::uint32_t first = 0;
  for (Vertex& v : vertices_) {
    v.first = first;
    first += v.capacity;
  }
  // Room for slices that outgrow their place before the pool is compacted.
  pool_limit_ = std::size_t{first} + first / 2 + 64;
  pool_.reserve(pool_limit_);
  pool_.resize(std::max<std::size_t>(first, 1));
  for (std::uint32_t i = 0; i < faces_.size(); ++i)
    for (const std::uint32_t c : faces_[i].corner) {
      Vertex& v = vertices_[c];
      pool_[v.first + v.count++] = i;
    }
}

void Simplifier::add_quadrics() {
  quadrics_.resize(vertices_.size());
  for (std::uint32_t u = 0; u < vertices_.size(); ++u) {
    Quadric& q = quadrics_[u];
    const Vertex& v = vertices_[u];
    gather_ring(u, ring_);
    const std::uint32_t once = stamp_ + 1;
    for (const std::uint32_t* it = faces_begin(v); it != faces_end(v); ++it) {
      const Face& f = faces_[*it];
      const Vec3 n = normal_of(f);
      const double length = std::sqrt(dot(n, n));
      const Vec3 unit = length > 0 ? Vec3{n[0] / length, n[1] / length, n[2] / length} : Vec3{};
      q.add_plane(unit, length / 2);
      for (const std::uint32_t x : f.corner) {
        if (x == u || vertices_[x].mark != once) continue;
        // A border edge: the plane through it that stands upright on its face.
        const Vec3 e = between(v, vertices_[x]);
        if (length > 0)
          q.add_plane(cross(unit, e), kBorderWeight);
        else
          q.add_line(e, kBorderWeight);
      }
    }
  }
}

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

double Simplifier::cost_of(std::uint32_t u, std::uint32_t s) const {
  const Quadric& q = quadrics_[u];
  const Vec3 d = between(vertices_[u], vertices_[s]);
  return q.error(d) + kLengthWeight * q.total_weight() * dot(d, d);
}

void Simplifier::set_choice(std::uint32_t u, const Choice& choice) {
  if (choice.value == Choice::kNever) {
    queue_.remove(u);
    return;
  }
  choice_[u] = choice.low();
  queue_.set(choice.key(u));
}

/// Queues u's cheapest collapse, or takes u out if it has no neighbour.
void Simplifier::choose(std::uint32_t u) {
  gather_ring(u, ring_);
  Choice best;
  for (const std::uint32_t x : ring_) {
    const Choice choice(cost_of(u, x), std::max(vertices_[u].depth, vertices_[x].depth), x, false);
    best.value = std::min(best.value, choice.value);
  }
  set_choice(u, best);
}

/// The same for the cheapest after the present one, which turned out illegal.
void Simplifier::choose_next(std::uint32_t u) {
  const std::uint64_t present = choice_of(u).value | 1U;
  gather_ring(u, ring_);
  Choice best;
  for (const std::uint32_t x : ring_) {
    const double cost = cost_of(u, x);
    const std::uint32_t depth = std::max(vertices_[u].depth, vertices_[x].depth);
    for (const bool may_break : {false, true}) {
      const Choice choice(may_break ? cost * kBreakingFactor : cost, depth, x, may_break);
      if (choice.value > present) best.value = std::min(best.value, choice.value | 1U);
    }
  }
  set_choice(u, best);
}

/// The same for x after u went into s. Of x's collapses only those to u and s have changed.
void Simplifier::choose_again(std::uint32_t x, std::uint32_t u, std::uint32_t s) {
  if (x == s || !queue_.contains(x)) return choose(x);
  const Choice present = choice_of(x);
  if (present.is_second() || present.partner() == u || present.partner() == s) return choose(x);
  const Choice choice(cost_of(x, s), std::max(vertices_[x].depth, vertices_[s].depth), s, false);
  if (choice.value < present.value) set_choice(x, choice);
}

void Simplifier::collapse_edges(Rule rule) {
  for (std::uint32_t u = 0; u < vertices_.size(); ++u)
    if (vertices_[u].count > 0) choose(u);
  effort_ = 0;
  while (!is_done() && !queue_.is_empty() && effort_ <= kPatience * (faces_in_ + 64)) {
    const auto u = static_cast<std::uint32_t>(queue_.top());
    const Choice choice = choice_of(u);
    if (!is_legal(u, choice, rule)) {
      effort_ += vertices_[u].count + vertices_[choice.partner()].count;
      choose_next(u);
      continue;
    }
    collapse(u, choice.partner());
    ++log_.edge_collapses;
    for (const std::uint32_t x : changed_) choose_again(x, u, choice.partner());
    report_progress();
  }
  log_.stop = StopReason::kReachedTarget;
}

bool Simplifier::is_legal(std::uint32_t u, const Choice& choice, Rule rule) {
  if (rule == Rule::kNothing) return true;
  const std::uint32_t s = choice.partner();
  bool is_tetrahedron = false;
  if (!choice.may_break() && !keeps_topology(u, s, is_tetrahedron)) return false;
  if (is_tetrahedron || rule == Rule::kNoNormals) return true;
  const Vertex& v = vertices_[u];
  return std::all_of(faces_begin(v), faces_end(v),
                     [&](std::uint32_t face) { return keeps_normal(faces_[face], u, s, rule); });
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

bool Simplifier::keeps_normal(const Face& f, std::uint32_t u, std::uint32_t s, Rule rule) const {
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
  if (rule == Rule::kAll && f.normal != 0) {
    const Vec3 original = unpack_normal(f.normal);
    const double turn = dot(original, after);
    constexpr double kLeast2 = kLeastCosineToInput * kLeastCosineToInput;
    if (turn <= 0 || turn * turn < kLeast2 * dot(original, original) * after2) return false;
  }
  return true;
}

/// Merges u into s. Leaves in changed_ the vertices whose best collapse may be another now.
void Simplifier::collapse(std::uint32_t u, std::uint32_t s) {
  const Vec3 d = between(vertices_[s], vertices_[u]);
  quadrics_[s].add(quadrics_[u], {-d[0], -d[1], -d[2]});
  move_faces(u, s);
  remove_vertex(u, s);
  gather_ring(s, changed_);
  for (const std::uint32_t x : thirds_)  // may have lost their last face with s
    if (vertices_[x].mark <= stamp_) {
      vertices_[x].mark = stamp_ + 1;
      changed_.push_back(x);
    }
  changed_.push_back(s);
}

void Simplifier::move_faces(std::uint32_t u, std::uint32_t s) {
  merged_.clear();
  thirds_.clear();
  Vertex &removed = vertices_[u], &kept = vertices_[s];
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
  kept.depth = std::max(kept.depth, removed.depth) + 1;
  removed.first = kNone;
  removed.count = removed.capacity = 0;
  queue_.remove(u);
  log_.collapses.push_back({input_number_[u], input_number_[s]});
}

void Simplifier::drop_face(std::uint32_t vertex, std::uint32_t face) {
  Vertex& v = vertices_[vertex];
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
    const auto first = static_cast<std::uint32_t>(pool.size());
    pool.insert(pool.end(), pool_.begin() + v.first, pool_.begin() + v.first + v.count);
    v.first = first;
    v.capacity = v.count;
  }
  pool_ = std::move(pool);
}

void Simplifier::report_progress() {
  if (!options_.on_progress) return;
  const double share = static_cast<double>(faces_in_ - faces_left_) /
                       static_cast<double>(faces_in_ - std::min(target_faces_, faces_in_ - 1));
  if (share < next_report_) return;
  options_.on_progress(std::min(share, 1.0));
  next_report_ = share + 0.01;
}

/// Merges vertices without faces: near ones pairwise, each group then into the nearest vertex that
/// has faces. Bottom up along the octree that Morton order is, so that no vertex takes in many one
/// after the other.
void Simplifier::merge_isolated() {
  std::vector<std::uint64_t> codes;
  for (std::uint32_t i = 0; i < vertices_.size(); ++i) {
    if (vertices_[i].first == kNone) continue;
    live_.push_back(i);
    codes.push_back(morton_code(vertices_[i].p, code_shift_));
    if (vertices_[i].count > 0) base_.push_back(i);
  }
  if (live_.size() == base_.size()) return;
  merge_range(codes, 0, live_.size());
  if (log_.clustered > 0 && log_.stop == StopReason::kReachedTarget)
    log_.stop = StopReason::kClustered;
}

Simplifier::Range Simplifier::merge_range(const std::vector<std::uint64_t>& codes,
                                          std::size_t begin, std::size_t end) {
  if (end - begin == 1) {
    const std::uint32_t v = live_[begin];
    const auto base = std::lower_bound(base_.begin(), base_.end(), v);
    const auto at = static_cast<std::size_t>(base - base_.begin());
    const bool has_faces = vertices_[v].count > 0;
    return {has_faces ? kNone : v, at, at + (has_faces ? 1 : 0)};
  }
  std::size_t middle = begin + (end - begin) / 2;
  if (const std::uint64_t differing = codes[begin] ^ codes[end - 1]; differing != 0) {
    const std::uint64_t split = codes[end - 1] >> (std::bit_width(differing) - 1)
                                                      << (std::bit_width(differing) - 1);
    middle = static_cast<std::size_t>(
        std::lower_bound(codes.begin() + static_cast<std::ptrdiff_t>(begin),
                         codes.begin() + static_cast<std::ptrdiff_t>(end), split) -
        codes.begin());
  }
  const Range left = merge_range(codes, begin, middle), right = merge_range(codes, middle, end);
  Range both{kNone, left.base_begin, right.base_end};
  const auto merge = [&](std::uint32_t removed, std::uint32_t kept) {
    remove_vertex(removed, kept);
    ++log_.clustered;
    return kept;
  };
  if (left.isolated != kNone && right.isolated != kNone) {
    const bool keep_left = vertices_[left.isolated].depth >= vertices_[right.isolated].depth;
    both.isolated =
        keep_left ? merge(right.isolated, left.isolated) : merge(left.isolated, right.isolated);
  } else {
    both.isolated = left.isolated != kNone ? left.isolated : right.isolated;
  }
  if (both.isolated != kNone && both.base_begin < both.base_end) {
    // Only one side has vertices with faces; those next to the other side in Morton order are
    // enough.
    constexpr std::size_t kLooked = 64;
    std::size_t from = both.base_begin, to = both.base_end;
    if (left.base_begin == left.base_end)
      to = std::min(to, from + kLooked);
    else if (to - from > kLooked)
      from = to - kLooked;
    merge(both.isolated, nearest_base(both.isolated, from, to));
    both.isolated = kNone;
  }
  return both;
}

std::uint32_t Simplifier::nearest_base(std::uint32_t v, std::size_t begin, std::size_t end) const {
  std::uint32_t nearest = kNone;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = begin; i < end; ++i) {
    const Vec3 d = between(vertices_[v], vertices_[base_[i]]);
    if (const double distance2 = dot(d, d); distance2 < least) {
      least = distance2;
      nearest = base_[i];
    }
  }
  return nearest;
}

}  // namespace

const char* to_string(StopReason reason) {
  switch (reason) {
    case StopReason::kReachedTarget:
      return "reached target";
    case StopReason::kClustered:
      return "clustered";
    case StopReason::kNothingToDo:
      return "nothing to do";
  }
  return "unknown";
}

CollapseLog simplify(const GridMesh& mesh, const SimplifyOptions& options) {
  NEARMESH_ASSERT(options.base_faces >= 1);
  NEARMESH_ASSERT(mesh.positions.size() <= kMaxVertices);
  Simplifier simplifier(mesh, options);
  for (const Rule rule : kRules)
    if (!simplifier.is_done()) simplifier.collapse_edges(rule);
  simplifier.merge_isolated();
  if (options.on_progress) options.on_progress(1.0);
  return simplifier.take_log();
}

}  // namespace nearmesh
