// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "html_parts.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "subscriber/recorded/survey.hpp"

namespace nearmesh::subscriber::report {
namespace {

/// How often a peer's frames are.
struct Frames {
  std::uint64_t first = 0, last = 0;
  double first_s = 0, last_s = 0;

  [[nodiscard]] double period_s() const {
    return last > first ? (last_s - first_s) / static_cast<double>(last - first) : 0;
  }
  /// On time, whatever its way to the recorder took.
  [[nodiscard]] double time_s(std::uint64_t frame) const {
    const double s =
        first_s + period_s() * (static_cast<double>(frame) - static_cast<double>(first));
    return std::clamp(s, first_s, last_s);
  }
};

class Gatherer {
 public:
  Gatherer(const RecordingReader& recording, const wire::RecordedSamples& samples)
      : recording_(recording), samples_(samples) {
    history_.duration_s = static_cast<double>(recording.end_ns() - recording.begin_ns()) * 1e-9;
  }

  /// The first run: of reports alone.
  void look(const RecordedMessage& message) {
    const auto report = samples_.read<wire::ContactReport>(message);
    if (!report) return;
    const auto [at, is_new] = frames_.try_emplace(wire::partition_of(report->peer));
    Frames& frames = at->second;
    const double s = seconds_of(message);
    if (is_new || report->frame < frames.first) frames = {report->frame, report->frame, s, s};
    if (report->frame > frames.last) {
      frames.last = report->frame;
      frames.last_s = s;
    }
  }
  void choose_bins() {
    double period_s = 0;
    for (const auto& [peer, frames] : frames_) period_s = std::max(period_s, frames.period_s());
    history_.bin_s = history_.duration_s / kBins;
    if (period_s > 0) history_.bin_s = period_s * std::ceil(history_.bin_s / period_s);
    if (history_.bin_s > 0)
      history_.bins = static_cast<std::size_t>(history_.duration_s / history_.bin_s) + 1;
  }

  void take(const RecordedMessage& message) {
    if (samples_.is<wire::SplitBatchMessage>(message)) {
      const std::string& partition = recording_.writers()[message.writer].partition;
      if (wire::peer_of(partition) == 0) return;
      bin_of(peer_of(partition), seconds_of(message)).bytes += message.cdr.size();
      bytes_[partition] += message.cdr.size();
    } else if (const auto report = samples_.read<wire::ContactReport>(message)) {
      take(message, *report);
    }
  }

  [[nodiscard]] History finish() { return std::move(history_); }

 private:
  void take(const RecordedMessage& message, const wire::ContactReport& report) {
    const std::string partition = wire::partition_of(report.peer);
    PeerHistory& peer = peer_of(partition);
    const double s = frames_.at(partition).time_s(report.frame);
    ++bin_of(peer, s).answers[report.status];
    const std::uint64_t bytes = bytes_[partition];
    if (const auto began = open_.add(report, {message.source_ns, bytes}))
      peer.certified.push_back(
          {static_cast<double>(message.source_ns - began->source_ns) * 1e-9, bytes - began->bytes});
    if (report.pair_count == 0) return;
    for (const std::string& body : {report.body_a, report.body_b}) {
      std::vector<std::uint32_t>& most = history_.contacts[body];
      most.resize(history_.bins);
      most[place_of(s)] = std::max(most[place_of(s)], report.pair_count);
    }
  }
  PeerHistory& peer_of(const std::string& partition) {
    PeerHistory& peer = history_.peers[partition];
    peer.bins.resize(history_.bins);
    return peer;
  }
  [[nodiscard]] PeerHistory::Bin& bin_of(PeerHistory& peer, double s) const {
    return peer.bins[place_of(s)];
  }
  [[nodiscard]] double seconds_of(const RecordedMessage& message) const {
    return static_cast<double>(message.received_ns - recording_.begin_ns()) * 1e-9;
  }
  [[nodiscard]] std::size_t place_of(double s) const {
    if (!(s > 0) || history_.bin_s <= 0) return 0;
    return std::min(static_cast<std::size_t>(s / history_.bin_s), history_.bins - 1);
  }

  const RecordingReader& recording_;
  const wire::RecordedSamples& samples_;
  History history_;
  std::map<std::string, Frames> frames_;        // by partition
  std::map<std::string, std::uint64_t> bytes_;  // so far, by partition
  CertifiedTimes open_;
};

}  // namespace

Result<History> gather_history(RecordingReader& recording) {
  const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(recording);
  NEARMESH_RETURN_IF_ERROR(samples);
  Gatherer gatherer(recording, samples.value());
  const auto read = [&](const auto& visit) {
    return recording.read(1, recording.message_count() + 1,
                          [&](std::int64_t, const RecordedMessage& message) {
                            visit(message);
                            return true;
                          });
  };
  NEARMESH_RETURN_IF_ERROR(read([&](const RecordedMessage& message) { gatherer.look(message); }));
  gatherer.choose_bins();
  NEARMESH_RETURN_IF_ERROR(read([&](const RecordedMessage& message) { gatherer.take(message); }));
  return gatherer.finish();
}

}  // namespace nearmesh::subscriber::report
