// SPDX-License-Identifier: Apache-2.0
#pragma once
// The bounds of models and worlds whose headers are recorded (takes headers and batches, gives
// boxes and reaches).

#include <map>

#include "core/broadphase/body_place.hpp"
#include "core/spm/coding_sets.hpp"
#include "core/world/content_bytes.hpp"
#include "core/world/page.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

class RecordedBounds {
 public:
  void take(const wire::MeshHeader& header);
  /// A world's first page has its box.
  [[nodiscard]] bool awaits_pages() const { return !worlds_.empty(); }
  void take(const wire::SplitBatchMessage& batch);
  /// Null where they are not known.
  [[nodiscard]] const ModelBounds* find(const ContentHash& content) const;

 private:
  struct World {
    ContentHash name;
    WorldRecord record;
    ContentReader reader;
  };
  SharedTables tables_;  // of the headers that were read
  std::map<ContentHash, ModelBounds> bounds_;
  std::map<ContentHash, World> worlds_;  // whose first page has not come, by that
};

}  // namespace nearmesh::subscriber
