// SPDX-License-Identifier: Apache-2.0
#pragma once
// A model as a publisher serves it, without a transport: for measurements.

#include <cstdlib>
#include <memory>
#include <vector>

#include "core/certificate/mirror.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"
#include "test_models.hpp"

namespace nearmesh::perf {

/// Ends the program where the model cannot be written or read again.
class Served {
 public:
  explicit Served(const BakedModel& baked) {
    if (!write_model_file(baked.header, baked.store, baked.numbers, path_.path()).is_ok())
      std::abort();
    file_ = std::make_shared<ModelFile>(ModelFile::open(path_.path()).value());
    if (!file_->require_all().is_ok()) std::abort();
  }
  [[nodiscard]] const ModelFile& file() const { return *file_; }
  /// Of a peer that holds nothing but the base mesh.
  [[nodiscard]] std::shared_ptr<Mirror> fresh() { return std::make_shared<Mirror>(file_); }
  /// Of a peer that holds all.
  [[nodiscard]] std::shared_ptr<Mirror> whole() {
    const SplitStore& store = file_->store();
    std::vector<NodeSpan> nodes;
    for (std::uint32_t v = 0; v < store.vertex_count(); ++v)
      if (!store.is_root({v})) nodes.push_back(store.node_of({v}));
    std::shared_ptr<Mirror> mirror = fresh();
    if (!mirror->split(nodes).is_ok()) std::abort();
    return mirror;
  }

 private:
  test::TempFile path_{".spm"};
  std::shared_ptr<ModelFile> file_;
};

}  // namespace nearmesh::perf
