// SPDX-License-Identifier: Apache-2.0
#include "settings.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>

namespace nearmesh::wire::program {
namespace {

constexpr std::string_view kVariablePrefix = "NEARMESH_";

Status invalid(std::string message) { return {StatusCode::kInvalidArgument, std::move(message)}; }

std::string text_of(double value) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value, std::chars_format::fixed);
  return {text, end.ptr};
}

nlohmann::ordered_json json_of(double value, bool whole) {
  if (whole) return static_cast<std::int64_t>(value);
  return value;
}

/// Insertions, deletions and exchanges between two words.
std::size_t distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t kept = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, kept});
    }
  }
  return row.back();
}

std::vector<std::string> split_at_commas(std::string_view text) {
  std::vector<std::string> parts;
  while (!text.empty()) {
    const std::size_t comma = text.find(',');
    parts.emplace_back(text.substr(0, comma));
    text = comma == std::string_view::npos ? "" : text.substr(comma + 1);
  }
  return parts;
}

}  // namespace

const char* to_string(Source source) {
  switch (source) {
    case Source::kBuiltIn:
      return "built-in";
    case Source::kPreset:
      return "preset";
    case Source::kFile:
      return "file";
    case Source::kEnvironment:
      return "environment";
    case Source::kFlag:
      return "flag";
  }
  return "unknown";
}

std::string flag_of(std::string_view key) {
  std::string flag = "--" + std::string(key);
  std::replace(flag.begin(), flag.end(), '_', '-');
  return flag;
}

std::string variable_of(std::string_view key) {
  std::string variable(kVariablePrefix);
  for (const char c : key)
    variable.push_back(static_cast<char>(std::toupper(static_cast<unsigned char>(c))));
  return variable;
}

void Settings::add(Setting setting) {
  NEARMESH_ASSERT(find(setting.key) == nullptr);
  setting.built_in = setting.value();
  settings_.push_back(std::move(setting));
}

void Settings::add_number(std::string key, bool whole, double least, double most, std::string help,
                          std::function<void(double)> set, std::function<double()> get) {
  const std::string range = std::string(whole ? "whole number" : "number") + " in [" +
                            text_of(least) + ", " + text_of(most) + "]";
  Setting setting{.key = std::move(key), .help = std::move(help), .values = range};
  setting.assign = [=](const std::vector<std::string>& values) -> Status {
    const std::string found = values.size() == 1 ? values[0] : "a list";
    double value = 0;
    const char* end = found.data() + found.size();
    const auto parsed = std::from_chars(found.data(), end, value);
    if (parsed.ec != std::errc{} || parsed.ptr != end || !(value >= least && value <= most) ||
        (whole && value != std::floor(value)))
      return invalid("expected a " + range + ", found " + found);
    set(value);
    return Status::ok();
  };
  setting.value = [=] { return json_of(get(), whole); };
  add(std::move(setting));
}

void Settings::add_text(std::string key, std::function<void(const std::string&)> set,
                        std::function<std::string()> get, std::string help, std::string values,
                        Check check) {
  Setting setting{.key = std::move(key), .help = std::move(help), .values = std::move(values)};
  setting.assign = [set = std::move(set),
                    check = std::move(check)](const std::vector<std::string>& found) {
    if (found.size() != 1) return invalid("expected one value, found a list");
    if (check) NEARMESH_RETURN_IF_ERROR(check(found[0]));
    set(found[0]);
    return Status::ok();
  };
  setting.value = [get = std::move(get)] { return nlohmann::ordered_json(get()); };
  add(std::move(setting));
}

void Settings::add(std::string key, std::vector<std::string>& target, std::string help,
                   std::string values, Check check) {
  Setting setting{
      .key = std::move(key), .help = std::move(help), .values = std::move(values), .is_list = true};
  setting.assign = [&target, check = std::move(check)](const std::vector<std::string>& found) {
    if (check)
      for (const std::string& value : found) NEARMESH_RETURN_IF_ERROR(check(value));
    target = found;
    return Status::ok();
  };
  setting.value = [&target] { return nlohmann::ordered_json(target); };
  add(std::move(setting));
}

Settings::Setting* Settings::find(std::string_view key) {
  const auto at = std::find_if(settings_.begin(), settings_.end(),
                               [&](const Setting& setting) { return setting.key == key; });
  return at == settings_.end() ? nullptr : &*at;
}

std::string nearest(std::string_view word, const std::set<std::string>& known) {
  const auto at = std::min_element(known.begin(), known.end(), [&](const auto& a, const auto& b) {
    return distance(a, word) < distance(b, word);
  });
  return at == known.end() ? "" : *at;
}

std::string Settings::nearest(std::string_view key) const {
  std::set<std::string> known;
  for (const Setting& setting : settings_) known.insert(setting.key);
  return program::nearest(key, known);
}

Status Settings::set(Setting& setting, const std::vector<std::string>& values, Source source,
                     const std::string& place) {
  if (const Status status = setting.assign(values); !status.is_ok()) {
    const std::string where =
        source == Source::kFile ? place + ": " + setting.key + ": " : place + ": ";
    return {status.code(), where + status.message()};
  }
  setting.source = source;
  setting.place = place;
  return Status::ok();
}

Status Settings::read_file(const std::string& path) {
  try {
    const YAML::Node root = YAML::LoadFile(path);
    if (root.IsNull()) return Status::ok();  // nothing but comments
    if (!root.IsMap()) return invalid(path + ": expected a map of settings");
    std::set<std::string> seen;
    for (const auto& entry : root) {
      const std::string place = path + ":" + std::to_string(entry.first.Mark().line + 1);
      if (!entry.first.IsScalar()) return invalid(place + ": expected the name of a setting");
      const std::string key = entry.first.Scalar();
      Setting* setting = find(key);
      if (setting == nullptr)
        return invalid(place + ": unknown key " + key + "; the nearest is " + nearest(key));
      if (!seen.insert(key).second) return invalid(place + ": " + key + " is set twice");
      std::vector<std::string> values;
      if (entry.second.IsScalar()) values.push_back(entry.second.Scalar());
      if (entry.second.IsSequence())
        for (const YAML::Node& item : entry.second) {
          if (!item.IsScalar()) return invalid(place + ": " + key + ": expected plain values");
          values.push_back(item.Scalar());
        }
      if (!entry.second.IsScalar() && !(setting->is_list && entry.second.IsSequence()))
        return invalid(place + ": " + key + ": expected " +
                       (setting->is_list ? "a list of values" : "one value"));
      NEARMESH_RETURN_IF_ERROR(set(*setting, values, Source::kFile, place));
    }
    return Status::ok();
  } catch (const YAML::BadFile&) {
    return {StatusCode::kIo, path + ": cannot open"};
  } catch (const YAML::Exception& error) {
    return invalid(path + ":" + std::to_string(error.mark.line + 1) + ": " + error.msg);
  }
}

Status Settings::read_environment(const char* const* environment) {
  for (Setting& setting : settings_) {
    const std::string variable = variable_of(setting.key);
    for (const char* const* entry = environment; *entry != nullptr; ++entry) {
      const std::string_view text = *entry;
      if (!text.starts_with(variable) || text.substr(variable.size()).substr(0, 1) != "=") continue;
      const std::string_view value = text.substr(variable.size() + 1);
      NEARMESH_RETURN_IF_ERROR(set(
          setting,
          setting.is_list ? split_at_commas(value) : std::vector<std::string>{std::string(value)},
          Source::kEnvironment, variable));
    }
  }
  return Status::ok();
}

Status Settings::set_flag(const std::string& key, const std::vector<std::string>& values) {
  Setting* setting = find(key);
  if (setting == nullptr)
    return {StatusCode::kNotFound, "unknown setting " + key + "; the nearest is " + nearest(key)};
  return set(*setting, values, Source::kFlag, flag_of(key));
}

void Settings::set_preset(const std::string& key, double value, const std::string& name) {
  Setting* setting = find(key);
  NEARMESH_ASSERT(setting != nullptr);
  if (setting->source != Source::kBuiltIn || setting->built_in == value) return;
  const Status status = set(*setting, {text_of(value)}, Source::kPreset, name);
  NEARMESH_ASSERT(status.is_ok());
}

std::vector<Settings::Shown> Settings::show() const {
  std::vector<Shown> shown;
  for (const Setting& setting : settings_)
    shown.push_back({setting.key, setting.help, setting.values, setting.built_in, setting.value(),
                     setting.source, setting.place, setting.is_list});
  return shown;
}

std::string Settings::as_yaml() const {
  std::string text;
  for (const Shown& setting : show()) {
    // JSON is YAML.
    std::string line = setting.key + ": " + setting.value.dump();
    line.resize(std::max<std::size_t>(line.size(), 36), ' ');
    text += line + "  # " + to_string(setting.source) +
            (setting.place.empty() ? "" : " " + setting.place) + "\n";
  }
  return text;
}

nlohmann::ordered_json Settings::as_json() const {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Shown& setting : show())
    list.push_back({{"key", setting.key},
                    {"value", setting.value},
                    {"source", to_string(setting.source)},
                    {"place", setting.place},
                    {"built_in", setting.built_in},
                    {"values", setting.values},
                    {"help", setting.help},
                    {"flag", flag_of(setting.key)},
                    {"variable", variable_of(setting.key)}});
  return list;
}

}  // namespace nearmesh::wire::program
