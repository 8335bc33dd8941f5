// SPDX-License-Identifier: Apache-2.0
// A scene drawn as SVG: triangles projected along one direction, flat-shaded, the farthest first.
// What is large is cut until no edge is longer than some pixels: so the order by centres is right but for a few pixels, and
// colours run from corner to corner.
#include <algorithm>
#include <cmath>
#include <limits>

#include "html_parts.hpp"
#include "mesh_colours.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber::report {
namespace {

using Vector = std::array<double, 3>;

constexpr double kPictureWidth = 640, kPictureHeight = 420;
constexpr double kLongestEdge = 18, kLeastArea = 0.05;  // in units of the picture
constexpr double kLeastOutlined = 8;  // faces whose edges are all shorter have no outline
constexpr std::size_t kMostPieces = 15'000;
// The camera looks down at an angle, from the south-west (z is up); right and up span the picture.
constexpr Vector kToRight{0.8, -0.6, 0}, kToTop{0.36, 0.48, 0.8}, kToViewer{-0.48, -0.64, 0.6};
constexpr Vector kLight{-0.36, -0.48, 0.8};

double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

struct Corner {
  double x = 0, y = 0, depth = 0;  // depth grows away from the eye
  std::array<double, 3> colour{};
};

struct Triangle {
  std::array<Corner, 3> corners;
  std::array<bool, 3> outlined{};  // edge i, from corner i on, is one of the face
};

struct Piece {
  Triangle triangle;
  double depth = 0, area = 0;
  Colour colour{};
};

double square_of_edge(const Triangle& t, std::size_t i) {
  const Corner &a = t.corners[i], &b = t.corners[(i + 1) % 3];
  return (b.x - a.x) * (b.x - a.x) + (b.y - a.y) * (b.y - a.y);
}

std::size_t longest_edge(const Triangle& t) {
  std::size_t longest = 0;
  for (std::size_t i = 1; i < 3; ++i)
    if (square_of_edge(t, i) > square_of_edge(t, longest)) longest = i;
  return longest;
}

Corner middle(const Corner& a, const Corner& b) {
  Corner m{(a.x + b.x) / 2, (a.y + b.y) / 2, (a.depth + b.depth) / 2};
  for (std::size_t k = 0; k < 3; ++k) m.colour[k] = (a.colour[k] + b.colour[k]) / 2;
  return m;
}

class Picture {
 public:
  /// About the middle of `body`.
  explicit Picture(const RecordedBody& body) {
    Vector lo, hi;
    lo.fill(std::numeric_limits<double>::max());
    hi.fill(std::numeric_limits<double>::lowest());
    for (const Vector& at : body.positions_world_m)
      for (std::size_t k = 0; k < 3; ++k) {
        lo[k] = std::min(lo[k], at[k]);
        hi[k] = std::max(hi[k], at[k]);
      }
    double square = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      centre_[k] = (lo[k] + hi[k]) / 2;
      square += (hi[k] - lo[k]) * (hi[k] - lo[k]);
    }
    scale_ = square > 0 ? kPictureHeight / (1.5 * std::sqrt(square)) : 1;
  }

  void add(const RecordedBody& body, bool other) {
    for (const auto& face : body.faces) {
      Triangle triangle;
      std::array<Vector, 3> at;
      for (std::size_t i = 0; i < 3; ++i) {
        at[i] = body.positions_world_m[face[i]];
        triangle.corners[i] = project(at[i]);
        const Colour colour = vertex_colour(body.eps_m[face[i]], body.size_m, other);
        for (std::size_t k = 0; k < 3; ++k) triangle.corners[i].colour[k] = colour[k];
      }
      triangle.outlined.fill(square_of_edge(triangle, longest_edge(triangle)) >=
                             kLeastOutlined * kLeastOutlined);
      cut(triangle, brightness(at));
    }
  }
  [[nodiscard]] std::string draw(const std::vector<ContactSegment>& segments) {
    if (pieces_.size() > kMostPieces) {
      std::stable_sort(pieces_.begin(), pieces_.end(),
                       [](const Piece& a, const Piece& b) { return a.area > b.area; });
      left_out_ = pieces_.size() - kMostPieces;
      pieces_.resize(kMostPieces);
    }
    std::stable_sort(pieces_.begin(), pieces_.end(),
                     [](const Piece& a, const Piece& b) { return a.depth > b.depth; });
    std::string out;
    for (const Piece& piece : pieces_) {
      draw(piece, out);
    }
    if (segments.empty()) return out;
    out += "<path class=\"contact\" d=\"";
    for (const ContactSegment& segment : segments)
      out += "M" + place(project(segment.p_m)) + " L" + place(project(segment.q_m));
    return out + "\"/>";
  }
  [[nodiscard]] std::size_t left_out() const { return left_out_; }
  [[nodiscard]] double metres_across() const { return kPictureWidth / scale_; }

 private:
  [[nodiscard]] Corner project(const Vector& at) const {
    Vector from{};
    for (std::size_t k = 0; k < 3; ++k) from[k] = at[k] - centre_[k];
    return {kPictureWidth / 2 + scale_ * dot(from, kToRight),
            kPictureHeight / 2 - scale_ * dot(from, kToTop), -dot(from, kToViewer)};
  }
  static void draw(const Piece& piece, std::string& out) {
    const auto& corners = piece.triangle.corners;
    out += "<path color=\"#";
    for (const std::uint8_t channel : piece.colour) {
      constexpr const char* kDigits = "0123456789abcdef";
      out += kDigits[channel >> 4];
      out += kDigits[channel & 15];
    }
    out += "\" d=\"M";
    for (const Corner& corner : corners) out += place(corner) + " ";
    out += "z\"/>";
    std::string outline;
    for (std::size_t i = 0; i < 3; ++i)
      if (piece.triangle.outlined[i])
        outline += "M" + place(corners[i]) + " " + place(corners[(i + 1) % 3]);
    if (!outline.empty()) out += "<path class=\"o\" d=\"" + outline + "\"/>";
  }
  static std::string place(const Corner& corner) {
    const auto tenth = [](double x) { return number(std::floor(x * 10 + 0.5) / 10, 6); };
    return tenth(corner.x) + " " + tenth(corner.y);
  }
  /// Both sides of a face are lit alike.
  static double brightness(const std::array<Vector, 3>& at) {
    Vector u{}, v{};
    for (std::size_t k = 0; k < 3; ++k) {
      u[k] = at[1][k] - at[0][k];
      v[k] = at[2][k] - at[0][k];
    }
    const Vector normal{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                        u[0] * v[1] - u[1] * v[0]};
    const double length = std::sqrt(dot(normal, normal));
    return length > 0 ? 0.45 + 0.55 * std::abs(dot(normal, kLight)) / length : 1;
  }
  void cut(const Triangle& whole, double light) {
    std::vector<Triangle> stack{whole};
    while (!stack.empty()) {
      const Triangle triangle = stack.back();
      stack.pop_back();
      const std::array<Corner, 3>& t = triangle.corners;
      const auto [x0, x1] = std::minmax({t[0].x, t[1].x, t[2].x});
      const auto [y0, y1] = std::minmax({t[0].y, t[1].y, t[2].y});
      if (!(x1 >= 0 && x0 <= kPictureWidth && y1 >= 0 && y0 <= kPictureHeight)) continue;
      const std::size_t i = longest_edge(triangle), next = (i + 1) % 3, last = (i + 2) % 3;
      if (square_of_edge(triangle, i) > kLongestEdge * kLongestEdge) {
        const Corner m = middle(t[i], t[next]);
        const auto& o = triangle.outlined;
        stack.push_back({{t[i], m, t[last]}, {o[i], false, o[last]}});
        stack.push_back({{m, t[next], t[last]}, {o[i], o[next], false}});
        continue;
      }
      Piece piece{.triangle = triangle};
      piece.area =
          std::abs((t[1].x - t[0].x) * (t[2].y - t[0].y) - (t[2].x - t[0].x) * (t[1].y - t[0].y)) /
          2;
      if (piece.area < kLeastArea) continue;
      piece.depth = (t[0].depth + t[1].depth + t[2].depth) / 3;
      for (std::size_t k = 0; k < 3; ++k)
        piece.colour[k] = static_cast<std::uint8_t>(
            light * (t[0].colour[k] + t[1].colour[k] + t[2].colour[k]) / 3);
      pieces_.push_back(piece);
    }
  }

  Vector centre_{};
  double scale_ = 1;  // units of the picture a metre
  std::vector<Piece> pieces_;
  std::size_t left_out_ = 0;
};

std::string describe(const RecordedBody& body) {
  const auto exact = std::count_if(body.faces.begin(), body.faces.end(), [&](const auto& face) {
    return std::all_of(face.begin(), face.end(),
                       [&](std::uint32_t corner) { return body.eps_m[corner] == 0; });
  });
  return body.name + ": " + std::to_string(body.faces.size()) + " faces, " + std::to_string(exact) +
         " of them exact, eps up to " +
         number(*std::max_element(body.eps_m.begin(), body.eps_m.end())) + " m";
}

/// "1.5 s on the exercise's clock, the pose of hull 0 s old, that of quay 0.02 s".
std::string ages(const wire::ContactReport& report) {
  const auto age = [&](const wire::ContactReport::Asked& asked) {
    return number(wire::age_s(asked.stamp, report.time_s)) + " s";
  };
  return number(report.time_s, 6) + " s on the exercise's clock, the pose of " + report.body_a +
         " " + age(report.a) + " old, that of " + report.body_b + " " + age(report.b);
}

}  // namespace

std::string picture_figure(const RecordedScene& scene, const std::string& why, double time_s) {
  const std::size_t smaller = scene.bodies[0].size_m < scene.bodies[1].size_m ? 0 : 1;
  Picture picture(scene.bodies[smaller]);
  picture.add(scene.bodies[smaller], false);
  picture.add(scene.bodies[1 - smaller], true);
  const std::string drawing = picture.draw(scene.contacts.segments);
  const std::string title = why + ": " + number(time_s, 6) + " s, peer " +
                            wire::partition_of(scene.report.peer) + ", frame " +
                            std::to_string(scene.report.frame);
  const std::string description =
      scene.report.body_a + " and " + scene.report.body_b + ", " +
      to_string(static_cast<AnswerStatus>(scene.report.status)) + " with " +
      std::to_string(scene.report.pair_count) + " touching face pairs. " + ages(scene.report) +
      ". " + describe(scene.bodies[smaller]) + ". " + describe(scene.bodies[1 - smaller]) + ". " +
      number(picture.metres_across(), 3) + " m across.";
  std::string caption = "<strong>" + escape(title) + "</strong><br>" + escape(description);
  if (picture.left_out() > 0)
    caption += " The " + std::to_string(picture.left_out()) + " smallest pieces are left out.";
  return "<figure class=\"picture\"><svg role=\"img\" viewBox=\"0 0 " + number(kPictureWidth) +
         " " + number(kPictureHeight) + "\" aria-label=\"" + escape(title + ". " + description) +
         "\"><title>" + escape(title) + "</title><desc>" + escape(description) +
         "</desc><g class=\"mesh\">" + drawing + "</g></svg><figcaption>" + caption +
         "</figcaption></figure>\n";
}

}  // namespace nearmesh::subscriber::report
