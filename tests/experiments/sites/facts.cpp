// SPDX-License-Identifier: Apache-2.0
#include "facts.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include "core/base/csv.hpp"
#include "idl/dds/body_book.hpp"
#include "nearmesh/idl/dds/payload.hpp"
#include "tables.hpp"

namespace nearmesh::sites {
namespace {

template <class Message>
double payload_bytes(const Message& message) {
  return static_cast<double>(wire::encode_payload(message).size());
}

/// Least squares. Precondition: two different x or more.
Measured::Line line_through(const std::vector<std::pair<double, double>>& points) {
  double n = 0, x_sum = 0, y_sum = 0, xx_sum = 0, xy_sum = 0;
  for (const auto& [x, y] : points) {
    n += 1;
    x_sum += x;
    y_sum += y;
    xx_sum += x * x;
    xy_sum += x * y;
  }
  const double slope = (n * xy_sum - x_sum * y_sum) / (n * xx_sum - x_sum * x_sum);
  return {(y_sum - slope * x_sum) / n, slope};
}

/// Both ways.
double pairs_of(double participants) { return participants * (participants - 1); }

/// Topics that stay although peers tell them peers.
constexpr std::pair<std::string_view, std::string_view> kStay[] = {
    {"process_status", "it is for who looks after programs at their own site"},
    {"echo", "a self-test of one network"},
    {"probe", "a self-test of one network"}};

constexpr double kFewParticipants = 5;  // below, what starts once hides what each pair costs

}  // namespace

MessageBytes message_bytes() {
  wire::BodyPoses poses;
  poses.bodies.resize(1);
  wire::RegionSubscription request;
  request.certificate.emplace();
  request.certificate->models.resize(2);
  request.certificate->pairs.resize(1);
  request.certificate->pairs[0].b = 1;
  wire::BodyPromises promises;
  // 200 km from the origin, in quanta of 16 m.
  promises.quantum = 4;
  promises.bodies.push_back({.place = {12'500, 12'500, 100}});
  return {payload_bytes(poses), payload_bytes(promises), payload_bytes(request),
          payload_bytes(wire::SplitBatchMessage{})};
}

double most_bodies_of_a_writer() { return static_cast<double>(wire::BodyBook::kMaxOfOne); }

std::vector<Crossing> crossings() {
  std::vector<Crossing> out;
  for (const wire::TopicFacts& topic : wire::kTopicFacts) {
    const auto* stays = std::find_if(std::begin(kStay), std::end(kStay),
                                     [&](const auto& one) { return one.first == topic.name; });
    if (stays != std::end(kStay)) {
      out.push_back({topic.name, false, stays->second});
    } else if (!topic.writers.has(wire::Role::kSubscriber)) {
      out.push_back({topic.name, false, "each site has publishers of its own"});
    } else if (topic.readers.has(wire::Role::kSubscriber)) {
      out.push_back({topic.name, true, "peers tell it peers"});
    } else if (topic.readers.has(wire::Role::kPublisher)) {
      out.push_back({topic.name, false, "peers ask publishers of their own site"});
    } else {
      out.push_back({topic.name, false, "each site has a recorder of its own"});
    }
  }
  return out;
}

std::string allow_list(const std::string& prefix) {
  const wire::TopicNames names(prefix, "*");
  std::string out = "allowlist:\n";
  const std::vector<Crossing> all = crossings();
  for (wire::TopicPlace place = 0; place < all.size(); ++place)
    if (all[place].crosses)
      out += "  - {name: \"" + names.at(place) + "\", type: \"" +
             std::string(wire::kTopicFacts[place].type) + "\"}\n";
  return out;
}

Result<std::vector<Measured::Row>> Measured::read_rows(const std::string& path) {
  const auto table = CsvTable::read(path);
  NEARMESH_RETURN_IF_ERROR(table);
  const auto columns = table.value().columns(
      {"participants", "rate_hz", "join_unicast_bytes", "join_multicast_bytes", "join_cpu_s",
       "stay_unicast_bytes", "stay_multicast_bytes", "stay_cpu_s"});
  NEARMESH_RETURN_IF_ERROR(columns);
  std::vector<Row> rows;
  for (std::size_t row = 0; row < table.value().row_count(); ++row) {
    std::array<double, 8> cells{};
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const auto cell = table.value().number(row, columns.value()[i]);
      NEARMESH_RETURN_IF_ERROR(cell);
      cells[i] = cell.value();
    }
    rows.push_back(
        {cells[0], cells[1], cells[2], cells[3], cells[4], cells[5], cells[6], cells[7]});
  }
  return rows;
}

Result<Measured> Measured::read(const std::string& path) {
  auto rows = read_rows(path);
  NEARMESH_RETURN_IF_ERROR(rows);
  Measured out;
  out.rows = std::move(rows).value();
  std::map<double, std::map<double, Row>> by_rate;
  for (const Row& row : out.rows) {
    if (row.participants >= kFewParticipants) by_rate[row.rate_hz][row.participants] = row;
    out.most_participants = std::max(out.most_participants, row.participants);
  }
  if (by_rate.size() != 2 || by_rate.begin()->second.size() < 3 ||
      !std::equal(by_rate.begin()->second.begin(), by_rate.begin()->second.end(),
                  by_rate.rbegin()->second.begin(), by_rate.rbegin()->second.end(),
                  [](const auto& a, const auto& b) { return a.first == b.first; }))
    return Status(StatusCode::kInvalidArgument,
                  path +
                      ": expected rows at two rates, at each the same three counts of at least " +
                      number(kFewParticipants) + " participants or more");
  const auto& [low_hz, low] = *by_rate.begin();
  const auto& [high_hz, high] = *by_rate.rbegin();
  std::vector<std::pair<double, double>> join, join_cpu, poses, pose_cpu, stay;
  for (const auto& [n, row] : low) {
    join.emplace_back(n, row.join_unicast_bytes / pairs_of(n));
    join_cpu.emplace_back(n - 1, row.join_cpu_s / n);
    // One of them is the publisher, which neither tells nor hears poses.
    const Row& faster = high.at(n);
    const double each = (n - 1) * (high_hz - low_hz);
    poses.emplace_back(n - 2, (faster.stay_unicast_bytes - row.stay_unicast_bytes) / each);
    pose_cpu.emplace_back(n - 2, (faster.stay_cpu_s - row.stay_cpu_s) / each);
  }
  out.join_bytes = line_through(join);
  out.join_cpu_s = line_through(join_cpu);
  out.pose_wire_bytes = line_through(poses).slope;
  out.pose_cpu_s = line_through(pose_cpu).slope;
  for (const auto& [n, row] : low)
    stay.emplace_back(
        n - 1, (row.stay_unicast_bytes - low_hz * out.pose_wire_bytes * pairs_of(n - 1)) / n);
  out.stay_bytes_per_s = line_through(stay);
  return out;
}

double Measured::all_join_bytes(double participants) const {
  return pairs_of(participants) * join_bytes.at(participants);
}
double Measured::all_join_cpu_s(double participants) const {
  return participants * join_cpu_s.at(participants - 1);
}
double Measured::around_bytes() const { return pose_wire_bytes - message_bytes().poses; }

Result<Asking> Asking::read(const std::string& path) {
  const auto table = CsvTable::read(path);
  NEARMESH_RETURN_IF_ERROR(table);
  const auto columns = table.value().columns(
      {"peers", "requests", "batch_bytes", "publisher_cpu_s", "publisher_start_cpu_s"});
  NEARMESH_RETURN_IF_ERROR(columns);
  Asking out;
  double most = 0;
  for (std::size_t row = 0; row < table.value().row_count(); ++row) {
    std::array<double, 5> cells{};
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const auto cell = table.value().number(row, columns.value()[i]);
      NEARMESH_RETURN_IF_ERROR(cell);
      cells[i] = cell.value();
    }
    const auto [peers, requests, batch_bytes, cpu_s, start_cpu_s] = cells;
    if (peers <= most || requests <= 0) continue;
    most = peers;
    out.answer_bytes = batch_bytes / requests;
    out.publisher_cpu_s = (cpu_s + start_cpu_s) / requests;
  }
  if (most == 0) return Status(StatusCode::kInvalidArgument, path + ": no row with requests");
  return out;
}

std::vector<Guess> guesses() {
  return {
      {"beyond the participants that were measured, joining and staying cost what the lines say",
       "the lines of what follows from the first table",
       "`measure_discovery.py --participants 10,30,100,300` on as many cores"},
      {"flights: a body a peer, ten frames a second, from 50 to 250 m/s between places drawn at "
       "random, half of them "
       "near one of twelve hubs, 100 to 3,000 m high",
       "`Flights` in `tests/experiments/sites/simulation.cpp`", "poses of an exercise, recorded"},
      {"a peer near the ground or another body asks as in the demo's flight",
       number(Asking{}.requests_per_s) + " requests a second",
       "requests that `status` counts in an exercise"},
      {"what `max_speed_mps` hosts set", "250 for every body", "scenes of an exercise"},
      {"a router writes for all peers through one writer a topic, and keeps what is latched",
       "DDS Router 3.5 and DDS Pipe, read in their sources",
       "the live test of two sites, with a DDS Router in the forwarder's place"},
      {"routers of one host that ignore that host's participants hand nothing on to each other",
       "DDS Router 3.5, read in its manual",
       "three domains in a row: nothing of the first may reach the third"},
      {"a sample that a router writes costs it what it costs a peer",
       "half of what a sample costs writer and reader together",
       "a router with 1 reader and then with 100, at growing rates"},
      {"round trips between sites", "not in the model",
       "`nearmesh-network cold` with the delay of your lines"},
  };
}

}  // namespace nearmesh::sites
