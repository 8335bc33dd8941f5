// SPDX-License-Identifier: Apache-2.0
#pragma once
// The one way in which a file that a user named is written: beside its place and renamed, so that a
// failure leaves what was there, and never over the input or over a file of another kind.
// (Recordings never replace a file; folders of identities have rules of their own.)

#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

/// What a file is, told by how it begins.
struct FileKind {
  std::string_view name;  ///< in messages: "a PLY file"
  std::string_view begins;
  std::string_view or_begins = begins;
};
inline constexpr FileKind kPlyFile{"a PLY file", "ply"};

/// May `path` be written as a file of this kind? Nothing is there, or an empty file, or one of this
/// kind that is none of `inputs` under any name; or a pipe or a device such as /dev/stdout, which
/// is written into as it is. For a long command, before it begins.
/// Errors: kConflict (the input, a file of another kind, a folder), kIo (may not be written),
/// naming the path.
[[nodiscard]] Status check_output(const std::string& path, const FileKind& kind,
                                  const std::vector<std::string>& inputs = {});

/// A file that is being written. Until put_in_place() or close() it has no name, so nothing of it
/// is left however the process ends. Where the file system has no such files it stands beside its
/// place, as PATH.PROCESS.partial, and is removed unless the process is killed. A link is followed:
/// the file that it names is replaced. Errors, of all: kIo, naming the path.
class OutputFile {
 public:
  /// Errors: also those of check_output().
  [[nodiscard]] static Result<OutputFile> create(const std::string& path, const FileKind& kind,
                                                 const std::vector<std::string>& inputs = {});
  /// A whole file, of which only close() is left, which puts it in place: several appear together
  /// where none is closed before all could be written. Of very many those beyond a quarter of the
  /// process's descriptors stand beside their places meanwhile.
  /// Errors: also those of check_output().
  [[nodiscard]] static Result<OutputFile> whole(const std::string& path, const FileKind& kind,
                                                std::string_view bytes,
                                                const std::vector<std::string>& inputs = {});
  OutputFile(OutputFile&& other) noexcept;
  OutputFile& operator=(OutputFile&&) = delete;
  ~OutputFile();

  [[nodiscard]] Status write(std::string_view bytes);
  [[nodiscard]] Status flush();
  /// Flushes, and replaces what was there; writing may go on, and readers see it. For lines that
  /// are looked at as they come.
  [[nodiscard]] Status put_in_place();
  /// put_in_place() where that has not been done. Nothing may be called afterwards.
  [[nodiscard]] Status close();

 private:
  OutputFile() = default;
  [[nodiscard]] Status failed(const char* action) const;
  [[nodiscard]] Status end_writing();
  [[nodiscard]] std::string name_beside_it(int tried) const;
  template <class Make>
  [[nodiscard]] bool put_beside(const Make& make);
  [[nodiscard]] Status name_beside();
  [[nodiscard]] Status rename();

  std::string path_, place_, beside_;  ///< as the user has it; without links; empty: not beside it
  bool is_unnamed_ = false;            ///< else, where it is not beside it: in its place
  std::FILE* file_ = nullptr;          ///< none: all is written
};

/// A whole file, in its place.
[[nodiscard]] Status write_file(const std::string& path, const FileKind& kind,
                                std::string_view bytes,
                                const std::vector<std::string>& inputs = {});

}  // namespace nearmesh
