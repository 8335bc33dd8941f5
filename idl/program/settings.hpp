// SPDX-License-Identifier: Apache-2.0
#pragma once
// Settings of a program, by layers: built-in < preset < file < environment < flag. Each is bound to
// a field of an options struct, whose value at that time is the built-in one; hosts that embed a
// library fill the structs themselves. One name in three spellings: lease_s in the file (YAML),
// NEARMESH_LEASE_S in the environment, --lease-s as a flag. Bad values are errors that name the
// place, the key, what was expected and what was found; nothing is changed then.

#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::wire::program {

enum class Source : std::uint8_t { kBuiltIn, kPreset, kFile, kEnvironment, kFlag };
[[nodiscard]] const char* to_string(Source source);

/// Threads: one at a time.
class Settings {
 public:
  using Check = std::function<Status(const std::string& value)>;

  /// A number in [least, most]. The targets must live as long as this.
  template <class Number>
  requires std::is_arithmetic_v<Number>
  void add(std::string key, Number& target, double least, double most, std::string help) {
    const bool whole = std::is_integral_v<Number>;
    add_number(
        std::move(key), whole, least, most, std::move(help),
        [&target](double value) { target = static_cast<Number>(value); },
        [&target] { return static_cast<double>(target); });
  }
  /// A text. `check` (may be empty) says what is wrong with a value; `values` (may be empty)
  /// describes what is right.
  void add(std::string key, std::string& target, std::string help, std::string values = {},
           Check check = {}) {
    add_text(
        std::move(key), [&target](const std::string& value) { target = value; },
        [&target] { return target; }, std::move(help), std::move(values), std::move(check));
  }
  /// As above, of what is not kept as a text.
  void add_text(std::string key, std::function<void(const std::string&)> set,
                std::function<std::string()> get, std::string help, std::string values,
                Check check);
  /// A list: a sequence in the file, separated by commas in the environment, a flag for each. A
  /// layer replaces the list.
  void add(std::string key, std::vector<std::string>& target, std::string help,
           std::string values = {}, Check check = {});

  /// Reads a YAML map. Errors: kIo; kInvalidArgument naming file, line and key, with the nearest
  /// key that is known.
  [[nodiscard]] Status read_file(const std::string& path);
  /// In: as ::environ. Variables NEARMESH_... that are no setting here are left alone: other
  /// programs may know them.
  [[nodiscard]] Status read_environment(const char* const* environment);
  /// Sets from a flag, or what stands for one. Errors: kNotFound (key), kInvalidArgument.
  [[nodiscard]] Status set_flag(const std::string& key, const std::vector<std::string>& values);
  /// Replaces what is built in; has no effect where a layer above has spoken.
  void set_preset(const std::string& key, double value, const std::string& name);

  struct Shown {
    std::string key, help, values;  ///< `values`: what is allowed, "number in [0, 1]"
    nlohmann::ordered_json built_in, value;
    Source source = Source::kBuiltIn;
    /// Where it was set: "FILE:LINE", "NEARMESH_LEASE_S", "--lease-s", name of the preset.
    std::string place;
    bool is_list = false;
  };
  /// In the order in which they were added.
  [[nodiscard]] std::vector<Shown> show() const;
  /// A file that sets what holds now, with where each value came from as a comment.
  [[nodiscard]] std::string as_yaml() const;
  [[nodiscard]] nlohmann::ordered_json as_json() const;

 private:
  struct Setting {
    std::string key, help, values;
    bool is_list = false;
    std::function<Status(const std::vector<std::string>&)> assign;  ///< all or nothing
    std::function<nlohmann::ordered_json()> value;
    nlohmann::ordered_json built_in;
    Source source = Source::kBuiltIn;
    std::string place;
  };

  void add_number(std::string key, bool whole, double least, double most, std::string help,
                  std::function<void(double)> set, std::function<double()> get);
  void add(Setting setting);
  [[nodiscard]] Setting* find(std::string_view key);
  [[nodiscard]] std::string nearest(std::string_view key) const;
  [[nodiscard]] static Status set(Setting& setting, const std::vector<std::string>& values,
                                  Source source, const std::string& place);

  std::vector<Setting> settings_;
};

/// Of the words that are known the one that a mistyped one comes next to, for error messages; ""
/// where there is none.
[[nodiscard]] std::string nearest(std::string_view word, const std::set<std::string>& known);

/// lease_s to --lease-s, and to NEARMESH_LEASE_S.
[[nodiscard]] std::string flag_of(std::string_view key);
[[nodiscard]] std::string variable_of(std::string_view key);

}  // namespace nearmesh::wire::program
