// SPDX-License-Identifier: Apache-2.0
#include "contender.hpp"

namespace nearmesh::perf {

std::vector<ContenderInfo> peers() {
  std::vector<ContenderInfo> found;
#ifdef NEARMESH_PERF_FCL
  found.push_back({"fcl-obb", true, make_fcl_obb});
  found.push_back({"fcl-obbrss", true, make_fcl_obbrss});
#endif
#ifdef NEARMESH_PERF_BULLET
  found.push_back({"bullet-gimpact", false, make_bullet});
#endif
#ifdef NEARMESH_PERF_EMBREE
  found.push_back({"embree-collide", true, make_embree});
#endif
#ifdef NEARMESH_PERF_CGAL
  found.push_back({"cgal-exact", false, make_cgal});
#endif
  return found;
}

}  // namespace nearmesh::perf
