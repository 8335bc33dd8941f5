// SPDX-License-Identifier: Apache-2.0
#include "scenes.hpp"

#include <algorithm>
#include <functional>

#include "nearmesh/core/base/detail/assert.hpp"
#include "variants.hpp"

namespace nearmesh::stability {
namespace {

using Cases = std::vector<Case>;

Cases all_base_cases() {
  Cases cases;
  for (const auto make : {touching_cases, small_pair_cases, degenerate_cases, concave_cases,
                          huge_triangle_cases, gap_cases}) {
    const Cases more = make();
    cases.insert(cases.end(), more.begin(), more.end());
  }
  return cases;
}

/// Every third case when a sample is enough.
Cases sample(Cases cases, bool quick) {
  if (!quick) return cases;
  Cases some;
  for (std::size_t i = 0; i < cases.size(); i += 3) some.push_back(std::move(cases[i]));
  return some;
}

/// Every stride-th variant, of each case others; fewer of large meshes and of a quick sample.
Cases vary(const Cases& base, std::vector<Case> (*variants)(const Case&), std::size_t stride,
           bool quick) {
  Cases cases;
  std::size_t number = 0;
  for (const Case& c : base) {
    const std::size_t step = quick                           ? 13 * stride
                             : c.a.mesh->faces.size() > 2000 ? std::max<std::size_t>(5, stride)
                                                             : stride;
    const Cases varied = variants(c);
    for (std::size_t k = number++ % step; k < varied.size(); k += step) cases.push_back(varied[k]);
  }
  return cases;
}

Cases touching_and_small() {
  Cases cases = touching_cases();
  const Cases small = small_pair_cases();
  cases.insert(cases.end(), small.begin(), small.end());
  return cases;
}

struct Row {
  const char* id;
  const char* title;
  std::function<Cases(const std::string& data_folder, bool quick)> make;
  const char* pairs_title = "";
};

const std::vector<Row>& rows() {
  static const std::vector<Row> kRows{
      {"F1", "needle that has not been received, ball driven into it",
       [](const auto&, bool quick) {
         return quick ? streamed_cases(293, 6) : streamed_cases(32, 40);
       }},
      {"F2", "one body inside the other",
       [](const auto&, bool quick) { return sample(solid_cases(), quick); }},
      {"F3", "touching and coplanar: contact or not",
       [](const auto&, bool quick) { return vary(touching_and_small(), near_variants, 1, quick); },
       "touching and coplanar: number of touching pairs"},
      {"F4", "slivers, segments, points, repeated vertices",
       [](const auto&, bool quick) { return vary(degenerate_cases(), near_variants, 2, quick); }},
      {"F5", "NaN, infinite, huge, denormal, no rotation",
       [](const auto&, bool) { return invalid_cases(); }},
      {"F6", "far from the origin, tiny, huge: contact or not",
       [](const auto&, bool quick) { return vary(all_base_cases(), far_variants, 4, quick); },
       "far from the origin, tiny, huge: number of touching pairs"},
      {"F7", "thin and fast: does the path hit?", [](const auto&, bool) { return sweep_cases(); }},
      {"F8", "contact points on both surfaces, normals",
       [](const auto&, bool quick) { return sample(contact_cases(), quick); }},
      {"F9", "ball rolling, box sliding over a flat plate of mixed levels",
       [](const auto&, bool) { return rolling_cases(); }},
      {"F10", "ball at rest on terrain while it refines and coarsens",
       [](const auto&, bool) { return resting_cases(); }},
      {"F11", "stored bounds of a simplified mesh",
       [](const auto&, bool) { return bound_cases(); }},
      {"F12", "order of updates and queries",
       [](const auto&, bool quick) { return sample(incremental_cases(), quick); }},
      {"F13", "two threads at once", [](const auto&, bool) { return thread_cases(); }},
      {"F15", "concave bodies in each other's hollows",
       [](const auto&, bool quick) { return vary(concave_cases(), near_variants, 1, quick); }},
      {"F16", "mesh files that are dirty, broken or hostile",
       [](const std::string& data_folder, bool) { return file_cases(data_folder); }},
      {"F17", "triangles of 10 km, a ball of 1/64 m",
       [](const auto&, bool quick) {
         return vary(huge_triangle_cases(), near_variants, 1, quick);
       }},
      {"F18", "limit on the number of pairs listed",
       [](const auto&, bool) { return limit_cases(); }},
      {"F19", "gaps and overlaps down to a quarter of a grid cell",
       [](const auto&, bool quick) { return vary(gap_cases(), near_variants, 5, quick); }},
  };
  return kRows;
}

}  // namespace

std::vector<std::string> scene_ids() {
  std::vector<std::string> ids;
  for (const Row& row : rows()) ids.emplace_back(row.id);
  return ids;
}

Scene make_scene(const std::string& id, const std::string& data_folder, bool quick) {
  for (const Row& row : rows())
    if (row.id == id) return {row.id, row.title, row.make(data_folder, quick), row.pairs_title};
  NEARMESH_ASSERT(false);
  return {};
}

}  // namespace nearmesh::stability
