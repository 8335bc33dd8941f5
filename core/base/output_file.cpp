// SPDX-License-Identifier: Apache-2.0
#include "output_file.hpp"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <utility>

namespace nearmesh {
namespace {

namespace fs = std::filesystem;

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

Status io_error(const std::string& path, const char* action) {
  return {StatusCode::kIo, path + ": cannot " + action + ": " + std::strerror(errno)};
}

bool is_stream(const struct stat& info) { return S_ISFIFO(info.st_mode) || S_ISCHR(info.st_mode); }

Result<bool> is_of_kind(const std::string& path, const FileKind& kind) {
  const std::unique_ptr<std::FILE, FileCloser> file(std::fopen(path.c_str(), "rb"));
  if (!file) return io_error(path, "look at what is there");
  std::string head(std::max(kind.begins.size(), kind.or_begins.size()), '\0');
  head.resize(std::fread(head.data(), 1, head.size(), file.get()));
  return head.empty() || head.starts_with(kind.begins) || head.starts_with(kind.or_begins);
}

Status check_is_not_input(const std::string& path, const struct stat& info,
                          const std::string& input) {
  struct stat other {};
  if (::stat(input.c_str(), &other) != 0 || other.st_dev != info.st_dev ||
      other.st_ino != info.st_ino)
    return Status::ok();
  return {StatusCode::kConflict, path + ": is the input " + input + "; name another file to write"};
}

/// Where a link leads, also if nothing is there yet.
fs::path without_links(fs::path path) {
  constexpr int kMostLinks = 40;
  std::error_code error;
  for (int i = 0; i < kMostLinks && fs::is_symlink(path, error); ++i)
    path = path.parent_path() / fs::read_symlink(path, error);  // an absolute one replaces it all
  return path;
}

/// What this process sees of a file that it has open.
std::string descriptor_path(int descriptor) {
  return "/proc/self/fd/" + std::to_string(descriptor);
}

/// A file in the folder that has no name yet, so that nothing of it is left where the process is
/// killed. Out: below 0 where there is no such thing: in file systems as NFS and FAT, and without
/// /proc, where it could not be named later.
int open_unnamed(const fs::path& folder) {
  const int descriptor =
      ::open(folder.empty() ? "." : folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0666);
  if (descriptor < 0 || ::access(descriptor_path(descriptor).c_str(), F_OK) == 0) return descriptor;
  ::close(descriptor);
  return -1;
}

/// Files that wait for others hold a quarter of the process's descriptors at most: of these it has
/// few.
bool may_be_held(int descriptor) {
  rlimit limit{};
  return ::getrlimit(RLIMIT_NOFILE, &limit) == 0 &&
         static_cast<rlim_t>(descriptor) < limit.rlim_cur / 4;
}

}  // namespace

Status check_output(const std::string& path, const FileKind& kind,
                    const std::vector<std::string>& inputs) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) {
    if (errno != ENOENT) return io_error(path, "write");
    const std::string folder = without_links(path).parent_path().string();
    if (::access(folder.empty() ? "." : folder.c_str(), W_OK | X_OK) != 0)
      return io_error(path, "create");
    return Status::ok();
  }
  for (const std::string& input : inputs)
    NEARMESH_RETURN_IF_ERROR(check_is_not_input(path, info, input));
  if (::access(path.c_str(), W_OK) != 0) return io_error(path, "write");
  if (is_stream(info)) return Status::ok();
  if (S_ISREG(info.st_mode)) {
    const Result<bool> fits = is_of_kind(path, kind);
    NEARMESH_RETURN_IF_ERROR(fits);
    if (fits.value()) return Status::ok();
  }
  return {StatusCode::kConflict, path + ": exists and is not " + std::string(kind.name) +
                                     ", so it is not replaced; name another file or remove it"};
}

Result<OutputFile> OutputFile::create(const std::string& path, const FileKind& kind,
                                      const std::vector<std::string>& inputs) {
  NEARMESH_RETURN_IF_ERROR(check_output(path, kind, inputs));
  OutputFile out;
  out.path_ = path;
  struct stat old {};
  const bool exists = ::stat(path.c_str(), &old) == 0;
  if (exists && is_stream(old)) {
    out.file_ = std::fopen(path.c_str(), "wb");
    if (out.file_ == nullptr) return out.failed("open");
    return out;
  }
  out.place_ = without_links(path).string();
  int descriptor = open_unnamed(fs::path(out.place_).parent_path());
  out.is_unnamed_ = descriptor >= 0;
  const auto make = [&descriptor](const char* name) {
    descriptor = ::open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    return descriptor >= 0;
  };
  if (!out.is_unnamed_) static_cast<void>(out.put_beside(make));
  // That it cannot have a name beside its place is to be known before others are put in theirs.
  if (struct stat found{};
      out.is_unnamed_ && ::lstat(out.name_beside_it(0).c_str(), &found) != 0 && errno != ENOENT) {
    const Status status = out.failed("create a file beside it");
    ::close(descriptor);
    return status;
  }
  out.file_ = descriptor < 0 ? nullptr : ::fdopen(descriptor, "wb");
  if (out.file_ == nullptr) {
    const Status status = out.failed("create a file beside it");
    if (descriptor >= 0) ::close(descriptor);
    return status;
  }
  // A file keeps the rights that its owner gave it; where that is refused it has the usual ones.
  if (exists) static_cast<void>(::fchmod(descriptor, old.st_mode & 0777U) != 0);
  return out;
}

Result<OutputFile> OutputFile::whole(const std::string& path, const FileKind& kind,
                                     std::string_view bytes,
                                     const std::vector<std::string>& inputs) {
  Result<OutputFile> file = create(path, kind, inputs);
  NEARMESH_RETURN_IF_ERROR(file);
  NEARMESH_RETURN_IF_ERROR(file.value().write(bytes));
  NEARMESH_RETURN_IF_ERROR(file.value().flush());
  OutputFile& written = file.value();
  const bool stays_unnamed = written.is_unnamed_ && may_be_held(::fileno(written.file_));
  if (!stays_unnamed) NEARMESH_RETURN_IF_ERROR(written.end_writing());
  return file;
}

OutputFile::OutputFile(OutputFile&& other) noexcept
    : path_(std::move(other.path_)),
      place_(std::move(other.place_)),
      beside_(std::exchange(other.beside_, {})),
      is_unnamed_(std::exchange(other.is_unnamed_, false)),
      file_(std::exchange(other.file_, nullptr)) {}

OutputFile::~OutputFile() {
  if (file_ != nullptr) std::fclose(file_);
  if (!beside_.empty()) std::remove(beside_.c_str());
}

Status OutputFile::failed(const char* action) const { return io_error(path_, action); }

Status OutputFile::write(std::string_view bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_) != bytes.size()) return failed("write");
  return Status::ok();
}

Status OutputFile::flush() {
  if (std::fflush(file_) != 0) return failed("write");
  return Status::ok();
}

Status OutputFile::put_in_place() {
  NEARMESH_RETURN_IF_ERROR(flush());
  return rename();
}

Status OutputFile::close() {
  if (file_ == nullptr) return rename();
  if (!is_unnamed_) {
    NEARMESH_RETURN_IF_ERROR(end_writing());
    return rename();
  }
  NEARMESH_RETURN_IF_ERROR(put_in_place());
  if (std::fclose(std::exchange(file_, nullptr)) != 0) return failed("write");
  return Status::ok();
}

Status OutputFile::end_writing() {
  NEARMESH_RETURN_IF_ERROR(flush());
  if (is_unnamed_) NEARMESH_RETURN_IF_ERROR(name_beside());
  // Full disks are often told of only here.
  if (std::fclose(std::exchange(file_, nullptr)) != 0) return failed("write");
  return Status::ok();
}

std::string OutputFile::name_beside_it(int tried) const {
  return place_ + "." + std::to_string(::getpid()) +
         (tried > 0 ? "-" + std::to_string(tried) : "") + ".partial";
}

template <class Make>
bool OutputFile::put_beside(const Make& make) {
  constexpr int kMostTries = 100;  // what a process of this number left behind is not touched
  for (int i = 0; i < kMostTries; ++i) {
    beside_ = name_beside_it(i);
    if (make(beside_.c_str())) return true;
    if (errno != EEXIST) break;
  }
  beside_.clear();
  return false;
}

Status OutputFile::name_beside() {
  const std::string from = descriptor_path(::fileno(file_));
  if (!put_beside([&](const char* name) {
        return ::linkat(AT_FDCWD, from.c_str(), AT_FDCWD, name, AT_SYMLINK_FOLLOW) == 0;
      }))
    return failed("name a file beside it");
  is_unnamed_ = false;
  return Status::ok();
}

Status OutputFile::rename() {
  if (is_unnamed_) NEARMESH_RETURN_IF_ERROR(name_beside());
  if (beside_.empty()) return Status::ok();
  if (std::rename(beside_.c_str(), place_.c_str()) != 0) return failed("rename into place");
  beside_.clear();
  return Status::ok();
}

Status write_file(const std::string& path, const FileKind& kind, std::string_view bytes,
                  const std::vector<std::string>& inputs) {
  Result<OutputFile> file = OutputFile::whole(path, kind, bytes, inputs);
  NEARMESH_RETURN_IF_ERROR(file);
  return file.value().close();
}

}  // namespace nearmesh
