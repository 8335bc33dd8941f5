// SPDX-License-Identifier: Apache-2.0
// Files are written whole or not at all, and never over what is none of their kind.
#include "core/base/output_file.hpp"
#include "tests/support/folder.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>
#include <vector>

namespace nearmesh {
namespace {

namespace fs = std::filesystem;

constexpr FileKind kPoem{"a poem", "POEM"};

class OutputFiles : public ::testing::Test {
 protected:
  [[nodiscard]] std::string put(const std::string& name, const std::string& text) const {
    std::ofstream(folder / name) << text;
    return (folder / name).string();
  }
  [[nodiscard]] std::string path(const std::string& name) const { return (folder / name).string(); }
  static std::string read(const std::string& path) {
    std::ifstream in(path);
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
  }
  [[nodiscard]] std::ptrdiff_t files() const {
    return std::distance(fs::directory_iterator(folder), fs::directory_iterator{});
  }
  /// Refused, naming the path.
  static void expect_refused(const Status& status, StatusCode code, const std::string& path) {
    EXPECT_EQ(status.code(), code) << status.message();
    EXPECT_TRUE(status.message().starts_with(path + ": ")) << status.message();
  }
  const test::Folder scratch_;
  const fs::path folder = scratch_.path();
};

/// As on a full disk: no byte of any file can be written while this lives.
class FullDisk {
 public:
  FullDisk() {
    before_ = std::signal(SIGXFSZ, SIG_IGN);
    EXPECT_EQ(::getrlimit(RLIMIT_FSIZE, &limit_), 0);
    const rlimit none{0, limit_.rlim_max};
    EXPECT_EQ(::setrlimit(RLIMIT_FSIZE, &none), 0);
  }
  ~FullDisk() {
    ::setrlimit(RLIMIT_FSIZE, &limit_);
    std::signal(SIGXFSZ, before_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  rlimit limit_{};
  void (*before_)(int) = nullptr;
};

TEST_F(OutputFiles, AreMadeAndReplaceTheirLike) {
  for (const std::string& text : {std::string("POEM one"), std::string("POEM two, longer")}) {
    const Status status = write_file(path("a"), kPoem, text);
    ASSERT_TRUE(status.is_ok()) << status.message();
    EXPECT_EQ(read(path("a")), text);
  }
  EXPECT_EQ(files(), 1);
}

TEST_F(OutputFiles, ReplaceWhatIsEmpty) {
  const std::string empty = put("a", "");
  EXPECT_TRUE(write_file(empty, kPoem, "POEM").is_ok());
  EXPECT_EQ(read(empty), "POEM");
}

TEST_F(OutputFiles, NeverReplaceAnotherKind) {
  for (const char* text : {"notes", "P", "POE", " POEM"}) {
    const std::string other = put("notes.txt", text);
    expect_refused(check_output(other, kPoem), StatusCode::kConflict, other);
    expect_refused(write_file(other, kPoem, "POEM"), StatusCode::kConflict, other);
    EXPECT_EQ(read(other), text);
  }
  expect_refused(check_output(folder.string(), kPoem), StatusCode::kConflict, folder.string());
  EXPECT_TRUE(check_output(put("b", "ODE"), {"a poem", "POEM", "ODE"}).is_ok());
}

TEST_F(OutputFiles, AreNeverTheInputUnderAnyName) {
  const std::string input = put("in", "POEM");
  fs::create_symlink(input, folder / "link");
  fs::create_hard_link(input, folder / "twin");
  fs::create_directory(folder / "sub");
  for (const std::string& name :
       {input, path("link"), path("twin"), path("./in"), path("sub/../in")}) {
    expect_refused(check_output(name, kPoem, {path("other"), input}), StatusCode::kConflict, name);
    EXPECT_FALSE(write_file(name, kPoem, "POEM two", {input}).is_ok());
    EXPECT_EQ(read(input), "POEM");
  }
  EXPECT_TRUE(check_output(put("copy", "POEM"), kPoem, {input}).is_ok());
}

TEST_F(OutputFiles, LeaveWhatWasThereOnAFullDisk) {
  const std::string old = put("a", "POEM old");
  {
    const FullDisk full;
    expect_refused(write_file(old, kPoem, "POEM new"), StatusCode::kIo, old);
    expect_refused(write_file(path("b"), kPoem, "POEM new"), StatusCode::kIo, path("b"));
  }
  EXPECT_EQ(read(old), "POEM old");
  EXPECT_EQ(files(), 1);
}

TEST_F(OutputFiles, LeaveWhatWasThereWhenGivenUp) {
  const std::string old = put("a", "POEM old");
  {
    Result<OutputFile> file = OutputFile::create(old, kPoem);
    ASSERT_TRUE(file.is_ok());
    ASSERT_TRUE(file.value().write("POEM new").is_ok());
  }
  EXPECT_EQ(read(old), "POEM old");
  EXPECT_EQ(files(), 1);
}

TEST_F(OutputFiles, AppearTogetherOnceAllCouldBeWritten) {
  const std::string old = put("a", "POEM old");
  {
    const Result<OutputFile> written = OutputFile::whole(old, kPoem, "POEM new");
    ASSERT_TRUE(written.is_ok());
    const FullDisk full;
    expect_refused(OutputFile::whole(path("b"), kPoem, "POEM new").status(), StatusCode::kIo,
                   path("b"));
  }
  EXPECT_EQ(read(old), "POEM old");
  EXPECT_EQ(files(), 1);

  std::vector<OutputFile> together;
  for (const char* name : {"a", "b"}) {
    Result<OutputFile> written = OutputFile::whole(path(name), kPoem, "POEM new");
    ASSERT_TRUE(written.is_ok());
    together.push_back(std::move(written).value());
  }
  EXPECT_EQ(read(old), "POEM old");
  EXPECT_FALSE(fs::exists(path("b")));
  for (OutputFile& file : together) EXPECT_TRUE(file.close().is_ok());
  for (const char* name : {"a", "b"}) EXPECT_EQ(read(path(name)), "POEM new");
  EXPECT_EQ(files(), 2);
}

// Those that wait for others must leave descriptors for what else the process does.
TEST_F(OutputFiles, ManyThatWaitHoldAQuarterOfTheDescriptors) {
  rlimit limit{};
  ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &limit), 0);
  const rlimit few{200, limit.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &few), 0);
  std::vector<OutputFile> together;
  for (int i = 0; i < 300; ++i) {
    Result<OutputFile> written = OutputFile::whole(path(std::to_string(i)), kPoem, "POEM");
    ASSERT_TRUE(written.is_ok()) << i << written.status().message();
    together.push_back(std::move(written).value());
  }
  EXPECT_LE(std::distance(fs::directory_iterator("/proc/self/fd"), fs::directory_iterator{}), 52);
  for (OutputFile& file : together) EXPECT_TRUE(file.close().is_ok());
  ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &limit), 0);
  EXPECT_EQ(files(), 300);
  EXPECT_EQ(read(path("299")), "POEM");
}

TEST_F(OutputFiles, LeaveNothingBesideWhenTheProcessIsKilled) {
  const int unnamed = ::open(folder.c_str(), O_TMPFILE | O_WRONLY, 0600);
  if (unnamed < 0) GTEST_SKIP() << "this file system has no files without a name";
  ::close(unnamed);
  const std::string old = put("a", "POEM old");
  const pid_t child = ::fork();
  if (child == 0) {
    Result<OutputFile> one = OutputFile::create(path("a"), kPoem),
                       two = OutputFile::whole(path("b"), kPoem, "POEM");
    if (one.is_ok() && two.is_ok() && one.value().write("POEM new").is_ok() &&
        one.value().flush().is_ok())
      ::raise(SIGKILL);
    ::_exit(1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(read(old), "POEM old");
  EXPECT_EQ(files(), 1);
}

TEST_F(OutputFiles, CanBeReadWhileTheyGrow) {
  const std::string at = put("a", "POEM old");
  Result<OutputFile> created = OutputFile::create(at, kPoem);
  ASSERT_TRUE(created.is_ok());
  OutputFile file = std::move(created).value();
  EXPECT_EQ(read(at), "POEM old");
  ASSERT_TRUE(file.write("POEM new").is_ok() && file.put_in_place().is_ok());
  EXPECT_EQ(read(at), "POEM new");
  ASSERT_TRUE(file.write(", and more").is_ok() && file.put_in_place().is_ok());
  EXPECT_EQ(read(at), "POEM new, and more");
  EXPECT_TRUE(file.close().is_ok());
  EXPECT_EQ(files(), 1);
}

TEST_F(OutputFiles, FollowLinksAndKeepRights) {
  const std::string real = put("real", "POEM");
  fs::create_symlink("real", folder / "link");
  fs::create_symlink("later", folder / "dangling");
  fs::permissions(real, fs::perms{0640});
  ASSERT_TRUE(write_file(path("link"), kPoem, "POEM two").is_ok());
  ASSERT_TRUE(write_file(path("dangling"), kPoem, "POEM three").is_ok());
  EXPECT_TRUE(fs::is_symlink(folder / "link") && fs::is_symlink(folder / "dangling"));
  EXPECT_EQ(read(real), "POEM two");
  EXPECT_EQ(fs::status(real).permissions(), fs::perms{0640});
  EXPECT_EQ(read(path("later")), "POEM three");
}

TEST_F(OutputFiles, TouchNothingThatAnotherProcessLeftBeside) {
  const std::string left = put("a." + std::to_string(::getpid()) + ".partial", "mine");
  EXPECT_TRUE(write_file(path("a"), kPoem, "POEM").is_ok());
  EXPECT_EQ(read(left), "mine");
}

TEST_F(OutputFiles, WriteIntoDevicesAsTheyAre) {
  struct stat before {
  }, after{};
  ASSERT_EQ(::stat("/dev/null", &before), 0);
  EXPECT_TRUE(write_file("/dev/null", kPoem, "POEM").is_ok());
  ASSERT_EQ(::stat("/dev/null", &after), 0);
  EXPECT_EQ(before.st_ino, after.st_ino);
  expect_refused(write_file("/dev/full", kPoem, "POEM"), StatusCode::kIo, "/dev/full");
}

TEST_F(OutputFiles, SayWhereNothingCanBeMade) {
  expect_refused(check_output(path("nowhere/a"), kPoem), StatusCode::kIo, path("nowhere/a"));
  expect_refused(check_output(put("file", "POEM") + "/a", kPoem), StatusCode::kIo,
                 path("file") + "/a");
  if (::geteuid() == 0) return;  // who may write anything
  const std::string locked = put("locked", "POEM");
  fs::permissions(locked, fs::perms{0444});
  expect_refused(check_output(locked, kPoem), StatusCode::kIo, locked);
}

}  // namespace
}  // namespace nearmesh
