// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer receives and holds that flies low over a world.

#include <string>

namespace nearmesh {

/// Rows of bytes and tiles, and a sum, of a flight of so many frames of 50 ms, to and fro. In: a world's folder, without a network. False: it cannot be
/// served.
bool run_stream(const std::string& folder, int frames);

}  // namespace nearmesh
