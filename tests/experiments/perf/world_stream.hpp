// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer receives, holds and computes that flies low over a world.

#include <string>

namespace nearmesh {

/// Rows of bytes and tiles, and a sum, of a flight of so many frames of 50 ms, to and fro. In: a
/// world's folder, without a network. False: it cannot be served.
bool run_stream(const std::string& folder, int frames);

/// A row of what an update takes of this thread's processor time, of a peer that flies 100 aircraft
/// low, each over a place of its own, to and fro over ground that is held: five legs of so many
/// frames of 50 ms, of which the first fetches and is not counted. What the publisher does in that
/// time is left out.
bool run_low(const std::string& folder, int frames);

/// Rows of what is allocated for a tile: at the publisher, at a peer that is far from it and at one
/// that is near.
bool run_memory(const std::string& folder);

}  // namespace nearmesh
