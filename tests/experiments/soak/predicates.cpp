// SPDX-License-Identifier: Apache-2.0
// Compares triangles_overlap with exact rational arithmetic on millions of hard pairs; a table of
// the families on standard output. Exit 0: all agree; 1: a disagreement, with its pair; 2: bad
// arguments; 3: a family has become too easy to prove anything.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cinttypes>
#include <cstdio>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/base/hash.hpp"
#include "core/base/stopwatch.hpp"
#include "core/geometry/triangle_overlap.hpp"
#include "exact_overlap.hpp"
#include "overlap_families.hpp"

using namespace nearmesh;
using namespace nearmesh::soak;

namespace {

constexpr std::uint64_t kBlock = 1024;  ///< pairs that a thread takes at a time

struct Options {
  std::uint64_t pairs = 1000000, first = 0, seed = 1;
  std::uint32_t threads = 1;
  bool digest_only = false;
};

struct Count {
  std::uint64_t pairs = 0;
  std::uint64_t touching = 0;
  std::uint64_t tight = 0;  ///< the answer changes when one triangle moves by some unit step
  std::uint64_t disagreements = 0;
};

struct Outcome {
  std::vector<Count> families = std::vector<Count>(overlap_families().size());
  std::uint64_t digest = 0;  ///< a sum of mixes, so that no order of threads matters

  void add(const Outcome& other) {
    for (std::size_t f = 0; f < families.size(); ++f) {
      families[f].pairs += other.families[f].pairs;
      families[f].touching += other.families[f].touching;
      families[f].tight += other.families[f].tight;
      families[f].disagreements += other.families[f].disagreements;
    }
    digest += other.digest;
  }
};

LatticeTriangle moved(LatticeTriangle t, const LatticePoint& by) {
  for (LatticePoint& p : t)
    for (int k = 0; k < 3; ++k) p[k] += by[k];
  return t;
}

/// What is wrong with the answer; nullptr when nothing is.
const char* find_fault(const TrianglePair& pair, bool answer, Random& random) {
  const bool truth =
      random.below(2) ? test::exact_overlap(pair.a, pair.b) : test::exact_overlap(pair.b, pair.a);
  if (answer != truth) return truth ? "they touch, the answer is free" : "they are apart";
  constexpr std::size_t kOrders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1},
                                         {1, 0, 2}, {0, 2, 1}, {2, 1, 0}};
  for (const auto& i : kOrders) {
    const auto& j = kOrders[random.below(6)];
    const LatticeTriangle a{pair.a[i[0]], pair.a[i[1]], pair.a[i[2]]};
    const LatticeTriangle b{pair.b[j[0]], pair.b[j[1]], pair.b[j[2]]};
    if (triangles_overlap(a, b) != truth) return "another order of corners, another answer";
    if (triangles_overlap(b, a) != truth) return "the other way round, another answer";
  }
  LatticePoint far;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t power = std::int64_t{1} << random.below(62);
    far[k] = random.below(2) ? power : -power;
  }
  if (triangles_overlap(moved(pair.a, far), moved(pair.b, far)) != truth)
    return "another place, another answer";
  return nullptr;
}

bool is_tight(const TrianglePair& pair, bool answer) {
  for (int k = 0; k < 3; ++k)
    for (const int step : {-1, 1}) {
      LatticePoint by;
      by[k] = step;
      if (triangles_overlap(pair.a, moved(pair.b, by)) != answer) return true;
    }
  return false;
}

std::uint64_t digest_of(std::uint64_t index, const TrianglePair& pair, bool answer) {
  std::uint64_t digest = mix(2 * index + answer);
  for (const LatticeTriangle* t : {&pair.a, &pair.b})
    for (const LatticePoint& p : *t)
      for (const std::int64_t x : p.v) digest = mix(digest ^ static_cast<std::uint64_t>(x));
  return digest;
}

void print_reproducer(const Options& options, std::uint64_t index, const TrianglePair& pair,
                      bool answer, const char* fault) {
  std::printf("%s: triangles_overlap says %s, but %s\n",
              overlap_families()[index % overlap_families().size()].name, answer ? "true" : "false",
              fault);
  for (const LatticeTriangle* t : {&pair.a, &pair.b}) {
    std::printf("  {{");
    for (std::size_t i = 0; i < 3; ++i)
      std::printf("%s{{%" PRId64 ", %" PRId64 ", %" PRId64 "}}", i ? ", " : "", (*t)[i].v[0],
                  (*t)[i].v[1], (*t)[i].v[2]);
    std::printf("}}\n");
  }
  std::printf("  again with: --seed %" PRIu64 " --first %" PRIu64 " --pairs 1\n", options.seed,
              index);
}

class Soak {
 public:
  explicit Soak(const Options& options) : options_(options) {}

  Outcome run() {
    std::vector<std::thread> threads;
    for (std::uint32_t i = 1; i < options_.threads; ++i) threads.emplace_back([this] { work(); });
    work();
    for (std::thread& thread : threads) thread.join();
    return total_;
  }

 private:
  void work() {
    Outcome mine;
    for (;;) {
      const std::uint64_t begin = next_.fetch_add(kBlock);
      if (begin >= options_.pairs || failed_) break;
      const std::uint64_t end = std::min(begin + kBlock, options_.pairs);
      for (std::uint64_t i = begin; i < end; ++i) check(options_.first + i, mine);
      show_progress(end);
    }
    const std::lock_guard lock(mutex_);
    total_.add(mine);
  }

  void check(std::uint64_t index, Outcome& mine) {
    const std::size_t family = index % mine.families.size();
    Random random(mix(options_.seed) ^ mix(~index));
    const TrianglePair pair = make_pair(overlap_families()[family], random);
    const bool answer = triangles_overlap(pair.a, pair.b);
    mine.digest += digest_of(index, pair, answer);
    Count& count = mine.families[family];
    ++count.pairs;
    count.touching += answer;
    if (options_.digest_only) return;
    count.tight += is_tight(pair, answer);
    if (const char* fault = find_fault(pair, answer, random)) {
      ++count.disagreements;
      const std::lock_guard lock(mutex_);
      if (!failed_.exchange(true)) print_reproducer(options_, index, pair, answer, fault);
    }
  }

  void show_progress(std::uint64_t done) {
    const std::lock_guard lock(mutex_);
    if (watch_.seconds() < shown_s_ + 10) return;
    shown_s_ = watch_.seconds();
    std::fprintf(stderr, "%" PRIu64 " of %" PRIu64 " pairs, %.0f s\n", done, options_.pairs,
                 shown_s_);
  }

  const Options options_;
  const Stopwatch watch_;
  std::atomic<std::uint64_t> next_{0};
  std::atomic<bool> failed_{false};
  std::mutex mutex_;  ///< guards what follows, and printing
  Outcome total_;
  double shown_s_ = 0;
};

void print_row(const char* name, const Count& count) {
  const double pairs = count.pairs ? static_cast<double>(count.pairs) : 1;
  std::printf("%-24s %11" PRIu64 " %9.1f %% %9.1f %% %14" PRIu64 "\n", name, count.pairs,
              100 * static_cast<double>(count.touching) / pairs,
              100 * static_cast<double>(count.tight) / pairs, count.disagreements);
}

/// Both answers must occur often, and often within a unit of each other.
bool is_hard(const Count& count) {
  if (count.pairs < 1000) return true;  // too few to tell
  const std::uint64_t twentieth = count.pairs / 20;
  return count.touching > twentieth && count.pairs - count.touching > twentieth &&
         count.tight > twentieth;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app{"Compares triangles_overlap with exact rational arithmetic on hard pairs."};
  app.add_option("--pairs", options.pairs, "How many pairs")->capture_default_str();
  app.add_option("--seed", options.seed, "Chooses the pairs")->capture_default_str();
  app.add_option("--first", options.first, "Number of the first pair")->capture_default_str();
  app.add_option("--threads", options.threads, "Threads; the pairs are the same for any number")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  app.add_flag("--digest", options.digest_only,
               "Decide only, without the comparison, and print the digest alone");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }

  const Outcome outcome = Soak(options).run();
  int result = 0;
  if (!options.digest_only) {
    std::printf("%-24s %11s %11s %11s %14s\n", "family", "pairs", "touching", "tight",
                "disagreements");
    Count total;
    for (std::size_t f = 0; f < outcome.families.size(); ++f) {
      const Count& count = outcome.families[f];
      const char* name = overlap_families()[f].name;
      print_row(name, count);
      total.pairs += count.pairs;
      total.touching += count.touching;
      total.tight += count.tight;
      total.disagreements += count.disagreements;
      if (!is_hard(count)) {
        std::fprintf(stderr, "%s: too few near pairs of either answer\n", name);
        result = 3;
      }
    }
    print_row("all", total);
    if (total.disagreements > 0) result = 1;
  }
  std::printf("digest of inputs and decisions: %s\n", to_hex(outcome.digest).c_str());
  return result;
}
