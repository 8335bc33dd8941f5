// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber info: one screen about a recorded session.
#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "commands.hpp"
#include "nearmesh/core/base/hash.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/core/session/recording.hpp"
#include "nearmesh/wire/payload.hpp"
#include "nearmesh/wire/topics.hpp"

namespace nearmesh::subscriber {
namespace {

struct TopicCount {
  std::uint64_t samples = 0, bytes = 0, missing = 0;
};

struct ModelFacts {
  std::string name;
  std::uint64_t faces = 0;
};

struct Survey {
  double duration_s = 0;
  std::set<wire::SessionId> peers, publishers;
  std::map<std::uint64_t, ModelFacts> models;  // by content hash
  std::vector<TopicCount> topics;
  std::array<std::uint64_t, 5> by_status{};
  std::uint64_t contact_pairs = 0;
  std::vector<double> to_certified_s;  // ascending
};

/// From the first report of a pair that is not certified to the next that is.
class CertifiedTimes {
 public:
  void add(const wire::ContactReport& report, std::int64_t source_ns) {
    const auto key = std::tuple(report.peer, report.body_a, report.body_b);
    const auto open = open_.find(key);
    if (!is_certified(static_cast<AnswerStatus>(report.status))) {
      if (open == open_.end()) open_.emplace(key, source_ns);
    } else if (open != open_.end()) {
      times_s.push_back(static_cast<double>(source_ns - open->second) * 1e-9);
      open_.erase(open);
    }
  }
  std::vector<double> times_s;

 private:
  std::map<std::tuple<wire::SessionId, std::string, std::string>, std::int64_t> open_;
};

Result<Survey> survey(RecordingReader& recording) {
  Survey survey;
  survey.topics.resize(recording.topics().size());
  survey.duration_s = static_cast<double>(recording.end_ns() - recording.begin_ns()) * 1e-9;
  const wire::TopicNames names(recording.facts().prefix);
  CertifiedTimes certified;
  const auto take = [&](std::int64_t, const RecordedMessage& message) {
    const std::uint32_t topic = recording.writers()[message.writer].topic;
    ++survey.topics[topic].samples;
    survey.topics[topic].bytes += message.cdr.size();
    const std::string& name = recording.topics()[topic].name;
    if (name == names.contact_report) {
      if (const auto report = wire::decode_payload<wire::ContactReport>(message.cdr);
          report.is_ok()) {
        survey.peers.insert(report.value().peer);
        ++survey.by_status[report.value().status];
        survey.contact_pairs += report.value().pair_count;
        certified.add(report.value(), message.source_ns);
      }
    } else if (name == names.body_pose) {
      if (const auto pose = wire::decode_payload<wire::BodyPose>(message.cdr); pose.is_ok())
        survey.peers.insert(pose.value().peer);
    } else if (name == names.region_subscription) {
      if (const auto asked = wire::decode_payload<wire::RegionSubscription>(message.cdr);
          asked.is_ok())
        survey.peers.insert(asked.value().peer);
    } else if (name == names.hello) {
      if (const auto hello = wire::decode_payload<wire::Hello>(message.cdr); hello.is_ok())
        survey.publishers.insert(hello.value().publisher);
    } else if (name == names.mesh_header) {
      if (const auto header = wire::decode_payload<wire::MeshHeader>(message.cdr); header.is_ok())
        if (const auto decoded = decode_header(header.value().bytes); decoded.is_ok())
          survey.models[header.value().content_hash] = {header.value().name,
                                                        decoded.value().face_count};
    }
    return true;
  };
  NEARMESH_RETURN_IF_ERROR(recording.read(1, recording.message_count() + 1, take));
  for (const RecordingGap& gap : recording.gaps())
    survey.topics[recording.writers()[gap.writer].topic].missing += gap.count;
  survey.to_certified_s = std::move(certified.times_s);
  std::sort(survey.to_certified_s.begin(), survey.to_certified_s.end());
  return survey;
}

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
  json["models"] = nlohmann::ordered_json::array();
  for (const auto& [hash, model] : survey.models)
    json["models"].push_back(
        {{"name", model.name}, {"content_hash", to_hex(hash)}, {"faces", model.faces}});
  json["topics"] = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < survey.topics.size(); ++i)
    json["topics"].push_back({{"name", recording.topics()[i].name},
                              {"samples", survey.topics[i].samples},
                              {"bytes", survey.topics[i].bytes},
                              {"missing", survey.topics[i].missing}});
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
  std::printf("%.3f s in %u file%s; %zu publishers, %zu peers\n", survey.duration_s,
              recording.parts(), recording.parts() == 1 ? "" : "s", survey.publishers.size(),
              survey.peers.size());
  for (const auto& [hash, model] : survey.models)
    std::printf("model   %-24s %s, %llu faces\n", model.name.c_str(), to_hex(hash).c_str(),
                count(model.faces));
  for (std::size_t i = 0; i < survey.topics.size(); ++i)
    std::printf(
        "topic   %-24s %10llu samples %12llu bytes %8llu missing\n",
        recording.topics()[i].name.substr(recording.topics()[i].name.rfind('/') + 1).c_str(),
        count(survey.topics[i].samples), count(survey.topics[i].bytes),
        count(survey.topics[i].missing));
  std::printf("reports ");
  for (std::size_t i = 0; i < survey.by_status.size(); ++i)
    std::printf(" %llu %s%s", count(survey.by_status[i]), to_string(static_cast<AnswerStatus>(i)),
                i + 1 < survey.by_status.size() ? "," : "");
  std::printf("; %llu touching face pairs\n", count(survey.contact_pairs));
  if (const auto& times = survey.to_certified_s; !times.empty())
    std::printf("certified after %.4f / %.4f / %.4f s (min, median, max of %zu times)\n",
                times.front(), times[times.size() / 2], times.back(), times.size());
}

Status run(const std::string& path, bool json) {
  const Result<std::unique_ptr<RecordingReader>> recording = RecordingReader::open(path);
  if (!recording.is_ok()) return recording.status();
  const Result<Survey> result = survey(*recording.value());
  if (!result.is_ok()) return result.status();
  if (json)
    std::printf("%s\n", to_json(*recording.value(), result.value()).dump(2).c_str());
  else
    print_text(*recording.value(), result.value());
  return Status::ok();
}

}  // namespace

void add_info_command(CLI::App& app, std::function<Status()>& chosen) {
  CLI::App* command = app.add_subcommand("info", "What is in a recorded session.");
  struct Options {
    std::string path;
    bool json = false;
  };
  const auto options = std::make_shared<Options>();
  command->add_option("session", options->path, "Recorded session (.db3)")->required();
  command->add_flag("--json", options->json, "As JSON");
  command->callback(
      [options, &chosen] { chosen = [options] { return run(options->path, options->json); }; });
}

}  // namespace nearmesh::subscriber
