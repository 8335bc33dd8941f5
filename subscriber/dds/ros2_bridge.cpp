// SPDX-License-Identifier: Apache-2.0
#include "ros2_bridge.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <deque>
#include <future>
#include <map>
#include <mutex>
#include <new>
#include <set>
#include <thread>
#include <utility>

#include "core/base/float_guard.hpp"
#include "idl/dds/room.hpp"
#include "or_no_memory.hpp"
#include "ros2_endpoints.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr double kRos2IdleWait_s = 0.5;  ///< everything wakes the thread; this is a safety net
constexpr double kRos2RetryWait_s = 0.005;
constexpr std::size_t kMaxRos2Taken = 256;  ///< of one topic, before the others have their turn
constexpr std::size_t kTransformsAMessage = 500;   ///< so that it fits what readers of ours take
constexpr std::int64_t kMaxStep_ns = 500'000'000;  ///< between poses that a velocity is made of
constexpr double kHardlyMoves_mps = 1e-9;
constexpr std::chrono::seconds kUntilKnown{2};  ///< until a reader that came has surely found us
constexpr std::chrono::seconds kQuiet{10};      ///< until what was refused is said again

/// ROS 2's default, and its own for /tf and /tf_static.
constexpr wire::Delivery kDefault{.depth = 10};
constexpr wire::Delivery kTf{.depth = 100};
constexpr wire::Delivery kTfStatic{.depth = 1, .is_latched = true};
/// Best effort takes what writers of both kinds offer.
constexpr wire::Delivery kPoses{.depth = 100, .is_reliable = false};

std::string without_slash(const std::string& frame) {
  return frame.starts_with('/') ? frame.substr(1) : frame;
}

std::string printable(const std::string& name) {
  constexpr std::size_t kMost = 64;
  return name.size() <= kMost ? name : name.substr(0, kMost) + "...";
}

}  // namespace

Result<Ros2Body> parse_ros2_body(const std::string& text) {
  const std::size_t at = text.find('=');
  const std::string body = text.substr(0, at);
  const std::string from = at == std::string::npos ? body : text.substr(at + 1);
  const auto is_good = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_' ||
           c == '/';
  };
  const bool is_topic = from.starts_with('/');
  if (body.empty() || from.empty() ||
      (is_topic &&
       (from.size() < 2 || from.ends_with('/') || !std::all_of(from.begin(), from.end(), is_good))))
    return Status{StatusCode::kInvalidArgument,
                  "\"" + text + "\": expected BODY, BODY=FRAME or BODY=/TOPIC"};
  return Ros2Body{.body = body, .frame = is_topic ? "" : from, .topic = is_topic ? from : ""};
}

class Ros2Bridge::Impl {
 public:
  explicit Impl(const Ros2Options& options) : options_(options), moved_(options.moved.size()) {}
  ~Impl() {
    stopping_ = true;
    mailbox_.wake();
    if (thread_.joinable()) thread_.join();
  }

  Status start() {
    NEARMESH_RETURN_IF_ERROR(wire::check_room(options_.transport));
    std::promise<Status> started;
    std::future<Status> outcome = started.get_future();
    thread_ =
        std::thread([this, promise = std::move(started)]() mutable { run(std::move(promise)); });
    return outcome.get();
  }

  void tell(Ros2View view) {
    {
      const std::lock_guard lock(mutex_);
      for (ros2::Marker& mesh : view.meshes) {
        std::erase_if(meshes_, [&](const ros2::Marker& waiting) {
          return waiting.name_space == mesh.name_space;
        });
        meshes_.push_back(std::move(mesh));
      }
      view.meshes.clear();
      view_ = std::move(view);
    }
    mailbox_.wake();
  }
  std::vector<Heard> take_heard() {
    std::vector<Heard> heard;
    const std::lock_guard lock(mutex_);
    for (const auto& [moved, one] : std::exchange(heard_, {})) heard.push_back(one);
    return heard;
  }
  MeshReaders mesh_readers() const {
    const std::lock_guard lock(mutex_);
    return mesh_readers_;
  }
  Counts counts() const {
    const std::lock_guard lock(mutex_);
    return counts_;
  }
  std::vector<std::string> take_complaints() { return mailbox_.take_complaints(); }

 private:
  using Key = std::pair<std::string, std::int32_t>;  // of a marker

  void run(std::promise<Status> started) {
    const FloatGuard guard;
    Ros2Endpoints endpoints(mailbox_);
    endpoints_ = &endpoints;
    const Status opened = or_no_memory([this] { return open(); });
    const bool works = opened.is_ok();
    started.set_value(opened);
    while (works && !stopping_) {
      try {
        const bool more = receive();
        const bool wrote_all = write();
        if (!more) mailbox_.wait(wrote_all ? kRos2IdleWait_s : kRos2RetryWait_s);
      } catch (const std::bad_alloc&) {
        mailbox_.complain_of_memory();
        mailbox_.wait(kRos2IdleWait_s);
      }
    }
  }

  Status open() {
    NEARMESH_RETURN_IF_ERROR(endpoints_->join(options_.transport));
    const auto add_writer = [this](Ros2Endpoints::Writer*& writer, const char* topic,
                                   const ros2::Type& type, const wire::Delivery& delivery) {
      const auto made = endpoints_->add_writer(topic, type.name, delivery);
      if (made.is_ok()) writer = made.value();
      return made.status();
    };
    if (options_.writes) {
      NEARMESH_RETURN_IF_ERROR(add_writer(tf_, "/tf", ros2::tf_message(), kTf));
      NEARMESH_RETURN_IF_ERROR(add_writer(tf_static_, "/tf_static", ros2::tf_message(), kTfStatic));
      NEARMESH_RETURN_IF_ERROR(
          add_writer(contacts_, "/nearmesh/contacts", ros2::marker_array(), kDefault));
      NEARMESH_RETURN_IF_ERROR(add_writer(mesh_, "/nearmesh/mesh", ros2::marker_array(), kDefault));
    }
    for (std::size_t i = 0; i < options_.moved.size(); ++i) {
      const Ros2Body& body = options_.moved[i];
      const std::string topic = body.topic.empty() ? "/tf" : body.topic;
      if (!std::any_of(inputs_.begin(), inputs_.end(),
                       [&](const Input& input) { return input.topic == topic; })) {
        const auto made = endpoints_->add_reader(
            topic, body.topic.empty() ? "tf2_msgs/msg/TFMessage" : "geometry_msgs/msg/PoseStamped",
            kPoses);
        NEARMESH_RETURN_IF_ERROR(made.status());
        inputs_.push_back({topic, made.value(), body.topic.empty()});
      }
    }
    return Status::ok();
  }

  // --- What others say

  struct Input {
    std::string topic;
    Ros2Endpoints::Reader* reader = nullptr;
    bool is_tf = false;
  };
  struct Moved {
    bool has_pose = false;
    Pose pose;
    std::int64_t at_ns = 0;
  };

  /// Out: true when there may be more.
  bool receive() {
    bool more = false;
    std::vector<std::uint8_t> cdr;
    for (const Input& input : inputs_) {
      static_cast<void>(input.reader->listener.take_matches());  // nobody asks
      std::size_t taken = 0;
      for (; taken < kMaxRos2Taken && endpoints_->take(*input.reader, cdr); ++taken)
        if (!cdr.empty()) receive(input, cdr);
      more |= taken == kMaxRos2Taken;
    }
    return more;
  }

  void receive(const Input& input, const std::vector<std::uint8_t>& cdr) {
    if (input.is_tf) {
      const auto said = ros2::read_tf_message(cdr);
      if (!said.is_ok()) return refuse(input.topic, said.status().message());
      for (const ros2::SaidPose& one : said.value()) {
        bool is_known = false;
        for (std::size_t i = 0; i < options_.moved.size(); ++i)
          if (options_.moved[i].topic.empty() &&
              options_.moved[i].frame == without_slash(one.child_frame)) {
            is_known = true;
            move(i, one);
          }
        if (!is_known) {
          const std::lock_guard lock(mutex_);
          ++counts_.strange;
        }
      }
      return;
    }
    const auto said = ros2::read_pose_stamped(cdr);
    if (!said.is_ok()) return refuse(input.topic, said.status().message());
    for (std::size_t i = 0; i < options_.moved.size(); ++i)
      if (options_.moved[i].topic == input.topic) move(i, said.value());
  }

  void move(std::size_t place, const ros2::SaidPose& said) {
    const std::string& body = options_.moved[place].body;
    if (without_slash(said.frame) != options_.frame)
      return refuse("frame of " + body,
                    "\"" + printable(said.frame) + "\", expected \"" + options_.frame + "\"");
    const auto pose = ros2::to_pose(said, body);
    if (!pose.is_ok()) return refuse("pose of " + body, pose.status().message());
    Moved& moved = moved_[place];
    const std::int64_t at_ns = said.stamp_ns != 0 ? said.stamp_ns : wire::now_us() * 1000;
    const std::int64_t step_ns = at_ns - moved.at_ns;
    Motion motion;
    if (moved.has_pose && step_ns > 0 && step_ns <= kMaxStep_ns)
      motion = motion_between(moved.pose, pose.value(), static_cast<double>(step_ns) * 1e-9);
    motion.pose = pose.value();
    if (!check_motion(motion, body).is_ok()) motion = {.pose = pose.value()};  // a jump
    if (is_at_rest(motion)) motion.linear_velocity_mps[2] = kHardlyMoves_mps;
    moved = {true, pose.value(), at_ns};
    const std::lock_guard lock(mutex_);
    heard_[place] = {place, said.stamp_ns, motion};
    ++counts_.taken;
  }

  /// A line for each `what` in a while: whoever sends faults without end, each another, shall not
  /// fill a log.
  void refuse(const std::string& what, const std::string& why) {
    const auto now = std::chrono::steady_clock::now();
    {
      const std::lock_guard lock(mutex_);
      ++counts_.refused;
    }
    const auto [said, is_new] = said_.try_emplace(what, now);
    if (!is_new && now - said->second < kQuiet) return;
    said->second = now;
    mailbox_.complain("ros2: refused: " + what + ": " + why);
  }

  // --- What is written

  /// Out: false when something could not be taken.
  bool write() {
    if (!options_.writes) return true;
    std::optional<Ros2View> view;
    std::deque<ros2::Marker> meshes;
    {
      const std::lock_guard lock(mutex_);
      mesh_readers_.are_there = mesh_->listener.has_readers();
      // A reader that is known here may not know of this writer yet, and then hears what comes
      // later alone.
      const auto now = std::chrono::steady_clock::now();
      if (mesh_->listener.take_came()) {
        ++mesh_readers_.came;
        comes_again_ = now + kUntilKnown;
      } else if (comes_again_ && now >= *comes_again_) {
        ++mesh_readers_.came;
        comes_again_.reset();
      }
      view = std::exchange(view_, std::nullopt);
      meshes = std::exchange(meshes_, {});
    }
    if (view) {
      told_ns_ = view->stamp_ns;
      write(*view);
    }
    bool wrote_all = true;
    while (!meshes.empty() && wrote_all && !stopping_) {
      wrote_all = endpoints_->write(*mesh_, ros2::marker_array(told_ns_, {meshes.front()}));
      if (wrote_all) meshes.pop_front();
    }
    if (!meshes.empty()) {
      const std::lock_guard lock(mutex_);
      meshes_.insert(meshes_.begin(), meshes.begin(), meshes.end());
    }
    return wrote_all;
  }

  void write(const Ros2View& view) {
    for (std::size_t i = 0; i < view.moving.size(); i += kTransformsAMessage) {
      const auto from = view.moving.begin() + static_cast<std::ptrdiff_t>(i);
      const auto most = std::min(kTransformsAMessage, view.moving.size() - i);
      endpoints_->write(
          *tf_, ros2::tf_message(view.stamp_ns, {from, from + static_cast<std::ptrdiff_t>(most)},
                                 options_.frame));
    }
    // Without the stamp: it is what shall be kept for who comes.
    ros2::Bytes placed = ros2::tf_message(0, view.placed, options_.frame);
    if (placed != placed_ &&
        endpoints_->write(*tf_static_,
                          ros2::tf_message(view.stamp_ns, view.placed, options_.frame)))
      placed_ = std::move(placed);
    // What is no more is taken away.
    std::vector<ros2::Marker> markers = view.contacts;
    std::set<Key> there;
    for (const ros2::Marker& marker : markers) there.insert({marker.name_space, marker.id});
    for (const Key& drawn : drawn_)
      if (!there.contains(drawn))
        markers.push_back({.frame = options_.frame, .name_space = drawn.first, .id = drawn.second});
    if (!markers.empty() &&
        endpoints_->write(*contacts_, ros2::marker_array(view.stamp_ns, markers)))
      drawn_ = std::move(there);
  }

  const Ros2Options options_;
  wire::Mailbox mailbox_;

  mutable std::mutex mutex_;  ///< never held during a DDS call
  std::optional<Ros2View> view_;
  std::deque<ros2::Marker> meshes_;
  std::map<std::size_t, Heard> heard_;
  MeshReaders mesh_readers_;
  Counts counts_;

  // The thread's own.
  Ros2Endpoints* endpoints_ = nullptr;
  Ros2Endpoints::Writer *tf_ = nullptr, *tf_static_ = nullptr, *contacts_ = nullptr,
                        *mesh_ = nullptr;
  std::vector<Input> inputs_;
  std::vector<Moved> moved_;
  std::map<std::string, std::chrono::steady_clock::time_point> said_;  ///< of topics and bodies
  ros2::Bytes placed_ = ros2::tf_message(0, {});                       ///< as they were written
  std::set<Key> drawn_;
  std::int64_t told_ns_ = 0;                                          ///< of the last view
  std::optional<std::chrono::steady_clock::time_point> comes_again_;  ///< who reads meshes

  std::atomic<bool> stopping_ = false;
  std::thread thread_;
};

Result<std::unique_ptr<Ros2Bridge>> Ros2Bridge::create(const Ros2Options& options) {
  auto impl = std::make_unique<Impl>(options);
  NEARMESH_RETURN_IF_ERROR(impl->start());
  return std::unique_ptr<Ros2Bridge>(new Ros2Bridge(std::move(impl)));
}

Ros2Bridge::Ros2Bridge(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Ros2Bridge::~Ros2Bridge() = default;
void Ros2Bridge::tell(Ros2View view) { impl_->tell(std::move(view)); }
Ros2Bridge::MeshReaders Ros2Bridge::mesh_readers() const { return impl_->mesh_readers(); }
std::vector<Ros2Bridge::Heard> Ros2Bridge::take_heard() { return impl_->take_heard(); }
Ros2Bridge::Counts Ros2Bridge::counts() const { return impl_->counts(); }
std::vector<std::string> Ros2Bridge::take_complaints() { return impl_->take_complaints(); }

}  // namespace nearmesh::subscriber
