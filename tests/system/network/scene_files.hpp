// SPDX-License-Identifier: Apache-2.0
#pragma once
// The models of a scene of the chart as files that a publisher serves.

#include <stdexcept>

#include "folder.hpp"
#include "nearmesh/core/spm/write_model_file.hpp"
#include "tests/experiments/chart/scenes.hpp"

namespace nearmesh::test {

/// a.spm and b.spm. Throws where they cannot be written.
inline void write_models(const chart::Scene& scene, const Folder& folder) {
  for (const auto& [model, name] : {std::pair(&scene.a, "a.spm"), {&scene.b, "b.spm"}}) {
    const BakedModel& baked = model->baked;
    const auto written =
        write_model_file(baked.header, baked.store, baked.numbers, folder.file(name));
    if (!written.is_ok()) throw std::runtime_error(written.status().message());
  }
}

}  // namespace nearmesh::test
