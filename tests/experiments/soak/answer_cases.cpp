// SPDX-License-Identifier: Apache-2.0
#include "answer_cases.hpp"

#include <limits>
#include <optional>

#include "core/base/hash.hpp"
#include "core/certificate/certificate.hpp"
#include "core/replica/held_nodes.hpp"
#include "core/replica/replica.hpp"
#include "distance.hpp"

namespace nearmesh::soak {
namespace {

struct Truth {
  std::vector<FacePair> pairs;
  double distance_m = std::numeric_limits<double>::infinity();  // where nothing touches
};

struct PosedFace {
  LatticeTriangle triangle;
  std::array<std::int64_t, 3> lo, hi;
  FaceKey key;
};

std::vector<PosedFace> pose_all(const Model& model, const PosedFrame& frame) {
  std::vector<PosedFace> posed;
  posed.reserve(model.faces.size());
  for (const test::KeyedFace& keyed : model.faces) {
    PosedFace face{test::posed(model.baked.store, frame, keyed.face), {}, {}, keyed.key};
    for (std::size_t k = 0; k < 3; ++k) {
      const LatticeTriangle& t = face.triangle;
      face.lo[k] = std::min({t[0].v[k], t[1].v[k], t[2].v[k]});
      face.hi[k] = std::max({t[0].v[k], t[1].v[k], t[2].v[k]});
    }
    posed.push_back(face);
  }
  return posed;
}

// Every face against every face; only the faces' own extents are looked at first.
Truth by_force(const Model& a, const Model& b, const PosedPair& posed) {
  const std::vector<PosedFace> faces_a = pose_all(a, posed.a), faces_b = pose_all(b, posed.b);
  Truth truth;
  const double cell_m = std::ldexp(1.0, posed.a.lattice_exp);
  for (const PosedFace& x : faces_a)
    for (const PosedFace& y : faces_b) {
      double apart = 0;  // along the axis where the extents are farthest apart
      for (std::size_t k = 0; k < 3; ++k)
        apart = std::max({apart, static_cast<double>(x.lo[k] - y.hi[k]),
                          static_cast<double>(y.lo[k] - x.hi[k])});
      if (apart * cell_m >= truth.distance_m) continue;
      if (apart == 0 && triangles_overlap(x.triangle, y.triangle)) {
        truth.pairs.push_back({x.key, y.key});
      } else if (truth.pairs.empty()) {
        truth.distance_m = std::min(truth.distance_m,
                                    test::distance_m(x.triangle, y.triangle, posed.a.lattice_exp));
      }
    }
  std::sort(truth.pairs.begin(), truth.pairs.end());
  return truth;
}

// A small step on, as from one frame to the next; now and then a large one.
Pose moved(const Pose& pose, double radius_m, Random& random) {
  Pose next = pose;
  const double reach = std::ldexp(radius_m, -static_cast<int>(random.below(8)));
  for (double& x : next.translation_m) x += random.between(-1, 1) * reach;
  double q[4]{1, 0, 0, 0}, square = 1;
  const double turn = std::ldexp(1.0, -2 - static_cast<int>(random.below(6)));
  for (int i = 1; i < 4; ++i) {
    q[i] = random.between(-turn, turn);
    square += q[i] * q[i];
  }
  const std::array<double, 9> small = test::rotation_of(q, std::sqrt(square));
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) {
      double sum = 0;
      for (std::size_t k = 0; k < 3; ++k) sum += small[3 * r + k] * pose.rotation[3 * k + c];
      next.rotation[3 * r + c] = sum;
    }
  return next;
}

class Case {
 public:
  Case(const ModelPair& pair, Policy policy, std::uint64_t seed, bool check_by_force)
      : a_(*pair.a), b_(*pair.b), policy_(policy), random_(seed), check_(check_by_force) {}

  CaseResult run() {
    switch (policy_) {
      case Policy::kBase:
      case Policy::kSubset:
      case Policy::kPrefix:
      case Policy::kDemand:
        refine_at_hand();
        break;
      case Policy::kLoss:
        for (std::uint32_t i = 0; i < kPosesPerCase && result_.fault.empty(); ++i) lose_batches(i);
        break;
      case Policy::kSession:
        run_session();
        break;
      case Policy::kServed:
        run_served();
        break;
    }
    return std::move(result_);
  }

 private:
  // Draws a pose and finds the full meshes' answer.
  void next_pose(std::uint32_t i, bool from_previous) {
    if (from_previous) {
      poses_.b = moved(poses_.b, b_.radius_m, random_);
      if (random_.below(2) == 0) poses_.a = moved(poses_.a, b_.radius_m, random_);
    } else {
      poses_ = test::near_poses(random_, a_.baked, a_.radius_m, b_.baked, b_.radius_m);
      // Far from the world's origin nothing may change but the rounding of the translations.
      if (random_.below(8) == 0)
        for (std::size_t k = 0; k < 3; ++k) {
          const double far =
              std::ldexp(random_.between(-1, 1), static_cast<int>(random_.below(24)));
          poses_.a.translation_m[k] += far;
          poses_.b.translation_m[k] += far;
        }
    }
    Result<PosedPair> posed =
        pose_pair(a_.baked.header.grid, poses_.a, "a", b_.baked.header.grid, poses_.b, "b");
    posed_ = std::move(posed).value();
    full_ = query(a_.full.tree.view(), posed_.a, b_.full.tree.view(), posed_.b);
    truth_.reset();
    ++result_.tally.poses;
    if (!check_ || i > 0) return;
    ++result_.tally.brute_force;
    truth_ = by_force(a_, b_, posed_);
    if (full_.pairs != truth_->pairs)
      found("the reference lists " + std::to_string(full_.pairs.size()) + " pairs, brute force " +
            std::to_string(truth_->pairs.size()) + " or others");
    check_clearance(full_);
  }

  void found(const std::string& fault) {
    ++result_.tally.false_answers;
    if (result_.fault.empty()) result_.fault = fault;
  }

  void check_clearance(const Answer& answer) {
    // The true distance is a long double's, rounded to double.
    if (truth_ && answer.clearance_m > truth_->distance_m * (1 + 1e-9))
      found("clearance " + std::to_string(answer.clearance_m) + " m beyond the true distance " +
            std::to_string(truth_->distance_m) + " m");
  }

  Answer judge(Answer answer) {
    ++result_.tally.answers[static_cast<std::size_t>(answer.status)];
    result_.digest = mix(result_.digest ^ digest(answer));
    if (std::string fault = test::fault_of(answer, full_); !fault.empty()) found(fault);
    check_clearance(answer);
    return answer;
  }
  template <class State>
  Answer ask(const State& a, const State& b, Clearance clearance) {
    return judge(query(a.view(), posed_.a, b.view(), posed_.b, {.clearance = clearance}));
  }

  // A tree that followed all operations must answer as one made of the state at once (F12).
  void compare_with_new_trees(const ActiveMesh& mesh_a, const ActiveMesh& mesh_b,
                              const Answer& answer) {
    const AbTree a(mesh_a), b(mesh_b);
    const Answer anew =
        query(a.view(a_.baked.header.grid), posed_.a, b.view(b_.baked.header.grid), posed_.b);
    if (digest(anew) != digest(answer))
      found("trees that followed the refinement answer otherwise than new ones");
  }

  // ---- all splits at hand: which are done is drawn ----------------------------------------------

  void refine_at_hand() {
    LocalModel a(a_.baked.store, a_.baked.header.grid), b(b_.baked.store, b_.baked.header.grid);
    for (std::uint32_t i = 0; i < kPosesPerCase && result_.fault.empty(); ++i) {
      next_pose(i, false);
      refine(a, a_);
      refine(b, b_);
      if (random_.below(2) == 0) test::tell_half_spaces(a, a_.half_spaces, random_, target_of(a_));
      if (random_.below(2) == 0) test::tell_half_spaces(b, b_.half_spaces, random_, target_of(b_));
      ask(a, b, Clearance::kBound);
      const Result<Answer> last =
          certify(a, posed_.a, test::no_require, b, posed_.b, test::no_require, {});
      if (!last.is_ok()) return found(last.status().message());
      judge(last.value());
      if (i + 1 == kPosesPerCase) compare_with_new_trees(a.mesh, b.mesh, last.value());
    }
  }

  void refine(LocalModel& local, const Model& model) {
    if (policy_ == Policy::kSubset && random_.below(2) == 0) {
      test::collapse_some(local, random_);
    } else {
      test::collapse_to_base(local);
    }
    if (policy_ == Policy::kSubset) test::split_random(local, random_);
    if (policy_ == Policy::kPrefix) {
      const std::size_t whole = model.order.size() >> random_.below(6);
      const std::size_t count = random_.below(static_cast<std::uint32_t>(whole) + 1);
      test::split_these(local, std::span(model.order).first(count));
    }
    if (policy_ != Policy::kDemand) return;
    const SplitStore& store = model.baked.store;
    const GridBox region = test::random_region(store, random_);
    const RegionRequest request = test::request_region(store, region, 1 + random_.below(2000));
    if (request.attach.empty()) return;  // all vertices are in the base
    std::vector<VertexId> splits;
    for (const TreeletSplit& split : collect(store, request, nullptr).value().treelet)
      splits.push_back(split.split);
    test::split_these(local, splits);
  }

  // ---- batches over a bad link ------------------------------------------------------------------

  using Batches = std::vector<std::vector<std::uint8_t>>;

  void lose_batches(std::uint32_t i) {
    next_pose(i, false);
    // What would certify this pose, for a and b in any order.
    LocalModel whole_a(a_.baked.store, a_.baked.header.grid);
    LocalModel whole_b(b_.baked.store, b_.baked.header.grid);
    const Result<Answer> whole = certify(whole_a, posed_.a, test::no_require, whole_b, posed_.b,
                                         test::no_require, {.clearance = Clearance::kNone});
    if (!whole.is_ok()) return found(whole.status().message());
    const std::size_t bytes = 100 + random_.below(kMaxBatchBytes - 100);
    const auto encode = [&](const Model& model, const LocalModel& local) {
      const Treelet treelet = active_treelet(local.mesh);
      return encode_batches(model.baked.header, model.baked.store, treelet, BoxPolicy::kCutNodes,
                            bytes, half_spaces(model)(treelet));
    };
    test::Body a(a_.baked.header), b(b_.baked.header);
    ask(a, b, Clearance::kBound);
    // In two halves, so that there are answers on the way.
    const Batches all_a = encode(a_, whole_a), all_b = encode(b_, whole_b);
    for (int half = 0; half < 2; ++half) {
      deliver(a, all_a);
      ask(a, b, Clearance::kNone);
      deliver(b, all_b);
      ask(a, b, Clearance::kNone);
    }
    finish(a, b, i);
  }

  void deliver(test::Body& body, Batches batches) {
    std::erase_if(batches, [this](const auto&) { return random_.below(2) == 0; });
    test::deliver(body, std::move(batches), random_);
  }

  // Asks for what is missing until nothing is.
  void finish(test::Body& a, test::Body& b, std::uint32_t i) {
    constexpr int kMaxRounds = 4000;
    Answer answer = ask(a, b, Clearance::kBound);
    for (int round = 0; !is_certified(answer.status); ++round) {
      if (round == kMaxRounds) return found("asking for what is missing does not end");
      request(a, a_, answer.missing_a);
      request(b, b_, answer.missing_b);
      answer = ask(a, b, Clearance::kBound);
    }
    if (i + 1 == kPosesPerCase) compare_with_new_trees(a.replica.mesh(), b.replica.mesh(), answer);
  }

  void request(test::Body& body, const Model& model, const std::vector<NodeSpan>& missing) {
    if (missing.empty()) return;
    const auto request =
        test::request_missing(body.replica.store(), missing, 1 + random_.below(500));
    test::deliver(body, test::serve(model.baked, request, kMaxBatchBytes, half_spaces(model)),
                  random_);
  }

  // Of every other answer.
  test::HalfSpacesOf half_spaces(const Model& model) {
    return [this, &model](const Treelet& treelet) {
      if (random_.below(2) == 0) return std::vector<NodeHalfSpace>();
      return test::random_half_spaces(model.baked.store, treelet, model.half_spaces, random_,
                                      target_of(model));
    };
  }
  test::Target target_of(const Model& model) {
    return &model == &a_ ? test::random_target(posed_.a, posed_.b, b_.baked.store, random_)
                         : test::random_target(posed_.b, posed_.a, a_.baked.store, random_);
  }

  // ---- a peer that moves on, keeps what it has, and gives some of it up -------------------------

  void run_session() {
    test::Body a(a_.baked.header), b(b_.baked.header);
    for (std::uint32_t i = 0; i < kPosesPerCase && result_.fault.empty(); ++i) {
      next_pose(i, i > 0 && random_.below(8) > 0);
      if (random_.below(2) == 0) prefetch(a, a_);
      if (random_.below(2) == 0) prefetch(b, b_);
      finish(a, b, i);
      a.evict_some(random_);
      b.evict_some(random_);
      ask(a, b, Clearance::kExact);
    }
  }

  // What a horizon would bring, whatever is known of it already: overlapping batches.
  void prefetch(test::Body& body, const Model& model) {
    const SplitStore& store = model.baked.store;
    const GridBox region = test::random_region(store, random_);
    const auto request = test::request_region(store, region, 1 + random_.below(500));
    test::deliver(body, test::serve(model.baked, request, kMaxBatchBytes, half_spaces(model)),
                  random_);
  }

  // ---- a peer that says where its bodies are, whose publisher chooses ---------------------------

  struct Desk {
    explicit Desk(const Model& model)
        : path(test::write_model(model.baked)),
          file(ModelFile::open(path->path()).value()),
          replica(file.header()) {}
    std::unique_ptr<test::TempFile> path;
    ModelFile file;
    Replica replica;
  };

  void run_served() {
    Desk desk_a(a_), desk_b(b_);
    Desk& other = &a_ == &b_ ? desk_a : desk_b;  // one replica a model
    Mirrors mirrors;
    for (std::uint32_t i = 0; i < kPosesPerCase && result_.fault.empty(); ++i) {
      next_pose(i, i > 0 && random_.below(8) > 0);
      const double speed = random_.below(4) == 0 ? 0 : b_.radius_m;
      Motion motion_a{.pose = poses_.a}, motion_b{.pose = poses_.b};
      for (Motion* motion : {&motion_a, &motion_b})
        for (std::size_t k = 0; k < 3; ++k) {
          motion->linear_velocity_mps[k] = random_.between(-speed, speed);
          motion->angular_velocity_radps[k] = speed > 0 ? random_.between(-1, 1) : 0;
        }
      // First over a bad link, then until it is certified.
      constexpr int kMaxRounds = 400;
      for (int round = 0;; ++round) {
        const Answer answer = ask(desk_a.replica, other.replica, Clearance::kBound);
        if (round > 1 && is_certified(answer.status)) break;
        if (round == kMaxRounds) return found("asking the publisher does not end");
        const bool is_lossy = round < 2;
        if (serve(desk_a, other, mirrors, relative(motion_a, motion_b), is_lossy) || is_lossy)
          continue;
        // The pose that was asked for is rounded, and looks end: then a peer names what is missing.
        send_missing(desk_a, a_, answer.missing_a);
        send_missing(other, b_, answer.missing_b);
      }
      if (random_.below(3) > 0) continue;
      for (Desk* desk : {&desk_a, &desk_b})
        desk->replica.give_up({{test::random_region(desk->file.store(), random_)}});
      ask(desk_a.replica, other.replica, Clearance::kBound);
    }
  }

  void send_missing(Desk& desk, const Model& model, const std::vector<NodeSpan>& missing) {
    Treelet treelet;
    for (const NodeSpan& node : missing)
      treelet.push_back({node, model.baked.store.split_of(node), false, false});
    for (const auto& batch :
         encode_batches(model.baked.header, model.baked.store, treelet, BoxPolicy::kCutNodes))
      if (const Status status =
              desk.replica.take(decode_batch(model.baked.header, batch).value()).status;
          !status.is_ok())
        return found(status.message());
  }

  // Out: whether anything was sent.
  bool serve(Desk& a, Desk& b, Mirrors& mirrors, CertificateRequest::Pair pair, bool is_lossy) {
    CertificateRequest request;
    request.horizon_s = random_.below(2) == 0 ? 0 : 0.3F;
    for (Desk* desk : {&a, &b}) {
      if (&a == &b && !request.models.empty()) break;
      request.models.push_back({desk->file.content_hash(), desk->replica.mesh().state_hash(), {}});
      // It must be told what the mirror of a lost batch does not know.
      request.models.back().held = held_nodes(desk->replica).bits;
      pair.b = static_cast<std::uint8_t>(request.models.size() - 1);
    }
    request.pairs = {pair};
    BegunCertificate begun =
        begin_certificate(1, request, mirrors, [&](const ContentHash& content) {
          return test::lent(content == a.file.content_hash() ? a.file : b.file);
        });
    if (!begun.maker) {
      found(begun.why_not);
      return false;
    }
    std::vector<std::pair<Desk*, std::vector<std::uint8_t>>> batches;
    while (!begun.maker->is_done()) {
      Result<CertificateMaker::Part> part = begun.maker->next();
      if (!part.is_ok()) {
        found(part.status().message());
        return false;
      }
      for (std::vector<std::uint8_t>& batch : part.value().batches) {
        seal_batch(part.value().content, batch);
        batches.emplace_back(part.value().content == a.file.content_hash() ? &a : &b,
                             std::move(batch));
      }
    }
    test::shuffle(batches, random_);
    for (const auto& [desk, batch] : batches) {
      if (is_lossy && random_.below(4) == 0) continue;
      for (std::uint32_t times = random_.below(8) == 0 ? 2 : 1; times > 0; --times)
        if (const Status status = desk->replica.take(batch).status; !status.is_ok())
          found(status.message());
      if (is_lossy && random_.below(4) == 0) ask(a.replica, b.replica, Clearance::kNone);
    }
    return !batches.empty();
  }

  const Model &a_, &b_;
  const Policy policy_;
  Random random_;
  const bool check_;
  test::PairOfPoses poses_;
  PosedPair posed_;
  Answer full_;
  std::optional<Truth> truth_;  // where brute force was asked
  CaseResult result_;
};

}  // namespace

Model::Model(BakedModel baked_model)
    : baked(std::move(baked_model)),
      full(baked),
      faces(test::all_faces(baked.store)),
      order(test::all_splits(baked.store)),
      half_spaces(baked.store),
      radius_m(test::radius_m(baked)) {}

void Tally::add(const Tally& other) {
  poses += other.poses;
  brute_force += other.brute_force;
  false_answers += other.false_answers;
  for (std::size_t i = 0; i < answers.size(); ++i) answers[i] += other.answers[i];
}

CaseResult run_case(const ModelPair& pair, Policy policy, std::uint64_t seed, bool check_by_force) {
  return Case(pair, policy, seed, check_by_force).run();
}

}  // namespace nearmesh::soak
