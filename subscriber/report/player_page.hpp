// SPDX-License-Identifier: Apache-2.0
#pragma once
// The moving picture on the page (takes a Film, gives HTML): its streams, deflated and as text, and
// the scripts of player/.

#include <map>
#include <string>
#include <string_view>

#include "nearmesh/core/base/status.hpp"
#include "subscriber/recorded/film.hpp"

namespace nearmesh::subscriber::report {

/// As they were when this was built.
struct PlayerFiles {
  /// three.js; empty where it was not there: there is no moving picture then.
  std::string_view three;
  std::string_view three_licence, script, style, markup;
};
[[nodiscard]] const PlayerFiles& player_files();

/// What is said where there is no three.js.
inline constexpr const char* kNoPlayer =
    "no moving picture: built without three.js (Debian package libjs-three)";

struct PlayerPage {
  std::string style, body;  ///< both empty without three.js
};
/// `film`: none for a live page, which is sent it. `names`: of peers, by partition.
/// Errors: kIo where there is no memory to compress.
[[nodiscard]] Result<PlayerPage> player_page(const Film* film,
                                             const std::map<std::string, std::string>& names);

}  // namespace nearmesh::subscriber::report
