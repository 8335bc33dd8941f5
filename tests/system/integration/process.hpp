// SPDX-License-Identifier: Apache-2.0
#pragma once
// The real programs as child processes: started, waited for with a deadline, signalled, their
// output kept in files.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "poll.hpp"
#include "tests/support/folder.hpp"

namespace nearmesh::test {

/// For anything that ought to happen soon: a machine may be held up for many seconds.
constexpr double kDeadline_s = 100;
/// For the end of a program that is told to end, which is promised within two seconds, on such a
/// machine.
constexpr double kEnd_s = 20;

inline void pause(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

/// Polls until `done` holds; false when the time is over.
inline bool await(const std::function<bool()>& done, double seconds = kDeadline_s) {
  return poll(done, seconds, 0.005);
}

inline std::string read_text(const std::string& path) {
  std::ifstream in(path);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

inline std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

/// One running program of NEARMESH_BIN_DIR. Killed at the end of its scope, and when the test dies.
class Process {
 public:
  Process(const Folder& folder, const std::string& program,
          const std::vector<std::string>& arguments) {
    static int number = 0;
    const std::string name = folder.file(program + std::to_string(number++));
    out_ = name + ".out";
    err_ = name + ".err";
    std::vector<std::string> words{NEARMESH_BIN_DIR "/" + program};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    pid_ = ::fork();
    if (pid_ != 0) return;
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    ::signal(SIGINT, SIG_DFL);  // what a shell began in its background has it ignored
    const int out = ::open(out_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    const int err = ::open(err_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ::dup2(out, STDOUT_FILENO);
    ::dup2(err, STDERR_FILENO);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process() {
    if (is_over()) return;
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }

  [[nodiscard]] pid_t id() const { return pid_; }
  void signal(int number) const { ::kill(pid_, number); }
  /// Waits until it has a handler for a signal: before, that would end it without a word.
  bool catches(int number) {
    return await([&] {
             const std::string status = read_text("/proc/" + std::to_string(pid_) + "/status");
             const std::size_t at = status.find("SigCgt:");
             return is_over() ||
                    (at != std::string::npos &&
                     (std::stoull(status.substr(at + 7), nullptr, 16) >> (number - 1) & 1));
           }) &&
           !is_over();
  }
  [[nodiscard]] bool is_over() {
    if (exit_code_ != kRunning) return true;
    int status = 0;
    if (::waitpid(pid_, &status, WNOHANG) != pid_) return false;
    exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
    return true;
  }
  /// Waits for the end: the exit code, 1000 + the signal's number, or -1 when the time is over.
  int wait(double seconds = kDeadline_s) {
    return await([this] { return is_over(); }, seconds) ? exit_code_ : kRunning;
  }
  [[nodiscard]] std::string out() const { return read_text(out_); }
  [[nodiscard]] std::string err() const { return read_text(err_); }
  /// Waits until standard error holds a text.
  bool says(const std::string& text, double seconds = kDeadline_s) {
    const auto found = [&] { return err().find(text) != std::string::npos; };
    return await([&] { return found() || is_over(); }, seconds) && found();
  }

 private:
  static constexpr int kRunning = -1;
  pid_t pid_ = 0;
  std::string out_, err_;
  int exit_code_ = kRunning;
};

/// Runs a program to its end.
inline int run(const Folder& folder, const std::string& program,
               const std::vector<std::string>& arguments, std::string* out = nullptr,
               std::string* err = nullptr) {
  Process process(folder, program, arguments);
  const int code = process.wait();
  if (out != nullptr) *out = process.out();
  if (err != nullptr) *err = process.err();
  return code;
}
/// The same, again until it ends with 0 and `holds` of what it printed. Of a program that listens
/// for a time that is short and fixed, in which a busy machine may say nothing. False when the time
/// is over.
inline bool run_until(const Folder& folder, const std::string& program,
                      const std::vector<std::string>& arguments, std::string& out,
                      const std::function<bool()>& holds) {
  return await([&] { return run(folder, program, arguments, &out) == 0 && holds(); });
}

/// Path of a small model, made by nearmesh-model when a newer program asks for the first time;
/// tests share it.
inline std::string model_file(const std::string& kind, int size) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(NEARMESH_MODELS_DIR) / std::to_string(size);
  fs::create_directories(folder);
  const int lock = ::open((folder / "lock").c_str(), O_RDWR | O_CREAT, 0600);
  EXPECT_EQ(::flock(lock, LOCK_EX), 0);
  const fs::path model = folder / (kind + ".spm"), mesh = folder / (kind + ".ply");
  const fs::path program = NEARMESH_BIN_DIR "/nearmesh-model";
  if (!fs::exists(model) || fs::last_write_time(model) < fs::last_write_time(program)) {
    const Folder scratch;
    std::string err;
    EXPECT_EQ(
        run(scratch, "nearmesh-model",
            {"generate", kind, "--size", std::to_string(size), "-o", mesh.string()}, nullptr, &err),
        0)
        << err;
    EXPECT_EQ(
        run(scratch, "nearmesh-model",
            {"build", mesh.string(), "-o", model.string(), "--base-faces", "64"}, nullptr, &err),
        0)
        << err;
  }
  ::close(lock);
  return model.string();
}

/// Waits until a file of answers, which grows, has so many from that line on of which `is_wanted`
/// holds.
inline bool answers_come(const std::string& answers, std::size_t from_line, std::size_t count,
                         const std::function<bool(const std::string& line)>& is_wanted) {
  std::ifstream in;
  std::size_t line_number = 0, found = 0;
  std::string line, part;
  return poll(
      [&] {
        if (!in.is_open()) in.open(answers);
        for (in.clear(); std::getline(in, part);) {
          line += part;
          if (in.eof()) break;  // it is half of one
          if (line_number++ >= from_line) found += is_wanted(line) ? 1 : 0;
          line.clear();
        }
        return found >= count;
      },
      kDeadline_s, 0.05);
}

struct CheckedAnswers {
  std::uint64_t answers = 0, wrong = 1, certified = 0;
};
/// Out of what nearmesh-model check prints; nothing where it checked none.
inline std::optional<CheckedAnswers> read_checked(const std::string& out) {
  unsigned long long answers = 0, wrong = 1, certified = 0;
  if (std::sscanf(out.c_str(), "answers %llu, wrong %llu, certified %llu", &answers, &wrong,
                  &certified) != 3)
    return std::nullopt;
  return CheckedAnswers{answers, wrong, certified};
}
/// What nearmesh-model check says of a file of answers. In: paths of the models that it is about. A
/// failed expectation where it fails.
inline CheckedAnswers check_answers(const Folder& folder, const std::vector<std::string>& models,
                                    const std::string& answers) {
  std::vector<std::string> words{"check"};
  words.insert(words.end(), models.begin(), models.end());
  words.insert(words.end(), {"--answers", answers});
  std::string out, err;
  EXPECT_EQ(run(folder, "nearmesh-model", words, &out, &err), 0) << out << err;
  const std::optional<CheckedAnswers> checked = read_checked(out);
  EXPECT_TRUE(checked) << out;
  return checked.value_or(CheckedAnswers{});
}

}  // namespace nearmesh::test
