// SPDX-License-Identifier: Apache-2.0
#include "soak.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <stdexcept>
#include <thread>

#include "dice.hpp"
#include "soak_report.hpp"

namespace nearmesh::test {
namespace {

constexpr auto kTick = std::chrono::milliseconds(50);
constexpr double kSample_s = 10, kShow_s = 30;
constexpr double kJoining_s = 2, kLongestLife_s = 60, kLongestPause_s = 4;

struct Place {
  Dice dice;
  std::unique_ptr<Life> life;
  double next_s = 0;  ///< when somebody joins here
  std::size_t lives = 0;
};

class Soak {
 public:
  Soak(const SoakOptions& options, const Exercise& exercise)
      : options_(options),
        exercise_(exercise),
        residents_(static_cast<std::size_t>(std::max(1, options.peers / 5))),
        lan_(links()),
        routes_(folder_, exercise),
        judge_(exercise) {}

  bool run();

 private:
  [[nodiscard]] bool same_host() const { return options_.transport == "same-host"; }
  [[nodiscard]] std::vector<Link> links() const;
  [[nodiscard]] std::vector<std::string> bus() const {
    return {"--domain", std::to_string(exercise_.domain), "--transport", options_.transport};
  }
  void start_publisher();
  [[nodiscard]] LifePlan plan(std::size_t number, Place& place) const;
  void join(std::size_t number);
  void step(std::size_t number);
  void bury(Place& place);
  void sample();
  void end();
  [[nodiscard]] bool report() const;

  const SoakOptions& options_;
  const Exercise& exercise_;
  const std::size_t residents_;
  const Folder folder_;
  const Lan lan_;
  const Routes routes_;
  AnswerCheck judge_;
  std::unique_ptr<Process> publisher_;
  std::vector<Place> places_;
  SoakCounts counts_;
  Warnings warnings_;
  std::vector<SoakSample> samples_;
  double shown_s_ = -kShow_s;
  const Stopwatch watch_;
};

std::vector<Link> Soak::links() const {
  std::vector<Link> links(1);
  if (!same_host())
    links.resize(static_cast<std::size_t>(options_.peers) + 1, {.loss = options_.loss});
  return links;
}

void Soak::start_publisher() {
  const Lan::Visit visit = lan_.visit(0);
  std::vector<std::string> words{"serve"};
  words.insert(words.end(), exercise_.models.begin(), exercise_.models.end());
  for (const std::string& word : bus()) words.push_back(word);
  publisher_ = std::make_unique<Process>(folder_, "nearmesh-publisher", words);
  if (!publisher_->says("ready on domain"))
    throw std::runtime_error("no publisher: " + publisher_->err());
}

/// The first places belong to those that stay.
LifePlan Soak::plan(std::size_t number, Place& place) const {
  const auto resident = [&](std::size_t i) { return "resident" + std::to_string(i % residents_); };
  LifePlan plan{.flight = number % 2, .from_row = place.dice.below(800)};
  if (number < residents_) {
    plan.name = resident(number);
    if (residents_ > 1) plan.other = resident(number + 1);
    plan.life_s = 60 * options_.minutes + 600;  // interrupted before
    return plan;
  }
  plan.name = "guest" + std::to_string(number);
  // Some come back as who they were, some as somebody new.
  if (place.dice.below(2) == 0) plan.name += "_" + std::to_string(place.lives);
  plan.other = resident(number);
  constexpr Ending kEndings[] = {Ending::kLands, Ending::kLeaves, Ending::kCrashes,
                                 Ending::kCrashes};
  plan.ending = kEndings[place.dice.below(std::size(kEndings))];
  // A quarter ends while it is still joining.
  plan.life_s = place.dice.below(4) == 0 ? place.dice.between(0, kJoining_s)
                                         : place.dice.between(kJoining_s, kLongestLife_s);
  return plan;
}

void Soak::join(std::size_t number) {
  Place& place = places_[number];
  const LifePlan planned = plan(number, place);
  const Lan::Visit visit = lan_.visit(same_host() ? 0 : number + 1);
  place.life = std::make_unique<Life>(planned, bus(), routes_, options_.rate_hz);
  ++place.lives;
  ++counts_.joined;
}

void Soak::bury(Place& place) {
  const Life& life = *place.life;
  if (const std::string fault = life.fault(); !fault.empty()) {
    ++counts_.failed;
    std::fprintf(stderr, "%4.0f s: %s\n", watch_.seconds(), fault.c_str());
  } else {
    ++counts_.ended[static_cast<std::size_t>(life.plan().ending)];
  }
  count_warnings(life.said(), warnings_);
  judge_.take(life.answers());
  place.life.reset();
}

void Soak::step(std::size_t number) {
  Place& place = places_[number];
  if (place.life != nullptr) {
    if (!place.life->is_over()) return;
    bury(place);
    place.next_s = watch_.seconds() + place.dice.between(0, kLongestPause_s);
  }
  if (watch_.seconds() >= place.next_s) join(number);
}

void Soak::sample() {
  SoakSample sample{.seconds = watch_.seconds(),
                    .counts = counts_,
                    .answers = judge_.answers,
                    .certified = judge_.certified,
                    .wrong = judge_.wrong,
                    .shared = shared_files()};
  if (!publisher_->is_over()) sample.publisher = holding_of(publisher_->id());
  const auto share = 1 / static_cast<double>(residents_);
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (places_[i].life == nullptr) continue;
    ++sample.present;
    if (i >= residents_) continue;
    const Holding one = holding_of(places_[i].life->id());
    sample.resident.rss_kb += one.rss_kb * share;
    sample.resident.pss_kb += one.pss_kb * share;
    sample.resident.heap_kb += one.heap_kb * share;
    sample.resident.threads = std::max(sample.resident.threads, one.threads);
    sample.resident.descriptors = std::max(sample.resident.descriptors, one.descriptors);
  }
  if (sample.seconds >= shown_s_ + kShow_s) {
    shown_s_ = sample.seconds;
    show(sample);
  }
  samples_.push_back(std::move(sample));
}

/// The guests and those that stayed, then the publisher.
void Soak::end() {
  for (Place& place : places_)
    if (place.life != nullptr) place.life->leave();
  for (Place& place : places_)
    if (place.life != nullptr) {
      place.life->wait();
      bury(place);
    }
  publisher_->signal(SIGINT);
  if (const int code = publisher_->wait(); code != 0) {
    ++counts_.failed;
    std::fprintf(stderr, "the publisher ended with %d: %s\n", code, publisher_->err().c_str());
  }
  count_warnings(publisher_->err(), warnings_);
  judge_.finish();
}

bool Soak::run() {
  start_publisher();
  for (std::size_t i = 0; i < static_cast<std::size_t>(options_.peers); ++i) {
    places_.push_back({Dice(options_.seed * 1000 + i), nullptr, 0, 0});
    if (i >= residents_) places_[i].next_s = 1 + places_[i].dice.between(0, kLongestPause_s);
  }
  double sampled_s = 0;
  while (watch_.seconds() < 60 * options_.minutes) {
    for (std::size_t i = 0; i < places_.size(); ++i) step(i);
    judge_.step();
    if (publisher_->is_over())
      throw std::runtime_error("the publisher ended: " + publisher_->err());
    if (watch_.seconds() >= sampled_s + kSample_s) {
      sampled_s = watch_.seconds();
      sample();
    }
    std::this_thread::sleep_for(kTick);
  }
  end();
  return report();
}

bool Soak::report() const {
  // What is left when all have gone is no sample of the run.
  SoakSample left{.seconds = watch_.seconds(),
                  .counts = counts_,
                  .answers = judge_.answers,
                  .certified = judge_.certified,
                  .wrong = judge_.wrong,
                  .shared = shared_files()};
  show(left);
  write_soak(options_, samples_, left, judge_.joins_s, warnings_);
  for (const std::string& name : left.shared.others)
    std::fprintf(stderr, "left in /dev/shm: %s\n", name.c_str());
  for (const std::string& fault : judge_.faults) std::fprintf(stderr, "%s\n", fault.c_str());
  for (const auto& [line, times] : warnings_)
    std::fprintf(stderr, "%llu times: %s\n", static_cast<unsigned long long>(times), line.c_str());
  std::printf(
      "answers %llu, certified %llu, wrong %llu\n", static_cast<unsigned long long>(left.answers),
      static_cast<unsigned long long>(left.certified), static_cast<unsigned long long>(left.wrong));
  for (const Growth& g : growth_of(samples_))
    std::printf("%-30s %8.0f kB to %8.0f kB: %+.1f kB a minute (+- %.1f)\n", g.kind.c_str(),
                g.first, g.last, g.slope.per_minute, g.slope.error);
  return left.wrong == 0 && left.answers > 0 && counts_.failed == 0 && left.shared.others.empty();
}

}  // namespace

bool soak(const SoakOptions& options, const Exercise& exercise) {
  take_own_shared_memory();
  return Soak(options, exercise).run();
}

}  // namespace nearmesh::test
