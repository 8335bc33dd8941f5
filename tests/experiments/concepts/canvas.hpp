// SPDX-License-Identifier: Apache-2.0
#pragma once
// An SVG picture of lines, areas and words, as text. The same calls, the same bytes.

#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace nearmesh::concepts {

using Point = std::array<double, 2>;

/// The colours of the player (docs/operate.md#watch): told apart by everybody, and by lightness.
struct Colours {
  static constexpr const char *kExact = "#1254a8", *kCoarse = "#a58a5c", *kOther = "#b86e00",
                              *kContact = "#d6006c", *kBox = "#6f7983", *kHalfSpace = "#1d7a49",
                              *kFull = "#9aa5b1", *kInk = "#101820", *kQuiet = "#454f5b";
};

/// How something is drawn.
struct Pen {
  const char* stroke = "none";
  double width = 1;
  const char* fill = "none";
  double fill_opacity = 1;
  const char* dashes = "";
};

struct Text {
  double size = 13;
  const char* fill = Colours::kInk;
  const char* anchor = "start";
  bool bold = false;
};

class Canvas {
 public:
  Canvas(double width, double height, std::string_view title);
  void lines(const std::vector<std::array<Point, 2>>& lines, const Pen& pen);
  void polygons(const std::vector<std::vector<Point>>& polygons, const Pen& pen);
  void circle(const Point& at, double radius, const Pen& pen);
  void text(const Point& at, std::string_view words, const Text& how = {});
  /// All that follows is cut to this rectangle, until end_clip().
  void begin_clip(const Point& at, double width, double height);
  void end_clip();
  /// A short stroke or square of this pen, and words beside it. Out: where the next may stand.
  double legend(const Point& at, const Pen& pen, std::string_view words);
  [[nodiscard]] std::string svg() const;

 private:
  std::string body_;
  int clips_ = 0;
};

/// From a plane of the world, in metres, to a rectangle of the picture; both axes alike.
struct Window {
  Point centre_m;
  double pixels_per_m = 1;
  Point at;  ///< of the rectangle's upper left corner
  double width = 0, height = 0;

  [[nodiscard]] Point operator()(const Point& p) const {
    return {at[0] + width / 2 + (p[0] - centre_m[0]) * pixels_per_m,
            at[1] + height / 2 - (p[1] - centre_m[1]) * pixels_per_m};
  }
};

}  // namespace nearmesh::concepts
