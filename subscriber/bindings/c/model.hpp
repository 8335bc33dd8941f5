// SPDX-License-Identifier: Apache-2.0
#pragma once
// The handle of a .spm file. Queries share the file itself, so that it may be closed before them.

#include <atomic>
#include <memory>
#include <optional>
#include <utility>

#include "answers.hpp"
#include "handle.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh::c {

struct SharedModel {
  explicit SharedModel(ModelFile opened) : file(std::move(opened)) {}
  ModelFile file;
  std::atomic<bool> in_use = false;
  // An exception came half-way through reading: what is held is not to be trusted.
  bool is_spoiled = false;
};

/// Runs `body`, which reads one file or two (`b` may be `a`), where nobody else does.
template <class Body>
Status with_files(SharedModel& a, SharedModel& b, Body&& body) {
  const Use use_a(a.in_use);
  std::optional<Use> use_b;
  if (&a != &b) use_b.emplace(b.in_use);
  if (!use_a.had() || (use_b && !use_b->had())) return Use::refusal(Kind::kModel);
  for (const SharedModel* model : {&a, &b})
    if (model->is_spoiled)
      return {StatusCode::kConflict,
              model->file.path() + ": an earlier call ended half-way; open the model again"};
  try {
    return body();
  } catch (...) {
    a.is_spoiled = b.is_spoiled = true;
    throw;
  }
}

}  // namespace nearmesh::c

struct nearmesh_model {
  static constexpr nearmesh::c::Kind kKind = nearmesh::c::Kind::kModel;
  nearmesh::c::Kind kind = kKind;
  std::atomic<bool> in_use = false;  // the handle; what it reads, of the shared one
  std::shared_ptr<nearmesh::c::SharedModel> shared;
  nearmesh::c::ContentText content;
  nearmesh_model_facts facts{};
  std::optional<nearmesh::FaceNumbering> numbering;
  std::optional<nearmesh::LocalModel> probed;  // as far as probes have needed it
};
