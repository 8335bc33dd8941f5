// SPDX-License-Identifier: Apache-2.0
#include "recording_parts.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>
#include <utility>

#include "mcap_recording.hpp"

namespace nearmesh {
namespace {

Result<sqlite::Database> open_part(const std::string& path) {
  const auto attempt = [&](int flags, const char* mode) -> Result<sqlite::Database> {
    Result<sqlite::Database> opened = sqlite::Database::open(path, flags);
    NEARMESH_RETURN_IF_ERROR(opened);
    if (mode != nullptr) NEARMESH_RETURN_IF_ERROR(opened.value().run(mode));
    NEARMESH_RETURN_IF_ERROR(opened.value().run("SELECT count(*) FROM sqlite_master"));
    return opened;
  };
  // Writing, since what a killed process has left in the log must be taken in.
  Result<sqlite::Database> opened = attempt(SQLITE_OPEN_READWRITE, nullptr);
  // On a full disk the log's index finds no room in a file; alone with the file it may be held in
  // memory.
  if (!opened.is_ok())
    if (auto alone = attempt(SQLITE_OPEN_READWRITE, "PRAGMA locking_mode=EXCLUSIVE"); alone.is_ok())
      return alone;
  // In a folder where nothing may be written.
  if (!opened.is_ok())
    if (auto plain = attempt(SQLITE_OPEN_READONLY, nullptr); plain.is_ok()) return plain;
  return opened;
}

/// Opens what an MCAP file holds as a recording of its own, which goes when it is closed.
Result<sqlite::Database> open_mcap(const std::string& path) {
  std::error_code error;
  std::string folder =
      (std::filesystem::temp_directory_path(error) / "nearmesh-recording-XXXXXX").string();
  if (error || ::mkdtemp(folder.data()) == nullptr)
    return Status{StatusCode::kIo, path + ": no folder for temporary files: " +
                                       (error ? error.message() : std::strerror(errno))};
  const std::string unpacked = folder + "/recording.db3";
  const Status status = unpack_mcap_recording(path, unpacked);
  Result<sqlite::Database> opened = status.is_ok() ? open_part(unpacked) : status;
  std::filesystem::remove_all(folder, error);  // an open file stays until it is closed
  return opened;
}

/// Tells the session also where this build does not read the version.
Status read_facts(sqlite::Database& database, const std::string& path, RecordingFacts& found) {
  bool any = false;
  const Status status = database.each(
      "SELECT version, session, part, wire_version, prefix, idl FROM nearmesh_session",
      [&](const sqlite::Statement& row) -> Status {
        any = true;
        found = {std::strtoull(row.text(1).c_str(), nullptr, 16),
                 static_cast<std::uint32_t>(row.integer(2)),
                 static_cast<std::uint32_t>(row.integer(3)), row.text(4), row.text(5)};
        if (row.integer(0) != kRecordingVersion)
          return {StatusCode::kUnsupported,
                  path + ": recording version " + std::to_string(row.integer(0)) +
                      ", this build reads " + std::to_string(kRecordingVersion)};
        return Status::ok();
      });
  if (status.is_ok() && !any) return {StatusCode::kCorrupt, path + ": nearmesh_session is empty"};
  return status;
}

/// What stands under the name of a further part.
struct Candidate {
  const char* instead = nullptr;             // of a part of any recording; null where it is one
  std::optional<sqlite::Database> database;  // of a part
  RecordingFacts facts;
  Status version;  // kUnsupported where this build does not read it
};

/// Errors: it cannot be told whether it is a part, nor of which recording.
Result<Candidate> look_at(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) {
    if (error) return Status{StatusCode::kIo, path + ": " + error.message()};
    return Candidate{.instead = "no file"};
  }
  Result<sqlite::Database> opened = open_part(path);
  NEARMESH_RETURN_IF_ERROR(opened);
  bool any = false, is_recording = false;
  NEARMESH_RETURN_IF_ERROR(
      opened.value().each("SELECT name FROM sqlite_master", [&](const sqlite::Statement& row) {
        any = true;
        is_recording |= row.text(0) == "nearmesh_session";
        return Status::ok();
      }));
  // All tables of a part are committed as one: who is killed while it begins one leaves none of
  // them.
  if (!any) return Candidate{.instead = "an empty file"};
  if (!is_recording) return Candidate{.instead = "a database of another kind"};
  Candidate found;
  found.version = read_facts(opened.value(), path, found.facts);
  if (found.version.code() != StatusCode::kUnsupported) NEARMESH_RETURN_IF_ERROR(found.version);
  found.database = std::move(opened).value();
  return found;
}

/// Numbers of the files that have a name as further parts of `first` have, ascending.
Result<std::vector<std::uint32_t>> further_numbers(const std::string& first) {
  const std::filesystem::path path(first);
  const std::string begin = path.stem().string() + "_";
  const std::filesystem::path folder =
      path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  std::vector<std::uint32_t> numbers;
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), last; !error && at != last;
       at.increment(error)) {
    const std::string name = at->path().filename().string();
    if (!name.starts_with(begin)) continue;
    std::uint32_t number = 0;
    std::from_chars(name.data() + begin.size(), name.data() + name.size(), number);
    // A number is written in one way: "x_01.db3" is no part.
    if (number > 0 && name == std::filesystem::path(part_path(first, number)).filename())
      numbers.push_back(number);
  }
  if (error)
    return Status{StatusCode::kIo, folder.string() + ": cannot look for further parts of " + first +
                                       ": " + error.message()};
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

/// Whether it is part `part` of this recording or a later one. A copy of one before is none.
bool is_of(const RecordingFacts& facts, const Candidate& candidate, std::uint32_t part) {
  return candidate.instead == nullptr && candidate.facts.session == facts.session &&
         candidate.facts.part >= part;
}

/// Where part `part` should be there is something else, or nothing: so it is behind the last
/// part, where a recorder was killed while it began the next, and where files of others have such
/// names. It is a hole where a later part is.
Status check_end(const RecordingFacts& facts, const std::string& first, std::uint32_t part,
                 const Candidate& found, const std::vector<std::uint32_t>& numbers) {
  std::string missing =
      part_path(first, part) + ": part " + std::to_string(part) +
      " of the recording is missing: found " +
      (found.instead != nullptr
           ? found.instead
           : "part " + std::to_string(found.facts.part) +
                 (found.facts.session == facts.session ? " of it" : " of another"));
  if (is_of(facts, found, part)) return {StatusCode::kCorrupt, missing};
  for (const std::uint32_t number : numbers) {
    if (number <= part) continue;
    const std::string path = part_path(first, number);
    const Result<Candidate> later = look_at(path);
    // Nothing says that one that cannot be read is of this recording.
    if (!later.is_ok() || !is_of(facts, later.value(), part)) continue;
    missing.append(", and ").append(path).append(" is part ");
    return {StatusCode::kCorrupt, missing + std::to_string(later.value().facts.part) + " of it"};
  }
  return Status::ok();
}

/// Adds parts 1, 2, ... of the recording whose part 0 is `first`. Errors: one cannot be read, or is
/// missing.
Status add_further_parts(const std::string& first, OpenedRecording& recording) {
  // Before a part is looked for: a recorder at work begins none before the one before it is there.
  const Result<std::vector<std::uint32_t>> numbers = further_numbers(first);
  NEARMESH_RETURN_IF_ERROR(numbers);
  for (std::uint32_t part = 1;; ++part) {
    const std::string path = part_path(first, part);
    Result<Candidate> next = look_at(path);
    if (!next.is_ok())
      return {next.status().code(), next.status().message() + "; by its name it is part " +
                                        std::to_string(part) + " of " + first +
                                        ": if it is not, move it elsewhere"};
    if (!is_of(recording.facts, next.value(), part) || next.value().facts.part != part)
      return check_end(recording.facts, first, part, next.value(), numbers.value());
    NEARMESH_RETURN_IF_ERROR(next.value().version);
    recording.parts.push_back({std::move(*next.value().database), path});
  }
}

}  // namespace

Result<OpenedRecording> open_recording(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error))
    return Status{StatusCode::kNotFound, path + ": " + (error ? error.message() : "no such file")};
  const bool is_mcap = mcap::is_mcap(path);  // such a file is whole
  Result<sqlite::Database> opened = is_mcap ? open_mcap(path) : open_part(path);
  OpenedRecording recording;
  Status status =
      opened.is_ok() ? read_facts(opened.value(), path, recording.facts) : opened.status();
  if (status.code() == StatusCode::kCorrupt && !is_mcap)
    status = {StatusCode::kCorrupt, "not a recorded session: " + status.message()};
  NEARMESH_RETURN_IF_ERROR(status);
  if (recording.facts.part != 0)
    return Status{StatusCode::kInvalidArgument, path + ": part " +
                                                    std::to_string(recording.facts.part) +
                                                    " of a recording; open its first file"};
  recording.parts.push_back({std::move(opened).value(), path});
  // All are found before the first is read: one that another follows is written no more.
  if (!is_mcap) NEARMESH_RETURN_IF_ERROR(add_further_parts(path, recording));
  return recording;
}

}  // namespace nearmesh
