// SPDX-License-Identifier: Apache-2.0
#pragma once
// The parts of a soak: one life of a peer, what it flies, and the check of what it answered.

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "soak.hpp"

namespace nearmesh::test {

enum class Ending {
  kLands,    ///< its trajectory ends
  kLeaves,   ///< interrupted
  kCrashes,  ///< killed, at any moment
};

/// The demo's two flights, cut to any length: forth and back along the same rows.
class Routes {
 public:
  Routes(const Folder& folder, const Exercise& exercise);
  /// A trajectory of so many rows from the given one on.
  [[nodiscard]] std::string cut(std::size_t flight, std::size_t from, std::size_t rows) const;

 private:
  std::string head_;
  std::vector<std::string> rows_[2];
};

/// How often programs warned, by line; words with digits in them are left out.
using Warnings = std::map<std::string, std::uint64_t>;
void count_warnings(const std::string& said, Warnings& warnings);

struct LifePlan {
  std::string name;   ///< of the body that it moves
  std::string other;  ///< a second body, another peer's, or none
  Ending ending = Ending::kLeaves;
  double life_s = 10;
  std::size_t flight = 0, from_row = 0;
};

/// One nearmesh-subscriber, from its start to its end.
class Life {
 public:
  Life(const LifePlan& plan, const std::vector<std::string>& bus, const Routes& routes,
       double rate_hz);
  [[nodiscard]] const LifePlan& plan() const { return plan_; }
  [[nodiscard]] pid_t id() const { return process_->id(); }
  /// Ends it when its time has come. Out: true once it is over.
  bool is_over();
  /// Ends it before its time.
  void leave();
  int wait() { return process_->wait(); }
  /// Of one that is over: what was not as planned; empty when all was.
  [[nodiscard]] std::string fault() const;
  [[nodiscard]] std::string said() const { return process_->err(); }
  /// Of one that is over: whole lines only, since who is killed may have written half of one. Empty
  /// when there is none.
  [[nodiscard]] std::string answers() const;

 private:
  LifePlan plan_;
  Folder folder_;
  std::unique_ptr<Process> process_;
  const Stopwatch watch_;
  bool signalled_ = false;
};

/// Checks answers against the full meshes with nearmesh-model, some lives at a time, beside the
/// run.
class AnswerCheck {
 public:
  explicit AnswerCheck(const Exercise& exercise) : exercise_(exercise) {}
  void take(const std::string& lines);
  /// Takes the verdict of a check that ended, and starts one of what waits: of all, or when that is
  /// enough to be worth it.
  /// Throws std::runtime_error when a check gave no verdict.
  void step(bool all = false);
  void finish();

  std::uint64_t answers = 0, certified = 0, wrong = 0;
  std::vector<double> joins_s;      ///< from the start of a program to its first certified answer
  std::vector<std::string> faults;  ///< what was wrong

 private:
  void take_verdict();

  const Exercise& exercise_;
  std::unique_ptr<Folder> waiting_ = std::make_unique<Folder>(), checked_;
  std::vector<std::string> files_;
  std::unique_ptr<Process> check_;
};

}  // namespace nearmesh::test
