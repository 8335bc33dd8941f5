// SPDX-License-Identifier: Apache-2.0
#include "live_server.hpp"

#include <civetweb.h>

#include <array>
#include <iterator>
#include <mutex>
#include <string_view>

namespace nearmesh::subscriber::program {
namespace {

constexpr std::size_t kMostBrowsers = 8;

std::string_view header(const mg_connection* connection, const char* name) {
  const char* value = mg_get_header(connection, name);
  return value == nullptr ? std::string_view() : value;
}

}  // namespace

class LiveServer::Impl {
 public:
  Impl(std::string address, std::string page)
      : address_(std::move(address)), page_(std::move(page)) {}
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (context_ != nullptr) mg_stop(context_);
    mg_exit_library();
  }

  Status start() {
    mg_init_library(MG_FEATURES_WEBSOCKET);
    // Twice as many threads as browsers: a page and its socket.
    const std::array<const char*, 9> options{
        "listening_ports",      address_.c_str(), "num_threads", "16", "request_timeout_ms", "1500",
        "websocket_timeout_ms", "3600000",        nullptr};
    mg_callbacks callbacks{};
    callbacks.log_message = [](const mg_connection*, const char*) { return 1; };
    context_ = mg_start(&callbacks, this, const_cast<const char**>(options.data()));
    if (context_ == nullptr) return {StatusCode::kIo, "cannot listen at " + address_ + " (--http)"};
    mg_set_request_handler(
        context_, "/$",
        [](mg_connection* connection, void* self) {
          return static_cast<Impl*>(self)->give_page(connection);
        },
        this);
    mg_set_websocket_handler(
        context_, "/film$",
        [](const mg_connection* connection, void* self) {
          return static_cast<Impl*>(self)->is_welcome(connection) ? 0 : 1;
        },
        [](mg_connection* connection, void* self) { static_cast<Impl*>(self)->add(connection); },
        // Pings and the like are answered by the library; data is for nobody.
        [](mg_connection*, int bits, char*, std::size_t, void*) {
          const int kind = bits & 15;
          return kind >= 8 && kind != 8 ? 1 : 0;
        },
        [](const mg_connection* connection, void* self) {
          static_cast<Impl*>(self)->remove(connection);
        },
        this);
    return Status::ok();
  }

  void send(const Streams& streams, const std::string& text, const std::function<bool()>& is_over) {
    const std::lock_guard lock(mutex_);
    for (auto at = browsers_.begin(); at != browsers_.end() && !is_over();)
      at = give(at->first, at->second, streams, text) ? std::next(at) : browsers_.erase(at);
  }
  /// Who is told is left: it comes again.
  void begin_anew() {
    const std::lock_guard lock(mutex_);
    for (const auto& [browser, sent] : browsers_)
      static_cast<void>(write(browser, MG_WEBSOCKET_OPCODE_TEXT, R"({"anew":true})"));
    browsers_.clear();
  }

 private:
  using Sent = std::map<std::string, std::size_t>;

  /// Out: false when it took too long. It has a part of a message then, and would read the next one
  /// as the rest of that.
  static bool give(mg_connection* browser, Sent& sent, const Streams& streams,
                   const std::string& text) {
    bool is_there = true;
    streams([&](const std::string& name, const std::string& bytes) {
      std::size_t& done = sent[name];
      if (!is_there || done == bytes.size()) return;
      std::string message(1, static_cast<char>(name.size()));
      message += name;
      message.append(bytes, done);
      is_there = write(browser, MG_WEBSOCKET_OPCODE_BINARY, message);
      done = bytes.size();
    });
    return is_there && write(browser, MG_WEBSOCKET_OPCODE_TEXT, text);
  }
  static bool write(mg_connection* browser, int kind, const std::string& message) {
    return mg_websocket_write(browser, kind, message.data(), message.size()) ==
           static_cast<int>(message.size());
  }
  int give_page(mg_connection* connection) {
    const std::string_view method = mg_get_request_info(connection)->request_method;
    if (method != "GET") {
      mg_send_http_error(connection, 405, "%s", "only GET");
      return 405;
    }
    mg_printf(
        connection,
        "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nContent-Length: %llu\r\n"
        "Cache-Control: no-store\r\nX-Frame-Options: DENY\r\n"
        "X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n",
        static_cast<unsigned long long>(page_.size()));
    mg_write(connection, page_.data(), page_.size());
    return 200;
  }
  [[nodiscard]] bool is_welcome(const mg_connection* connection) {
    const std::string port = address_.substr(address_.rfind(':'));
    const std::string_view host = header(connection, "Host"), origin = header(connection, "Origin");
    // By number or as localhost: any other name might be a stranger's that stands for this machine.
    const std::string_view name = host.substr(0, host.rfind(':'));
    const bool is_ours =
        host == address_ || host == "localhost" + port ||
        (name.find_first_not_of("0123456789.") == std::string_view::npos && !name.empty());
    const std::lock_guard lock(mutex_);
    return is_ours && origin == "http://" + std::string(host) && browsers_.size() < kMostBrowsers;
  }
  void add(mg_connection* connection) {
    const std::lock_guard lock(mutex_);
    browsers_.try_emplace(connection);
  }
  void remove(const mg_connection* connection) {
    const std::lock_guard lock(mutex_);
    browsers_.erase(const_cast<mg_connection*>(connection));
  }

  const std::string address_, page_;
  mg_context* context_ = nullptr;
  std::mutex mutex_;
  /// Of each browser, how much of each stream it has.
  std::map<mg_connection*, Sent> browsers_;
};

LiveServer::LiveServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
LiveServer::~LiveServer() = default;

Result<std::unique_ptr<LiveServer>> LiveServer::start(const std::string& address,
                                                      std::string page) {
  auto impl = std::make_unique<Impl>(address, std::move(page));
  NEARMESH_RETURN_IF_ERROR(impl->start());
  return std::unique_ptr<LiveServer>(new LiveServer(std::move(impl)));
}

void LiveServer::send(const Streams& streams, const std::string& text,
                      const std::function<bool()>& is_over) {
  impl_->send(streams, text, is_over);
}
void LiveServer::begin_anew() { impl_->begin_anew(); }

}  // namespace nearmesh::subscriber::program
