// SPDX-License-Identifier: Apache-2.0
#include "pictures.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "cut.hpp"
#include "parts.hpp"

namespace nearmesh::concepts {
namespace {

std::string format(const char* pattern, auto... values) {
  char text[256];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

std::vector<std::array<Point, 2>> on(const Window& window, const std::vector<CutFace>& faces,
                                     bool is_exact) {
  std::vector<std::array<Point, 2>> out;
  for (const CutFace& face : faces)
    if (face.is_exact == is_exact) out.push_back({window(face.line[0]), window(face.line[1])});
  return out;
}

std::vector<Point> on(const Window& window, const std::vector<Point>& polygon) {
  std::vector<Point> out;
  for (const Point& p : polygon) out.push_back(window(p));
  return out;
}

constexpr Pen kBoxPen{
    .stroke = Colours::kBox, .width = 1, .fill = Colours::kBox, .fill_opacity = 0.12};
constexpr Pen kWiderBoxPen{.stroke = Colours::kBox, .width = 1, .dashes = "2 3"};
constexpr Pen kRestPen{
    .stroke = Colours::kHalfSpace, .width = 1.5, .fill = Colours::kHalfSpace, .fill_opacity = 0.22};
constexpr Pen kFullPen{.stroke = Colours::kFull, .width = 1.2};
constexpr Pen kCoarsePen{.stroke = Colours::kCoarse, .width = 1.8, .dashes = "6 3"};
constexpr Pen kGroundPen{.stroke = Colours::kExact, .width = 3.2};
constexpr Pen kOtherPen{.stroke = Colours::kOther, .width = 3.2};
constexpr Pen kContactPen{.stroke = Colours::kContact, .width = 1, .fill = Colours::kContact};
constexpr Pen kSplitPen{.fill = Colours::kQuiet};
constexpr Pen kExactPen{.fill = Colours::kExact};
constexpr Pen kUnresolvedPen{.stroke = Colours::kInk, .width = 2, .fill = "#ffffff"};
constexpr Pen kBelowPen{.stroke = "#c9d0d7", .width = 1, .fill = "#c9d0d7"};

/// One body in the plane, with what its boxes and half-spaces leave.
void draw_body(Canvas& canvas, const Window& window, const Body& body, const ActiveMesh& mesh,
               double plane_m, const Pen& exact) {
  std::vector<std::vector<Point>> boxes, wider, rests;
  for (const CutNode& node : cut_nodes(body, unresolved_nodes(mesh), plane_m)) {
    (node.rest == node.box ? boxes : wider).push_back(on(window, node.box));
    if (node.rest != node.box && !node.rest.empty()) rests.push_back(on(window, node.rest));
  }
  canvas.polygons(boxes, kBoxPen);
  canvas.polygons(wider, kWiderBoxPen);
  canvas.polygons(rests, kRestPen);
  canvas.lines(on(window, cut_faces(body, full_faces(body.full.store), plane_m), true), kFullPen);
  const std::vector<CutFace> now = cut_faces(body, faces_now(mesh), plane_m);
  canvas.lines(on(window, now, false), kCoarsePen);
  canvas.lines(on(window, now, true), exact);
}

void draw_heading(Canvas& canvas, const Window& window, std::string_view words) {
  canvas.text({window.at[0], window.at[1] - 8}, words, {.size = 14, .bold = true});
}

/// Faces in a view.
std::vector<std::vector<Point>> on(const Window& window, const View& view, const Body& body,
                                   const std::vector<Face>& faces) {
  std::vector<std::vector<Point>> out;
  for (const Face& face : faces) {
    out.emplace_back();
    for (const VertexId corner : face.corners)
      out.back().push_back(window(view(body.place(corner))));
  }
  return out;
}

std::vector<Face> of_kind(const std::vector<Face>& faces, bool is_exact) {
  std::vector<Face> out;
  for (const Face& face : faces)
    if (face.is_exact == is_exact) out.push_back(face);
  return out;
}

constexpr View kFromAbove{{1, 0, 0}, {0, 1, 0}};

/// Around all these points, with some room.
Window around(const std::vector<std::vector<Point>>& polygons, const Point& at, double width,
              double height) {
  Point lo{1e9, 1e9}, hi{-1e9, -1e9};
  for (const std::vector<Point>& polygon : polygons)
    for (const Point& p : polygon)
      for (std::size_t k = 0; k < 2; ++k) {
        lo[k] = std::min(lo[k], p[k]);
        hi[k] = std::max(hi[k], p[k]);
      }
  return {{(lo[0] + hi[0]) / 2, (lo[1] + hi[1]) / 2},
          0.9 * std::min(width / (hi[0] - lo[0]), height / (hi[1] - lo[1])),
          at,
          width,
          height};
}

}  // namespace

std::string draw_cut(const Exchange& hill) {
  Canvas canvas(920, 1010, "Ground and a ball, cut by a plane: before and after one answer");
  const Place contact = hill.contacts.patches[0].centroid_m;
  const double plane_m = contact[1], middle_m = hill.other.motion.pose.translation_m[2] - 20;
  const ActiveMesh base_ground(hill.ground.held->store()), base_ball(hill.other.held->store());
  const std::array<Window, 3> windows{Window{{0, middle_m}, 0.88, {14, 124}, 892, 240},
                                      Window{{0, middle_m}, 0.88, {14, 404}, 892, 240},
                                      Window{{contact[0], contact[2] + 8}, 6, {14, 684}, 892, 312}};
  const std::string words[] = {
      format("First: the base meshes, of %zu and %zu faces. The answer is \"%s\".",
             hill.ground.full.store.base_faces().size(), hill.other.full.store.base_faces().size(),
             to_string(hill.first.status)),
      format("%zu bytes later: %u of %u and %u of %u splits. The answer is \"%s\", %zu pairs of "
             "faces.",
             hill.sent_bytes, hill.ground.held->mesh().split_count(),
             hill.ground.full.header.split_count(), hill.other.held->mesh().split_count(),
             hill.other.full.header.split_count(), to_string(hill.answer.status),
             hill.answer.pairs.size()),
      "The same, near the contact."};
  double x = canvas.legend({14, 54}, kFullPen, "full mesh");
  x = canvas.legend({x, 54}, kCoarsePen, "held, coarse");
  x = canvas.legend({x, 54}, kGroundPen, "held, exact: ground");
  x = canvas.legend({x, 54}, kOtherPen, "ball");
  canvas.legend({x, 54}, kContactPen, "they touch");
  x = canvas.legend({14, 80}, kBoxPen, "box of an unresolved node");
  x = canvas.legend({x, 80}, kWiderBoxPen, "such a box with half-spaces");
  canvas.legend({x, 80}, kRestPen, "what these leave of it");
  for (std::size_t panel = 0; panel < windows.size(); ++panel) {
    const Window& window = windows[panel];
    draw_heading(canvas, window, words[panel]);
    canvas.begin_clip(window.at, window.width, window.height);
    draw_body(canvas, window, hill.ground, panel == 0 ? base_ground : hill.ground.held->mesh(),
              plane_m, kGroundPen);
    draw_body(canvas, window, hill.other, panel == 0 ? base_ball : hill.other.held->mesh(), plane_m,
              kOtherPen);
    if (panel > 0)
      for (const ContactSegment& segment : hill.contacts.segments) {
        const Place &p = segment.p_m, &q = segment.q_m;
        if ((p[1] < plane_m) == (q[1] < plane_m)) continue;
        const double share = (plane_m - p[1]) / (q[1] - p[1]);
        canvas.circle(window({p[0] + share * (q[0] - p[0]), p[2] + share * (q[2] - p[2])}),
                      panel == 1 ? 3.5 : 6, kContactPen);
      }
    canvas.end_clip();
  }
  return canvas.svg();
}

std::string draw_forest(const Exchange& patch) {
  Canvas canvas(920, 800, "A forest, its front, and the mesh that the front stands for");
  const Body& ground = patch.ground;
  const SplitStore& full = ground.full.store;
  const ActiveMesh& mesh = ground.held->mesh();
  double x = canvas.legend({14, 54}, kSplitPen, "split");
  x = canvas.legend({x, 54}, kExactPen, "in the front: a vertex for itself alone");
  x = canvas.legend({x, 54}, kUnresolvedPen, "in the front: unresolved");
  x = canvas.legend({x, 54}, kBelowPen, "not here");
  canvas.legend({x, 54}, {.stroke = Colours::kOther, .width = 3}, "the ball");

  const double step = 892.0 / full.vertex_count();
  const auto at = [&](const ForestNode& n) {
    return Point{14 + step * (n.node.begin() + n.node.size / 2.0), 96 + 38.0 * n.depth};
  };
  const std::vector<ForestNode> nodes = forest_of(full, mesh);
  std::vector<std::array<Point, 2>> above, below;
  for (const ForestNode& n : nodes)
    if (n.parent)
      (n.kind == ForestNode::Kind::kBelow ? below : above).push_back({at(nodes[*n.parent]), at(n)});
  canvas.lines(below, kBelowPen);
  canvas.lines(above, {.stroke = Colours::kQuiet, .width = 1.4});

  const Window full_window{{0, 0}, 1.95, {14, 344}, 440, 440},
      held_window{{0, 0}, 1.95, {466, 344}, 440, 440};
  draw_heading(canvas, full_window,
               format("The full mesh, from above: %u vertices, %u faces", full.vertex_count(),
                      ground.full.header.face_count));
  draw_heading(canvas, held_window,
               format("The mesh held: %u of %u splits", mesh.split_count(),
                      ground.full.header.split_count()));
  const std::vector<Face> faces = faces_now(mesh);
  for (const Window& window : {full_window, held_window}) {
    canvas.begin_clip(window.at, window.width, window.height);
    canvas.polygons(on(window, kFromAbove, ground, full_faces(full)),
                    {.stroke = Colours::kFull, .width = 1});
    if (window.at == held_window.at) {
      canvas.polygons(on(window, kFromAbove, ground, of_kind(faces, false)),
                      {.stroke = Colours::kCoarse,
                       .width = 1.8,
                       .fill = Colours::kCoarse,
                       .fill_opacity = 0.15});
      canvas.polygons(
          on(window, kFromAbove, ground, of_kind(faces, true)),
          {.stroke = Colours::kExact, .width = 1.8, .fill = Colours::kExact, .fill_opacity = 0.3});
    }
    canvas.circle(window(kFromAbove(patch.other.motion.pose.translation_m)),
                  kPatchBall_m * window.pixels_per_m, {.stroke = Colours::kOther, .width = 3});
    canvas.end_clip();
  }
  for (const ForestNode& n : nodes) {
    const bool is_front =
        n.kind == ForestNode::Kind::kExact || n.kind == ForestNode::Kind::kUnresolved;
    if (n.kind == ForestNode::Kind::kBelow) canvas.circle(at(n), 2, {.fill = kBelowPen.fill});
    if (n.kind == ForestNode::Kind::kSplit) canvas.circle(at(n), 3.5, kSplitPen);
    if (n.node.size == 1)
      canvas.circle(full_window(kFromAbove(ground.place(n.node.first))), 2,
                    {.fill = Colours::kQuiet});
    if (!is_front) continue;
    const Pen& pen = n.kind == ForestNode::Kind::kExact ? kExactPen : kUnresolvedPen;
    const Point place = held_window(kFromAbove(ground.place(n.node.first)));
    const std::string name = n.node.size == 1 ? format("%u", n.node.begin())
                                              : format("%u-%u", n.node.begin(), n.node.end() - 1);
    canvas.circle(at(n), 6, pen);
    canvas.text({at(n)[0], at(n)[1] + (n.parent ? 19 : -9)}, name,
                {.size = 11, .anchor = "middle"});
    canvas.circle(place, 5, pen);
    const bool is_right = place[0] > held_window.at[0] + held_window.width - 60;
    canvas.text({place[0] + (is_right ? -8 : 8), place[1] + (is_right ? 16 : -6)}, name,
                {.size = 12, .anchor = is_right ? "end" : "start", .bold = true});
  }
  return canvas.svg();
}

std::string draw_slot(const Exchange& hill) {
  const Body& body = hill.ground;
  // The slot with the most faces.
  OpenedSlot slot;
  std::size_t most = 0;
  for (OpenedSlot& other : open_slots(*body.held)) {
    std::size_t faces = 0;
    for (const OpenedSlot::Lane& lane : other.lanes) faces += lane.faces.size();
    if (faces > most) slot = std::move(other);
    most = std::max(most, faces);
  }
  static const char* const kBlocks[] = {"#1254a8", "#2e9ccf", "#6a3d9a"};
  Canvas canvas(
      920, 620,
      format("A slot: vertices %u to %u, opened", slot.node.begin(), slot.node.end() - 1));

  std::vector<std::vector<Point>> boxes;
  for (const OpenedSlot::Lane& lane : slot.lanes)
    boxes.push_back(outline(body, lane.entry.box, kFromAbove));
  const Window window = around(boxes, {14, 74}, 560, 530);
  draw_heading(canvas, window, "From above");
  canvas.begin_clip(window.at, window.width, window.height);
  canvas.polygons(on(window, kFromAbove, body, faces_now(body.held->mesh())),
                  {.stroke = Colours::kCoarse, .width = 1});
  std::size_t blocks = 0;
  const OpenedSlot::Lane* shown = nullptr;
  Point note{600, 92};
  for (std::size_t i = 0; i < slot.lanes.size(); ++i) {
    const OpenedSlot::Lane& lane = slot.lanes[i];
    const bool is_block = !lane.faces.empty();
    const Pen pen = is_block ? Pen{.stroke = kBlocks[blocks % 3], .width = 2}
                             : Pen{.stroke = Colours::kInk, .width = 1.4, .dashes = "5 3"};
    std::vector<std::vector<Point>> faces;
    for (const TreeFace& face : lane.faces) {
      faces.emplace_back();
      for (const GridPoint& p : face.corners)
        faces.back().push_back(window(kFromAbove(body.place(p))));
    }
    canvas.polygons(faces,
                    {.stroke = "#ffffff", .width = 1, .fill = pen.stroke, .fill_opacity = 0.75});
    canvas.polygons({on(window, boxes[i])}, pen);
    if (is_block) {
      ++blocks;
      if (shown == nullptr || lane.faces.size() > shown->faces.size()) shown = &lane;
    }
  }
  for (std::size_t i = 0; i < slot.lanes.size(); ++i) {
    const Point corner = window({boxes[i][0][0], boxes[i][2][1]});
    canvas.text({corner[0] + 4, corner[1] + 15}, format("%zu", i), {.size = 13, .bold = true});
  }
  canvas.end_clip();
  blocks = 0;
  for (std::size_t i = 0; i < slot.lanes.size(); ++i) {
    const OpenedSlot::Lane& lane = slot.lanes[i];
    const bool is_block = !lane.faces.empty();
    const NodeSpan node = is_block ? NodeSpan{} : lane.entry.unresolved_node();
    canvas.legend(note,
                  is_block ? Pen{.fill = kBlocks[blocks % 3], .fill_opacity = 0.75}
                           : Pen{.stroke = Colours::kInk, .width = 1.4, .dashes = "5 3"},
                  is_block
                      ? format("lane %zu: a block of %zu exact faces", i, lane.faces.size())
                      : format("lane %zu: unresolved node %u-%u", i, node.begin(), node.end() - 1));
    if (is_block) ++blocks;
    note[1] += 24;
  }
  // One block from the side: its box, and the slab between two planes across the faces' mean
  // normal.
  const auto& n = shown->entry.slab.normal;
  const double level = std::sqrt(double(n[0]) * n[0] + double(n[1]) * n[1]);
  const View side{level > 0 ? Place{n[0] / level, n[1] / level, 0} : Place{1, 0, 0}, {0, 0, 1}};
  const std::vector<Point> box = outline(body, shown->entry.box, side);
  const CenteredBox middle = centered(shown->entry.box);
  const double cell_m = std::ldexp(1.0, body.grid().exponent);
  const Point normal{level > 0 ? level : double(n[0]), double(n[2])},
      centre = side(body.place(middle.center));
  const double at_centre = normal[0] * centre[0] + normal[1] * centre[1];
  const std::vector<Point> slab =
      clip(clip(box, normal, at_centre + shown->entry.slab.to * cell_m), {-normal[0], -normal[1]},
           -at_centre - shown->entry.slab.from * cell_m);
  const Window beside = around({box}, {600, 330}, 306, 220);
  draw_heading(
      canvas, beside,
      format("Lane %zu from the side", static_cast<std::size_t>(shown - slot.lanes.data())));
  canvas.begin_clip(beside.at, beside.width, beside.height);
  canvas.polygons(
      {on(beside, box)},
      {.stroke = Colours::kBox, .width = 1.5, .fill = Colours::kBox, .fill_opacity = 0.1});
  canvas.polygons({on(beside, slab)}, kRestPen);
  for (const TreeFace& face : shown->faces) {
    std::vector<Point> corners;
    for (const GridPoint& p : face.corners) corners.push_back(beside(side(body.place(p))));
    canvas.polygons(
        {corners},
        {.stroke = Colours::kExact, .width = 1.5, .fill = Colours::kExact, .fill_opacity = 0.3});
  }
  canvas.end_clip();
  canvas.legend({600, 576}, kBoxPen, "its box");
  canvas.legend({700, 576}, kRestPen, "its slab");
  return canvas.svg();
}

/// How bright a face is, in steps from 0 to kShades - 1.
constexpr int kShades = 12;
int shade_of(const Body& body, const Face& face) {
  const Place p = body.place(face.corners[0]), q = body.place(face.corners[1]),
              r = body.place(face.corners[2]);
  Place n;
  double square = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t l = (k + 1) % 3, m = (k + 2) % 3;
    n[k] = (q[l] - p[l]) * (r[m] - p[m]) - (q[m] - p[m]) * (r[l] - p[l]);
    square += n[k] * n[k];
  }
  if (square == 0) return 0;
  const double light = (-0.6 * n[0] + 0.48 * n[1] + 0.64 * n[2]) / std::sqrt(square);
  return std::max(0, static_cast<int>((kShades - 1) * light));
}

std::string draw_levels(const Exchange& hill) {
  Canvas canvas(920, 780, "One model in four states");
  const Body& body = hill.ground;
  // So steep that no slope hides another: faces may be drawn in any order.
  constexpr View kSteep{{0.8, 0.6, 0}, {-0.48, 0.64, 0.6}};
  ActiveMesh base(body.full.store), some(body.full.store), all(body.full.store);
  RefineDelta ignored;
  constexpr std::uint32_t kSome = 150;
  const std::vector<VertexId> order = global_order(body.full.store, body.full.header.split_count());
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i < kSome) static_cast<void>(some.split(order[i], ignored));
    static_cast<void>(all.split(order[i], ignored));
  }
  const struct {
    const char* name;
    const ActiveMesh* mesh;
  } states[] = {{"Base mesh", &base},
                {"Its largest nodes split", &some},
                {"Full mesh", &all},
                {"Held to answer for the ball", &body.held->mesh()}};
  std::vector<std::vector<Point>> extent;
  for (const Face& face : faces_now(all))
    for (const VertexId corner : face.corners) extent.push_back({kSteep(body.place(corner))});
  for (std::size_t i = 0; i < 4; ++i) {
    const Window window =
        around(extent, {14 + 452.0 * double(i % 2), 74 + 358.0 * double(i / 2)}, 440, 318);
    const std::vector<Face> faces = faces_now(*states[i].mesh);
    draw_heading(canvas, window,
                 format("%s: %zu faces, %zu exact", states[i].name, faces.size(),
                        of_kind(faces, true).size()));
    canvas.begin_clip(window.at, window.width, window.height);
    for (const bool is_exact : {false, true})
      for (int shade = 0; shade < kShades; ++shade) {
        std::vector<Face> alike;
        for (const Face& face : faces)
          if (face.is_exact == is_exact && shade_of(body, face) == shade) alike.push_back(face);
        const std::array<int, 3> dark =
            is_exact ? std::array{0x0b, 0x34, 0x6b} : std::array{0x6b, 0x5a, 0x3a};
        const std::array<int, 3> light =
            is_exact ? std::array{0x5a, 0x9b, 0xe8} : std::array{0xf3, 0xea, 0xd4};
        int colour[3];
        for (std::size_t k = 0; k < 3; ++k)
          colour[k] = dark[k] + (light[k] - dark[k]) * shade / (kShades - 1);
        const std::string fill = format("#%02x%02x%02x", colour[0], colour[1], colour[2]);
        canvas.polygons(
            on(window, kSteep, body, alike),
            {.stroke = is_exact ? "#0b346b" : "#6b5a3a", .width = 0.5, .fill = fill.c_str()});
      }
    canvas.end_clip();
  }
  canvas.legend({14, 774}, {.fill = "#c9bd9f"}, "coarse faces");
  canvas.legend({170, 774}, {.fill = Colours::kExact}, "exact faces: as in the full mesh");
  return canvas.svg();
}

std::string draw_certificate(const Exchange& hill) {
  Canvas canvas(920, 440, "Three ways in which a pair of parts is decided");
  constexpr double kTop = 78, kWide = 288, kHigh = 270;
  const auto left = [](std::size_t panel) { return 14 + 302.0 * double(panel); };
  const auto caption = [&](std::size_t panel, const std::vector<std::string>& lines) {
    for (std::size_t i = 0; i < lines.size(); ++i)
      canvas.text({left(panel), kTop + kHigh + 22 + 19 * double(i)}, lines[i],
                  {.fill = Colours::kQuiet});
  };
  const std::optional<ProvedApart> apart[] = {narrowest_boxes(hill), narrowest_half_space(hill)};
  const char* const words[] = {"1. Boxes are apart", "2. Boxes meet, a half-space parts"};
  for (std::size_t i = 0; i < 2; ++i) {
    if (!apart[i]) continue;
    const ProvedApart& pair = *apart[i];
    View view{{1, 0, 0}, {0, 0, 1}};
    Point normal{};
    double bound = 0;
    if (pair.axis == 1) view.right = {0, 1, 0};
    if (pair.half_space) {  // seen along its plane
      const auto& n = half_space_normal(pair.half_space->direction);
      const double level = std::sqrt(double(n[0]) * n[0] + double(n[1]) * n[1]);
      if (level > 0) view.right = {n[0] / level, n[1] / level, 0};
      const Point vertex = view(hill.ground.place(pair.a.node.first));
      normal = {level, double(n[2])};
      bound =
          normal[0] * vertex[0] + normal[1] * vertex[1] +
          std::ldexp(double(half_space_reach(pair.half_space->reach)), hill.ground.grid().exponent);
    }
    const std::vector<Point> box_a = outline(hill.ground, pair.a.box, view),
                             box_b = outline(hill.other, pair.b.box, view);
    const Window window = around({box_a, box_b}, {left(i), kTop}, kWide, kHigh);
    draw_heading(canvas, window, words[i]);
    canvas.begin_clip(window.at, window.width, window.height);
    const Pen ground{
        .stroke = Colours::kExact, .width = 2, .fill = Colours::kBox, .fill_opacity = 0.12};
    const Pen other{
        .stroke = Colours::kOther, .width = 2, .fill = Colours::kBox, .fill_opacity = 0.12};
    canvas.polygons({on(window, box_a)}, pair.half_space ? kWiderBoxPen : ground);
    canvas.polygons({on(window, box_b)}, other);
    if (pair.half_space) canvas.polygons({on(window, clip(box_a, normal, bound))}, kRestPen);
    for (const auto& [body, node] :
         {std::pair{&hill.ground, pair.a.node}, std::pair{&hill.other, pair.b.node}})
      canvas.polygons(on(window, view, *body, faces_at(*body, node)),
                      {.stroke = Colours::kFull, .width = 1.2});
    canvas.end_clip();
  }
  caption(0,
          {"Blue: box of an unresolved node of the", "ground. Orange: one of the ball's. Grey: all",
           "faces of these nodes, held or not."});
  caption(1, {"The dotted box meets the orange one.", "Green: what the half-space leaves of it,",
              "seen along its plane."});

  // The pair of exact faces with the longest contact.
  const auto length = [](const ContactSegment& s) {
    double square = 0;
    for (std::size_t k = 0; k < 3; ++k) square += (s.q_m[k] - s.p_m[k]) * (s.q_m[k] - s.p_m[k]);
    return square;
  };
  const ContactSegment& longest = *std::max_element(
      hill.contacts.segments.begin(), hill.contacts.segments.end(),
      [&](const ContactSegment& s, const ContactSegment& t) { return length(s) < length(t); });
  const View oblique{{0.8, 0.6, 0}, {-0.36, 0.48, 0.8}};
  const auto triangle = [&](const Body& body, FaceKey key) {
    std::vector<Point> out;
    for (const VertexId corner : body.full.store.face(key).corners())
      out.push_back(oblique(body.place(corner)));
    return out;
  };
  const std::vector<Point> face_a = triangle(hill.ground, longest.pair.a),
                           face_b = triangle(hill.other, longest.pair.b);
  const Window window = around({face_a, face_b}, {left(2), kTop}, kWide, kHigh);
  draw_heading(canvas, window, "3. Two exact faces: integers decide");
  canvas.begin_clip(window.at, window.width, window.height);
  canvas.polygons(
      {on(window, face_a)},
      {.stroke = Colours::kExact, .width = 2, .fill = Colours::kExact, .fill_opacity = 0.3});
  canvas.polygons(
      {on(window, face_b)},
      {.stroke = Colours::kOther, .width = 2, .fill = Colours::kOther, .fill_opacity = 0.3});
  canvas.lines({{window(oblique(longest.p_m)), window(oblique(longest.q_m))}},
               {.stroke = Colours::kContact, .width = 4});
  canvas.end_clip();
  caption(2, {"A face of the ground and one of the ball.",
              "Both are as in the full meshes. The pink", "segment is what they share."});
  return canvas.svg();
}

Result<std::vector<Picture>> draw_all() {
  const Result<Exchange> hill = ball_on_hill();
  if (!hill.is_ok()) return hill.status();
  const Result<Exchange> patch = ball_on_patch();
  if (!patch.is_ok()) return patch.status();
  return std::vector<Picture>{{"levels", draw_levels(hill.value())},
                              {"cut", draw_cut(hill.value())},
                              {"forest", draw_forest(patch.value())},
                              {"slot", draw_slot(hill.value())},
                              {"certificate", draw_certificate(hill.value())}};
}

}  // namespace nearmesh::concepts
