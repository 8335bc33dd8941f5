// SPDX-License-Identifier: Apache-2.0
#include <utility>

#include "nearmesh/core/spm/detail/codec.hpp"
#include "recorded_peer.hpp"

namespace nearmesh::subscriber {

void ModelSources::take(const wire::MeshHeader& header) {
  if (is_world_record(header.bytes)) {
    if (auto record = decode_world(header.bytes); record.is_ok())
      worlds_.try_emplace(header.content_hash, record.value(), header.name);
  } else if (!headers_.contains(header.content_hash) &&
             decode_header(header.bytes, &tables_).is_ok()) {
    headers_.emplace(header.content_hash, header.bytes);
  }
}

void ModelSources::take_piece(const wire::SplitBatchMessage& message) {
  const ContentHash& content = message.content_hash;
  if (pages_.contains(content) || headers_.contains(content)) return;
  const auto piece = unseal_batch(content, message.bytes);
  if (!piece.is_ok()) return;
  const auto at = unread_.try_emplace(content, content).first;
  auto bytes = at->second.take(piece.value());
  if (!bytes.is_ok() || !bytes.value()) return;
  unread_.erase(at);
  if (Result<WorldPage> page = decode_page(*bytes.value()); page.is_ok()) {
    pages_.emplace(content, std::move(page).value());
  } else if (decode_header(*bytes.value(), &tables_).is_ok()) {
    headers_.emplace(content, std::move(*bytes.value()));
  }
}

std::optional<SpmHeader> ModelSources::header(const ContentHash& content) const {
  const auto at = headers_.find(content);
  if (at == headers_.end()) return std::nullopt;
  return decode_header(at->second, &tables_).value();
}

const WorldRecord* ModelSources::world(const ContentHash& content) const {
  const auto at = worlds_.find(content);
  if (at != worlds_.end()) return &at->second.first;
  return files == nullptr ? nullptr : files->world(content);
}

const std::string& ModelSources::name_of_world(const ContentHash& content) const {
  static const std::string kUnknown = "world";
  const auto at = worlds_.find(content);
  return at == worlds_.end() ? kUnknown : at->second.second;
}

const WorldPage* ModelSources::page(const ContentHash& content) const {
  const auto at = pages_.find(content);
  return at == pages_.end() ? nullptr : &at->second;
}

}  // namespace nearmesh::subscriber
