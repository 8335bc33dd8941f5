// SPDX-License-Identifier: Apache-2.0
// Contacts from update to update, and the detail that their depth lacks.
#include <algorithm>
#include <cmath>
#include <utility>

#include "session_impl.hpp"

namespace nearmesh::subscriber {
namespace {

/// Tells the events of a pair since `first`.
void sign(std::vector<ContactEvent>& events, std::size_t first, const Body& a, const Body& b) {
  for (std::size_t i = first; i < events.size(); ++i) {
    events[i].a = a.id;
    events[i].b = b.id;
  }
}

/// A ball about a point of the world, in a model's grid.
GridBox box_around(const Grid& grid, const Pose& pose, const std::array<double, 3>& at_m,
                   double radius_m) {
  GridBox box;
  for (std::size_t k = 0; k < 3; ++k) {
    double in_model = 0;
    for (std::size_t r = 0; r < 3; ++r)
      in_model += pose.rotation[3 * r + k] * (at_m[r] - pose.translation_m[r]);
    const auto cells = [&](double x_m) {
      constexpr double kMost = 1 << 30;
      return std::clamp(std::ldexp(x_m - grid.origin_m[k], -grid.exponent), -kMost, kMost);
    };
    box.lo[static_cast<int>(k)] = static_cast<std::int32_t>(std::floor(cells(in_model - radius_m)));
    box.hi[static_cast<int>(k)] = static_cast<std::int32_t>(std::ceil(cells(in_model + radius_m)));
  }
  return box;
}

}  // namespace

const char* to_string(ContactChange change) {
  switch (change) {
    case ContactChange::kBegin:
      return "begin";
    case ContactChange::kPersist:
      return "persist";
    case ContactChange::kEnd:
      return "end";
    case ContactChange::kUnconfirmed:
      return "unconfirmed";
  }
  return "unknown";
}

void Session::Impl::follow_contacts(Pair& pair, PairAnswer& answer, FrameReport& report) {
  if (!answer.asked && pair.contacts.is_empty()) return;
  bool is_of_others = false;
  if (answer.asked) {
    is_of_others = pair.content_a != answer.content_a || pair.content_b != answer.content_b;
    pair.content_a = answer.content_a;
    pair.content_b = answer.content_b;
  }
  if (is_of_others) end_contacts(pair, report);
  const Answer& now = answer.answer;
  const bool is_all = is_certified(now.status) && !now.truncated &&
                      !(options.any && now.status == AnswerStatus::kContact);
  const std::size_t first = report.contact_events.size();
  pair.contacts.follow({.contacts = answer.contacts ? &*answer.contacts : nullptr,
                        .is_all = is_all,
                        .pose_a = answer.pose_a,
                        .pose_b = answer.pose_b},
                       next_contact, answer.contact_ids, report.contact_events);
  sign(report.contact_events, first, *pair.a, *pair.b);
}

void Session::Impl::end_contacts(Pair& pair, FrameReport& report) {
  const std::size_t first = report.contact_events.size();
  pair.contacts.end(report.contact_events);
  sign(report.contact_events, first, *pair.a, *pair.b);
}

/// By region, as for a probe: around the contacts, as far as they reach and B would go.
void Session::Impl::ask_for_depth(const Pair& pair, const PairAnswer& answer) {
  const Depth& depth = *answer.depth;
  if (depth.missing_a.empty() && depth.missing_b.empty()) return;
  std::vector<GridBox> where_a, where_b;
  for (const ContactPatch& patch : answer.contacts->patches) {
    double reach_m = depth.at_least_m;
    for (std::uint32_t i = 0; i < patch.manifold_count; ++i) {
      double square = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const double way = patch.manifold_m[i][k] - patch.centroid_m[k];
        square += way * way;
      }
      reach_m = std::max(reach_m, depth.at_least_m + std::sqrt(square));
    }
    const auto around = [&](const Body& body, const Pose& pose) {
      return box_around(body.model->replica->header().grid, pose, patch.centroid_m, reach_m);
    };
    where_a.push_back(around(*pair.a, answer.pose_a));
    where_b.push_back(around(*pair.b, answer.pose_b));
  }
  if (!depth.missing_a.empty()) note_lacking(*pair.a->model, depth.missing_a, std::move(where_a));
  if (!depth.missing_b.empty()) note_lacking(*pair.b->model, depth.missing_b, std::move(where_b));
}

}  // namespace nearmesh::subscriber
