// SPDX-License-Identifier: Apache-2.0
#include "dds_headers.hpp"

#include <algorithm>
#include <utility>

#include "core/base/hash.hpp"
#include "idl/dds/endpoint_names.hpp"

namespace nearmesh::subscriber {

using wire::Handle;

DdsHeaders::DdsHeaders(wire::Mailbox& mailbox, std::string topic)
    : mailbox_(mailbox), topic_(std::move(topic)) {}

void DdsHeaders::announced(const wire::Hello& hello, const Handle& writer) {
  Announced& known = announced_[hello.publisher];
  known.writer = writer;
  known.contents.clear();
  for (const wire::Hello::Model& model : hello.models) known.contents.push_back(model.content_hash);
}

void DdsHeaders::lost(wire::SessionId publisher, std::vector<Counted> not_taken) {
  announced_.erase(publisher);
  for (Counted& counted : not_taken) heard(std::move(counted.header.message), counted.writer);
}

void DdsHeaders::heard(wire::MeshHeader&& header, const Handle& writer) {
  std::erase_if(waiting_, [&](const Waiting& known) {
    return known.writer == writer && known.header.content_hash == header.content_hash;
  });
  if (!has_room(header, writer))
    std::erase_if(waiting_, [](const Waiting& known) { return known.is_gone; });
  if (has_room(header, writer)) {
    waiting_.push_back({std::move(header), writer, clock_.seconds()});
    return;
  }
  ++dropped_;
  refuse(writer, "too many wait for a hello that announces their content");
}

bool DdsHeaders::has_room(const wire::MeshHeader& header, const Handle& writer) const {
  std::size_t bytes_of_one = header.bytes.size(), bytes_of_all = bytes_of_one, of_one = 1;
  for (const Waiting& known : waiting_) {
    bytes_of_all += known.header.bytes.size();
    if (!wire::have_one_participant(known.writer, writer)) continue;
    bytes_of_one += known.header.bytes.size();
    ++of_one;
  }
  return bytes_of_one <= kMaxBytesOfOne && bytes_of_all <= kMaxBytesOfAll && of_one <= kMaxOfOne &&
         waiting_.size() < kMaxOfAll;
}

void DdsHeaders::take(const std::vector<wire::ReaderListener::Match>& matches) {
  for (const auto& event : matches)
    for (Waiting& known : waiting_)
      if (known.writer == event.writer) known.is_gone = event.is_gone();
}

std::vector<DdsHeaders::Counted> DdsHeaders::release() {
  std::vector<Counted> counted;
  std::erase_if(waiting_, [&](Waiting& waiting) {
    for (const auto& [publisher, known] : announced_) {
      if (!wire::have_one_participant(known.writer, waiting.writer) ||
          std::find(known.contents.begin(), known.contents.end(), waiting.header.content_hash) ==
              known.contents.end())
        continue;
      counted.push_back({{publisher, std::move(waiting.header)}, waiting.writer});
      return true;
    }
    return false;
  });
  return counted;
}

std::uint64_t DdsHeaders::complain_of_strays() {
  std::uint64_t count = std::exchange(dropped_, 0);
  for (Waiting& waiting : waiting_) {
    if (waiting.is_told || clock_.seconds() - waiting.since_s < kPatience_s) continue;
    waiting.is_told = true;
    ++count;
    refuse(waiting.writer, "its participant announces no such content");
  }
  return count;
}

void DdsHeaders::refuse(const Handle& writer, const std::string& why) {
  mailbox_.complain(topic_ + ": headers of " + wire::name_of(writer, mailbox_) +
                    " do not count: " + why);
}

void DdsHeaders::clear() {
  announced_.clear();
  waiting_.clear();
}

}  // namespace nearmesh::subscriber
