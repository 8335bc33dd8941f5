// SPDX-License-Identifier: Apache-2.0
#include "soak_peers.hpp"

#include <sys/resource.h>

#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace nearmesh::test {
namespace {

constexpr double kRowsPerSecond = 4;  // of the demo's generator: 40 m a row, 16 km over the terrain
constexpr int kRows = 400;
constexpr double kStartTimeout_s = 60;
constexpr double kCheckDeadline_s = 600;
constexpr std::size_t kLivesPerCheck = 30;
constexpr int kKilled = 1000 + SIGKILL;

}  // namespace

Routes::Routes(const Folder& folder, const Exercise& exercise) {
  std::string err;
  if (run(folder, "nearmesh-demo-flights",
          {folder.path(), "--size", std::to_string(exercise.terrain_cells), "--frames",
           std::to_string(kRows), "--rate", std::to_string(kRowsPerSecond)},
          nullptr, &err) != 0)
    throw std::runtime_error("no flight: " + err);
  for (std::size_t flight = 0; flight < 2; ++flight) {
    rows_[flight] =
        lines_of(read_text(folder.file("flight" + std::to_string(flight + 1) + ".csv")));
    head_ = rows_[flight].front();
    rows_[flight].erase(rows_[flight].begin());
  }
}

std::string Routes::cut(std::size_t flight, std::size_t from, std::size_t rows) const {
  const std::vector<std::string>& all = rows_[flight];
  const std::size_t period = 2 * all.size() - 2;
  std::string text = head_ + "\n";
  for (std::size_t i = from; i < from + rows; ++i) {
    const std::size_t at = i % period;
    text += all[std::min(at, period - at)] + "\n";
  }
  return text;
}

void count_warnings(const std::string& said, Warnings& warnings) {
  for (const std::string& line : lines_of(said)) {
    const std::size_t at = line.find("warning: ");
    if (at == std::string::npos) continue;
    std::string kind, word;
    for (const char c : line.substr(at) + " ") {
      if (std::isalnum(static_cast<unsigned char>(c)) != 0) {
        word += c;
        continue;
      }
      const bool numbered = word.find_first_of("0123456789") != std::string::npos;
      kind += (numbered ? "#" : word) + c;
      word.clear();
    }
    ++warnings[kind];
  }
}

Life::Life(const LifePlan& plan, const std::vector<std::string>& bus, const Routes& routes,
           double rate_hz)
    : plan_(plan) {
  const double spare_s = plan.ending == Ending::kLands ? 0 : kStartTimeout_s;
  folder_.write("route.csv",
                routes.cut(plan.flight, plan.from_row,
                           static_cast<std::size_t>((plan.life_s + spare_s) * rate_hz) + 2));
  std::string scene =
      "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, 0]}}\n  - {name: " +
      plan.name + ", model: aircraft}\n";
  if (!plan.other.empty()) scene += "  - {name: " + plan.other + ", model: aircraft}\n";
  scene += "moves:\n  - {body: " + plan.name + ", trajectory: route.csv}\npairs:\n  - [ground, " +
           plan.name + "]\n";
  if (!plan.other.empty()) scene += "  - [" + plan.name + ", " + plan.other + "]\n";
  scene += "lookahead_s: 0.3\nstart_timeout_s: " + std::to_string(kStartTimeout_s) +
           "\nframe_rate_hz: " + std::to_string(rate_hz) + "\n";
  folder_.write("scene.yaml", scene);
  std::vector<std::string> words{"run", folder_.file("scene.yaml"), "--answers",
                                 folder_.file("answers.jsonl")};
  words.insert(words.end(), bus.begin(), bus.end());
  process_ = std::make_unique<Process>(folder_, "nearmesh-subscriber", words);
}

bool Life::is_over() {
  if (process_->is_over()) return true;
  const double age_s = watch_.seconds();
  if (plan_.ending == Ending::kLands || signalled_ || age_s < plan_.life_s) {
    // Who neither ends nor can be ended is killed, which is not as planned.
    if (age_s > plan_.life_s + 2 * kStartTimeout_s) process_->signal(SIGKILL);
    return false;
  }
  process_->signal(plan_.ending == Ending::kLeaves ? SIGINT : SIGKILL);
  signalled_ = true;
  return false;
}

void Life::leave() {
  if (process_->is_over()) return;
  process_->signal(SIGINT);
  plan_.ending = Ending::kLeaves;
  signalled_ = true;
}

std::string Life::fault() const {
  const int code = process_->wait(0);
  if (code == (plan_.ending == Ending::kCrashes ? kKilled : 0)) return {};
  return plan_.name + " ended with " + std::to_string(code) + ": " + process_->err();
}

std::string Life::answers() const {
  std::string text = read_text(folder_.file("answers.jsonl"));
  const std::size_t end = text.rfind('\n');
  text.resize(end == std::string::npos ? 0 : end + 1);
  return text;
}

void AnswerCheck::take(const std::string& lines) {
  if (lines.empty()) return;
  const std::string last = lines_of(lines).back();
  if (const auto line = nlohmann::json::parse(last); line.contains("summary"))
    if (const auto& s = line.at("summary").at("first_certified_s"); !s.is_null())
      joins_s.push_back(s.get<double>());
  const std::string name = std::to_string(files_.size()) + ".jsonl";
  waiting_->write(name, lines);
  files_.push_back(waiting_->file(name));
}

void AnswerCheck::step(bool all) {
  if (check_ != nullptr) {
    if (!check_->is_over()) return;
    take_verdict();
  }
  if (files_.size() < (all ? 1 : kLivesPerCheck)) return;
  std::vector<std::string> words{"check"};
  words.insert(words.end(), exercise_.models.begin(), exercise_.models.end());
  words.emplace_back("--answers");
  words.insert(words.end(), files_.begin(), files_.end());
  checked_ = std::exchange(waiting_, std::make_unique<Folder>());
  files_.clear();
  check_ = std::make_unique<Process>(*checked_, "nearmesh-model", words);
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(check_->id()), 10);
}

void AnswerCheck::take_verdict() {
  const std::string out = check_->out();
  if (const std::optional<CheckedAnswers> checked = read_checked(out)) {
    answers += checked->answers;
    wrong += checked->wrong;
    certified += checked->certified;
    if (checked->wrong > 0) faults.push_back(check_->err());
  } else if (check_->err().find("no answer was found") == std::string::npos) {
    throw std::runtime_error("answers were not checked: " + out + check_->err());
  }
  check_.reset();
}

void AnswerCheck::finish() {
  for (step(true); check_ != nullptr; step(true))
    if (check_->wait(kCheckDeadline_s) < 0)
      throw std::runtime_error("answers were not checked in time");
}

}  // namespace nearmesh::test
