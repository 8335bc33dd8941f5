// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber report: a recorded session as one page of HTML that needs nothing else.
#include <cstdio>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "subscriber/report/html_page.hpp"
#include "subscriber/report/player_page.hpp"

namespace nearmesh::subscriber::program {
Status run(const ReportOptions& options) {
  Result<std::unique_ptr<RecordingReader>> opened = RecordingReader::open(options.session);
  NEARMESH_RETURN_IF_ERROR(opened);
  const std::string path = (std::filesystem::path(options.folder) / "index.html").string();
  if (std::filesystem::exists(path))
    NEARMESH_RETURN_IF_ERROR(check_output(path, report::kPageFile));
  const Result<std::string> html = report::html_page(
      *opened.value(), std::filesystem::path(options.session).filename().string());
  if (!html.is_ok())
    return {html.status().code(), options.session + ": " + html.status().message()};
  std::error_code error;
  std::filesystem::create_directories(options.folder, error);
  if (error) return {StatusCode::kIo, options.folder + ": cannot create: " + error.message()};
  NEARMESH_RETURN_IF_ERROR(write_file(path, report::kPageFile, html.value()));
  std::printf("%s: %zu bytes\n", path.c_str(), html.value().size());
  if (report::player_files().three.empty()) std::printf("%s\n", report::kNoPlayer);
  return Status::ok();
}

}  // namespace nearmesh::subscriber::program
