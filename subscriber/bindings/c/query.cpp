// SPDX-License-Identifier: Apache-2.0
// Queries of two files at hand.
#include <memory>
#include <optional>
#include <utility>

#include "model.hpp"
#include "nearmesh/core/query/depth.hpp"

struct nearmesh_query {
  static constexpr nearmesh::c::Kind kKind = nearmesh::c::Kind::kQuery;
  nearmesh::c::Kind kind = kKind;
  std::atomic<bool> in_use = false;
  std::shared_ptr<nearmesh::c::SharedModel> a, b;
  std::optional<nearmesh::LocalModel> local_a, local_b;  // as far as answers have needed them
  nearmesh::QueryOptions options;
  bool contacts = false, depth = false;
  std::uint64_t max_depth_tests = 0;
  nearmesh::c::OwnedAnswer answer;
};

namespace nearmesh::c {
namespace {

constexpr nearmesh_query_options kQueryDefaults{.size = sizeof(nearmesh_query_options),
                                                .any = 0,
                                                .clearance = NEARMESH_CLEARANCE_BOUND,
                                                .max_pairs = UINT64_MAX,
                                                .solid_a = 0,
                                                .solid_b = 0,
                                                .contacts = 0,
                                                .depth = 0,
                                                .max_tests = UINT64_MAX,
                                                .max_depth_tests = kDepthTests};

Require require_of(SharedModel& model) {
  return [&model](NodeSpan node) { return model.file.require(node); };
}

Status ask(nearmesh_query& query, const Pose& pose_a, const Pose& pose_b) {
  ModelFile &a = query.a->file, &b = query.b->file;
  const Result<PosedPair> posed =
      pose_pair(a.header().grid, pose_a, "A", b.header().grid, pose_b, "B");
  NEARMESH_RETURN_IF_ERROR(posed);
  if (!query.local_a) query.local_a.emplace(a.store(), a.header().grid);
  if (!query.local_b) query.local_b.emplace(b.store(), b.header().grid);
  const Result<Answer> answer =
      certify(*query.local_a, posed.value().a, require_of(*query.a), *query.local_b,
              posed.value().b, require_of(*query.b), query.options);
  NEARMESH_RETURN_IF_ERROR(answer);
  std::optional<Contacts> contacts;
  std::optional<Depth> depth;
  if (query.contacts && !answer.value().pairs.empty())
    contacts = find_contacts(query.local_a->view(), posed.value().a, query.local_b->view(),
                             posed.value().b, answer.value());
  if (query.depth && contacts) {
    Result<Depth> found =
        certify_depth(*query.local_a, pose_a, require_of(*query.a), *query.local_b, pose_b,
                      require_of(*query.b), answer.value(), *contacts,
                      {.solid_a = query.options.solid_a,
                       .solid_b = query.options.solid_b,
                       .max_tests = query.max_depth_tests});
    NEARMESH_RETURN_IF_ERROR(found);
    depth = std::move(found).value();
  }
  query.answer.fill(answer.value(), contacts, depth);
  return Status::ok();
}

}  // namespace
}  // namespace nearmesh::c

using namespace nearmesh;  // NOLINT: what follows is C

nearmesh_status nearmesh_query_options_init(nearmesh_query_options* options, size_t size) noexcept {
  return c::init_options(options, size, c::kQueryDefaults);
}

nearmesh_status nearmesh_query_create(nearmesh_model* a, nearmesh_model* b,
                                      const nearmesh_query_options* options, nearmesh_query** query,
                                      nearmesh_error* error) noexcept {
  if (query != nullptr) *query = nullptr;
  return c::guarded(error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(query, "query"));
    NEARMESH_RETURN_IF_ERROR(c::check_handle(a));
    NEARMESH_RETURN_IF_ERROR(c::check_handle(b));
    nearmesh_query_options read = c::kQueryDefaults;
    NEARMESH_RETURN_IF_ERROR(c::read_options(options, "nearmesh_query_options", read));
    NEARMESH_RETURN_IF_ERROR(c::check_number(read.clearance, NEARMESH_CLEARANCE_NONE,
                                             NEARMESH_CLEARANCE_EXACT, "clearance"));
    if (read.solid_a != 0)
      NEARMESH_RETURN_IF_ERROR(check_solid(a->shared->file.header().surface, "A"));
    if (read.solid_b != 0)
      NEARMESH_RETURN_IF_ERROR(check_solid(b->shared->file.header().surface, "B"));
    auto made = std::make_unique<nearmesh_query>();
    made->a = a->shared;
    made->b = b->shared;
    made->options = {
        .any = read.any != 0,
        .clearance = static_cast<Clearance>(read.clearance),
        .max_pairs = static_cast<std::size_t>(std::min<std::uint64_t>(read.max_pairs, kAllPairs)),
        .max_tests = read.max_tests,
        .solid_a = read.solid_a != 0,
        .solid_b = read.solid_b != 0};
    made->contacts = read.contacts != 0 || read.depth != 0;
    made->depth = read.depth != 0;
    made->max_depth_tests = read.max_depth_tests;
    *query = made.release();
    return Status::ok();
  });
}

void nearmesh_query_destroy(nearmesh_query* query) noexcept {
  if (!c::is_handle(query)) return;
  query->kind = c::Kind::kNone;
  delete query;
}

nearmesh_status nearmesh_query_ask(nearmesh_query* query, const nearmesh_pose* pose_a,
                                   const nearmesh_pose* pose_b, const nearmesh_answer** answer,
                                   nearmesh_error* error) noexcept {
  if (answer != nullptr) *answer = nullptr;
  return c::guarded(query, error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(c::check_given(answer, "answer"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(pose_a, "pose_a"));
    NEARMESH_RETURN_IF_ERROR(c::check_given(pose_b, "pose_b"));
    const Status asked = c::with_files(*query->a, *query->b, [&] {
      return c::ask(*query, c::from_c(*pose_a), c::from_c(*pose_b));
    });
    // Meshes and trees may have parted half-way.
    if (asked.code() == StatusCode::kCorrupt || asked.code() == StatusCode::kIo ||
        asked.code() == StatusCode::kNotFound) {
      query->local_a.reset();
      query->local_b.reset();
    }
    NEARMESH_RETURN_IF_ERROR(asked);
    *answer = &query->answer.answer;
    return Status::ok();
  });
}
