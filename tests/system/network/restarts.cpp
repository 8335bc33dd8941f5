// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <csignal>
#include <stdexcept>
#include <thread>

#include "flyers.hpp"
#include "measures.hpp"

namespace nearmesh::test {
namespace {

constexpr double kAway_s[] = {0.3, 1.5, 6};  // below the lease, and above
constexpr double kSettle_s = 4;              // more than a lease
constexpr double kResume_s = 20;
constexpr double kFlight_hz = 20;

/// A flight of a nearmesh-subscriber meanwhile, on a host of its own, whose every answer is held
/// against the full mesh.
class CheckedFlight {
 public:
  CheckedFlight(const Lan& lan, std::size_t host, const Exercise& exercise, double seconds)
      : thread_([this, &lan, host, &exercise, seconds] {
          try {
            result_ =
                fly(lan, host, folder_, exercise,
                    {.frames = static_cast<int>(seconds * kFlight_hz), .rate_hz = kFlight_hz});
          } catch (const std::exception& error) {
            result_.complaint = error.what();
          }
        }) {}
  ~CheckedFlight() {
    if (thread_.joinable()) thread_.join();
  }
  [[nodiscard]] FlightResult end() {
    thread_.join();
    if (!result_.ended) throw std::runtime_error("the flight: " + result_.complaint);
    return result_;
  }

 private:
  const Folder folder_;
  FlightResult result_;
  std::thread thread_;
};

class Restarts {
 public:
  Restarts(const MeasureOptions& options, const Exercise& exercise)
      : options_(options), exercise_(exercise), airspace_(exercise) {
    const Lan::Visit visit = airspace_.lan.visit(1);
    subscriber::DdsChannelOptions listener;
    listener.transport.domain = exercise.domain;
    listener_ = std::move(subscriber::DdsChannel::create(listener)).value();
    pause(kSettle_s);
    out_ = open_csv(options.out + "/restarts.csv");
    std::fprintf(out_, "kind,away_s,round,stuck,hello_s,median_s,worst_s,worst_after_hello_s\n");
  }
  ~Restarts() { std::fclose(out_); }

  void measure() {
    const double most_s =
        options_.rounds * (std::size(kAway_s) * (kSettle_s + 10) + 2 * (kSettle_s + 4));
    CheckedFlight flight(airspace_.lan, 2, exercise_, most_s);
    for (int round = 1; round <= options_.rounds; ++round)
      for (const double away_s : kAway_s) restart(away_s, round);
    for (int round = 1; round <= options_.rounds; ++round) lose_twin(round);
    const FlightResult flown = flight.end();
    std::FILE* out = open_csv(options_.out + "/restarts-flight.csv");
    std::fprintf(out, "answers,certified,wrong,longest_lag_s\n%llu,%llu,%llu,%.2f\n",
                 static_cast<unsigned long long>(flown.answers),
                 static_cast<unsigned long long>(flown.certified),
                 static_cast<unsigned long long>(flown.wrong), flown.longest_lag_s);
    std::fclose(out);
  }

 private:
  /// Seconds from `since_s` on to the answers of frames that were open then, ascending.
  [[nodiscard]] static std::vector<double> open_frames(const std::vector<Flyers::Answer>& answers,
                                                       double since_s) {
    std::vector<double> waits_s;
    for (const Flyers::Answer& answer : answers)
      if (answer.asked_s < since_s && answer.certified_s > since_s)
        waits_s.push_back(answer.certified_s - since_s);
    std::sort(waits_s.begin(), waits_s.end());
    return waits_s;
  }
  void write(const char* kind, double away_s, int round, const std::vector<double>& waits_s,
             double hello_s) {
    const double median = waits_s.empty() ? 0 : waits_s[waits_s.size() / 2];
    const double worst = waits_s.empty() ? 0 : waits_s.back();
    std::fprintf(out_, "%s,%g,%d,%zu,%.3f,%.3f,%.3f,%.3f\n", kind, away_s, round, waits_s.size(),
                 hello_s, median, worst, worst - hello_s);
    std::fflush(out_);
    std::fprintf(stderr, "%s, away %g s: hello %.2f s, answers after %.2f (worst %.2f) s\n", kind,
                 away_s, hello_s, median, worst);
  }

  /// Killed, away, and started again: how long after its start the frames are answered that waited
  /// for it.
  void restart(double away_s, int round) {
    airspace_.publisher->signal(SIGKILL);
    static_cast<void>(airspace_.publisher->wait());
    pause(away_s);
    static_cast<void>(listener_->take());
    static_cast<void>(airspace_.flyers->take_answers());
    const double began_s = airspace_.flyers->now_s();
    double hello_s = -1;
    std::thread ear([&] {
      while (hello_s < 0 && airspace_.flyers->now_s() - began_s < kResume_s) {
        listener_->wait(0.01);
        if (!listener_->take().hellos.empty()) hello_s = airspace_.flyers->now_s() - began_s;
      }
    });
    airspace_.publisher = serve(airspace_.lan, airspace_.folder, exercise_);
    ear.join();
    pause(kSettle_s);
    write("restart", away_s, round, open_frames(airspace_.flyers->take_answers(), began_s),
          hello_s);
  }

  /// Two serve the same; each of them dies once. How long the frames wait that were open then or
  /// began in the next seconds.
  void lose_twin(int round) {
    auto twin = serve(airspace_.lan, airspace_.folder, exercise_);
    pause(kSettle_s);
    for (auto* dying : {&airspace_.publisher, &twin}) {
      static_cast<void>(airspace_.flyers->take_answers());
      const double began_s = airspace_.flyers->now_s();
      (*dying)->signal(SIGKILL);
      static_cast<void>((*dying)->wait());
      pause(kSettle_s);
      std::vector<double> waits_s;
      for (const Flyers::Answer& answer : airspace_.flyers->take_answers())
        if (answer.waited && answer.certified_s > began_s)
          waits_s.push_back(answer.certified_s - std::max(answer.asked_s, began_s));
      std::sort(waits_s.begin(), waits_s.end());
      write("twin", 0, round, waits_s, 0);
      *dying = serve(airspace_.lan, airspace_.folder, exercise_);
      pause(kSettle_s);
    }
  }

  const MeasureOptions& options_;
  const Exercise& exercise_;
  Airspace airspace_;
  std::unique_ptr<subscriber::DdsChannel> listener_;
  std::FILE* out_ = nullptr;
};

}  // namespace

void measure_restarts(const MeasureOptions& options, const Exercise& exercise) {
  Restarts(options, exercise).measure();
}

}  // namespace nearmesh::test
