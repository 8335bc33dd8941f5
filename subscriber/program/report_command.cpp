// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber report: a recorded session as one page of HTML that needs nothing else.
#include <cstdio>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "subscriber/report/html_page.hpp"
#include "subscriber/report/mesh_files.hpp"

namespace nearmesh::subscriber::program {
namespace {

struct Options {
  std::string session, folder;
  std::vector<double> at_s;
};

Status run(const Options& options) {
  Result<std::unique_ptr<RecordingReader>> opened = RecordingReader::open(options.session);
  if (!opened.is_ok()) return opened.status();
  const Result<std::string> html = report::html_page(
      *opened.value(), std::filesystem::path(options.session).filename().string(), options.at_s);
  if (!html.is_ok())
    return {html.status().code(), options.session + ": " + html.status().message()};
  std::error_code error;
  std::filesystem::create_directories(options.folder, error);
  if (error) return {StatusCode::kIo, options.folder + ": cannot create: " + error.message()};
  const std::string path = (std::filesystem::path(options.folder) / "index.html").string();
  NEARMESH_RETURN_IF_ERROR(report::write_file(html.value(), path));
  std::printf("%s: %zu bytes\n", path.c_str(), html.value().size());
  return Status::ok();
}

}  // namespace

void add_report_command(CLI::App& app, std::function<Status()>& chosen) {
  CLI::App* command = app.add_subcommand(
      "report",
      "Write a recorded session as one page of HTML: answers, bytes, contacts, pictures.");
  const auto options = std::make_shared<Options>();
  command->add_option("session", options->session, "Recorded session (.db3)")->required();
  command->add_option("-o,--output", options->folder, "Folder for index.html; made if need be")
      ->required();
  command
      ->add_option("--at", options->at_s,
                   "Picture the meshes so many seconds after the first message; repeatable "
                   "(default: first contact, most contacts, largest replicas)")
      ->allow_extra_args(false)
      ->check(CLI::NonNegativeNumber);
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

}  // namespace nearmesh::subscriber::program
