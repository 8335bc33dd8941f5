// SPDX-License-Identifier: Apache-2.0
#include "metrics.hpp"

#include <arpa/inet.h>
#include <prometheus/client_metric.h>
#include <prometheus/collectable.h>
#include <prometheus/exposer.h>
#include <prometheus/metric_family.h>
#include <prometheus/metric_type.h>

#include <charconv>
#include <exception>
#include <mutex>
#include <optional>

#include "core/base/hash.hpp"

namespace nearmesh::wire::program {
namespace {

class Families {
 public:
  explicit Families(const wire::ProcessStatus& status)
      : role_(status.is_publisher ? "publisher" : "peer") {}

  void add(const char* name, const char* help, double value, bool is_counter = false) {
    family(name, help, is_counter).metric.push_back(metric(value, is_counter));
  }
  void add_refusals(const char* name, const char* help, const wire::ProcessStatus& status) {
    prometheus::MetricFamily& refusals = family(name, help, true);
    for (std::size_t i = 0; i < status.door_refused.size(); ++i) {
      prometheus::ClientMetric entry = metric(static_cast<double>(status.door_refused[i]), true);
      entry.label.push_back({"reason", to_string(static_cast<wire::DoorRefusal>(i))});
      refusals.metric.push_back(std::move(entry));
    }
  }
  void add_name(const char* name, const char* help, const wire::ProcessStatus& status) {
    prometheus::ClientMetric entry = metric(1, false);
    entry.label.push_back({"name", status.name});
    entry.label.push_back({"session", to_hex(status.session)});
    family(name, help, false).metric.push_back(std::move(entry));
  }
  template <class Value>
  void add_models(const char* name, const char* help, const wire::ProcessStatus& status,
                  Value value) {
    if (status.models.empty()) return;
    prometheus::MetricFamily& of_models = family(name, help, false);
    for (const auto& model : status.models) {
      prometheus::ClientMetric entry = metric(static_cast<double>(value(model)), false);
      entry.label.push_back({"model", model.name});
      entry.label.push_back({"content", to_hex(model.content_hash)});
      of_models.metric.push_back(std::move(entry));
    }
  }
  std::vector<prometheus::MetricFamily> take() { return std::move(families_); }

 private:
  prometheus::MetricFamily& family(const char* name, const char* help, bool is_counter) {
    prometheus::MetricFamily& made = families_.emplace_back();
    made.name = name;
    made.help = help;
    made.type = is_counter ? prometheus::MetricType::Counter : prometheus::MetricType::Gauge;
    return made;
  }
  prometheus::ClientMetric metric(double value, bool is_counter) const {
    prometheus::ClientMetric made;
    made.label.push_back({"role", role_});
    (is_counter ? made.counter.value : made.gauge.value) = value;
    return made;
  }

  const std::string role_;
  std::vector<prometheus::MetricFamily> families_;
};

std::vector<prometheus::MetricFamily> families_of(const wire::ProcessStatus& status) {
  const auto number = [](std::uint64_t n) { return static_cast<double>(n); };
  Families all(status);
  all.add_name("nearmesh_process_info", "1; what the process is called", status);
  all.add("nearmesh_uptime_seconds", "Since the process began", status.uptime_s);
  all.add("nearmesh_resident_bytes", "Memory", number(status.resident_bytes));
  all.add("nearmesh_peers", "Peers that a publisher serves", status.peers);
  all.add("nearmesh_requests_total", "Requests taken, or made", number(status.requests), true);
  all.add("nearmesh_refused_total", "Requests refused", number(status.refused), true);
  all.add("nearmesh_batches_total", "Batches sent, or received", number(status.batches), true);
  all.add("nearmesh_batch_bytes_total", "Bytes of them", number(status.bytes), true);
  all.add("nearmesh_lost_batches_total", "Batches that never came", number(status.lost_batches),
          true);
  all.add("nearmesh_waiting_batches", "Batches to be sent, or to be taken in",
          number(status.waiting_batches));
  all.add("nearmesh_watched_pairs", "Pairs of bodies that a peer asks about", status.watched_pairs);
  all.add("nearmesh_certified_pairs", "Those whose last answer is certified",
          status.certified_pairs);
  all.add("nearmesh_uncertainty_metres", "Largest bound of an answer that is not certified",
          status.uncertainty_m);
  all.add("nearmesh_moved_bodies", "Bodies that a peer moves", status.moved_bodies);
  all.add("nearmesh_stale_bodies", "Bodies of others on whose poses nothing certified can rest",
          status.stale_bodies);
  all.add("nearmesh_oldest_pose_seconds", "Age of the oldest pose that a peer looks at",
          status.oldest_age_s);
  all.add("nearmesh_complaints", "Lines of trouble in the last minute, at most 16",
          number(status.complaints.size()));
  all.add("nearmesh_door", "1: messages are checked before Fast DDS reads them",
          status.has_door ? 1 : 0);
  all.add_refusals("nearmesh_door_refused_total", "Messages that the door refused, by reason",
                   status);
  all.add_models("nearmesh_model_faces", "Faces of the whole model", status,
                 [](const auto& model) { return model.faces; });
  all.add_models("nearmesh_model_splits", "Splits of the whole model", status,
                 [](const auto& model) { return model.splits; });
  all.add_models("nearmesh_model_held_splits", "Splits that a peer holds", status,
                 [](const auto& model) { return model.held_splits; });
  return all.take();
}

}  // namespace

std::optional<std::string> listening_address(const std::string& text) {
  const std::size_t colon = text.find(':');
  const std::string port_text = colon == std::string::npos ? text : text.substr(colon + 1);
  const std::string address = colon == std::string::npos ? "127.0.0.1" : text.substr(0, colon);
  unsigned port = 0;
  const char* end = port_text.data() + port_text.size();
  const auto parsed = std::from_chars(port_text.data(), end, port);
  in_addr unused{};
  if (parsed.ec != std::errc{} || parsed.ptr != end || port < 1 || port > 65535 ||
      inet_pton(AF_INET, address.c_str(), &unused) != 1)
    return std::nullopt;
  return address + ":" + port_text;
}

void add_metrics_setting(Settings& settings, std::string& address) {
  settings.add(
      "metrics", address, "Serve metrics for Prometheus at /metrics",
      "PORT (on 127.0.0.1) or ADDRESS:PORT; empty: do not", [](const std::string& text) {
        if (text.empty() || listening_address(text)) return Status::ok();
        return Status{StatusCode::kInvalidArgument, "expected PORT or ADDRESS:PORT, found " + text};
      });
}

class MetricsServer::Impl : public prometheus::Collectable {
 public:
  std::vector<prometheus::MetricFamily> Collect() const override {
    const std::lock_guard lock(mutex_);
    if (!status_) return {};
    return families_of(*status_);
  }
  void set(const wire::ProcessStatus& status) {
    const std::lock_guard lock(mutex_);
    status_ = status;
  }

 private:
  mutable std::mutex mutex_;
  std::optional<wire::ProcessStatus> status_;
};

Result<std::unique_ptr<MetricsServer>> MetricsServer::start(const std::string& address) {
  const std::optional<std::string> full = listening_address(address);
  if (!full)
    return Status{StatusCode::kInvalidArgument,
                  "metrics: expected PORT or ADDRESS:PORT, found " + address};
  std::unique_ptr<MetricsServer> server(new MetricsServer);
  try {
    server->exposer_ = std::make_unique<prometheus::Exposer>(*full);
    server->exposer_->RegisterCollectable(server->impl_);
  } catch (const std::exception& error) {
    return Status{StatusCode::kIo, "metrics: cannot listen at " + *full + ": " + error.what()};
  }
  return server;
}

MetricsServer::MetricsServer() : impl_(std::make_shared<Impl>()) {}
MetricsServer::~MetricsServer() = default;
void MetricsServer::set(const wire::ProcessStatus& status) { impl_->set(status); }

}  // namespace nearmesh::wire::program
