// SPDX-License-Identifier: Apache-2.0
// That the pictures of docs/concepts.md are true, and those that are drawn now.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>
#include <sstream>

#include "cut.hpp"
#include "parts.hpp"
#include "pictures.hpp"

namespace nearmesh::concepts {
namespace {

constexpr double kRounding_m = 1e-6;

const Exchange& hill() {
  static const Exchange kHill = std::move(ball_on_hill()).value();
  return kHill;
}
const Exchange& patch() {
  static const Exchange kPatch = std::move(ball_on_patch()).value();
  return kPatch;
}
std::vector<const Body*> bodies() {
  return {&hill().ground, &hill().other, &patch().ground, &patch().other};
}

bool has_corner_in(const Face& face, NodeSpan node) {
  return std::any_of(face.corners.begin(), face.corners.end(),
                     [&](VertexId v) { return node.contains(v); });
}

/// How far a point lies outside a convex polygon that runs counter-clockwise, or clockwise.
double outside_m(const std::vector<Point>& polygon, const Point& p) {
  double worst = -1e9, area = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &u = polygon[i], &v = polygon[(i + 1) % polygon.size()];
    area += u[0] * v[1] - u[1] * v[0];
  }
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &u = polygon[i], &v = polygon[(i + 1) % polygon.size()];
    const double length = std::hypot(v[0] - u[0], v[1] - u[1]);
    const double cross = (v[0] - u[0]) * (p[1] - u[1]) - (v[1] - u[1]) * (p[0] - u[0]);
    if (length > 0) worst = std::max(worst, (area > 0 ? -cross : cross) / length);
  }
  return worst;
}

TEST(ConceptsExchange, AnswersAsTheFullMeshesDo) {
  for (const Exchange* exchange : {&hill(), &patch()}) {
    EXPECT_EQ(exchange->first.status, AnswerStatus::kUncertain);
    EXPECT_EQ(exchange->answer.status, AnswerStatus::kContact);
    EXPECT_EQ(exchange->answer.pairs, exchange->truth.pairs);
    EXPECT_LT(exchange->ground.held->mesh().split_count(),
              exchange->ground.full.header.split_count() / 2);
  }
}

TEST(ConceptsCut, WhatIsLeftOfABoxHoldsAllFacesOfItsNode) {
  std::size_t held = 0, told = 0;
  for (const Body* body : bodies()) {
    const std::vector<Face> faces = full_faces(body->full.store);
    const std::vector<Unresolved> nodes = unresolved_nodes(body->held->mesh());
    for (double y_m = -60.3; y_m < 60; y_m += 7) {
      for (const CutNode& node : cut_nodes(*body, nodes, y_m)) {
        told += node.rest == node.box ? 0 : 1;
        std::vector<Face> own;
        std::copy_if(faces.begin(), faces.end(), std::back_inserter(own),
                     [&](const Face& face) { return has_corner_in(face, node.node); });
        for (const CutFace& cut : cut_faces(*body, own, y_m))
          for (const Point& p : cut.line) {
            ++held;
            ASSERT_GT(node.rest.size(), 2U);
            ASSERT_LT(outside_m(node.rest, p), kRounding_m)
                << to_string(node.node) << " at " << y_m;
          }
      }
    }
  }
  EXPECT_GT(held, 1000U);
  EXPECT_GT(told, 10U);
}

TEST(ConceptsCut, ExactFacesAreFacesOfTheFullMesh) {
  for (const Body* body : bodies()) {
    std::set<std::array<Point, 2>> full;
    const double y_m = 3.7;
    for (const CutFace& face : cut_faces(*body, full_faces(body->full.store), y_m))
      full.insert(face.line);
    for (const CutFace& face : cut_faces(*body, faces_now(body->held->mesh()), y_m))
      EXPECT_TRUE(!face.is_exact || full.contains(face.line));
  }
}

TEST(ConceptsForest, FrontSharesOutAllVertices) {
  for (const Body* body : bodies()) {
    const std::vector<ForestNode> nodes = forest_of(body->full.store, body->held->mesh());
    std::uint32_t next = 0, splits = 0;
    for (const ForestNode& n : nodes) {
      splits += n.kind == ForestNode::Kind::kSplit ? 1 : 0;
      if (n.kind == ForestNode::Kind::kSplit || n.kind == ForestNode::Kind::kBelow) continue;
      EXPECT_EQ(n.node.begin(), next);
      EXPECT_EQ(n.kind == ForestNode::Kind::kExact, body->held->mesh().is_resolved(n.node.first));
      next = n.node.end();
    }
    EXPECT_EQ(next, body->full.store.vertex_count());
    EXPECT_EQ(splits, body->held->mesh().split_count());
  }
}

TEST(ConceptsSlot, LanesHoldItsExactFacesAndItsUnresolvedNodes) {
  std::size_t slots = 0;
  for (const Body* body : bodies()) {
    for (const OpenedSlot& slot : open_slots(*body->held)) {
      ++slots;
      std::set<FaceKey> drawn, known;
      std::vector<NodeSpan> nodes, unresolved;
      for (const OpenedSlot::Lane& lane : slot.lanes) {
        for (const TreeFace& face : lane.faces) {
          drawn.insert(face.key);
          for (const GridPoint& p : face.corners) {
            GridBox corner;
            corner.add(p);
            EXPECT_TRUE(lane.entry.box.contains(corner));
            const CenteredBox middle = centered(lane.entry.box);
            double along = 0;
            for (int k = 0; k < 3; ++k)
              along += lane.entry.slab.normal[static_cast<std::size_t>(k)] *
                       (p[k] - middle.center[static_cast<std::size_t>(k)]);
            EXPECT_GE(along, double{lane.entry.slab.from});
            EXPECT_LE(along, double{lane.entry.slab.to});
          }
        }
        if (lane.faces.empty()) nodes.push_back(lane.entry.unresolved_node());
      }
      const ActiveMesh& mesh = body->held->mesh();
      for (const Face& face : faces_now(mesh))
        if (face.is_exact && slot.node.contains(mesh.store().face(face.key).right))
          known.insert(face.key);
      for (const Unresolved& node : unresolved_nodes(mesh))
        if (slot.node.contains(node.node.first)) unresolved.push_back(node.node);
      std::sort(nodes.begin(), nodes.end());
      EXPECT_EQ(drawn, known);
      EXPECT_EQ(nodes, unresolved);
      EXPECT_LE(slot.node.size, kSlotSize);
    }
  }
  EXPECT_GT(slots, 0U);
}

TEST(ConceptsCertificate, PartsShownApartAreApart) {
  const auto boxes = narrowest_boxes(hill()), half_space = narrowest_half_space(hill());
  ASSERT_TRUE(boxes && half_space);
  double highest = -1e9, lowest = 1e9;
  const auto axis = static_cast<std::size_t>(boxes->axis);
  for (const Face& face : faces_at(hill().ground, boxes->a.node))
    for (const VertexId v : face.corners) {
      highest = std::max(highest, hill().ground.place(v)[axis]);
      lowest = std::min(lowest, hill().ground.place(v)[axis]);
    }
  for (const Face& face : faces_at(hill().other, boxes->b.node))
    for (const VertexId v : face.corners) {
      const double at = hill().other.place(v)[axis];
      EXPECT_TRUE(at >= highest + boxes->gap_m || at <= lowest - boxes->gap_m);
    }
  const auto& n = half_space_normal(half_space->half_space->direction);
  const auto along = [&](const Place& p) { return n[0] * p[0] + n[1] * p[1] + n[2] * p[2]; };
  double farthest = -1e9;
  for (const Face& face : faces_at(hill().ground, half_space->a.node))
    for (const VertexId v : face.corners)
      farthest = std::max(farthest, along(hill().ground.place(v)));
  for (const Face& face : faces_at(hill().other, half_space->b.node))
    for (const VertexId v : face.corners) EXPECT_GT(along(hill().other.place(v)), farthest);
}

TEST(ConceptsPictures, OfTheDocsAreThoseThatAreDrawn) {
  const auto pictures = draw_all();
  ASSERT_TRUE(pictures.is_ok()) << pictures.status().message();
  for (const Picture& picture : pictures.value()) {
    std::ifstream file(std::string(NEARMESH_CONCEPTS_DIR) + '/' + picture.name + ".svg",
                       std::ios::binary);
    std::ostringstream stored;
    stored << file.rdbuf();
    EXPECT_TRUE(stored.str() == picture.svg)
        << picture.name << ".svg: draw it anew: nearmesh-draw-concepts docs/concepts";
  }
}

}  // namespace
}  // namespace nearmesh::concepts
