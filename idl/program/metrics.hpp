// SPDX-License-Identifier: Apache-2.0
#pragma once
// Metrics of a process for Prometheus, over HTTP (GET /metrics): the fields of its ProcessStatus.

#include <memory>
#include <optional>
#include <string>

#include "nearmesh/idl/messages/messages.hpp"
#include "settings.hpp"

namespace prometheus {
class Exposer;
}

namespace nearmesh::wire::program {

/// Adds the setting "metrics": "PORT" (on loopback alone), "ADDRESS:PORT", or "" for none.
void add_metrics_setting(Settings& settings, std::string& address);

/// Where to listen: "PORT" is of loopback. Nothing when it is neither that nor "ADDRESS:PORT".
[[nodiscard]] std::optional<std::string> listening_address(const std::string& text);

/// Threads: set() by one; the server has its own.
class MetricsServer {
 public:
  /// Errors: kIo when the address cannot be listened at.
  [[nodiscard]] static Result<std::unique_ptr<MetricsServer>> start(const std::string& address);
  ~MetricsServer();
  /// What is told from now on.
  void set(const wire::ProcessStatus& status);

 private:
  class Impl;
  MetricsServer();
  std::shared_ptr<Impl> impl_;
  std::unique_ptr<prometheus::Exposer> exposer_;
};

}  // namespace nearmesh::wire::program
