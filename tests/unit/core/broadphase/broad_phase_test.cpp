// SPDX-License-Identifier: Apache-2.0
#include "core/broadphase/broad_phase.hpp"

#include <gtest/gtest.h>

#include <optional>
#include <set>

#include "core/base/random.hpp"

namespace nearmesh {
namespace {

using Near = std::set<std::pair<BroadPhase::Slot, BroadPhase::Slot>>;

WorldBox grown(WorldBox box, double by_m) {
  for (std::size_t k = 0; k < 3; ++k) {
    box.lo_m[k] -= by_m;
    box.hi_m[k] += by_m;
  }
  return box;
}

// Bodies that come, move, jump, are lost and go; the truth beside the broad phase.
class Crowd {
 public:
  explicit Crowd(std::uint64_t seed) : random_(seed) {}

  void step() {
    if (bodies_.empty() || random_.unit() < 0.5) come();
    for (auto& [slot, body] : bodies_) {
      const double luck = random_.unit();
      if (luck < 0.02) {
        broad.lose(slot);
        body.box.reset();
      } else if (luck < 0.05 || !body.box) {
        put(slot, anywhere());
      } else if (!body.company.is_scenery) {
        WorldBox box = *body.box;
        for (std::size_t k = 0; k < 3; ++k) {
          const double way_m = random_.between(-0.4, 0.4);
          box.lo_m[k] += way_m;
          box.hi_m[k] += way_m;
        }
        put(slot, box);
      }
    }
    if (bodies_.size() > 60 || (!bodies_.empty() && random_.unit() < 0.1)) go();
  }

  Near brute_force() const {
    Near near;
    for (const auto& [a, one] : bodies_)
      for (const auto& [b, two] : bodies_)
        if (a < b && one.box && two.box && one.company.wants(two.company) &&
            one.box->meets(*two.box))
          near.emplace(a, b);
    return near;
  }
  std::uint64_t pairs(bool placed_only) const {
    std::uint64_t pairs = 0;
    for (const auto& [a, one] : bodies_)
      for (const auto& [b, two] : bodies_)
        pairs += a < b && one.company.wants(two.company) && (!placed_only || (one.box && two.box))
                     ? 1U
                     : 0U;
    return pairs;
  }

  BroadPhase broad;

 private:
  struct Body {
    Company company;
    std::optional<WorldBox> box;
  };

  WorldBox anywhere() {
    WorldBox box;
    for (std::size_t k = 0; k < 3; ++k) {
      box.lo_m[k] = random_.between(-10, 10);
      box.hi_m[k] = box.lo_m[k] + random_.between(0, 3);
    }
    return box;
  }
  void come() {
    const Company company{.group = 1U << random_.below(3),
                          .mask = 1 + random_.below(7),
                          .is_scenery = random_.unit() < 0.3};
    const BroadPhase::Slot slot = broad.add(company);
    EXPECT_FALSE(bodies_.contains(slot));
    bodies_[slot] = {company, std::nullopt};
  }
  void go() {
    auto at = bodies_.begin();
    std::advance(at, random_.below(static_cast<std::uint32_t>(bodies_.size())));
    broad.remove(at->first);
    bodies_.erase(at);
  }
  void put(BroadPhase::Slot slot, const WorldBox& box) {
    bodies_.at(slot).box = box;
    // Any roam will do, also one that is too small.
    broad.place(slot, box, [&] { return grown(box, random_.between(-0.5, 2)); });
  }

  Random random_;
  std::map<BroadPhase::Slot, Body> bodies_;
};

Near as_set(const std::vector<std::pair<BroadPhase::Slot, BroadPhase::Slot>>& found) {
  Near near;
  for (const auto& [a, b] : found)
    EXPECT_TRUE(near.emplace(std::min(a, b), std::max(a, b)).second)
        << a << " and " << b << " twice";
  return near;
}

TEST(BroadPhase, FindsWhatAllPairsWouldWhateverComesMovesAndGoes) {
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    Crowd crowd(seed);
    std::size_t found = 0;
    for (int frame = 0; frame < 400; ++frame) {
      crowd.step();
      const Near near = as_set(crowd.broad.find_near());
      ASSERT_EQ(near, crowd.brute_force()) << "seed " << seed << ", frame " << frame;
      ASSERT_EQ(crowd.broad.pair_count(), crowd.pairs(false));
      ASSERT_EQ(crowd.broad.placed_pair_count(), crowd.pairs(true));
      found += near.size();
    }
    EXPECT_GT(found, 200U);
  }
}

TEST(BroadPhase, LooksOnlyAtWhatHasLeftItsRoam) {
  BroadPhase broad;
  int asked = 0;
  const auto slot = broad.add({});
  for (int i = 0; i < 100; ++i) {
    const double x = 0.1 * i;
    broad.place(slot, {{x, 0, 0}, {x + 1, 1, 1}}, [&] {
      ++asked;
      return WorldBox{{x - 2, -1, -1}, {x + 3, 2, 2}};
    });
  }
  EXPECT_EQ(asked, 5);  // each roam holds 2.0 m of way
}

}  // namespace
}  // namespace nearmesh
