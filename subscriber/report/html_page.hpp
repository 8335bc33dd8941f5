// SPDX-License-Identifier: Apache-2.0
#pragma once
// A recorded session as one page of HTML that needs nothing else: the moving picture, and charts of
// answers, bytes and contacts (takes a recording, gives the page).

#include <string>

#include "core/base/output_file.hpp"
#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh::subscriber::report {

inline constexpr FileKind kPageFile{
    "a page of nearmesh-subscriber report",
    "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
    "<meta name=\"generator\" content=\"nearmesh-subscriber report\">"};

/// Errors: those of the reader; kIo where there is no memory for replicas. Cost: that of verify,
/// and some runs through the recording. The same recording gives the same page.
[[nodiscard]] Result<std::string> html_page(RecordingReader& recording, const std::string& title);

/// The page of `watch`: the same picture, of what a web socket at /film beside it sends. Without
/// three.js: that alone.
[[nodiscard]] Result<std::string> live_page(const std::string& title);

}  // namespace nearmesh::subscriber::report
