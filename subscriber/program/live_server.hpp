// SPDX-License-Identifier: Apache-2.0
#pragma once
// A page and a web socket beside it, for browsers that look on (takes streams that grow, gives them
// to whoever is there). Nothing can be written: what a browser sends ends its connection. A page
// from elsewhere gets nothing, whatever it is called there: the socket's Origin must be this
// server, by its address or as localhost.

#include <functional>
#include <map>
#include <memory>
#include <string>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::subscriber::program {

/// Threads: one at a time; the server has its own.
class LiveServer {
 public:
  /// `address`: ADDRESS:PORT. Errors: kIo when it cannot be listened at.
  [[nodiscard]] static Result<std::unique_ptr<LiveServer>> start(const std::string& address,
                                                                 std::string page);
  ~LiveServer();

  /// Calls its argument for each stream, with its name and all of its bytes.
  using Streams =
      std::function<void(const std::function<void(const std::string&, const std::string&)>&)>;
  /// Sends each browser what it lacks of each stream, and the text, until `is_over` says so. Blocks
  /// for as long as a browser takes; one that takes nothing for 1.5 s is left.
  void send(const Streams& streams, const std::string& text, const std::function<bool()>& is_over);
  /// The streams begin anew: each browser is told so, {"anew": true}, and loads the page again.
  void begin_anew();

 private:
  class Impl;
  explicit LiveServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::subscriber::program
