// SPDX-License-Identifier: Apache-2.0
#include "certificate.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/geometry/motion_bounds.hpp"
#include "core/query/find_missing.hpp"
#include "core/query/lacking_ahead.hpp"
#include "nearmesh/core/spm/detail/header.hpp"

namespace nearmesh {
namespace {

/// What is needed now goes first where it is more than some batches: less is cheaper together with
/// what is ahead.
constexpr std::size_t kWorthItsOwn = 768;
/// Room for less than some splits is not worth the attach nodes of another batch.
constexpr std::size_t kWorthJoining = 96;
/// Tests between two turns of those who are served, at least.
constexpr std::uint64_t kTestsATurn = 50'000;
/// So much of its way may a body end beside where it is predicted (figures: README.md).
constexpr double kOffCourse = 1.0 / 40;

/// At most so many: small ones say little as long as large ones are not known.
std::vector<NodeSpan> largest_of(std::span<const NodeSpan> nodes, std::size_t most) {
  std::vector<NodeSpan> largest(nodes.begin(), nodes.end());
  if (largest.size() <= most) return largest;
  std::sort(largest.begin(), largest.end(), [](const NodeSpan& one, const NodeSpan& other) {
    return one.size != other.size ? one.size > other.size : one < other;
  });
  largest.resize(most);
  return largest;
}

Motion motion_of(const CertificateRequest::Pair& pair) {
  const double w = pair.rotation[0], x = pair.rotation[1], y = pair.rotation[2],
               z = pair.rotation[3];
  const double s = 2 / (w * w + x * x + y * y + z * z);
  Motion motion;
  motion.pose.rotation = {
      1 - s * (y * y + z * z), s * (x * y - w * z),     s * (x * z + w * y),
      s * (x * y + w * z),     1 - s * (x * x + z * z), s * (y * z - w * x),
      s * (x * z - w * y),     s * (y * z + w * x),     1 - s * (x * x + y * y)};
  for (std::size_t k = 0; k < 3; ++k) {
    motion.pose.translation_m[k] = pair.translation_m[k];
    motion.linear_velocity_mps[k] = pair.linear_velocity_mps[k];
    motion.angular_velocity_radps[k] = pair.angular_velocity_radps[k];
  }
  return motion;
}

/// How far a request's rounding may take a point of body b, metres: that of floats, and of a
/// rotation made a quaternion.
double rounding_m(const Motion& b_in_a, const TreeView& b) {
  return 0x1p-21 * reach_m(*b.grid, b.root().box) +
         0x1p-22 * length_bound(b_in_a.pose.translation_m);
}

std::array<double, 3> to_frame(const std::array<double, 9>& rotation,
                               const std::array<double, 3>& world) {
  std::array<double, 3> own{};
  for (std::size_t k = 0; k < 3; ++k)
    own[k] = rotation[k] * world[0] + rotation[3 + k] * world[1] + rotation[6 + k] * world[2];
  return own;
}

std::array<float, 3> as_floats(const std::array<double, 3>& v) {
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

/// Of a rotation matrix, row-major. The largest component is found first, so that none is divided
/// by a small one.
std::array<float, 4> quaternion_of(const std::array<double, 9>& r) {
  const std::array<double, 4> squares{1 + r[0] + r[4] + r[8], 1 + r[0] - r[4] - r[8],
                                      1 - r[0] + r[4] - r[8], 1 - r[0] - r[4] + r[8]};
  const auto largest =
      static_cast<std::size_t>(std::max_element(squares.begin(), squares.end()) - squares.begin());
  const double c = std::sqrt(squares[largest]), f = 0.5 / c;
  const double wx = f * (r[7] - r[5]), wy = f * (r[2] - r[6]), wz = f * (r[3] - r[1]);
  const double xy = f * (r[3] + r[1]), xz = f * (r[2] + r[6]), yz = f * (r[7] + r[5]);
  const std::array<std::array<double, 4>, 4> quaternions{
      {{c / 2, wx, wy, wz}, {wx, c / 2, xy, xz}, {wy, xy, c / 2, yz}, {wz, xz, yz, c / 2}}};
  const std::array<double, 4>& q = quaternions[largest];
  return {static_cast<float>(q[0]), static_cast<float>(q[1]), static_cast<float>(q[2]),
          static_cast<float>(q[3])};
}

}  // namespace

CertificateRequest::Pair relative(const Motion& a, const Motion& b) {
  const std::array<double, 9>&ra = a.pose.rotation, &rb = b.pose.rotation;
  std::array<double, 9> turned{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      turned[3 * i + j] = ra[i] * rb[j] + ra[3 + i] * rb[3 + j] + ra[6 + i] * rb[6 + j];
  std::array<double, 3> apart{}, linear{}, angular{};
  for (std::size_t k = 0; k < 3; ++k) {
    apart[k] = b.pose.translation_m[k] - a.pose.translation_m[k];
    linear[k] = b.linear_velocity_mps[k] - a.linear_velocity_mps[k];
    angular[k] = b.angular_velocity_radps[k] - a.angular_velocity_radps[k];
  }
  // As a turns, b goes round it.
  const std::array<double, 3>& w = a.angular_velocity_radps;
  linear[0] -= w[1] * apart[2] - w[2] * apart[1];
  linear[1] -= w[2] * apart[0] - w[0] * apart[2];
  linear[2] -= w[0] * apart[1] - w[1] * apart[0];
  return {.rotation = quaternion_of(turned),
          .translation_m = as_floats(to_frame(ra, apart)),
          .linear_velocity_mps = as_floats(to_frame(ra, linear)),
          .angular_velocity_radps = as_floats(to_frame(ra, angular))};
}

CertificateMaker::CertificateMaker(CertificateRequest request,
                                   std::vector<std::shared_ptr<Mirror>> mirrors)
    : request_(std::move(request)),
      mirrors_(std::move(mirrors)),
      splits_(mirrors_.size()),
      told_of_(mirrors_.size()),
      kept_(mirrors_.size()) {}

Status CertificateMaker::note_read(std::size_t model, const Status& read) {
  if (!read.is_ok()) unreadable_ = request_.models[model].content;
  return read;
}

Status CertificateMaker::split(const CertificateRequest::Pair& pair, std::span<const NodeSpan> a,
                               std::span<const NodeSpan> b) {
  for (const auto& [model, lacking] : {std::pair{pair.a, a}, std::pair{pair.b, b}}) {
    const std::vector<NodeSpan> nodes =
        largest_of(lacking, kMaxSplits - std::min(kMaxSplits, split_count_));
    if (nodes.empty()) continue;
    const ActiveMesh& mesh = mirrors_[model]->model().mesh;
    for (const NodeSpan& node : nodes)
      if (mesh.is_current(node) && !mesh.half_spaces().of(node.first).empty())
        kept_[model].push_back(node);
    const Result<std::vector<VertexId>> done = mirrors_[model]->split(nodes);
    NEARMESH_RETURN_IF_ERROR(note_read(model, done.status()));
    splits_[model].insert(splits_[model].end(), done.value().begin(), done.value().end());
    split_count_ += done.value().size();
  }
  return Status::ok();
}

/// What is wanted around body b, beside what is known of it.
double CertificateMaker::margin_m(const CertificateRequest::Pair& pair, bool is_ahead) const {
  const TreeView b = mirrors_[pair.b]->model().view();
  const Motion motion = motion_of(pair);
  const double rounding = rounding_m(motion, b);
  if (!is_ahead) return rounding;
  return rounding + request_.margin_m +
         kOffCourse * request_.horizon_s * speed_bound_mps(motion, reach_m(*b.grid, b.root().box));
}

/// Looks at one pair once. Goes on to the next where it lacks nothing.
Status CertificateMaker::round(std::uint64_t round_tests) {
  const CertificateRequest::Pair& pair = request_.pairs[at_];
  const TreeView a = mirrors_[pair.a]->model().view(), b = mirrors_[pair.b]->model().view();
  const Motion motion = motion_of(pair);
  const bool is_ahead = step_ == Step::kAhead;
  const auto requires_of = [this](std::size_t model) -> Require {
    return [this, model, &file = mirrors_[model]->file()](NodeSpan node) {
      return note_read(model, file.require(node));
    };
  };
  const auto lacking = lacking_ahead(a, {}, "a", b, motion, "b", is_ahead ? request_.horizon_s : 0,
                                     margin_m(pair, is_ahead), requires_of(pair.a),
                                     requires_of(pair.b), round_tests);
  NEARMESH_RETURN_IF_ERROR(lacking);
  tests_ += lacking.value().tests;
  if (!lacking.value().is_nothing()) return split(pair, lacking.value().a, lacking.value().b);
  if (step_ == Step::kNow) {
    // What a look that ran out of tests did not come to; then what the peer asks, in full, where
    // solids' rays may lack something.
    const Result<PosedPair> posed = pose_pair(*a.grid, {}, "a", *b.grid, motion.pose, "b");
    NEARMESH_RETURN_IF_ERROR(posed);
    query_tests_ = std::max(query_tests_, round_tests);
    Answer answer = find_missing(a, posed.value().a, b, posed.value().b, query_tests_);
    tests_ += tests_of(answer.stats);
    const auto is_missing = [&] { return !answer.missing_a.empty() || !answer.missing_b.empty(); };
    if ((pair.solid_a || pair.solid_b) && !is_missing() && !answer.exhausted) {
      answer = query(a, posed.value().a, b, posed.value().b,
                     {.clearance = Clearance::kNone,
                      .max_pairs = 0,
                      .max_tests = query_tests_,
                      .solid_a = pair.solid_a,
                      .solid_b = pair.solid_b});
      tests_ += tests_of(answer.stats);
    }
    if (is_missing()) {
      for (const auto& [model, nodes] :
           {std::pair{pair.a, &answer.missing_a}, std::pair{pair.b, &answer.missing_b}})
        kept_[model].insert(kept_[model].end(), nodes->begin(), nodes->end());
      return split(pair, answer.missing_a, answer.missing_b);
    }
    // Who waits for a turn is not kept waiting by this: more tests the next time.
    if (answer.exhausted) {
      query_tests_ *= 4;
      return Status::ok();
    }
    query_tests_ = 0;
  }
  ++at_;
  return Status::ok();
}

/// Looks at some splits of one model, whether they can be spared. Goes on to the next model when
/// all are.
Status CertificateMaker::spare(std::uint64_t round_tests) {
  if (at_ == 0 && !sparer_) {
    // What is spared of one is in the way of the next: the one of which there is more goes first.
    spare_order_.resize(mirrors_.size());
    std::iota(spare_order_.begin(), spare_order_.end(), 0);
    std::stable_sort(spare_order_.begin(), spare_order_.end(), [&](std::size_t x, std::size_t y) {
      return splits_[x].size() > splits_[y].size();
    });
  }
  const std::size_t model = spare_order_[at_];
  if (!sparer_) {
    std::vector<ToClear> others;
    const bool is_ahead = farthest_ == Step::kAhead;
    for (const CertificateRequest::Pair& pair : request_.pairs) {
      const double duration_s = is_ahead ? double{request_.horizon_s} : 0,
                   around_m = margin_m(pair, is_ahead);
      if (pair.a == model)
        others.push_back({mirrors_[pair.b].get(), {}, motion_of(pair), duration_s, around_m});
      if (pair.b == model)
        others.push_back({mirrors_[pair.a].get(), motion_of(pair), {}, duration_s, around_m});
    }
    sparer_.emplace(*mirrors_[model], splits_[model], kept_[model], std::move(others));
  }
  for (const std::uint64_t end = tests_ + std::min(kTestsATurn, round_tests);
       !sparer_->is_done() && tests_ < std::min(end, kMaxTests);) {
    const Result<std::uint64_t> tests = sparer_->look();
    NEARMESH_RETURN_IF_ERROR(note_read(model, tests.status()));
    tests_ += tests.value();
  }
  if (!sparer_->is_done() && tests_ < kMaxTests) return Status::ok();
  told_of_[model] = sparer_->apply();
  sparer_.reset();
  ++at_;
  return Status::ok();
}

/// How large the first batch of a model is to be, so that it has room in the sample of the last one
/// of the model before.
std::size_t CertificateMaker::beside_last() const {
  const std::size_t left = room_.left();
  return left < kWorthJoining ? kMaxBatchBytes : left - kSealBytes;
}

CertificateMaker::Part CertificateMaker::encode(std::size_t model) {
  Mirror& mirror = *mirrors_[model];
  const ActiveMesh& mesh = mirror.model().mesh;
  // Some were spared, some of these done again.
  std::vector<VertexId>& splits = splits_[model];
  std::sort(splits.begin(), splits.end());
  splits.erase(std::unique(splits.begin(), splits.end()), splits.end());
  std::erase_if(splits, [&](VertexId split) { return !mesh.is_active(split); });
  std::vector<NodeHalfSpace> half_spaces;
  for (const NodeSpan& node : told_of_[model])
    if (mesh.is_current(node))
      for (const HalfSpace& half_space : mesh.half_spaces().of(node.first))
        half_spaces.push_back({node, half_space});
  const Treelet treelet = treelet_of(mesh.store(), splits);
  Part part{model, request_.models[model].content, {}};
  if (!treelet.empty() || !half_spaces.empty())
    part.batches = encode_batches(mirror.file().header(), mesh.store(), treelet,
                                  BoxPolicy::kCutNodes, kMaxBatchBytes, half_spaces, beside_last());
  for (const std::vector<std::uint8_t>& batch : part.batches) room_.add(batch.size() + kSealBytes);
  splits.clear();
  told_of_[model].clear();
  return part;
}

Result<CertificateMaker::Part> CertificateMaker::next(std::uint64_t round_tests) {
  if (step_ == Step::kSend) {
    Part part = encode(at_++);
    if (at_ == mirrors_.size()) {
      step_ = farthest_ = after_;
      room_ = {};
      is_spared_ = false;
      at_ = 0;
    }
    return part;
  }
  if (step_ == Step::kSpare) {
    NEARMESH_RETURN_IF_ERROR(spare(round_tests));
    // Then all is looked at again: what is spared was seen by itself.
    if (at_ == mirrors_.size()) {
      step_ = Step::kNow;
      is_spared_ = true;
      at_ = 0;
    }
    return Part{};
  }
  const bool is_full = split_count_ >= kMaxSplits || tests_ >= kMaxTests;
  if (at_ < request_.pairs.size() && !is_full) {
    NEARMESH_RETURN_IF_ERROR(round(round_tests));
    return Part{};
  }
  at_ = 0;
  farthest_ = std::max(farthest_, step_);
  const bool is_over = farthest_ == Step::kAhead || is_full || request_.horizon_s == 0;
  const bool is_looked_at_again = is_spared_ && step_ < farthest_ && !is_full;
  const bool is_worth_sending = is_over || is_spared_ || split_count_ >= kWorthItsOwn;
  if (is_worth_sending && !is_looked_at_again) {
    after_ = is_over ? Step::kDone : Step::kAhead;
    step_ = is_spared_ ? Step::kSend : Step::kSpare;
  } else {
    step_ = Step::kAhead;
  }
  return Part{};
}

CertificateBeginner::CertificateBeginner(std::uint64_t peer, CertificateRequest request,
                                         Mirrors& mirrors, FileOf file_of)
    : peer_(peer), request_(std::move(request)), mirrors_(&mirrors), file_of_(std::move(file_of)) {}

namespace {

BegunCertificate not_served(const ContentHash& content, bool is_any_served) {
  return {.maker = {},
          .why_not = "content " + to_hex(content) + " is not served here",
          .content = is_any_served ? content : ContentHash{},
          .wants_regions = true};
}

}  // namespace

/// The first is not served: is any?
std::optional<BegunCertificate> CertificateBeginner::look_for_any() {
  const bool is_served = file_of_(request_.models[not_served_].content) != nullptr;
  if (is_served || ++not_served_ == request_.models.size())
    return not_served(request_.models.front().content, is_served);
  return std::nullopt;
}

std::optional<BegunCertificate> CertificateBeginner::next(std::size_t nodes) {
  if (not_served_ > 0) return look_for_any();
  bool has_looked = false;
  while (found_.size() < request_.models.size()) {
    CertificateRequest::Model& model = request_.models[found_.size()];
    if (maker_ == nullptr) {
      if (std::exchange(has_looked, true)) return std::nullopt;
      const std::shared_ptr<ModelFile> file = file_of_(model.content);
      if (file == nullptr && found_.empty() && request_.models.size() > 1) {
        not_served_ = 1;
        return std::nullopt;
      }
      if (file == nullptr) return not_served(model.content, !found_.empty());
      Mirrors::Found known = mirrors_->find(peer_, file, model.state);
      if (known.mirror) {
        found_.push_back(std::move(known.mirror));
        continue;
      }
      is_waking_ = !known.held.empty();
      std::vector<std::uint8_t>& held = is_waking_ ? known.held : model.held;
      if (held.empty())
        return BegunCertificate{
            .maker = {},
            .why_not = "the state of content " + to_hex(model.content) + " is not known",
            .content = model.content};
      maker_ = std::make_unique<MirrorMaker>(file, std::move(held));
    }
    const std::size_t before = maker_->told_nodes();
    Result<std::shared_ptr<Mirror>> made = maker_->next(nodes);
    const std::size_t done = maker_->told_nodes() - before;
    told_nodes_ += done;
    if (made.is_ok() && made.value() == nullptr) return std::nullopt;
    nodes -= std::min(nodes, done);
    maker_.reset();
    const bool is_that_state = made.is_ok() && made.value()->state() == model.state;
    // What slept comes out as another where the file was changed: then the peer is to say what it
    // holds, as if there had been nothing.
    if (!is_that_state && is_waking_) continue;
    if (!is_that_state)
      return BegunCertificate{.maker = {},
                              .why_not = made.is_ok()
                                             ? "what is held of content " + to_hex(model.content) +
                                                   " is not the state that is said to be held"
                                             : made.status().message(),
                              .content = model.content,
                              .wants_regions = true};
    mirrors_->keep(peer_, made.value());
    found_.push_back(std::move(made).value());
  }
  return begin();
}

BegunCertificate CertificateBeginner::begin() {
  // A query of a solid rests on its surface being closed.
  for (const CertificateRequest::Pair& pair : request_.pairs)
    for (const auto& [model, is_solid] :
         {std::pair{pair.a, pair.solid_a}, std::pair{pair.b, pair.solid_b}})
      if (is_solid)
        if (const Status status =
                check_solid(found_[model]->file().header().surface,
                            "of content " + to_hex(request_.models[model].content));
            !status.is_ok())
          return {.maker = {},
                  .why_not = status.message(),
                  .content = request_.models[model].content,
                  .wants_regions = true};
  return {.maker = CertificateMaker(std::move(request_), std::move(found_))};
}

BegunCertificate begin_certificate(std::uint64_t peer, const CertificateRequest& request,
                                   Mirrors& mirrors, const CertificateBeginner::FileOf& file_of) {
  CertificateBeginner beginner(peer, request, mirrors, file_of);
  for (;;)
    if (auto begun = beginner.next(~std::size_t{0})) return *std::move(begun);
}

}  // namespace nearmesh
