// SPDX-License-Identifier: Apache-2.0
// A message for the door, as it came from the network. The first byte: 1 asks for a good header, so
// that more than that is reached. Holds: what passes passes again as it is handed on, every
// submessage of it lies inside it, a lease that is rewritten leaves it right, and nothing is left
// to change of what was changed. What another speaker adds is a shorter message.

#include <memory>
#include <vector>

#include "fuzz_input.hpp"
#include "idl/dds/participant_book.hpp"
#include "idl/dds/rtps_check.hpp"

using namespace nearmesh::wire;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  nearmesh::fuzz::FuzzInput in(data, size);
  const bool is_headed = (in.byte() & 1) != 0;
  constexpr std::uint8_t kHeader[] = {'R', 'T', 'P', 'S', 2, 3, 1, 15, 1, 15,
                                      1,   2,   3,   4,   5, 6, 7, 8,  9, 1};
  const std::size_t head = is_headed ? sizeof kHeader : 0;
  const std::size_t count = head + in.rest().size();
  // A buffer of just this size, so that a read beyond it is seen.
  const auto bytes = std::make_unique<std::uint8_t[]>(count);
  std::copy_n(kHeader, head, bytes.get());
  std::copy(in.rest().begin(), in.rest().end(), bytes.get() + head);

  RtpsVerdict verdict = check_rtps({bytes.get(), count});
  if (verdict.refusal) return 0;
  ParticipantBook().hold_back(verdict);
  FUZZ_CHECK(verdict.size <= count && verdict.size >= 20);
  const std::size_t sent = size_without_statistics({bytes.get(), count});
  FUZZ_CHECK(sent == count || sent + 60 == count);
  std::size_t at = 20;
  while (at + 4 <= verdict.size) {
    const bool little_endian = (bytes[at + 1] & 1) != 0;
    const std::size_t length =
        little_endian ? bytes[at + 2] | bytes[at + 3] << 8 : bytes[at + 2] << 8 | bytes[at + 3];
    const bool is_to_the_end =
        length == 0 && (bytes[at] == 0x15 || bytes[at] == 0x16 || bytes[at] == 0x30);
    at = is_to_the_end ? verdict.size : at + 4 + length;
  }
  FUZZ_CHECK(at == verdict.size);
  if (verdict.announcement && verdict.announcement->lease_at != 0) {
    FUZZ_CHECK(verdict.announcement->lease_at + 8 <= verdict.size);
    for (std::size_t i = 0; i < 8; ++i) bytes[verdict.announcement->lease_at + i] = 1;
  }
  if (verdict.next_speaker_at != 0) {
    const std::vector<std::uint8_t> next = rtps_of_next_speaker({bytes.get(), count}, verdict);
    FUZZ_CHECK(next.size() < count);
    static_cast<void>(check_rtps(next));
  }
  for (const RtpsChange& change : verdict.changes) FUZZ_CHECK(change.at < verdict.size);
  // A sample that became longer has no more bytes in its fragments.
  const bool as_it_came = verdict.has_fragments;
  RtpsCopy copy;
  const std::span<const std::uint8_t> passed = copy.of({bytes.get(), verdict.size}, verdict);
  const RtpsVerdict again =
      check_rtps(as_it_came ? std::span<const std::uint8_t>{bytes.get(), verdict.size} : passed);
  FUZZ_CHECK(!again.refusal && again.size == verdict.size && again.next_speaker_at == 0);
  FUZZ_CHECK(as_it_came || (again.changes.empty() && again.far_beginnings.empty()));
  FUZZ_CHECK(again.announcement.has_value() == verdict.announcement.has_value());
  return 0;
}
