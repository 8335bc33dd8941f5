// SPDX-License-Identifier: Apache-2.0
// Random poses of many models under many ways of refining: every answer is compared with the full
// meshes'.
//   nearmesh-soak-answers --poses 1000000 --seed 1 --threads 2
// The table on standard output, digest included, depends on poses, seed and policies only. Exit 1
// at the first false answer, with the arguments that bring it back.

#include <CLI/CLI.hpp>
#include <atomic>
#include <cinttypes>
#include <cstdio>
#include <memory>
#include <mutex>
#include <thread>

#include "answer_cases.hpp"
#include "core/base/hash.hpp"
#include "core/base/stopwatch.hpp"

using namespace nearmesh;
using namespace nearmesh::soak;

namespace {

struct Options {
  std::uint64_t poses = 10000, seed = 1;
  unsigned threads = 1;
  std::vector<std::string> policies;  // none: all
  std::int64_t only_case = -1;
};

class Zoo {
 public:
  Zoo() {
    // Small models, so that a million poses take an hour; small bases, so that most of them is
    // progressive.
    const Model& terrain_1k = add(generate_terrain(16, 7), 16);
    const Model& aircraft_1k = add(generate_aircraft(500, 7), 16);
    const Model& sphere_1k = add(generate_sphere(20, 0), 16);
    const Model& soup = add(test::make_soup(150, 500, 7), 16);
    const Model& components = add(test::make_components(20, 7), 16);
    const Model& degenerate = add(test::make_degenerate(7), 16);
    const Model& book = add(test::make_book(200), 16);
    const Model& one_face = add(test::make_mesh("one_face"), 16);
    pair("terrain x aircraft", terrain_1k, aircraft_1k);
    pair("sphere x sphere", sphere_1k, sphere_1k);
    pair("soup x components", soup, components);
    pair("degenerate x aircraft", degenerate, aircraft_1k);
    pair("book x sphere", book, sphere_1k);
    pair("aircraft x aircraft", aircraft_1k, aircraft_1k);
    pair("terrain x one_face", terrain_1k, one_face);
    pair("components x degenerate", components, degenerate);
    const Model& aircraft_20k = add(generate_aircraft(20000, 3), 256);
    pair("terrain 24k x aircraft 20k", add(generate_terrain(110, 3), 256), aircraft_20k);
    pair("sphere 21k x aircraft 20k", add(generate_sphere(146, 0), 256), aircraft_20k);
  }
  [[nodiscard]] const std::vector<ModelPair>& pairs() const { return pairs_; }
  // One turn in 256 is of large models.
  [[nodiscard]] std::size_t pair_of(std::uint64_t turn) const {
    const std::size_t few = pairs_.size() - kLarge;
    return turn % kLargeEvery == 63 ? few + turn / kLargeEvery % kLarge : turn % few;
  }
  // Brute force for one small case in 32; of large ones, where it takes seconds, for one in 32 as
  // well.
  [[nodiscard]] bool by_force(std::uint64_t turn) const {
    const std::size_t few = pairs_.size() - kLarge;
    return pair_of(turn) < few ? turn / few % 32 == 2 : turn / kLargeEvery % 32 == 16;
  }

 private:
  static constexpr std::size_t kLarge = 2;
  static constexpr std::uint64_t kLargeEvery = 256;
  const Model& add(const IndexedMesh& mesh, std::uint32_t base_faces) {
    models_.push_back(std::make_unique<Model>(test::bake_mesh(mesh, base_faces)));
    return *models_.back();
  }
  void pair(const char* name, const Model& a, const Model& b) { pairs_.push_back({name, &a, &b}); }
  std::vector<std::unique_ptr<Model>> models_;
  std::vector<ModelPair> pairs_;
};

class Soak {
 public:
  Soak(const Options& options, const Zoo& zoo) : options_(options), zoo_(zoo) {
    for (std::size_t p = 0; p < kPolicyNames.size(); ++p)
      if (options.policies.empty() || std::find(options.policies.begin(), options.policies.end(),
                                                kPolicyNames[p]) != options.policies.end())
        chosen_.push_back(p);
    tallies_.resize(kPolicyNames.size() * zoo.pairs().size());
  }

  bool run() {
    if (options_.only_case >= 0) {
      run_one(static_cast<std::uint64_t>(options_.only_case));
    } else {
      cases_ = (options_.poses + kPosesPerCase - 1) / kPosesPerCase;
      std::vector<std::thread> threads;
      for (unsigned t = 0; t < options_.threads; ++t) threads.emplace_back([this] { work(); });
      for (std::thread& thread : threads) thread.join();
    }
    print();
    return failed_case_ == kNone;
  }

 private:
  static constexpr std::uint64_t kNone = ~std::uint64_t{0};

  // A case's number decides its policy, its pair and all that is drawn; never which thread runs it,
  // or when.
  void run_one(std::uint64_t number) {
    const std::size_t policy = number % kPolicyNames.size();
    const std::uint64_t turn = number / kPolicyNames.size();
    const std::size_t pair = zoo_.pair_of(turn);
    const CaseResult result =
        run_case(zoo_.pairs()[pair], static_cast<Policy>(policy), mix(options_.seed ^ mix(number)),
                 zoo_.by_force(turn) || options_.only_case >= 0);
    const std::lock_guard lock(mutex_);
    tallies_[policy * zoo_.pairs().size() + pair].add(result.tally);
    digest_ += mix(result.digest ^ mix(number));
    if (!result.fault.empty() && number < failed_case_) {
      failed_case_ = number;
      fault_ = result.fault;
    }
  }

  void work() {
    for (std::uint64_t next = next_++; next < cases_ && !failed(); next = next_++) {
      run_one(next / chosen_.size() * kPolicyNames.size() + chosen_[next % chosen_.size()]);
      const std::lock_guard lock(mutex_);
      if (clock_.seconds() < told_s_ + 5) continue;
      told_s_ = clock_.seconds();
      std::fprintf(stderr, "%" PRIu64 " of %" PRIu64 " poses, %.0f s\n", (next + 1) * kPosesPerCase,
                   cases_ * kPosesPerCase, told_s_);
    }
  }
  bool failed() {
    const std::lock_guard lock(mutex_);
    return failed_case_ != kNone;
  }

  void print() const {
    std::printf("%-8s %-27s %9s %8s %9s %9s %9s %10s %6s\n", "policy", "pair", "poses", "by force",
                "free", "contact", "partial", "uncertain", "false");
    const auto row = [](const char* policy, const std::string& pair, const Tally& t) {
      std::printf("%-8s %-27s %9" PRIu64 " %8" PRIu64 " %9" PRIu64 " %9" PRIu64 " %9" PRIu64
                  " %10" PRIu64 " %6" PRIu64 "\n",
                  policy, pair.c_str(), t.poses, t.brute_force, t.answers[0], t.answers[1],
                  t.answers[2], t.answers[3], t.false_answers);
    };
    Tally total;
    for (std::size_t i = 0; i < tallies_.size(); ++i) {
      const std::size_t pairs = zoo_.pairs().size();
      total.add(tallies_[i]);
      if (tallies_[i].poses > 0)
        row(kPolicyNames[i / pairs], zoo_.pairs()[i % pairs].name, tallies_[i]);
    }
    row("all", "", total);
    std::printf("digest %s\n", to_hex(digest_).c_str());
    std::fprintf(stderr, "%.1f s\n", clock_.seconds());
    if (failed_case_ == kNone) return;
    std::printf("FALSE: %s\n  %s, policy %s; again: --seed %" PRIu64 " --case %" PRIu64 "\n",
                fault_.c_str(),
                zoo_.pairs()[zoo_.pair_of(failed_case_ / kPolicyNames.size())].name.c_str(),
                kPolicyNames[failed_case_ % kPolicyNames.size()], options_.seed, failed_case_);
  }

  const Options& options_;
  const Zoo& zoo_;
  std::vector<std::size_t> chosen_;
  std::uint64_t cases_ = 0;
  std::atomic<std::uint64_t> next_ = 0;
  Stopwatch clock_;
  std::mutex mutex_;  // for all below
  std::vector<Tally> tallies_;
  std::uint64_t digest_ = 0;
  std::uint64_t failed_case_ = kNone;
  std::string fault_;
  double told_s_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app{"Compares answers under partial data with the full meshes' answers"};
  app.add_option("--poses", options.poses, "How many")->capture_default_str();
  app.add_option("--seed", options.seed)->capture_default_str();
  app.add_option("--threads", options.threads)->check(CLI::Range(1, 64))->capture_default_str();
  app.add_option("--policy", options.policies, "Only these")
      ->check(CLI::IsMember(std::vector<std::string>(kPolicyNames.begin(), kPolicyNames.end())));
  app.add_option("--case", options.only_case, "Only the case of this number")
      ->check(CLI::NonNegativeNumber);
  CLI11_PARSE(app, argc, argv);
  const Zoo zoo;
  return Soak(options, zoo).run() ? 0 : 1;
}
