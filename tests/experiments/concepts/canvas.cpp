// SPDX-License-Identifier: Apache-2.0
#include "canvas.hpp"

#include <cmath>
#include <cstdio>

namespace nearmesh::concepts {
namespace {

/// One decimal; no "-0.0".
std::string number(double x) {
  char text[32];
  const double tenths = std::floor(x * 10 + 0.5);
  std::snprintf(text, sizeof text, "%g", (tenths == 0 ? 0.0 : tenths) / 10);
  return text;
}

std::string path_of(const Point& p) { return number(p[0]) + "," + number(p[1]); }

std::string style_of(const Pen& pen) {
  std::string out = std::string(" stroke=\"") + pen.stroke + "\" stroke-width=\"" +
                    number(pen.width) + "\" fill=\"" + pen.fill + '"';
  if (pen.fill_opacity < 1) out += " fill-opacity=\"" + number(pen.fill_opacity) + '"';
  if (*pen.dashes != 0) out += std::string(" stroke-dasharray=\"") + pen.dashes + '"';
  return out + " stroke-linejoin=\"round\"";
}

std::string escaped(std::string_view words) {
  std::string out;
  for (const char c : words) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else
      out += c;
  }
  return out;
}

}  // namespace

Canvas::Canvas(double width, double height, std::string_view title) {
  const std::string w = number(width), h = number(height);
  body_ = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " + w + ' ' + h + "\" width=\"" +
          w + "\" height=\"" + h + "\" font-family=\"Helvetica, Arial, sans-serif\">\n<title>" +
          escaped(title) + "</title>\n<rect width=\"" + w + "\" height=\"" + h +
          "\" fill=\"#ffffff\"/>\n";
  text({14, 28}, title, {.size = 18, .bold = true});
}

void Canvas::lines(const std::vector<std::array<Point, 2>>& lines, const Pen& pen) {
  if (lines.empty()) return;
  body_ += "<path" + style_of(pen) + " stroke-linecap=\"round\" d=\"";
  for (const auto& [from, to] : lines) body_ += 'M' + path_of(from) + 'L' + path_of(to);
  body_ += "\"/>\n";
}

void Canvas::polygons(const std::vector<std::vector<Point>>& polygons, const Pen& pen) {
  if (polygons.empty()) return;
  body_ += "<path" + style_of(pen) + " d=\"";
  for (const std::vector<Point>& polygon : polygons) {
    char step = 'M';
    for (const Point& p : polygon) {
      body_ += step + path_of(p);
      step = 'L';
    }
    body_ += 'Z';
  }
  body_ += "\"/>\n";
}

void Canvas::circle(const Point& at, double radius, const Pen& pen) {
  body_ += "<circle cx=\"" + number(at[0]) + "\" cy=\"" + number(at[1]) + "\" r=\"" +
           number(radius) + '"' + style_of(pen) + "/>\n";
}

void Canvas::text(const Point& at, std::string_view words, const Text& how) {
  body_ += "<text x=\"" + number(at[0]) + "\" y=\"" + number(at[1]) + "\" font-size=\"" +
           number(how.size) + "\" fill=\"" + how.fill + "\" text-anchor=\"" + how.anchor + '"' +
           (how.bold ? " font-weight=\"bold\"" : "") + '>' + escaped(words) + "</text>\n";
}

void Canvas::begin_clip(const Point& at, double width, double height) {
  const std::string name = "clip" + std::to_string(clips_++);
  const std::string rectangle = "<rect x=\"" + number(at[0]) + "\" y=\"" + number(at[1]) +
                                "\" width=\"" + number(width) + "\" height=\"" + number(height) +
                                "\"";
  body_ += "<clipPath id=\"" + name + "\">" + rectangle + "/></clipPath>\n" + rectangle +
           " fill=\"#f4f7fa\"/>\n<g clip-path=\"url(#" + name + ")\">\n";
}

void Canvas::end_clip() { body_ += "</g>\n"; }

double Canvas::legend(const Point& at, const Pen& pen, std::string_view words) {
  const double x = at[0], y = at[1] - 4.5;
  if (std::string_view(pen.fill) == "none")
    lines({{Point{x, y}, Point{x + 24, y}}}, pen);
  else
    polygons({{{x, y - 6}, {x + 24, y - 6}, {x + 24, y + 6}, {x, y + 6}}}, pen);
  text({x + 31, at[1]}, words, {.fill = Colours::kQuiet});
  return x + 31 + 7.1 * static_cast<double>(words.size()) + 16;
}

std::string Canvas::svg() const { return body_ + "</svg>\n"; }

}  // namespace nearmesh::concepts
