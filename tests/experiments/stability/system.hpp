// SPDX-License-Identifier: Apache-2.0
#pragma once
// One way of asking for each system in the comparison. The same doubles go to each; each is used by
// its documented call for all contacts of two triangle meshes. A system that is not installed is
// not in the list.

#include <memory>
#include <string>
#include <vector>

#include "case.hpp"

namespace nearmesh::stability {

class System {
 public:
  virtual ~System() = default;
  [[nodiscard]] virtual std::string name() const = 0;
  [[nodiscard]] virtual std::string version() const = 0;
  /// What is called, for the legend.
  [[nodiscard]] virtual std::string call() const = 0;
  /// May throw, crash or hang: it runs in a child process.
  [[nodiscard]] virtual Verdict answer(const Case& asked) const = 0;
};

std::unique_ptr<System> make_nearmesh();
/// The other libraries that this build has.
std::vector<std::unique_ptr<System>> make_peers();

/// nearmesh first, then those of the others that this build has.
[[nodiscard]] std::vector<std::unique_ptr<System>> available_systems();

/// Asks in a forked child with a limit of CPU time and of memory, so that a crash or a hang is a
/// verdict. An exception is a refusal. kThreads is asked once alone and then in two threads at
/// once.
[[nodiscard]] Verdict ask_in_child(const System& system, const Case& asked, unsigned limit_s);

}  // namespace nearmesh::stability
