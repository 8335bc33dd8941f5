// SPDX-License-Identifier: Apache-2.0
#include "system.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <exception>
#include <thread>

#include "nearmesh_system.hpp"

namespace nearmesh::stability {
namespace {

using Kind = Verdict::Kind;

constexpr std::size_t kMemoryLimit_bytes = std::size_t{8} << 30;
constexpr int kTimeout_exit = 75;

class Nearmesh : public System {
 public:
  [[nodiscard]] std::string name() const override { return "nearmesh"; }
  [[nodiscard]] std::string version() const override { return NEARMESH_VERSION; }
  [[nodiscard]] std::string call() const override {
    return "clean_mesh at 21 bits, bake, query; also from the base and from a random partial state "
           "by certify";
  }
  [[nodiscard]] Verdict answer(const Case& asked) const override {
    return ask_nearmesh(asked).verdict;
  }
};

Verdict guarded(const System& system, const Case& asked) {
  try {
    return system.answer(asked);
  } catch (const std::exception&) {
    return {.kind = Kind::kRefused};
  }
}

bool equal(const Verdict& x, const Verdict& y) {
  return x.kind == y.kind && x.has_pairs == y.has_pairs && x.pairs == y.pairs;
}

Verdict ask_in_threads(const System& system, Case asked) {
  asked.question = Question::kTouch;
  const Verdict alone = guarded(system, asked);
  constexpr int kRepeats = 4;
  bool agree[2] = {true, true};
  const auto run = [&](bool& agrees) {
    for (int i = 0; i < kRepeats; ++i) agrees = agrees && equal(alone, guarded(system, asked));
  };
  std::thread first(run, std::ref(agree[0]));
  run(agree[1]);
  first.join();
  return agree[0] && agree[1] ? alone : Verdict{.kind = Kind::kContradicts};
}

[[noreturn]] void run_child(const System& system, const Case& asked, unsigned limit_s, int pipe) {
  const rlimit cpu{limit_s, limit_s + 1}, memory{kMemoryLimit_bytes, kMemoryLimit_bytes},
      core{0, 0};
  setrlimit(RLIMIT_CPU, &cpu);
  setrlimit(RLIMIT_AS, &memory);
  setrlimit(RLIMIT_CORE, &core);
  for (const int signal_number : {SIGXCPU, SIGALRM})
    signal(signal_number, [](int) { _exit(kTimeout_exit); });
  alarm(30 * limit_s);  // for one that sleeps for ever; the machine may be shared
  const int null = open("/dev/null", O_WRONLY);
  dup2(null, STDOUT_FILENO);
  dup2(null, STDERR_FILENO);
  const Verdict verdict =
      asked.question == Question::kThreads ? ask_in_threads(system, asked) : guarded(system, asked);
  const bool written = write(pipe, &verdict, sizeof verdict) == sizeof verdict;
  _exit(written ? 0 : 1);
}

}  // namespace

std::unique_ptr<System> make_nearmesh() { return std::make_unique<Nearmesh>(); }

std::vector<std::unique_ptr<System>> available_systems() {
  std::vector<std::unique_ptr<System>> systems;
  systems.push_back(make_nearmesh());
  for (auto& peer : make_peers()) systems.push_back(std::move(peer));
  return systems;
}

Verdict ask_in_child(const System& system, const Case& asked, unsigned limit_s) {
  int ends[2];
  if (pipe(ends) != 0) return {.kind = Kind::kCrashed};
  const pid_t child = fork();
  if (child == 0) {
    close(ends[0]);
    run_child(system, asked, limit_s, ends[1]);
  }
  close(ends[1]);
  Verdict verdict{.kind = Kind::kCrashed};
  // The child's end closes when it exits, by itself or by its limit of CPU time: this read ends.
  const bool got = child > 0 && read(ends[0], &verdict, sizeof verdict) == sizeof verdict;
  close(ends[0]);
  int status = 0;
  if (child > 0) waitpid(child, &status, 0);
  if (got) return verdict;
  const bool timed_out = WIFEXITED(status) && WEXITSTATUS(status) == kTimeout_exit;
  return {.kind = timed_out ? Kind::kHung : Kind::kCrashed};
}

}  // namespace nearmesh::stability
