// SPDX-License-Identifier: Apache-2.0
#pragma once
// Lists of parameters in RTPS messages, which describe participants and endpoints, and tokens of
// DDS Security: whether they are whole.

#include "rtps_cursor.hpp"

namespace nearmesh::wire {

/// Whether a parameter of discovery describes a type: by an identifier, the whole, or the same as
/// of XTypes 1.3.
[[nodiscard]] bool describes_type(std::uint16_t parameter);

/// Whether these bytes are such a parameter of discovery. Unknown ones pass: Fast DDS skips them.
[[nodiscard]] bool is_parameter(std::uint16_t id, Cursor::Bytes bytes, bool little_endian);

void read_properties(Cursor& in);

/// A token of DDS Security: a class, then properties as text and as bytes, of which `see(name,
/// bytes)` is told.
template <class See>
void read_token(Cursor& in, See see) {
  in.text();
  read_properties(in);
  for (std::uint32_t left = in.count(8); left > 0 && in.is_whole(); --left) {
    const Cursor::Bytes name = in.bytes();
    see(name, in.bytes());
  }
}

/// Walks a list of parameters; `see(id, place in `in`, bytes)` says whether one is right. Out: it
/// is whole, and ends.
template <class See>
bool read_parameters(Cursor& in, See see) {
  while (in.is_whole()) {
    const std::uint16_t id = in.u16();
    const std::uint16_t length = in.u16();
    if (!in.is_whole()) return false;
    if (id == 1) return true;  // the end; its length has no meaning
    if (length % 4 != 0) return false;
    const std::size_t place = in.at();
    const Cursor::Bytes bytes = in.take(length);
    if (!in.is_whole() || !see(id, place, bytes)) return false;
  }
  return false;
}

}  // namespace nearmesh::wire
