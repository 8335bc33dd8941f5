// SPDX-License-Identifier: Apache-2.0
#include "measures.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace nearmesh::program {
namespace {

constexpr double kSmall_m = 0.01, kLarge_m = 10'000;

const char* source_name(OriginSource source) {
  constexpr const char* kNames[] = {"assumed", "file", "format", "option"};
  return kNames[static_cast<int>(source)];
}

const char* axis_name(UpAxis axis) {
  constexpr const char* kNames[] = {"unknown", "x", "y", "z"};
  return kNames[static_cast<int>(axis)];
}

std::string number(double x) {
  char text[40];
  std::snprintf(text, sizeof text, "%.9g", x);
  return text;
}

std::string units_text(const MeshOrigin& origin) {
  constexpr const char* kSources[] = {"assumed: neither the file nor its format states it",
                                      "stated by the file", "by the format", "as --unit says"};
  std::string text = "1 unit of the file is " + number(origin.unit_m) + " m, " +
                     kSources[static_cast<int>(origin.unit_source)];
  if (origin.scale != 1) text += "; scaled by " + number(origin.scale);
  return text;
}

std::string axes_text(const MeshOrigin& origin) {
  if (origin.z_up)
    return std::string("z is up: ") + axis_name(origin.up) + " is up in the file, as --up says";
  if (origin.up_source == OriginSource::kNobody)
    return "as in the file; neither it nor its format states which is up";
  return std::string("as in the file: ") + axis_name(origin.up) + " is up, " +
         (origin.up_source == OriginSource::kFile ? "stated by the file" : "by the format");
}

}  // namespace

Measures measure(const Grid& grid, const GridBox& box, const MeshOrigin& origin) {
  Measures out{.origin = origin};
  for (std::size_t k = 0; k < 3; ++k) {
    out.lo_m[k] = grid.origin_m[k] + std::ldexp(box.lo[static_cast<int>(k)], grid.exponent);
    out.hi_m[k] = grid.origin_m[k] + std::ldexp(box.hi[static_cast<int>(k)], grid.exponent);
  }
  return out;
}

std::string round_up(double bound) {
  char text[40];
  std::snprintf(text, sizeof text, "%.3g", bound);
  // Half of the last digit is at most 0.005 of it.
  if (std::strtod(text, nullptr) < bound) std::snprintf(text, sizeof text, "%.3g", bound * 1.005);
  return text;
}

std::vector<std::string> doubts_but_of_size(const Measures& measures) {
  std::vector<std::string> found = measures.terrain_doubts;
  const UpAxis stated = measures.stated_up, asked = measures.origin.up;
  if (measures.origin.z_up && stated != UpAxis::kUnknown && stated != asked)
    found.push_back(std::string("--up says that ") + axis_name(asked) +
                    " is up in the file; the file or its format states " + axis_name(stated));
  return found;
}

std::vector<std::string> doubts(const Measures& measures) {
  std::vector<std::string> found = doubts_but_of_size(measures);
  double size_m = 0;
  for (std::size_t k = 0; k < 3; ++k)
    size_m = std::max(size_m, measures.hi_m[k] - measures.lo_m[k]);
  if (size_m < kSmall_m || (size_m > kLarge_m && !measures.is_terrain))
    found.push_back("the model is " + number(size_m) + " m long, " +
                    (size_m < kSmall_m ? "less than a centimetre" : "more than ten kilometres") +
                    ": is its unit right? " + units_text(measures.origin));
  return found;
}

void add_json(const Measures& measures, nlohmann::ordered_json& report) {
  std::array<double, 3> size_m{};
  for (std::size_t k = 0; k < 3; ++k) size_m[k] = measures.hi_m[k] - measures.lo_m[k];
  const MeshOrigin& origin = measures.origin;
  report["box_min_m"] = measures.lo_m;
  report["box_max_m"] = measures.hi_m;
  report["size_m"] = size_m;
  report["unit_m"] = origin.unit_m;
  report["unit_source"] = source_name(origin.unit_source);
  report["scale"] = origin.scale;
  report["up_axis"] = axis_name(origin.up);
  report["up_source"] = source_name(origin.up_source);
  report["turned_z_up"] = origin.z_up && origin.up != UpAxis::kZ;
  report["warnings"] = doubts(measures);
}

void print_text(const Measures& measures) {
  const auto &lo = measures.lo_m, &hi = measures.hi_m;
  std::printf("  size          %.6g x %.6g x %.6g m: [%.6g, %.6g] x [%.6g, %.6g] x [%.6g, %.6g]\n",
              hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2], lo[0], hi[0], lo[1], hi[1], lo[2],
              hi[2]);
  std::printf("  units         %s\n", units_text(measures.origin).c_str());
  std::printf("  axes          %s\n", axes_text(measures.origin).c_str());
}

}  // namespace nearmesh::program
