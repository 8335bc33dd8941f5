// SPDX-License-Identifier: Apache-2.0
#include "recorded_bounds.hpp"

#include "core/world/near_tiles.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh::subscriber {

void RecordedBounds::take(const wire::MeshHeader& header) {
  if (bounds_.contains(header.content_hash)) return;
  if (is_world_record(header.bytes)) {
    if (auto record = decode_world(header.bytes); record.is_ok())
      worlds_.try_emplace(record.value().root, World{header.content_hash, record.value(),
                                                     ContentReader(record.value().root)});
  } else if (auto model = decode_header(header.bytes, &tables_); model.is_ok()) {
    const SplitStore store(model.value());
    bounds_.emplace(header.content_hash, ModelBounds(model.value().grid, store));
  }
}

void RecordedBounds::take(const wire::SplitBatchMessage& batch) {
  const auto at = worlds_.find(batch.content_hash);
  if (at == worlds_.end() || batch.refused) return;
  World& world = at->second;
  const auto piece = unseal_batch(batch.content_hash, batch.bytes);
  if (!piece.is_ok()) return;
  const auto bytes = world.reader.take(piece.value());
  if (!bytes.is_ok() || !bytes.value()) return;
  const Result<WorldPage> page = decode_page(*bytes.value());
  if (!page.is_ok() || page.value().level != world.record.root_level) return;
  const CellBox all = page.value().box();
  GridBox box;
  for (std::size_t k = 0; k < 3; ++k) {
    box.lo.v[k] = static_cast<std::int32_t>(all.lo[k]);
    box.hi.v[k] = static_cast<std::int32_t>(all.hi[k]);
  }
  bounds_.emplace(world.name, ModelBounds(world_grid(world.record), box));
  worlds_.erase(at);
}

const ModelBounds* RecordedBounds::find(const ContentHash& content) const {
  const auto at = bounds_.find(content);
  return at == bounds_.end() ? nullptr : &at->second;
}

}  // namespace nearmesh::subscriber
