// SPDX-License-Identifier: Apache-2.0
// nearmesh inside a host that has a DDS of its own (examples/flight_sim): what the host had stays
// as it was, in whatever order things end, and nothing of ours shows in its process.

#include <dlfcn.h>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <regex>
#include <stdexcept>

#include "core/base/stopwatch.hpp"
#include "examples/flight_sim/flight.hpp"
#include "examples/flight_sim/host_bus.hpp"
#include "idl/dds/fastdds_api.hpp"
#include "idl/security/security.hpp"
#include "nearmesh/idl/dds/door.hpp"
#include "nearmesh/idl/dds/identity.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/wait_ready.hpp"
#include "process.hpp"

namespace nearmesh {
namespace {

namespace fdds = eprosima::fastdds::dds;
using flight_sim::HostBus;
using subscriber::ReadyStage;
using subscriber::Session;
using wire::is_ok;

constexpr std::uint32_t kDomain = 68;
const char* const kProfiles = NEARMESH_FLIGHT_SIM_DIR "/profiles.xml";

std::unique_ptr<HostBus> join() {
  std::string why;
  auto bus = HostBus::join(kProfiles, "flight_sim_loopback", kDomain, "", why);
  EXPECT_NE(bus, nullptr) << why;
  return bus;
}

constexpr subscriber::BodyId kLeft{0}, kRight{1};

/// A session on the host's participant that moves two spheres.
std::unique_ptr<Session> make_session(const HostBus& bus, const std::string& left = "left") {
  subscriber::DdsChannelOptions options;
  options.participant = bus.participant;
  auto channel = subscriber::DdsChannel::create(options);
  EXPECT_TRUE(channel.is_ok()) << channel.status().message();
  auto session = std::make_unique<Session>(std::move(channel).value());
  for (const std::string& name : {left, "right of " + left})
    EXPECT_TRUE(session->add_body({.name = name, .model = "sphere", .own = true}).is_ok());
  EXPECT_TRUE(session->watch(kLeft, kRight).is_ok());
  return session;
}

std::vector<Session::OwnMotion> touching() {
  Motion right;
  right.pose.translation_m = {1.98, 0.1, 0.05};
  return {{kLeft, {}}, {kRight, right}};
}

bool is_ready(Session& session) {
  const auto ready = subscriber::wait_ready(session, kLeft, test::kDeadline_s, touching());
  EXPECT_TRUE(ready.is_ok()) << ready.status().message();
  EXPECT_EQ(ready.value().readiness.stage, ReadyStage::kCertified)
      << ready.value().readiness.reason;
  return ready.value().readiness.stage == ReadyStage::kCertified;
}

/// All that a host may have set on its own entities.
struct HostState {
  explicit HostState(const HostBus& bus)
      : participant(bus.participant->get_qos()),
        publisher(bus.publisher->get_qos()),
        subscriber(bus.subscriber->get_qos()),
        writer(bus.writer->get_qos()),
        reader(bus.reader->get_qos()),
        topic(bus.topic->get_qos()),
        default_writer(bus.publisher->get_default_datawriter_qos()),
        default_topic(bus.participant->get_default_topic_qos()),
        participant_listener(bus.participant->get_listener()),
        reader_listener(bus.reader->get_listener()),
        mask(bus.participant->get_status_mask()) {}
  bool operator==(const HostState& o) const {
    return participant == o.participant && publisher == o.publisher && subscriber == o.subscriber &&
           writer == o.writer && reader == o.reader && topic == o.topic &&
           default_writer == o.default_writer && default_topic == o.default_topic &&
           participant_listener == o.participant_listener && reader_listener == o.reader_listener &&
           mask.to_string() == o.mask.to_string();
  }
  fdds::DomainParticipantQos participant;
  fdds::PublisherQos publisher;
  fdds::SubscriberQos subscriber;
  fdds::DataWriterQos writer;
  fdds::DataReaderQos reader;
  fdds::TopicQos topic;
  fdds::DataWriterQos default_writer;
  fdds::TopicQos default_topic;
  const fdds::DomainParticipantListener* participant_listener;
  const fdds::DataReaderListener* reader_listener;
  fdds::StatusMask mask;
};

class Host : public ::testing::Test {
 protected:
  test::Folder folder;
  test::Process publisher{folder,
                          "nearmesh-publisher",
                          {"serve", test::model_file("sphere", 64), "--domain",
                           std::to_string(kDomain), "--interface", "127.0.0.1"}};
  void SetUp() override { ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err(); }
};

TEST_F(Host, KeepsItsEntitiesAndItsTraffic) {
  const auto bus = join(), other = join();
  const HostState before(*bus);
  auto session = make_session(*bus);
  ASSERT_TRUE(is_ready(*session));
  // The host's own topic goes on beside ours, through the host's own listener.
  flight_sim::Aircraft aircraft;
  aircraft.name = "alpha1";
  std::size_t heard = 0;
  ASSERT_TRUE(test::await([&] {
    other->publish(aircraft, 7);
    for (const auto& state : bus->take()) heard += state.step() == 7 ? 1 : 0;
    return heard >= 5;
  }));
  EXPECT_TRUE(HostState(*bus) == before);
  EXPECT_EQ(bus->listener.peers, 2);  // its own writer and the other's: none of ours
  session.reset();
  EXPECT_TRUE(HostState(*bus) == before);
}

TEST_F(Host, EndsInAnyOrder) {
  {  // the session first: the usual way
    const auto bus = join();
    auto session = make_session(*bus);
    ASSERT_TRUE(is_ready(*session));
  }
  {  // the host's entities first, the participant last
    const auto bus = join();
    auto session = make_session(*bus);
    ASSERT_TRUE(is_ready(*session));
    EXPECT_TRUE(is_ok(bus->publisher->delete_datawriter(bus->writer)));
    EXPECT_TRUE(is_ok(bus->subscriber->delete_datareader(bus->reader)));
    EXPECT_TRUE(is_ok(bus->participant->delete_publisher(bus->publisher)));
    EXPECT_TRUE(is_ok(bus->participant->delete_subscriber(bus->subscriber)));
    EXPECT_TRUE(is_ok(bus->participant->delete_topic(bus->topic)));
    bus->writer = nullptr;
    bus->reader = nullptr;
    bus->publisher = nullptr;
    bus->subscriber = nullptr;
    bus->topic = nullptr;
    EXPECT_TRUE(is_ready(*session));
    // Too early, and refused: nothing is harmed.
    auto* const factory = fdds::DomainParticipantFactory::get_instance();
    EXPECT_FALSE(is_ok(factory->delete_participant(bus->participant)));
    EXPECT_TRUE(is_ready(*session));
    session.reset();
    EXPECT_TRUE(is_ok(factory->delete_participant(bus->participant)));
    bus->participant = nullptr;
  }
  {  // an exception through the host's loop
    const auto bus = join();
    try {
      const auto session = make_session(*bus);
      ASSERT_TRUE(is_ready(*session));
      throw std::runtime_error("of the host");
    } catch (const std::runtime_error&) {
    }
    EXPECT_TRUE(is_ready(*make_session(*bus)));  // and again on the same participant
  }
}

TEST_F(Host, HasTwoSessionsThatKnowNothingOfEachOther) {
  const auto bus = join(), second_bus = join();
  auto one = make_session(*bus, "one"), two = make_session(*bus, "two");
  auto apart = make_session(*second_bus, "apart");
  EXPECT_TRUE(is_ready(*one));
  EXPECT_TRUE(is_ready(*two));
  EXPECT_TRUE(is_ready(*apart));
  one.reset();
  EXPECT_TRUE(is_ready(*two));
  EXPECT_TRUE(is_ready(*apart));
}

/// Standard output of the process, into a file.
class CapturedOutput {
 public:
  explicit CapturedOutput(const std::string& path) : path_(path) {
    std::fflush(stdout);
    saved_ = ::dup(STDOUT_FILENO);
    const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ::dup2(file, STDOUT_FILENO);
    ::close(file);
  }
  ~CapturedOutput() { release(); }
  CapturedOutput(const CapturedOutput&) = delete;
  CapturedOutput& operator=(const CapturedOutput&) = delete;
  std::string release() {
    if (saved_ < 0) return {};
    std::fflush(stdout);
    ::dup2(saved_, STDOUT_FILENO);
    ::close(saved_);
    saved_ = -1;
    return test::read_text(path_);
  }

 private:
  std::string path_;
  int saved_ = -1;
};

std::vector<std::pair<const void*, int>> signal_handlers() {
  std::vector<std::pair<const void*, int>> handlers;
  for (int number = 1; number < NSIG; ++number) {
    struct sigaction action {};
    if (::sigaction(number, nullptr, &action) != 0) continue;
    handlers.emplace_back((action.sa_flags & SA_SIGINFO) != 0
                              ? reinterpret_cast<const void*>(action.sa_sigaction)
                              : reinterpret_cast<const void*>(action.sa_handler),
                          action.sa_flags);
  }
  return handlers;
}

TEST_F(Host, HearsNothingOnItsOutputAndKeepsItsSignals) {
  const auto bus = join();
  const auto handlers = signal_handlers();
  CapturedOutput output(folder.file("stdout"));
  {
    auto session = make_session(*bus);
    EXPECT_TRUE(is_ready(*session));
    EXPECT_EQ(signal_handlers(), handlers);
    // Nor when things go wrong: the publisher dies, and answers turn uncertain.
    publisher.signal(SIGKILL);
    EXPECT_TRUE(test::await([&] {
      Motion far;
      far.pose.translation_m = {0.3, 0.2, 0.1};
      return !session->update(1, 1, {{kLeft, far}}, 0.1).value().all_certified();
    }));
  }
  EXPECT_EQ(output.release(), "");
  EXPECT_EQ(signal_handlers(), handlers);
}

/// What a shared library of a host's exports when it links nearmesh: its own functions alone.
TEST(HostLibrary, ExportsNoSymbolOfOurs) {
  const test::Folder folder;
  const std::string list = folder.file("symbols");
  ASSERT_EQ(std::system(("nm -D --defined-only -C " NEARMESH_HOST_LIBRARY " > " + list).c_str()),
            0);
  std::size_t own = 0;
  for (const std::string& line : test::lines_of(test::read_text(list))) {
    if (line.find("host_library_") != std::string::npos) ++own;
    EXPECT_EQ(line.find("nearmesh"), std::string::npos) << line;
  }
  EXPECT_EQ(own, 2U);
}

/// Data of ours in that library that could be written to: constants alone (kName), which need an
/// address or a table to be filled in at start, Highway's tables of functions, and the table in
/// which filters of Fast DDS, that are given a sample and nothing else, find the session that wrote
/// it (idl/dds/routes.cpp).
TEST(HostLibrary, HasNoGlobalState) {
  const test::Folder folder;
  const std::string list = folder.file("symbols");
  ASSERT_EQ(std::system(("nm -C " NEARMESH_HOST_LIBRARY " > " + list).c_str()), 0);
  std::size_t ours = 0;
  for (const std::string& line : test::lines_of(test::read_text(list))) {
    if (line.find("nearmesh::") == std::string::npos || line.size() < 18) continue;
    ++ours;
    static const std::regex constant(
        "(::k[A-Z][A-Za-z0-9_]*|HighwayDispatchTable)$|"
        "::(writers|routes_filters)\\(\\)::all$|"
        " (vtable|typeinfo|typeinfo name) for ");
    if (std::string("bBdDsS").find(line[17]) != std::string::npos) {
      EXPECT_TRUE(std::regex_search(line, constant)) << line;
    }
  }
  EXPECT_GT(ours, 100U);
}

TEST_F(Host, WorksBesideALibraryWithACopyOfItsOwn) {
  const auto bus = join();
  auto session = make_session(*bus);
  void* const library = ::dlopen(NEARMESH_HOST_LIBRARY, RTLD_NOW | RTLD_LOCAL);
  ASSERT_NE(library, nullptr) << ::dlerror();
  using Certifies = int (*)(const char* model_file);
  const auto certifies = reinterpret_cast<Certifies>(::dlsym(library, "host_library_certifies"));
  ASSERT_NE(certifies, nullptr);
  EXPECT_EQ(certifies(test::model_file("sphere", 64).c_str()), 1);
  EXPECT_EQ(certifies("no such file"), 0);
  using Hears = int (*)(int domain, double timeout_s);
  const auto hears = reinterpret_cast<Hears>(::dlsym(library, "host_library_hears"));
  ASSERT_NE(hears, nullptr);
  EXPECT_EQ(hears(kDomain, test::kDeadline_s), 1);
  EXPECT_TRUE(is_ready(*session));
  EXPECT_EQ(::dlclose(library), 0);
}

/// A host on a secured bus, with an identity for its own topic and nearmesh's.
class SecuredHost : public ::testing::Test {
 protected:
  static constexpr std::uint32_t kSecuredDomain = kDomain + 2;
  test::Folder folder;
  void SetUp() override {
    wire::SecurityPlan plan;
    plan.domain = kSecuredDomain;
    plan.identities = {{"serve", wire::Role::kPublisher}, {"plain", wire::Role::kSubscriber}};
    const Status made = wire::make_security(folder.file("set"), plan);
    ASSERT_TRUE(made.is_ok()) << made.message();
    plan.identities = {{"sim1", wire::Role::kSubscriber}, {"sim2", wire::Role::kSubscriber}};
    plan.topics = {"flight_sim/state"};
    const Status added = wire::make_security(folder.file("set"), plan);
    ASSERT_TRUE(added.is_ok()) << added.message();
  }
  [[nodiscard]] std::string identity(const std::string& name) const {
    return folder.file("set/" + name);
  }
  std::unique_ptr<HostBus> join_as(const std::string& name, const char* profile,
                                   std::string& why) const {
    return HostBus::join(kProfiles, profile, kSecuredDomain, identity(name), why);
  }
};

TEST_F(SecuredHost, HasItsOwnTopicAndCertifiedAnswers) {
  test::Process publisher(
      folder, "nearmesh-publisher",
      {"serve", test::model_file("sphere", 64), "--domain", std::to_string(kSecuredDomain),
       "--interface", "127.0.0.1", "--security", identity("serve")});
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  std::string why;
  const auto bus = join_as("sim1", "flight_sim_loopback", why);
  ASSERT_NE(bus, nullptr) << why;
  const auto other = join_as("sim2", "flight_sim_loopback", why);
  ASSERT_NE(other, nullptr) << why;
  // Somebody without an identity, on the same topic.
  const auto stranger = HostBus::join(kProfiles, "flight_sim_loopback", kSecuredDomain, "", why);
  ASSERT_NE(stranger, nullptr) << why;
  auto session = make_session(*bus);
  EXPECT_TRUE(is_ready(*session));
  flight_sim::Aircraft aircraft;
  aircraft.name = "alpha1";
  std::size_t heard = 0, strange = 0;
  EXPECT_TRUE(test::await([&] {
    other->publish(aircraft, 7);
    stranger->publish(aircraft, 8);
    for (const auto& state : bus->take()) ++(state.step() == 7 ? heard : strange);
    return heard >= 5;
  }));
  EXPECT_EQ(strange, 0U);
}

TEST_F(SecuredHost, IsToldWhatItsIdentityLacks) {
  std::string why;
  EXPECT_EQ(join_as("plain", "flight_sim_loopback", why), nullptr);
  EXPECT_NE(why.find("could not make the topic flight_sim/state"), std::string::npos) << why;
  EXPECT_NE(why.find("set/plain"), std::string::npos) << why;
  EXPECT_EQ(join_as("nobody", "flight_sim_loopback", why), nullptr);
  EXPECT_NE(why.find("set/nobody"), std::string::npos) << why;
  // No room for a handshake: it would hear of others, and match nobody.
  EXPECT_EQ(join_as("sim1", "flight_sim", why), nullptr);
  EXPECT_NE(why.find("max_message_size is 1400"), std::string::npos) << why;
}

TEST_F(SecuredHost, TakesItsIdentityOnceAndBeforeTheDoor) {
  fdds::DomainParticipantQos qos, with_door;
  const auto add = [&](fdds::DomainParticipantQos& to) {
    return wire::add_identity(to, identity("sim1"), kSecuredDomain);
  };
  EXPECT_TRUE(add(qos).is_ok());
  const fdds::DomainParticipantQos before = qos;
  EXPECT_EQ(add(qos).code(), StatusCode::kConflict);
  EXPECT_TRUE(qos == before);
  wire::add_door(with_door);
  const fdds::DomainParticipantQos with_door_before = with_door;
  EXPECT_EQ(add(with_door).code(), StatusCode::kConflict);
  EXPECT_TRUE(with_door == with_door_before);
}

// ---- the whole simulator ------------------------------------------------------------------------

TEST(FlightSim, TwoOfThemFlyAndMeet) {
  const test::Folder folder;
  const std::string domain = std::to_string(kDomain + 1);
  test::Process publisher(
      folder, "nearmesh-publisher",
      {"serve", test::model_file("terrain", 128), test::model_file("aircraft", 1000), "--domain",
       domain, "--interface", "127.0.0.1"});
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  const auto fly = [&](const std::string& callsign, const std::string& policy) {
    return std::make_unique<test::Process>(
        folder, "nearmesh-example-flight-sim",
        std::vector<std::string>{"--profiles", kProfiles, "--profile", "flight_sim_loopback",
                                 "--domain", domain, "--callsign", callsign, "--policy", policy,
                                 "--seconds", "5", "--wait-s", "90"});
  };
  // On a busy machine one may have ended before the other begins: then they fly again.
  std::unique_ptr<test::Process> alpha, bravo;
  const auto meet = [&] {
    alpha = fly("alpha", "hold"), bravo = fly("bravo", "conservative");
    for (test::Process* sim : {alpha.get(), bravo.get()}) {
      EXPECT_EQ(sim->wait(), 0) << sim->err();
      EXPECT_EQ(sim->err(), "");
    }
    return alpha->out().find(" 2 other aircraft") != std::string::npos &&
           bravo->out().find(" 2 other aircraft") != std::string::npos;
  };
  EXPECT_TRUE(test::await([&] { return meet() || HasFailure(); })) << alpha->out() << bravo->out();
  for (test::Process* sim : {alpha.get(), bravo.get()}) {
    EXPECT_NE(sim->out().find("500 steps, 2 other aircraft; answers "), std::string::npos)
        << sim->out();
    EXPECT_EQ(sim->out().find(" 0 free"), std::string::npos) << sim->out();
    std::printf("%s", sim->out().c_str());
  }
}

TEST(FlightSim, SaysWhatIsWrong) {
  const test::Folder folder;
  const std::string program = "nearmesh-example-flight-sim";
  std::string out, err;
  EXPECT_EQ(test::run(folder, program, {"--help"}, &out), 0);
  EXPECT_NE(out.find("--policy"), std::string::npos);
  EXPECT_EQ(test::run(folder, program, {"--policy", "hope"}), 2);
  EXPECT_EQ(test::run(folder, program, {"--profiles", "missing.xml"}, nullptr, &err), 1);
  EXPECT_NE(err.find("missing.xml: "), std::string::npos) << err;
  // Nobody serves: refused after the wait, with the reason.
  EXPECT_EQ(test::run(folder, program,
                      {"--profiles", kProfiles, "--profile", "flight_sim_loopback", "--domain",
                       std::to_string(kDomain + 2), "--wait-s", "0.2"},
                      nullptr, &err),
            1);
  EXPECT_NE(err.find("no publisher found"), std::string::npos) << err;
}

// ---- step time ----------------------------------------------------------------------------------

double p99_us(std::vector<double>& samples_us) {
  std::sort(samples_us.begin(), samples_us.end());
  return samples_us[samples_us.size() * 99 / 100];
}

/// Reports figures, asserts none: machines are shared. The two hosts take turns, so both see the
/// same load.
TEST_F(Host, StepTimesWithAndWithoutSideBySide) {
  const auto with = join(), without = join();
  auto session = make_session(*with);
  ASSERT_TRUE(is_ready(*session));
  const flight_sim::Ground ground;
  auto fleet_with = flight_sim::make_fleet(ground, "with", 4, 1);
  auto fleet_without = flight_sim::make_fleet(ground, "with", 4, 1);
  const auto host_step_us = [&](HostBus& bus, std::vector<flight_sim::Aircraft>& fleet,
                                std::uint64_t step) {
    const Stopwatch watch;
    for (flight_sim::Aircraft& aircraft : fleet) flight_sim::fly(aircraft, ground);
    static_cast<void>(bus.take());
    for (const flight_sim::Aircraft& aircraft : fleet) bus.publish(aircraft, step);
    return watch.seconds() * 1e6;
  };
  std::vector<double> with_us, without_us, update_us;
  for (std::uint64_t step = 0; step < 1000; ++step) {
    // In turns, so that none always runs first.
    if (step % 2 == 0) with_us.push_back(host_step_us(*with, fleet_with, step));
    without_us.push_back(host_step_us(*without, fleet_without, step));
    if (step % 2 == 1) with_us.push_back(host_step_us(*with, fleet_with, step));
    const Stopwatch watch;
    auto motions = touching();
    motions[1].motion.pose.translation_m[0] = 1.9 + 1e-4 * static_cast<double>(step);
    ASSERT_TRUE(session->update(step, static_cast<double>(step) * 0.01, motions, 0.002).is_ok());
    update_us.push_back(watch.seconds() * 1e6);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  for (std::size_t i = 0; i < fleet_with.size(); ++i)  // the same flights, to the bit
    EXPECT_EQ(fleet_with[i].pose.matrix(), fleet_without[i].pose.matrix());
  std::printf(
      "p99 of the host's own step: %.0f us with nearmesh, %.0f us without; update() %.0f us\n",
      p99_us(with_us), p99_us(without_us), p99_us(update_us));
}

}  // namespace
}  // namespace nearmesh
