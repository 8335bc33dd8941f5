// SPDX-License-Identifier: Apache-2.0
#pragma once
// As much of SQLite as a recording needs, with our Status.

#include <sqlite3.h>

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::sqlite {

/// One prepared statement. Parameters count from 1, columns from 0. What is bound must live until
/// step().
class Statement {
 public:
  explicit Statement(sqlite3_stmt* statement = nullptr) : statement_(statement) {}

  void bind(int at, std::int64_t value) { sqlite3_bind_int64(statement_.get(), at, value); }
  void bind_null(int at) { sqlite3_bind_null(statement_.get(), at); }
  void bind(int at, std::string_view text) {
    sqlite3_bind_text64(statement_.get(), at, text.data(), text.size(), SQLITE_STATIC, SQLITE_UTF8);
  }
  void bind(int at, std::span<const std::uint8_t> bytes) {
    // A null pointer would bind NULL.
    static constexpr std::uint8_t kNothing = 0;
    sqlite3_bind_blob64(statement_.get(), at, bytes.empty() ? &kNothing : bytes.data(),
                        bytes.size(), SQLITE_STATIC);
  }
  /// SQLITE_ROW, SQLITE_DONE or an error code.
  [[nodiscard]] int step() { return sqlite3_step(statement_.get()); }
  void reset() { sqlite3_reset(statement_.get()); }

  [[nodiscard]] std::int64_t integer(int column) const {
    return sqlite3_column_int64(statement_.get(), column);
  }
  [[nodiscard]] std::string text(int column) const {
    const auto bytes = blob(column);
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }
  /// Until the next step.
  [[nodiscard]] std::span<const std::uint8_t> blob(int column) const {
    const auto* bytes =
        static_cast<const std::uint8_t*>(sqlite3_column_blob(statement_.get(), column));
    return {bytes, static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
  }

 private:
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
};

/// One connection. Threads: one at a time.
class Database {
 public:
  [[nodiscard]] static Result<Database> open(const std::string& path, int flags) {
    sqlite3* handle = nullptr;
    const int code = sqlite3_open_v2(path.c_str(), &handle, flags | SQLITE_OPEN_NOMUTEX, nullptr);
    Database database(handle, path);
    if (code != SQLITE_OK) return database.failure("open");
    sqlite3_extended_result_codes(handle, 1);
    sqlite3_busy_timeout(handle, 2000);
    return database;
  }

  [[nodiscard]] Status run(const std::string& sql) {
    if (sqlite3_exec(handle_.get(), sql.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK)
      return Status::ok();
    return failure(sql.substr(0, sql.find_first_of(" (;")));
  }
  [[nodiscard]] Result<Statement> prepare(const std::string& sql) {
    sqlite3_stmt* statement = nullptr;
    if (sqlite3_prepare_v2(handle_.get(), sql.c_str(), -1, &statement, nullptr) != SQLITE_OK)
      return failure("prepare");
    return Statement(statement);
  }
  /// Visits all rows of a query: Status visit(const Statement&). Out: the first that is not ok.
  template <class Visit>
  [[nodiscard]] Status each(const std::string& sql, Visit visit) {
    Result<Statement> rows = prepare(sql);
    NEARMESH_RETURN_IF_ERROR(rows);
    for (;;) {
      const int code = rows.value().step();
      if (code == SQLITE_DONE) return Status::ok();
      if (code != SQLITE_ROW) return failure("read");
      NEARMESH_RETURN_IF_ERROR(visit(rows.value()));
    }
  }
  /// The last error: kCorrupt where the bytes are to blame, else kIo.
  [[nodiscard]] Status failure(const std::string& what) const {
    const int code = handle_ == nullptr ? SQLITE_NOMEM : sqlite3_errcode(handle_.get());
    const bool corrupt = code == SQLITE_CORRUPT || code == SQLITE_NOTADB || code == SQLITE_ERROR;
    return {
        corrupt ? StatusCode::kCorrupt : StatusCode::kIo,
        path_ + ": " + what + ": " +
            (handle_ == nullptr ? "no memory" : sqlite3_errmsg(handle_.get())) + " (SQLite " +
            std::to_string(handle_ == nullptr ? code : sqlite3_extended_errcode(handle_.get())) +
            ")"};
  }

 private:
  struct Close {
    void operator()(sqlite3* handle) const { sqlite3_close_v2(handle); }
  };
  Database(sqlite3* handle, std::string path) : handle_(handle), path_(std::move(path)) {}
  std::unique_ptr<sqlite3, Close> handle_;
  std::string path_;
};

}  // namespace nearmesh::sqlite
