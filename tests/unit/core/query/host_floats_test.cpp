// SPDX-License-Identifier: Apache-2.0
// Whatever a host has set in the processor, the core's answers are the same to the last bit,
// nothing traps, and the host finds its settings again.
#include "host_floats.hpp"

#include <bit>
#include <fstream>

#include "core/base/hash.hpp"
#include "model_pairs.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "nearmesh/core/query/contacts.hpp"
#include "nearmesh/core/query/sweep.hpp"
#include "random_policies.hpp"

namespace nearmesh {
namespace {

using test::expect_same_under_all_floats;

/// Bits of all that was seen, without computing on it.
class Seen {
 public:
  void add(std::uint64_t x) { bits_.push_back(x); }
  void add(double x) { add(std::bit_cast<std::uint64_t>(x)); }
  template <std::size_t n>
  void add(const std::array<double, n>& all) {
    for (const double x : all) add(x);
  }
  void add(const Pose& pose) {
    add(pose.rotation);
    add(pose.translation_m);
  }
  void add(const PosedFrame& frame) {
    for (const std::int64_t x : frame.rotation) add(static_cast<std::uint64_t>(x));
    for (const std::int64_t x : frame.translation) add(static_cast<std::uint64_t>(x));
  }
  void add(const Contacts& contacts) {
    for (const ContactSegment& segment : contacts.segments) {
      add(segment.p_m);
      add(segment.q_m);
    }
    for (const ContactPatch& patch : contacts.patches) {
      add(patch.length_m);
      add(patch.centroid_m);
      add(patch.normal);
      add(patch.normal_error_rad);
      add(patch.uncertainty_m);
    }
    add(contacts.position_error_m);
  }
  bool operator==(const Seen&) const = default;

 private:
  std::vector<std::uint64_t> bits_;
};

class HostFloats : public test::ModelPair {};
INSTANTIATE_TEST_SUITE_P(Models, HostFloats, test::model_pairs(), test::name_of_pair);

/// From poses to contacts and the time ahead, as a host asks for it.
TEST_P(HostFloats, LeaveAnswersAsTheyAre) {
  Random random(61);
  std::vector<std::pair<Motion, Motion>> motions;
  // A soup takes a hundred times as long as the others.
  const int count = std::string(GetParam().first) == "soup" ? 1 : 3;
  for (int i = 0; i < count; ++i) {
    const test::PairOfPoses poses =
        test::near_poses(random, a_, test::radius_m(a_), b_, test::radius_m(b_));
    auto& [one, two] = motions.emplace_back();
    one.pose = poses.a;
    two.pose = poses.b;
    for (double& x : two.linear_velocity_mps) x = random.between(-1, 1) * test::radius_m(b_);
    for (double& x : one.angular_velocity_radps) x = random.between(-1, 1);
  }
  expect_same_under_all_floats([&] {
    Seen seen;
    for (const auto& pair : motions) {
      // Clang 14 does not let a lambda have what is bound by structure.
      const Motion& one = pair.first;
      const Motion& two = pair.second;
      const Pose later = pose_at(one, 0.3);
      seen.add(later);
      const PosedPair posed =
          pose_pair(a_.header.grid, later, "a", b_.header.grid, two.pose, "b").value();
      seen.add(posed.a);
      seen.add(posed.b);
      LocalModel a(a_.store, a_.header.grid), b(b_.store, b_.header.grid);
      const auto look = [&] {
        const Answer answer = query(a.view(), posed.a, b.view(), posed.b, {.max_pairs = 200});
        seen.add(digest(answer));
        for (const NodeSpan& node : answer.missing_a) seen.add(node_bound(a_.store, node));
        seen.add(find_contacts(a.view(), posed.a, b.view(), posed.b, answer));
        seen.add(approximate_contacts(a.mesh, posed.a, b.mesh, posed.b, 20));
        const auto swept =
            sweep(a.view(), one, "a", b.view(), two, "b", {.duration_s = 0.25, .max_tests = 1000});
        seen.add(swept.value().free_until_s);
        seen.add(swept.value().hit_s);
        seen.add(safe_horizon_s(a.view(), one, b.view(), two, answer.clearance_m));
      };
      look();
      const Result<Answer> certain =
          certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {.max_pairs = 200});
      seen.add(digest(certain.value()));
      look();
    }
    return seen;
  });
}

TEST(HostFloatsOfModels, LeaveModelsAsTheyAre) {
  const std::string path =
      ::testing::TempDir() + "nearmesh_floats_" + std::to_string(::getpid()) + ".obj";
  {
    Random random(62);
    std::ofstream out(path);
    out.precision(17);
    for (int i = 0; i < 600; ++i)
      out << "v " << random.between(-1, 1) << ' ' << random.between(-1, 1) / 3 << ' '
          << random.between(-1, 1) * 1e-3 << '\n';
    for (int i = 1; i <= 598; ++i) out << "f " << i << ' ' << i + 1 << ' ' << i + 2 << '\n';
  }
  expect_same_under_all_floats([&] {
    Seen seen;
    for (const IndexedMesh& mesh : {import_mesh(path).value(), generate_terrain(20, 1),
                                    generate_aircraft(300, 1), generate_sphere(14, 0)}) {
      for (const auto& p : mesh.positions_m) seen.add(p);
      const CleanResult clean = clean_mesh(mesh).value();
      const BakedModel model = bake(clean.mesh, clean.report.rounding_error_m, {}).value();
      seen.add(hash_bytes(encode_header(model.header)));
      for (const Collapse& c : model.log.collapses)
        seen.add(std::uint64_t{c.removed} << 32 | c.kept);
    }
    return seen;
  });
  std::remove(path.c_str());
}

}  // namespace
}  // namespace nearmesh
