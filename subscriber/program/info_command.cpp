// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber info: one screen about a recorded session.
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "core/base/counted.hpp"
#include "core/base/hash.hpp"
#include "core/command/json_text.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "subscriber/recorded/survey.hpp"

namespace nearmesh::subscriber::program {
namespace {

nlohmann::ordered_json to_json(const RecordingReader& recording, const Survey& survey) {
  nlohmann::ordered_json json = {{"duration_s", survey.duration_s},
                                 {"files", recording.parts()},
                                 {"messages", recording.message_count()},
                                 {"wire_version", recording.facts().wire_version},
                                 {"prefix", recording.facts().prefix}};
  const auto ids = [](const std::set<wire::SessionId>& sessions) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    for (const wire::SessionId id : sessions) list.push_back(wire::partition_of(id));
    return list;
  };
  json["publishers"] = ids(survey.publishers);
  json["peers"] = ids(survey.peers);
  json["names"] = nlohmann::ordered_json::object();
  for (const auto& [id, name] : survey.names) json["names"][wire::partition_of(id)] = name;
  json["models"] = nlohmann::ordered_json::array();
  for (const auto& [hash, model] : survey.models)
    json["models"].push_back(
        {{"name", model.name}, {"content_hash", to_hex(hash)}, {"faces", model.faces}});
  json["topics"] = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < survey.topics.size(); ++i)
    json["topics"].push_back({{"name", recording.topics()[i].name},
                              {"samples", survey.topics[i].samples},
                              {"bytes", survey.topics[i].bytes},
                              {"before", survey.topics[i].before},
                              {"missing", survey.topics[i].missing}});
  json["late"] = nlohmann::ordered_json::array();
  for (const LateWriter& writer : survey.late)
    json["late"].push_back({{"topic", recording.topics()[writer.topic].name},
                            {"who", writer.who},
                            {"from_sample", writer.first_sequence}});
  for (std::size_t i = 0; i < survey.by_status.size(); ++i)
    json["reports"][to_string(static_cast<AnswerStatus>(i))] = survey.by_status[i];
  json["contact_pairs"] = survey.contact_pairs;
  if (const auto& times = survey.to_certified_s; !times.empty())
    json["to_certified_s"] = {{"count", times.size()},
                              {"min", times.front()},
                              {"median", times[times.size() / 2]},
                              {"max", times.back()}};
  return json;
}

void print_text(const RecordingReader& recording, const Survey& survey) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf("%.3f s in %s; %s, %s\n", survey.duration_s,
              counted(recording.parts(), "file").c_str(),
              counted(survey.publishers.size(), "publisher").c_str(),
              counted(survey.peers.size(), "peer").c_str());
  for (const auto& [hash, model] : survey.models)
    std::printf("model   %-24s %s, %llu faces\n", model.name.c_str(), to_hex(hash).c_str(),
                count(model.faces));
  for (const auto& [id, name] : survey.names)
    std::printf("%-7s %-24s %s\n", survey.publishers.contains(id) ? "server" : "peer",
                wire::partition_of(id).c_str(), name.c_str());
  const auto topic_of = [&](std::size_t i) {
    const std::string& name = recording.topics()[i].name;
    return name.substr(name.rfind('/') + 1);
  };
  for (std::size_t i = 0; i < survey.topics.size(); ++i)
    std::printf("topic   %-24s %10llu samples %12llu bytes %8llu before %8llu missing\n",
                topic_of(i).c_str(), count(survey.topics[i].samples), count(survey.topics[i].bytes),
                count(survey.topics[i].before), count(survey.topics[i].missing));
  for (const LateWriter& writer : survey.late)
    std::printf("late    %-24s from sample %llu on, of %s\n", topic_of(writer.topic).c_str(),
                count(writer.first_sequence), writer.who.c_str());
  std::printf("reports ");
  for (std::size_t i = 0; i < survey.by_status.size(); ++i)
    std::printf(" %llu %s%s", count(survey.by_status[i]), to_string(static_cast<AnswerStatus>(i)),
                i + 1 < survey.by_status.size() ? "," : "");
  std::printf("; %llu touching face pairs\n", count(survey.contact_pairs));
  if (const auto& times = survey.to_certified_s; !times.empty())
    std::printf("certified after %.4f / %.4f / %.4f s (min, median, max of %zu times)\n",
                times.front(), times[times.size() / 2], times.back(), times.size());
}

}  // namespace

Status run(const InfoOptions& options) {
  const Result<std::unique_ptr<RecordingReader>> recording = RecordingReader::open(options.path);
  NEARMESH_RETURN_IF_ERROR(recording);
  const Result<Survey> result = survey(*recording.value());
  NEARMESH_RETURN_IF_ERROR(result);
  if (options.json)
    std::printf("%s\n", text_of(to_json(*recording.value(), result.value()), 2).c_str());
  else
    print_text(*recording.value(), result.value());
  return Status::ok();
}

}  // namespace nearmesh::subscriber::program
