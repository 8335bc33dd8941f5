// SPDX-License-Identifier: Apache-2.0
#pragma once
// A recorded session as one page of HTML that needs nothing else: answers, bytes, contacts, pictures (takes a recording, gives
// the page).

#include <string>
#include <vector>

#include "core/base/output_file.hpp"
#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh::subscriber::report {

inline constexpr FileKind kPageFile{
    "a page of nearmesh-subscriber report",
    "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
    "<meta name=\"generator\" content=\"nearmesh-subscriber report\">"};

/// `at_s`: the meshes are pictured so many seconds after the first message; empty: at moments that the recording suggests.
/// Errors: those of the reader; kNotFound where there is no answer at such a time. Cost: some runs through the recording.
[[nodiscard]] Result<std::string> html_page(RecordingReader& recording, const std::string& title,
                                            const std::vector<double>& at_s);

}  // namespace nearmesh::subscriber::report
