// SPDX-License-Identifier: Apache-2.0
#include "storm.hpp"

#include <arpa/inet.h>
#include <linux/if_packet.h>
#include <net/ethernet.h>
#include <net/if.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <stdexcept>

#include "dice.hpp"
#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh::test {
namespace {

using nlohmann::json;

constexpr double kFrames_per_s = 20;
constexpr double kCapture_s = 3;
/// A door binds a participant to its sockets some seconds after it was first heard: the storm
/// begins on a bus that is at work.
constexpr double kSettle_s = 12;
constexpr double kRecover_s = 2;  ///< after the storm
constexpr double kLook_s = 2;

struct Captured {
  RtpsBytes bytes;
  sockaddr_in to{};
};

/// What is said on loopback to ports of DDS.
std::vector<Captured> capture(double seconds) {
  const int wire = ::socket(AF_PACKET, SOCK_DGRAM | SOCK_CLOEXEC, htons(ETH_P_IP));
  if (wire < 0) throw std::runtime_error("cannot capture: needs root");
  sockaddr_ll lo{};
  lo.sll_family = AF_PACKET;
  lo.sll_protocol = htons(ETH_P_IP);
  lo.sll_ifindex = static_cast<int>(::if_nametoindex("lo"));
  ::bind(wire, reinterpret_cast<const sockaddr*>(&lo), sizeof lo);
  std::vector<Captured> all;
  std::vector<std::uint8_t> buffer(1 << 16);
  for (const Stopwatch clock; clock.seconds() < seconds;) {
    pollfd ready{wire, POLLIN, 0};
    if (::poll(&ready, 1, 50) != 1) continue;
    sockaddr_ll from{};
    socklen_t size = sizeof from;
    const ssize_t got = ::recvfrom(wire, buffer.data(), buffer.size(), 0,
                                   reinterpret_cast<sockaddr*>(&from), &size);
    // Everything on loopback is seen twice.
    if (got < 28 || from.sll_pkttype == PACKET_OUTGOING || buffer[9] != IPPROTO_UDP) continue;
    const std::size_t head = 4U * (buffer[0] & 15U);
    if (static_cast<std::size_t>(got) < head + 8 + 20 ||
        std::memcmp(buffer.data() + head + 8, "RTPS", 4) != 0)
      continue;
    Captured one;
    one.bytes.assign(buffer.begin() + static_cast<std::ptrdiff_t>(head + 8), buffer.begin() + got);
    one.to.sin_family = AF_INET;
    std::memcpy(&one.to.sin_addr, buffer.data() + 16, 4);
    std::memcpy(&one.to.sin_port, buffer.data() + head + 2, 2);
    all.push_back(std::move(one));
  }
  ::close(wire);
  if (all.empty()) throw std::runtime_error("nothing was captured");
  return all;
}

class Storm {
 public:
  Storm(std::vector<Captured> captured, std::uint64_t seed)
      : captured_(std::move(captured)), dice_(seed) {
    std::map<std::pair<std::uint32_t, std::uint16_t>, sockaddr_in> places;
    for (const Captured& one : captured_) {
      places[{one.to.sin_addr.s_addr, one.to.sin_port}] = one.to;
      Rtps::Key key;
      std::copy_n(one.bytes.begin() + 8, key.size(), key.begin());
      keys_.insert(keys_.end(), key);
      note_entities(one.bytes);
    }
    for (const auto& [place, address] : places) places_.push_back(address);
    open_sockets();
  }
  ~Storm() { close_sockets(); }
  Storm(const Storm&) = delete;
  Storm& operator=(const Storm&) = delete;

  void send_one() {
    if (++sent_ % 5000 == 0) open_sockets();  // others, as other strangers
    if (below(2) == 0) {
      const Captured& one = captured_[pick(captured_.size())];
      send(changed(one.bytes), one.to);
    } else {
      send(built(), places_[pick(places_.size())]);
    }
  }
  void send_everywhere(const RtpsBytes& bytes) {
    for (const sockaddr_in& place : places_) send(bytes, place);
  }

 private:
  std::uint32_t below(std::size_t count) { return static_cast<std::uint32_t>(dice_.below(count)); }
  std::uint32_t pick(std::size_t count) { return below(count); }
  bool chance(std::uint32_t of) { return below(of) == 0; }
  std::uint8_t byte() { return static_cast<std::uint8_t>(below(256)); }

  void open_sockets() {
    close_sockets();
    for (int i = 0; i < 8; ++i) {
      sockets_.push_back(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
      in_addr lo{htonl(INADDR_LOOPBACK)};
      ::setsockopt(sockets_.back(), IPPROTO_IP, IP_MULTICAST_IF, &lo, sizeof lo);
    }
  }
  void close_sockets() {
    for (const int one : sockets_) ::close(one);
    sockets_.clear();
  }
  void send(const RtpsBytes& bytes, const sockaddr_in& to) {
    static_cast<void>(::sendto(sockets_[pick(sockets_.size())], bytes.data(), bytes.size(), 0,
                               reinterpret_cast<const sockaddr*>(&to), sizeof to));
  }

  /// Readers and writers that are spoken of, to speak of them too.
  void note_entities(const RtpsBytes& bytes) {
    for (std::size_t at = 20; at + 16 <= bytes.size();) {
      const std::uint8_t id = bytes[at];
      const std::size_t length = bytes[at + 2] | std::size_t{bytes[at + 3]} << 8;
      const std::size_t from = at + (id == 0x15 || id == 0x16 ? 8 : 4);
      if ((id == 0x15 || id == 0x16 || (id >= 6 && id <= 8)) && entities_.size() < 4096)
        entities_.insert(entities_.end(), {word(bytes, from), word(bytes, from + 4)});
      if (length == 0) break;
      at += 4 + length;
    }
  }
  static std::uint32_t word(const RtpsBytes& bytes, std::size_t at) {
    return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
           std::uint32_t{bytes[at + 2]} << 8 | bytes[at + 3];
  }

  /// A packet as it was heard, with one to eight changes.
  RtpsBytes changed(RtpsBytes bytes) {
    static constexpr std::uint32_t kWords[] = {0,          1,          2,          255,
                                               0x7fff,     0xffff,     0x10000,    0x7fffffff,
                                               0x80000000, 0xffffffff, 0xfffffffe, 0x01000000};
    for (std::uint32_t left = below(8) + 1; left > 0 && bytes.size() > 24; --left) {
      const std::size_t at = 4 + pick(bytes.size() - 8);
      switch (below(8)) {
        case 0:
          bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ (1U << below(8)));
          break;
        case 1:
          bytes[at] = byte();
          break;
        case 2: {
          const std::uint32_t value = kWords[pick(std::size(kWords))];
          const std::size_t aligned = at & ~std::size_t{3};
          for (std::size_t i = 0; i < 4; ++i)
            bytes[aligned + i] = static_cast<std::uint8_t>(value >> (8 * i));
          break;
        }
        case 3:
          bytes.resize(at);
          break;
        case 4:
          bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at), 4, byte());
          break;
        case 5: {  // a part of another packet
          const RtpsBytes& other = captured_[pick(captured_.size())].bytes;
          const std::size_t from = pick(other.size());
          const std::size_t count =
              std::min({other.size() - from, bytes.size() - at, std::size_t{64}});
          std::copy_n(other.begin() + static_cast<std::ptrdiff_t>(from), count,
                      bytes.begin() + static_cast<std::ptrdiff_t>(at));
          break;
        }
        case 6: {  // in the name of somebody else
          const Rtps::Key key = speaker();
          std::copy(key.begin(), key.end(), bytes.begin() + 8);
          break;
        }
        default:  // another packet's submessages behind
          const RtpsBytes& other = captured_[pick(captured_.size())].bytes;
          if (bytes.size() + other.size() < 8000)
            bytes.insert(bytes.end(), other.begin() + 20, other.end());
      }
    }
    return bytes;
  }

  Rtps::Key speaker() {
    Rtps::Key key{1, 15};
    if (!chance(3)) return keys_[pick(keys_.size())];
    for (std::size_t i = 2; i < key.size(); ++i) key[i] = byte();
    // Some come again, so that they are let in and can say more.
    if (chance(2)) std::fill(key.begin() + 2, key.begin() + 11, std::uint8_t{7});
    return key;
  }
  std::uint32_t entity() {
    static constexpr std::uint32_t kBuiltin[] = {
        0,          0x000100c2, 0x000100c7, 0x000003c2, 0x000003c7, 0x000004c2, 0x000004c7,
        0x000200c2, 0x000200c7, 0x000201c3, 0x000201c4, 0xff0202c3, 0xff0202c4, 0xff0003c2,
        0xff0004c2, 0xff0101c2, 0x000300c3, 0x000300c4, 0x000301c3};
    if (chance(3) && !entities_.empty()) return entities_[pick(entities_.size())];
    return kBuiltin[pick(std::size(kBuiltin))];
  }
  std::int64_t number() {
    static constexpr std::int64_t kNumbers[] = {0,
                                                -1,
                                                1,
                                                2,
                                                255,
                                                256,
                                                1 << 16,
                                                (1 << 16) + 2,
                                                1 << 20,
                                                0x7fffffff,
                                                0x80000000,
                                                0xffffffff,
                                                std::int64_t{1} << 44,
                                                std::int64_t{1} << 62};
    if (chance(2)) return kNumbers[pick(std::size(kNumbers))];
    return below(2000);
  }
  std::uint32_t some_word() {
    return chance(4) ? static_cast<std::uint32_t>(number()) : below(1 << 16);
  }

  void add_parameters(Rtps& packet) {
    static constexpr std::uint16_t kIds[] = {
        0x02, 0x05, 0x06,   0x07,   0x15,   0x16,   0x1a,   0x1b,   0x1d,   0x1e,  0x1f, 0x21, 0x23,
        0x25, 0x27, 0x29,   0x2b,   0x2c,   0x2d,   0x2e,   0x2f,   0x30,   0x31,  0x32, 0x33, 0x35,
        0x43, 0x48, 0x50,   0x58,   0x59,   0x5a,   0x60,   0x62,   0x69,   0x70,  0x71, 0x72, 0x73,
        0x74, 0x75, 0x1001, 0x1002, 0x1004, 0x1005, 0x8002, 0x8005, 0x8006, 0x800f};
    for (std::uint32_t left = below(6); left > 0; --left) {
      packet.begin_parameter(kIds[pick(std::size(kIds))]);
      switch (below(5)) {
        case 0:
          packet.text("nearmesh/body_poses");
          break;
        case 1:  // a token with its lists
          packet.text("DDS:Auth:PKI-DH:1.0").u32(1).text("dds.cert.sn").text("x");
          packet.u32(chance(2) ? 1 : some_word()).text("c.id").u32(some_word()).zeros(8);
          break;
        case 2:
          packet.u32(some_word());
          [[fallthrough]];
        default:
          for (std::uint32_t words = below(8); words > 0; --words) packet.u32(some_word());
      }
      packet.end_parameter();
    }
  }

  void add_data(Rtps& packet) {
    const std::uint8_t flags = static_cast<std::uint8_t>(below(16) & ~1U);
    packet.begin_data(entity(), entity(), chance(4) ? number() : below(50) + 1, flags);
    if ((flags & 2) != 0) {
      add_parameters(packet);
      packet.sentinel();
    }
    if ((flags & 12) != 0) {
      packet.encapsulation(static_cast<std::uint8_t>(below(5)));
      switch (below(3)) {
        case 0:
          add_parameters(packet);
          packet.sentinel();
          break;
        case 1:  // a handshake
          packet.zeros(2 * 24 + 3 * 16).text("dds.sec.auth").u32(some_word());
          packet.text("DDS:Auth").u32(some_word()).u32(some_word()).zeros(16);
          break;
        default:
          for (std::uint32_t left = below(300); left > 0; --left) packet.u8(byte());
          packet.align();
      }
    }
    packet.end();
  }

  void add_endpoint(Rtps& packet, bool is_writer) {
    packet.begin_endpoint(is_writer, chance(2) ? "nearmesh/body_poses" : "x",
                          "nearmesh::wire_types::BodyPosesSample", below(5) + 1);
    if (chance(2)) packet.malformed_type();
    add_parameters(packet);
    packet.sentinel().end();
  }

  /// Half of them are all right but for their sizes, so that these are looked at.
  void add_fragments(Rtps& packet) {
    if (chance(2)) {
      static constexpr std::uint16_t kSizes[] = {1, 2, 3, 7, 8, 9, 100, 400, 0xffff};
      const std::uint16_t size = kSizes[pick(std::size(kSizes))];
      packet.fragments(below(3) + 1, static_cast<std::uint16_t>(below(3) + 1), size,
                       4U * size + below(9), 4U * below(300), entity(),
                       static_cast<std::uint8_t>(chance(4) ? below(4) << 1 : 0), entity(),
                       below(50) + 1);
    } else {
      packet.fragments(some_word(), static_cast<std::uint16_t>(below(4)),
                       static_cast<std::uint16_t>(some_word()), some_word(), 4U * below(100),
                       entity(), static_cast<std::uint8_t>(below(4) << 1), entity(), number());
    }
  }

  RtpsBytes built() {
    Rtps packet(speaker(), chance(8) ? 0x0110 : 0x010f);
    for (std::uint32_t left = below(5) + 1; left > 0; --left) {
      switch (below(14)) {
        case 0:
          packet.to(chance(4) ? speaker() : keys_[pick(keys_.size())]);
          break;
        case 1:
          packet.timestamp();
          break;
        case 2: {
          const std::int64_t first = number();
          packet.heartbeat(first, chance(2) ? first : number(), some_word(), entity(), entity());
          break;
        }
        case 3:
          packet.ack_nack(number(), below(300), some_word(), entity(), entity());
          break;
        case 4:
          packet.gap(number(), number(), below(300), entity(), entity());
          break;
        case 5:
        case 6:
          add_data(packet);
          break;
        case 7:
          add_fragments(packet);
          break;
        case 8:
          packet.begin_announcement(below(4) + 1);
          add_parameters(packet);
          if (chance(2)) packet.lease(static_cast<std::int32_t>(some_word()), some_word());
          packet.finish_announcement();
          break;
        case 9:
          packet.announcement(1, static_cast<std::int32_t>(below(20)) + 1);
          add_endpoint(packet, chance(2));
          break;
        case 10:
          packet.farewell(number());
          break;
        case 11: {
          packet.begin(byte(), byte());
          for (std::uint32_t words = below(16); words > 0; --words) packet.u32(some_word());
          packet.end();
          break;
        }
        case 12:
          packet.speaker(speaker());
          break;
        default:
          packet.begin(static_cast<std::uint8_t>(0x30 + below(5)));
          for (std::uint32_t words = below(16); words > 0; --words) packet.u32(some_word());
          packet.end();
      }
    }
    if (chance(4)) packet.statistics();
    if (chance(16)) packet.zeros(below(4));
    return std::move(packet.bytes);
  }

  std::vector<Captured> captured_;
  Dice dice_;
  std::vector<sockaddr_in> places_;
  std::vector<Rtps::Key> keys_;
  std::vector<std::uint32_t> entities_;
  std::vector<int> sockets_;
  std::uint64_t sent_ = 0;
};

// --- Who is out in it

/// Seconds of processor time of each thread.
std::map<std::string, double> threads_of(pid_t process) {
  std::map<std::string, double> spent;
  const std::string folder = "/proc/" + std::to_string(process) + "/task";
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    const std::string stat = read_text(entry.path() / "stat");
    if (stat.empty()) continue;
    std::istringstream after_name(stat.substr(stat.rfind(')') + 2));
    std::string skipped;
    for (int i = 3; i < 14; ++i) after_name >> skipped;
    double user = 0, system = 0;
    after_name >> user >> system;
    spent[entry.path().filename()] = (user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK));
  }
  return spent;
}

constexpr char kScenePattern[] = R"(bodies:
  - {name: terrain, model: terrain, pose: {translation: [0, 0, 0]}}
  - {name: aircraft1, model: aircraft}
  - {name: aircraft2, model: aircraft}
moves:
  - {body: aircraft%d, trajectory: flight%d.csv}
pairs:
  - [terrain, aircraft%d]
  - [aircraft1, aircraft2]
frame_rate_hz: 20
budget_ms: 10
lookahead_s: 0.3
start_timeout_s: 60
)";

struct Flyer {
  Folder folder;
  std::unique_ptr<Process> process;
  [[nodiscard]] std::string answers() const { return folder.file("answers.jsonl"); }
};

/// What a peer answered in the lines from `from` on.
struct Answers {
  std::size_t lines = 0, certified = 0;
  std::set<std::string> other_poses;  ///< of what another peer moves
  std::size_t longest_pause = 0;      ///< answers in a row without a certified one
};

Answers read_answers(const std::string& path, std::size_t from = 0) {
  Answers found;
  std::map<std::string, std::size_t> pauses;
  for (const std::string& text : lines_of(read_text(path))) {
    const json line = json::parse(text, nullptr, false);
    if (line.is_discarded() || line.contains("summary")) continue;  // the last may be half written
    if (found.lines++ < from) continue;
    const std::string status = line.at("status"), a = line.at("a"), b = line.at("b");
    const bool certified = status == "free" || status == "contact" || status == "contained";
    found.certified += certified ? 1 : 0;
    std::size_t& pause = pauses[a + b];
    pause = certified ? 0 : pause + 1;
    found.longest_pause = std::max(found.longest_pause, pause);
    if (a == "aircraft1" && b == "aircraft2")
      found.other_poses.insert(line.at("pose_a").dump() + line.at("pose_b").dump());
  }
  return found;
}

class Victims {
 public:
  Victims(const Lan& lan, const Exercise& exercise, const StormOptions& options)
      : exercise_(exercise), secured_(options.secured), deaf_s_(options.deaf_s) {
    const Lan::Visit visit = lan.visit(0);
    if (secured_) make_identities();
    std::vector<std::string> words{"serve"};
    words.insert(words.end(), exercise.models.begin(), exercise.models.end());
    start("publisher", "nearmesh-publisher", words, "serve");
    if (!of("publisher").says("ready on domain"))
      throw std::runtime_error("no publisher: " + of("publisher").err());
    start("recorder", "nearmesh-subscriber", {"record", "-o", folder_.file("storm.db3")}, "rec");
    const double seconds = kSettle_s + kCapture_s + kRecover_s + kLook_s + 60 +
                           1.5 * static_cast<double>(options.packets) / options.packets_per_s;
    for (int i = 0; i < 2; ++i) {
      Flyer& flyer = flyers_[i];
      write_flights(flyer.folder, exercise, static_cast<int>(seconds * kFrames_per_s),
                    kFrames_per_s);
      char scene[1024];
      std::snprintf(scene, sizeof scene, kScenePattern, i + 1, i + 1, i + 1);
      flyer.folder.write("scene.yaml", scene);
      start("peer" + std::to_string(i + 1), "nearmesh-subscriber",
            {"run", flyer.folder.file("scene.yaml"), "--answers", flyer.answers()},
            i == 0 ? "alice" : "bob");
    }
    words = {"--domain",   std::to_string(exercise.domain),
             "--profiles", NEARMESH_FLIGHT_SIM_DIR "/profiles.xml",
             "--profile",  "flight_sim_loopback",
             "--seconds",  std::to_string(static_cast<int>(seconds)),
             "--policy",   "proceed"};
    if (secured_) words.insert(words.end(), {"--security", folder_.file("set") + "/sim"});
    start_words("simulator", "nearmesh-example-flight-sim", words);
    if (!await([this] {
          return read_answers(flyers_[0].answers()).certified > 0 &&
                 read_answers(flyers_[1].answers()).certified > 0;
        }))
      throw std::runtime_error("the peers do not fly: " + of("peer1").err() + of("peer2").err());
  }

  [[nodiscard]] std::size_t lines(int flyer) const {
    return read_answers(flyers_[flyer].answers()).lines;
  }

  void look_for_ended(StormResult& result) {
    for (auto& [name, process] : all_)
      if (process->is_over() &&
          std::find(result.ended.begin(), result.ended.end(), name) == result.ended.end()) {
        result.ended.push_back(name);
        const std::string said = process->err();
        result.complaint +=
            name + ": " + said.substr(said.size() - std::min<std::size_t>(said.size(), 600));
      }
  }

  /// For kLook_s: who spins, and who hears nothing.
  void look(StormResult& result) {
    std::map<std::string, std::map<std::string, double>> before;
    for (auto& [name, process] : all_) before[name] = threads_of(process->id());
    const std::size_t from[2] = {lines(0), lines(1)};
    const Stopwatch clock;
    pause(kLook_s);
    const double seconds = clock.seconds();
    for (auto& [name, process] : all_)
      for (const auto& [thread, spent] : threads_of(process->id()))
        if (const auto was = before[name].find(thread);
            was != before[name].end() && spent - was->second > seconds / 2)
          result.spins.push_back(name + " thread " + thread);
    for (int i = 0; i < 2; ++i) {
      Answers now;
      const std::string name = "peer" + std::to_string(i + 1);
      static_cast<void>(poll(
          [&] {
            now = read_answers(flyers_[i].answers(), from[i]);
            return now.certified > 0 && now.other_poses.size() >= 2;
          },
          deaf_s_, 0.1));
      if (now.certified == 0) result.deaf.push_back(name + ": no certified answer");
      // Its own aircraft moves each frame; half the frames at least shall have the other's new pose
      // too.
      if (now.other_poses.size() < 2) result.deaf.push_back(name + ": no poses of the other");
    }
    look_at_statuses(result);
  }

  void end(StormResult& result) {
    for (auto& [name, process] : all_) {
      if (process->is_over()) continue;
      const Stopwatch clock;
      process->signal(SIGINT);
      const int code = process->wait();
      result.slowest_end_s = std::max(result.slowest_end_s, clock.seconds());
      // The simulator leaves SIGINT to the system.
      if (code != 0 && code != 1000 + SIGINT)
        result.ended.push_back(name + " at its end, code " + std::to_string(code));
    }
    for (const Flyer& flyer : flyers_) {
      const Answers all = read_answers(flyer.answers());
      result.answers += all.lines;
      result.certified += all.certified;
      result.longest_pause_s =
          std::max(result.longest_pause_s, static_cast<double>(all.longest_pause) / kFrames_per_s);
      result.wrong += count_wrong_answers(flyer.folder, exercise_, all.lines);
    }
    look_at_recording(result);
  }

 private:
  /// Of the publisher: whether requests still reach it. Of the simulator: whether detail does,
  /// since it is certified.
  void look_at_statuses(StormResult& result) {
    looked_ns_ = wall_ns();
    const std::string name = "status";
    start(name, "nearmesh-subscriber", {"status", "--watch", "--seconds", "1", "--json"}, "watch");
    const auto process = std::move(all_.extract(name).mapped());
    std::set<std::uint64_t> requests;
    std::set<std::string> readiness;
    const auto look = [&] {
      for (const std::string& line : lines_of(process->out())) {
        const json told = json::parse(line, nullptr, false);  // the last may be half of one
        if (!told.is_object()) break;
        for (const json& one : told.at("publishers"))
          if (one.value("process_id", 0) == of("publisher").id())
            requests.insert(one.at("requests").get<std::uint64_t>());
        for (const json& one : told.at("peers"))
          if (one.value("process_id", 0) == of("simulator").id())
            readiness.insert(one.at("readiness").get<std::string>());
      }
      return requests.size() >= 2 && readiness.contains("ready");
    };
    constexpr double kStatuses_s = 4;  // one a second
    static_cast<void>(poll(look, kStatuses_s + deaf_s_, 0.1));
    process->signal(SIGINT);
    static_cast<void>(process->wait());
    if (requests.size() < 2) result.deaf.push_back("publisher: no requests");
    if (!readiness.contains("ready"))
      result.deaf.push_back("simulator: " + (readiness.empty() ? "no status" : *readiness.begin()));
  }
  /// The recorder heard poses of everybody until it was told to end.
  void look_at_recording(StormResult& result) {
    const auto recording = RecordingReader::open(folder_.file("storm.db3"));
    if (!recording.is_ok()) throw std::runtime_error(recording.status().message());
    RecordingReader& reader = *recording.value();
    std::set<std::uint32_t> heard;
    const Result<std::int64_t> first = reader.find(looked_ns_);
    if (!first.is_ok()) throw std::runtime_error(first.status().message());
    const Status read = reader.read(
        first.value(), reader.message_count() + 1, [&](std::int64_t, const RecordedMessage& said) {
          const std::string& topic = reader.topics()[reader.writers()[said.writer].topic].name;
          if (topic.ends_with("/body_poses")) heard.insert(said.writer);
          return true;
        });
    if (!read.is_ok()) throw std::runtime_error(read.message());
    constexpr std::size_t kMovers = 3;
    if (heard.size() < kMovers)
      result.deaf.push_back("recorder: poses of " + std::to_string(heard.size()) + " of " +
                            std::to_string(kMovers));
  }
  static std::int64_t wall_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::system_clock::now().time_since_epoch())
        .count();
  }

  Process& of(const std::string& name) { return *all_.at(name); }
  void start(const std::string& name, const std::string& program, std::vector<std::string> words,
             const std::string& identity) {
    words.insert(words.end(),
                 {"--domain", std::to_string(exercise_.domain), "--interface", "127.0.0.1"});
    if (secured_) words.insert(words.end(), {"--security", folder_.file("set") + "/" + identity});
    start_words(name, program, words);
  }
  void start_words(const std::string& name, const std::string& program,
                   const std::vector<std::string>& words) {
    all_[name] = std::make_unique<Process>(folder_, program, words);
  }
  void make_identities() {
    std::string err;
    if (run(folder_, "nearmesh-publisher",
            {"make-security", folder_.file("set"), "--publisher", "serve", "--subscriber", "alice",
             "--subscriber", "bob", "--subscriber", "watch", "--subscriber", "sim", "--recorder",
             "rec", "--topic", "flight_sim/state", "--domain", std::to_string(exercise_.domain)},
            nullptr, &err) != 0)
      throw std::runtime_error("no identities: " + err);
  }

  const Exercise exercise_;
  const bool secured_;
  const double deaf_s_;
  const Folder folder_;
  std::int64_t looked_ns_ = 0;  ///< by the wall clock, which recordings use
  Flyer flyers_[2];
  std::map<std::string, std::unique_ptr<Process>> all_;
};

}  // namespace

StormResult weather_storm(const Exercise& exercise, const StormOptions& options) {
  const Lan lan({Link{}});
  Victims victims(lan, exercise, options);
  const Lan::Visit visit = lan.visit(0);
  StormResult result;
  std::vector<Captured> captured = capture(kCapture_s);
  result.captured = captured.size();
  pause(kSettle_s);
  Storm storm(std::move(captured), options.seed);
  for (const RtpsBytes& packet : options.first) storm.send_everywhere(packet);
  const Stopwatch clock;
  for (; result.sent < options.packets; ++result.sent) {
    storm.send_one();
    if (result.sent % 64 == 0) {
      const double ahead_s =
          static_cast<double>(result.sent) / options.packets_per_s - clock.seconds();
      if (ahead_s > 0) pause(ahead_s);
    }
    if (result.sent % 5000 == 0) victims.look_for_ended(result);
    if (!result.ended.empty()) break;
  }
  pause(kRecover_s);
  victims.look_for_ended(result);
  victims.look(result);
  victims.end(result);
  return result;
}

}  // namespace nearmesh::test
