// SPDX-License-Identifier: Apache-2.0
// PQP: two models of OBB and RSS trees, PQP_Collide() and PQP_Distance().
#include <PQP.h>

#include <stdexcept>

#include "peers.hpp"

namespace nearmesh::peers {
namespace {

class Pqp : public Peer {
 public:
  Pqp(const IndexedMesh& a, const IndexedMesh& b) {
    build(a, a_.model);
    build(b, b_.model);
  }

  void place(const Pose& a, const Pose& b) override {
    a_.place(a);
    b_.place(b);
  }
  bool touches() override { return collide(PQP_FIRST_CONTACT) > 0; }
  std::optional<std::uint64_t> count_pairs() override { return collide(PQP_ALL_CONTACTS); }
  // A search begins with the triangles that were nearest in the one before. Poses here do not
  // follow each other, and the same one is timed several times: each begins as the first of all
  // does.
  std::optional<double> distance_m() override {
    a_.model.last_tri = a_.model.tris;
    b_.model.last_tri = b_.model.tris;
    PQP_DistanceResult result;
    PQP_Distance(&result, a_.rotation, a_.translation, &a_.model, b_.rotation, b_.translation,
                 &b_.model, 0, 0);
    return result.Distance();
  }

 private:
  struct Body {
    PQP_Model model;
    PQP_REAL rotation[3][3] = {}, translation[3] = {};

    void place(const Pose& pose) {
      for (std::size_t row = 0; row < 3; ++row) {
        translation[row] = pose.translation_m[row];
        for (std::size_t column = 0; column < 3; ++column)
          rotation[row][column] = pose.rotation[3 * row + column];
      }
    }
  };

  static void build(const IndexedMesh& mesh, PQP_Model& model) {
    model.BeginModel(static_cast<int>(mesh.faces.size()));
    int id = 0;
    for (const auto& f : mesh.faces)
      model.AddTri(mesh.positions_m[f[0]].data(), mesh.positions_m[f[1]].data(),
                   mesh.positions_m[f[2]].data(), id++);
    if (model.EndModel() != PQP_OK) throw std::runtime_error("PQP refuses the mesh");
  }

  std::uint64_t collide(int flag) {
    PQP_Collide(&found_, a_.rotation, a_.translation, &a_.model, b_.rotation, b_.translation,
                &b_.model, flag);
    return static_cast<std::uint64_t>(found_.NumPairs());
  }

  Body a_, b_;
  PQP_CollideResult found_;  // keeps its memory from query to query
};

}  // namespace

PeerInfo pqp() {
  return {.name = "pqp",
          .library = "PQP",
          .version = "1.3",
          .counts_exactly = true,
          .make = [](const IndexedMesh& a, const IndexedMesh& b) -> std::unique_ptr<Peer> {
            return std::make_unique<Pqp>(a, b);
          }};
}

}  // namespace nearmesh::peers
