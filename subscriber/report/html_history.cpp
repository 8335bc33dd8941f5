// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "html_parts.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "subscriber/recorded/survey.hpp"

namespace nearmesh::subscriber::report {
namespace {

class Gatherer {
 public:
  Gatherer(const RecordingReader& recording, const wire::RecordedSamples& samples)
      : recording_(recording), samples_(samples) {
    history_.duration_s = static_cast<double>(recording.end_ns() - recording.begin_ns()) * 1e-9;
  }

  void take(std::int64_t id, const RecordedMessage& message) {
    if (samples_.is<wire::SplitBatchMessage>(message)) {
      const std::string& partition = recording_.writers()[message.writer].partition;
      history_.peers[partition].bins[bin_of(message)].bytes += message.cdr.size();
      bytes_[partition] += message.cdr.size();
    } else if (const auto report = samples_.read<wire::ContactReport>(message)) {
      take(id, message, *report);
    }
  }

  [[nodiscard]] History finish() {
    for (const auto& [why, best] :
         {std::pair("First contact", first_contact_), std::pair("Most contacts", most_contacts_),
          std::pair("Largest replicas", largest_)}) {
      if (best.report == 0) continue;
      const auto same =
          std::find_if(history_.moments.begin(), history_.moments.end(),
                       [id = best.report](const Moment& m) { return m.report == id; });
      if (same == history_.moments.end())
        history_.moments.push_back({why, best.report});
      else
        same->why += std::string("; ") + static_cast<char>(why[0] - 'A' + 'a') + (why + 1);
    }
    return std::move(history_);
  }

 private:
  struct Best {
    std::int64_t report = 0;
    std::uint64_t value = 0;
    void offer(std::int64_t id, std::uint64_t offered) {
      if (offered > value) *this = {id, offered};
    }
  };

  void take(std::int64_t id, const RecordedMessage& message, const wire::ContactReport& report) {
    const std::string partition = wire::partition_of(report.peer);
    PeerHistory& peer = history_.peers[partition];
    const std::size_t bin = bin_of(message);
    ++peer.bins[bin].answers[report.status];
    const std::uint64_t bytes = bytes_[partition];
    if (const auto began = open_.add(report, {message.source_ns, bytes}))
      peer.certified.push_back(
          {static_cast<double>(message.source_ns - began->source_ns) * 1e-9, bytes - began->bytes});
    for (const std::string& body : {report.body_a, report.body_b}) {
      std::vector<std::uint32_t>& most = history_.contacts[body];
      most.resize(kBins);
      most[bin] = std::max(most[bin], report.pair_count);
    }
    if (!report.asked || report.gave_up_detail) return;
    if (first_contact_.report == 0) first_contact_.offer(id, report.pair_count);
    most_contacts_.offer(id, report.pair_count);
    largest_.offer(id, std::uint64_t{report.a.applied_batches} + report.b.applied_batches);
  }
  [[nodiscard]] std::size_t bin_of(const RecordedMessage& message) const {
    const double s = static_cast<double>(message.received_ns - recording_.begin_ns()) * 1e-9;
    if (!(s > 0) || history_.duration_s <= 0) return 0;
    return static_cast<std::size_t>(std::min(s / history_.duration_s * kBins, kBins - 1.0));
  }

  const RecordingReader& recording_;
  const wire::RecordedSamples& samples_;
  History history_;
  std::map<std::string, std::uint64_t> bytes_;  // so far, by partition
  CertifiedTimes open_;
  Best first_contact_, most_contacts_, largest_;
};

}  // namespace

Result<History> gather_history(RecordingReader& recording) {
  const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(recording);
  if (!samples.is_ok()) return samples.status();
  Gatherer gatherer(recording, samples.value());
  NEARMESH_RETURN_IF_ERROR(recording.read(1, recording.message_count() + 1,
                                          [&](std::int64_t id, const RecordedMessage& message) {
                                            gatherer.take(id, message);
                                            return true;
                                          }));
  return gatherer.finish();
}

}  // namespace nearmesh::subscriber::report
