// SPDX-License-Identifier: Apache-2.0
#include "peers.hpp"

namespace nearmesh::peers {

std::vector<PeerInfo> timed_peers() {
  std::vector<PeerInfo> found;
#ifdef NEARMESH_PEER_PQP
  found.push_back(pqp());
#endif
#ifdef NEARMESH_PEER_FCL
  found.push_back(fcl_obb());
  found.push_back(fcl_obbrss());
#endif
#ifdef NEARMESH_PEER_COAL
  found.push_back(coal_obbrss());
#endif
#ifdef NEARMESH_PEER_BULLET
  found.push_back(bullet());
#endif
#ifdef NEARMESH_PEER_EMBREE
  found.push_back(embree());
#endif
#ifdef NEARMESH_PEER_CGAL
  found.push_back(cgal_rigid());
#endif
  return found;
}

}  // namespace nearmesh::peers
