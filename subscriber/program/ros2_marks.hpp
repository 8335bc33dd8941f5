// SPDX-License-Identifier: Apache-2.0
#pragma once
// What ROS 2's tools draw of a flight, the same whether a peer shows it or a looker-on.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "idl/messages/ros2_messages.hpp"
#include "nearmesh/core/query/contacts.hpp"

namespace nearmesh::subscriber::program {

inline constexpr double kMostShown_hz = 60;
inline constexpr double kRos2MeshStep_s = 1;  ///< a body's mesh is drawn anew after this

/// Of the machine's clock.
[[nodiscard]] std::int64_t ros2_now_ns();

/// Of lines about models whose cells are 2^exponent metres.
[[nodiscard]] double line_width_m(int exponent);

/// What all lines of a body or a pair share. They go by themselves when nobody renews them.
struct LineMark {
  std::string frame, name;
  std::int32_t id = 0;
  double width_m = 0.01;
};
/// Where two bodies touch; without segments none is to be written.
[[nodiscard]] ros2::Marker contact_mark(const LineMark& mark,
                                        const std::vector<ContactSegment>& segments);
/// From body to body, where the answer is not certified: nothing is drawn where all is free.
[[nodiscard]] ros2::Marker uncertain_mark(const LineMark& mark, const std::array<double, 3>& a_m,
                                          const std::array<double, 3>& b_m);
/// A body of which nothing is known, where it was last.
[[nodiscard]] ros2::Marker unknown_mark(const LineMark& mark, const std::array<double, 3>& at_m,
                                        double span_m);
/// A body in its own frame, corners three by three. None where it has too many faces: the log says
/// so.
[[nodiscard]] std::vector<ros2::Marker> mesh_marks(const std::string& body,
                                                   std::vector<std::array<double, 3>> exact_m,
                                                   std::vector<std::array<double, 3>> coarse_m);

}  // namespace nearmesh::subscriber::program
