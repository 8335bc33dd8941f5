// SPDX-License-Identifier: Apache-2.0
#include "export_mcap.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include "core/recording/mcap_recording.hpp"
#include "core/replica/triangles.hpp"
#include "idl/messages/ros2_messages.hpp"
#include "nearmesh/idl/dds/recorded_samples.hpp"
#include "recorded_peer.hpp"

namespace nearmesh::subscriber {
namespace {

// Colours of the player: exact faces, coarse faces, contacts.
constexpr std::array<float, 4> kExact{0.13F, 0.27F, 0.60F, 1};
constexpr std::array<float, 4> kCoarse{0.78F, 0.82F, 0.86F, 1};
constexpr std::array<float, 4> kContact{1, 0, 1, 1};
constexpr double kContactShare = 0.002;  ///< width of contacts, of the smaller body's size

/// Derived messages in a temporary file, and where they lie in it.
class Waiting {
 public:
  struct Entry {
    std::int64_t stamp_ns = 0;
    std::uint16_t channel = 0;
    std::uint32_t sequence = 0;
    std::uint64_t at = 0;
    std::uint32_t size = 0;
  };

  [[nodiscard]] bool add(std::int64_t stamp_ns, std::uint16_t channel, std::uint32_t sequence,
                         const ros2::Bytes& bytes) {
    if (!file_ || std::fwrite(bytes.data(), 1, bytes.size(), file_.get()) != bytes.size())
      return false;
    entries_.push_back(
        {stamp_ns, channel, sequence, end_, static_cast<std::uint32_t>(bytes.size())});
    end_ += bytes.size();
    return true;
  }
  void sort() {
    std::stable_sort(entries_.begin(), entries_.end(),
                     [](const Entry& a, const Entry& b) { return a.stamp_ns < b.stamp_ns; });
  }
  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  [[nodiscard]] bool read(const Entry& entry, ros2::Bytes& bytes) const {
    bytes.resize(entry.size);
    return std::fseek(file_.get(), static_cast<long>(entry.at), SEEK_SET) == 0 &&
           std::fread(bytes.data(), 1, bytes.size(), file_.get()) == bytes.size();
  }

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::unique_ptr<std::FILE, Close> file_{std::tmpfile()};
  std::vector<Entry> entries_;
  std::uint64_t end_ = 0;
};

/// Makes channels and messages of them. What fails is remembered; then nothing more is made.
class Derived {
 public:
  explicit Derived(mcap::Writer& file) : file_(file) {}

  void add(const std::string& topic, const ros2::Type& type, std::int64_t stamp_ns,
           const ros2::Bytes& bytes) {
    if (!status_.is_ok()) return;
    const auto channel = channel_of(topic, type);
    if (!channel) return;
    if (!waiting_.add(stamp_ns, channel->first, channel->second++, bytes))
      status_ = {StatusCode::kIo, "no room for a temporary file"};
  }
  [[nodiscard]] const Status& status() const { return status_; }
  [[nodiscard]] Waiting& waiting() { return waiting_; }
  [[nodiscard]] std::uint64_t left_out() const { return left_out_; }

 private:
  using Numbered = std::pair<std::uint16_t, std::uint32_t>;  // channel, messages

  Numbered* channel_of(const std::string& topic, const ros2::Type& type) {
    constexpr std::size_t kMostChannels = 60'000;  // of the 65,536 that the format has
    if (const auto known = channels_.find(topic); known != channels_.end()) return &known->second;
    if (channels_.size() == kMostChannels) {
      ++left_out_;
      return nullptr;
    }
    auto schema = schemas_.find(type.name);
    if (schema == schemas_.end()) {
      const Result<std::uint16_t> added = file_.add_schema({type.name, "ros2msg", type.definition});
      status_ = added.status();
      if (!added.is_ok()) return nullptr;
      schema = schemas_.emplace(type.name, added.value()).first;
    }
    const Result<std::uint16_t> added = file_.add_channel(
        {.schema = schema->second, .topic = topic, .message_encoding = "cdr", .metadata = {}});
    status_ = added.status();
    if (!added.is_ok()) return nullptr;
    return &channels_.emplace(topic, Numbered{added.value(), 0}).first->second;
  }

  mcap::Writer& file_;
  Status status_;
  std::map<std::string, std::uint16_t> schemas_;
  std::map<std::string, Numbered> channels_;
  Waiting waiting_;
  std::uint64_t left_out_ = 0;
};

/// Says what one peer held and answered.
class McapPeer final : public RecordedPeer {
 public:
  McapPeer(Derived& derived, std::string topic, bool has_meshes)
      : derived_(derived), topic_(std::move(topic)), has_meshes_(has_meshes) {}

 private:
  struct Told {
    std::uint64_t state = 0;
    std::int64_t at_ns = std::numeric_limits<std::int64_t>::min() / 2;
  };
  struct Pair {
    std::int32_t id = 0;
    std::string topic;
    bool touches = false;
  };

  void visit(const RecordedReport& report, Standing standing) override {
    const wire::ContactReport& r = report.message;
    const std::string& pair = pair_of(r).topic;
    derived_.add(pair + "/clearance_m", ros2::float64(), report.received_ns,
                 ros2::float64(finite_or_infinite(r.clearance_m)));
    derived_.add(pair + "/uncertainty_m", ros2::float64(), report.received_ns,
                 ros2::float64(finite_or_infinite(r.uncertainty_m)));
    const bool has_both = is_rebuilt(r, standing);
    if (has_both && has_meshes_) {
      tell_mesh(r.body_a, r.a, report.received_ns);
      tell_mesh(r.body_b, r.b, report.received_ns);
    }
    tell_contacts(report, has_both);
  }

  Pair& pair_of(const wire::ContactReport& r) {
    const auto [at, is_new] = pairs_.try_emplace(std::pair(r.body_a, r.body_b));
    Pair& pair = at->second;
    if (!is_new) return pair;
    pair.id = static_cast<std::int32_t>(pairs_.size());
    // Of "arm-1" and "arm.1" a topic's name leaves the same.
    const std::string name =
        topic_ + "/" + ros2::topic_part(r.body_a) + "/" + ros2::topic_part(r.body_b);
    pair.topic = name;
    for (int n = 2; !topics_.insert(pair.topic).second; ++n)
      pair.topic = name + "_" + std::to_string(n);
    return pair;
  }

  /// On the wire the greatest number stands for "cannot be bounded".
  static double finite_or_infinite(double x) {
    return x == std::numeric_limits<double>::max() ? std::numeric_limits<double>::infinity() : x;
  }

  void tell_contacts(const RecordedReport& report, bool has_both) {
    const wire::ContactReport& r = report.message;
    Pair& pair = pair_of(r);
    ros2::Marker marker{.frame = "world",
                        .name_space = r.body_a + " " + r.body_b,
                        .id = pair.id,
                        .kind = ros2::Marker::Kind::kLineList,
                        .width_m = 0,
                        .rgba = kContact,
                        .points_m = {}};
    if (has_both && r.pair_count > 0) {
      const Result<Answered> asked = ask(r, {.clearance = Clearance::kNone, .contacts = true});
      if (asked.is_ok() && asked.value().contacts)
        for (const ContactSegment& segment : asked.value().contacts->segments) {
          marker.points_m.push_back(segment.p_m);
          marker.points_m.push_back(segment.q_m);
        }
      marker.width_m = kContactShare * std::min(size_m(replica(r.a.content_hash)),
                                                size_m(replica(r.b.content_hash)));
    }
    const bool touched = std::exchange(pair.touches, !marker.points_m.empty());
    if (touched || pair.touches)
      derived_.add(topic_ + "/contacts", ros2::marker_array(), report.received_ns,
                   ros2::marker_array(report.received_ns, {marker}));
  }

  static double size_m(const Replica& replica) {
    const SpmHeader& header = replica.header();
    GridBox whole;
    for (const BaseRoot& root : replica.store().roots()) whole.add(replica.store().box(root.node));
    double most = 0;
    for (int k = 0; k < 3; ++k)
      most = std::max(most, std::ldexp(double{1} * whole.hi[k] - double{1} * whole.lo[k],
                                       header.grid.exponent));
    return most;
  }

  void tell_mesh(const std::string& body, const wire::ContactReport::Asked& asked,
                 std::int64_t now_ns) {
    const Replica& held = replica(asked.content_hash);
    const ActiveMesh& mesh = held.mesh();
    Told& told = told_[body];
    if (told.state == mesh.state_hash() ||
        now_ns - told.at_ns < static_cast<std::int64_t>(kMeshStep_s * 1e9))
      return;
    told = {mesh.state_hash(), now_ns};
    ros2::Marker exact{.frame = body,
                       .name_space = body + " exact",
                       .id = 0,
                       .kind = ros2::Marker::Kind::kTriangleList,
                       .width_m = 0,
                       .rgba = kExact,
                       .points_m = {}};
    ros2::Marker coarse = exact;
    coarse.name_space = body + " coarse";
    coarse.rgba = kCoarse;
    add_triangles(held, exact.points_m, coarse.points_m);
    derived_.add(topic_ + "/mesh", ros2::marker_array(), now_ns,
                 ros2::marker_array(now_ns, {exact, coarse}));
  }

  Derived& derived_;
  std::string topic_;
  bool has_meshes_;
  std::map<std::string, Told> told_;  // by body
  std::map<std::pair<std::string, std::string>, Pair> pairs_;
  std::set<std::string> topics_;  // of pairs
};

/// Looks at all samples once: says where bodies are, and finds out who touched something.
class FirstLook {
 public:
  explicit FirstLook(Derived& derived) : derived_(derived) {}

  void take(const RecordedMessage& message, const wire::RecordedSamples& samples) {
    if (const auto told = samples.read<wire::BodyDirectory>(message)) {
      for (const wire::BodyDirectory::Body& body : told->bodies) {
        names_[{told->peer, body.number}] = body.name;
        moved_.insert(body.name);
      }
    } else if (const auto poses = samples.read_poses(message)) {
      std::vector<ros2::Transform> transforms;
      for (const wire::BodyPoses::Body& body : poses->bodies)
        if (const auto name = names_.find({poses->peer, body.number}); name != names_.end())
          transforms.push_back({name->second, body.motion.pose});
      if (!transforms.empty())
        derived_.add("/tf", ros2::tf_message(), message.received_ns,
                     ros2::tf_message(message.received_ns, transforms));
    } else if (const auto watched = samples.read<wire::WatchedBodies>(message)) {
      for (const wire::WatchedBodies::Placed& body : watched->placed)
        first_.try_emplace(body.name, message.received_ns, body.pose);
    } else if (const auto report = samples.read<wire::ContactReport>(message);
               report && report->asked) {
      const std::string partition = wire::partition_of(report->peer);
      if (any_.empty()) any_ = partition;
      if (touching_.empty() && report->pair_count > 0) touching_ = partition;
      first_.try_emplace(report->body_a, message.received_ns, report->a.pose);
      first_.try_emplace(report->body_b, message.received_ns, report->b.pose);
    }
  }
  /// Bodies in place are in nobody's directory.
  void tell_placed() {
    for (const auto& [name, first] : first_)
      if (!moved_.contains(name))
        derived_.add("/tf_static", ros2::tf_message(), first.first,
                     ros2::tf_message(first.first, {{name, first.second}}));
  }
  /// The first that touched something, else the first that answered.
  [[nodiscard]] const std::string& peer() const { return touching_.empty() ? any_ : touching_; }

 private:
  Derived& derived_;
  std::map<std::pair<wire::SessionId, std::uint32_t>, std::string> names_;  // of bodies
  std::set<std::string> moved_;
  // That was asked about, or told of in its place.
  std::map<std::string, std::pair<std::int64_t, Pose>> first_;
  std::string touching_, any_;
};

}  // namespace

Result<McapExport> export_mcap(RecordingReader& recording, const std::string& path,
                               const std::vector<std::string>& inputs, const std::string& peer,
                               DetailFolder* models) {
  const Result<wire::RecordedSamples> samples = wire::RecordedSamples::of(recording);
  NEARMESH_RETURN_IF_ERROR(samples);
  Result<std::unique_ptr<mcap::Writer>> created = mcap::Writer::create(path, "nearmesh", inputs);
  NEARMESH_RETURN_IF_ERROR(created);
  mcap::Writer& file = *created.value();
  const Result<std::vector<std::uint16_t>> channels = begin_mcap_recording(recording, file);
  NEARMESH_RETURN_IF_ERROR(channels);

  McapExport done;
  Derived derived(file);
  FirstLook look(derived);
  NEARMESH_RETURN_IF_ERROR(recording.read(1, recording.message_count() + 1,
                                          [&](std::int64_t, const RecordedMessage& message) {
                                            look.take(message, samples.value());
                                            return true;
                                          }));
  look.tell_placed();
  done.mesh_peer = peer.empty() ? look.peer() : peer;
  // One thread: messages of all peers go into one file in the same order each time.
  const Result<Played> played =
      play(recording, {.threads = 1,
                       .make_peer =
                           [&](const std::string& partition) {
                             return std::make_unique<McapPeer>(
                                 derived, "/nearmesh/" + ros2::topic_part(partition),
                                 partition == done.mesh_peer);
                           },
                       .models = models});
  NEARMESH_RETURN_IF_ERROR(played);
  NEARMESH_RETURN_IF_ERROR(derived.status());

  Waiting& waiting = derived.waiting();
  waiting.sort();
  auto next = waiting.entries().begin();
  const auto end = waiting.entries().end();
  ros2::Bytes bytes;
  Status status;
  const auto derive_until = [&](std::int64_t now_ns) {
    for (; next != end && next->stamp_ns <= now_ns && status.is_ok(); ++next) {
      if (!waiting.read(*next, bytes))
        status = {StatusCode::kIo, "a temporary file cannot be read"};
      else
        status = file.append({.channel = next->channel,
                              .sequence = next->sequence,
                              .log_ns = static_cast<std::uint64_t>(next->stamp_ns),
                              .publish_ns = static_cast<std::uint64_t>(next->stamp_ns),
                              .data = bytes});
    }
  };
  NEARMESH_RETURN_IF_ERROR(recording.read(
      1, recording.message_count() + 1, [&](std::int64_t, const RecordedMessage& message) {
        if (status.is_ok())
          status = file.append({.channel = channels.value()[message.writer],
                                .sequence = static_cast<std::uint32_t>(message.sequence),
                                .log_ns = static_cast<std::uint64_t>(message.received_ns),
                                .publish_ns = static_cast<std::uint64_t>(message.source_ns),
                                .data = message.cdr});
        ++done.samples;
        derive_until(message.received_ns);
        return status.is_ok();
      }));
  derive_until(std::numeric_limits<std::int64_t>::max());
  NEARMESH_RETURN_IF_ERROR(status);
  NEARMESH_RETURN_IF_ERROR(file.close());
  done.derived = waiting.entries().size();
  done.bytes = file.bytes();
  if (derived.left_out() > 0)
    done.complaints.push_back(
        std::to_string(derived.left_out()) +
        " messages were left out: the format has 65,536 channels, and each pair takes two");
  return done;
}

}  // namespace nearmesh::subscriber
