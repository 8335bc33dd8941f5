// SPDX-License-Identifier: Apache-2.0
#include "run_program.hpp"

#include <cmath>
#include <cstdio>
#include <exception>
#include <new>

#include "core/base/standard_streams.hpp"

namespace nearmesh {
namespace {

/// A range of numbers lets nan pass, with which no comparison is true: a verb that waits until then
/// would not, or for ever.
void refuse_what_is_no_number(CLI::App& verb) {
  const CLI::Validator is_number(
      [](const std::string& text) {
        double x = 0;
        return CLI::detail::lexical_cast(text, x) && std::isnan(x)
                   ? "expected a number, found " + text
                   : std::string();
      },
      "");
  for (CLI::Option* option : verb.get_options())
    for (const char* kind : {"FLOAT", "NONNEGATIVE"})
      if (option->get_type_name().find(kind) != std::string::npos) option->check(is_number);
}

Outcome parse_and_run(CLI::App& app, int argc, char** argv, const Action& chosen) {
  try {
    app.parse(argc, argv);
    return chosen();
  } catch (const CLI::ParseError&) {
    throw;
  } catch (const std::bad_alloc&) {
    return Status{StatusCode::kIo, "no memory"};
  } catch (const std::exception& error) {
    return Status{StatusCode::kIo, error.what()};
  }
}

}  // namespace

void end_help(CLI::App& verb, std::initializer_list<const char*> examples,
              const std::string& said) {
  std::string end = said.empty() ? "Examples:" : said + "\n\nExamples:";
  for (const char* example : examples) end += std::string("\n    ") + example;
  verb.footer(end);
}

int run_program(CLI::App& app, int argc, char** argv, const Action& chosen,
                const std::string& libraries, const std::string& exit_codes) {
  keep_standard_streams();
  const std::string version =
      app.get_name() + " " + NEARMESH_VERSION + (libraries.empty() ? "" : "\n" + libraries);
  app.set_version_flag("--version", version, "Print versions, and end");
  app.footer(
      "`" + app.get_name() +
      " COMMAND --help` tells a command's options, with examples.\n"
      "Exit codes. 0: done. 1: failed, and the last line on standard error says why. 2: wrong "
      "usage." +
      exit_codes);
  for (CLI::App* verb : app.get_subcommands({})) {
    verb->set_version_flag("--version", version, "Print versions, and end");
    refuse_what_is_no_number(*verb);
  }
  Outcome outcome = Status::ok();
  try {
    outcome = parse_and_run(app, argc, argv, chosen);
  } catch (const CLI::ParseError& error) {
    if (app.exit(error) != 0) return 2;
  }
  // Before what went wrong is said: both may go to one terminal.
  const Status printed = flush_standard_output();
  if (outcome.status.is_ok()) outcome = printed;
  if (outcome.status.is_ok()) return 0;
  std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), outcome.status.message().c_str());
  return outcome.exit_code;
}

}  // namespace nearmesh
