// SPDX-License-Identifier: Apache-2.0
// A peer of another vendor, nearmesh-cyclone-peer, against the real publisher: it must receive, to
// the byte, what a Fast DDS peer receives that asked the same. UDP on 127.0.0.1, processes of their
// own.

#include <algorithm>
#include <cinttypes>

#include "core/base/hash.hpp"
#include "idl/dds/codec.hpp"
#include "nearmesh/core/spm/detail/header.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "on_loopback.hpp"
#include "tests/system/integration/process.hpp"

namespace nearmesh {
namespace {

using test::Folder;
using test::Process;

constexpr int kDomain = 98;
constexpr const char* kCyclonePeer = "00000000000000c1";
constexpr wire::SessionId kFastPeer = 0xfa;

std::string hex(const std::vector<std::uint8_t>& bytes) {
  std::string text;
  char two[3];
  for (const std::uint8_t byte : bytes) {
    std::snprintf(two, sizeof two, "%02x", byte);
    text += two;
  }
  return text;
}

template <class... Words>
std::string line_of(const char* kind, const Words&... words) {
  std::ostringstream line;
  line << kind;
  ((line << ' ' << words), ...);
  return line.str();
}

std::string words(const ContentHash& content) {
  return std::to_string(content.high) + ' ' + std::to_string(content.low);
}

std::string line_of(const wire::Hello& hello) {
  std::string names, hashes;
  for (const wire::Hello::Model& model : hello.models) {
    names += model.name + "\n";
    hashes += (hashes.empty() ? "" : " ") + words(model.content_hash);
  }
  return line_of("hello", hello.publisher, hex({names.begin(), names.end()}), hashes);
}

std::string line_of(const wire::MeshHeader& header) {
  return line_of("header", words(header.content_hash), header.name, hex(header.bytes));
}

std::string line_of(const wire::SplitBatchMessage& batch) {
  return line_of("batch", batch.publisher, words(batch.content_hash), batch.request, batch.sequence,
                 (batch.last ? 1 : 0) + (batch.refused ? 2 : 0), hex(batch.bytes));
}

// As nearmesh-cyclone-peer reads it.
std::string line_of(const wire::RegionSubscription& subscription) {
  wire_types::RegionSubscriptionSample sample;
  wire::encode(subscription, sample);
  std::ostringstream line;
  line << sample.publisher() << ' ' << words(subscription.content_hash) << ' ' << sample.request()
       << ' ' << int{sample.priority()} << ' ' << sample.acknowledged_sequence() << ' '
       << sample.window_bytes() << ' ' << sample.max_splits() << ' ' << sample.attach().size();
  for (const std::uint32_t word : sample.attach()) line << ' ' << word;
  for (const std::int32_t cells : sample.region_origin()) line << ' ' << cells;
  line << ' ' << int{sample.region_shift()} << ' ' << sample.region_radius() << ' '
       << sample.region_parts().size();
  for (const std::uint8_t byte : sample.region_parts()) line << ' ' << int{byte};
  return line.str();
}

class CyclonePeer : public ::testing::Test {
 protected:
  // The Fast DDS peer: joins, and hears hello and header.
  void join() {
    subscriber::DdsChannelOptions options;
    options.transport.domain = kDomain;
    options.transport.prefix = prefix;
    options.transport.interface = "127.0.0.1";
    options.session = kFastPeer;
    auto made = subscriber::DdsChannel::create(options);
    ASSERT_TRUE(made.is_ok()) << made.status().message();
    channel = std::move(made).value();
    ASSERT_TRUE(test::await([this] {
      for (const auto& hello : take().hellos) hellos.push_back(hello);
      return !hellos.empty() && !headers.empty();
    }));
  }

  subscriber::Channel::Inbox take() {
    subscriber::Channel::Inbox inbox = channel->take();
    for (const auto& header : inbox.headers) headers.push_back(header.message);
    batches.insert(batches.end(), inbox.batches.begin(), inbox.batches.end());
    return inbox;
  }

  // Asks as the Fast DDS peer, and waits for the whole answer.
  void ask(const wire::RegionSubscription& subscription) {
    channel->send(subscription);
    ASSERT_TRUE(test::await([&] {
      static_cast<void>(take());
      return !batches.empty() && batches.back().request == subscription.request &&
             batches.back().last;
    }));
    asked.push_back(subscription);
  }

  // The same requests by the other peer: what it printed.
  std::vector<std::string> ask_by_cyclone() {
    std::string text;
    for (const wire::RegionSubscription& subscription : asked) text += line_of(subscription) + "\n";
    folder.write("requests.txt", text);
    test::set_cyclone_on_loopback(test::kDatagramsOfOurs);
    Process peer(folder, "nearmesh-cyclone-peer",
                 {std::to_string(kDomain), prefix, std::to_string(wire::kWireVersion), kCyclonePeer,
                  folder.file("requests.txt")});
    EXPECT_EQ(peer.wait(), 0) << peer.err();
    return test::lines_of(peer.out());
  }

  [[nodiscard]] std::vector<std::string> received_by_fast_dds() const {
    std::vector<std::string> lines;
    for (const auto& hello : hellos) lines.push_back(line_of(hello));
    for (const auto& header : headers) lines.push_back(line_of(header));
    for (const auto& batch : batches) lines.push_back(line_of(batch));
    return lines;
  }

  Folder folder;
  // Without '-', which Cyclone DDS does not take in a topic's name.
  const std::string prefix = "cyclone_" + std::to_string(::getpid());
  std::unique_ptr<subscriber::DdsChannel> channel;
  std::vector<wire::Hello> hellos;
  std::vector<wire::MeshHeader> headers;
  std::vector<wire::SplitBatchMessage> batches;
  std::vector<wire::RegionSubscription> asked;
};

TEST_F(CyclonePeer, ReceivesToTheByteWhatAFastDdsPeerReceives) {
  Process publisher(folder, "nearmesh-publisher",
                    {"serve", test::model_file("terrain", 48), "--domain", std::to_string(kDomain),
                     "--prefix", prefix, "--interface", "127.0.0.1"});
  ASSERT_TRUE(publisher.says("ready on domain")) << publisher.err();
  ASSERT_NO_FATAL_FAILURE(join());
  const Result<SpmHeader> model = decode_header(headers.at(0).bytes);
  ASSERT_TRUE(model.is_ok()) << model.status().message();

  wire::RegionSubscription subscription;
  subscription.peer = kFastPeer;
  subscription.publisher = hellos.at(0).publisher;
  subscription.content_hash = headers.at(0).content_hash;
  subscription.request = 1;
  for (const BaseRoot& root : model.value().roots)
    if (root.node.size > 1 && subscription.region.attach.size() < kMaxAttachNodes)
      subscription.region.attach.push_back(root.node);
  constexpr std::int32_t kWhole = 1 << 21;
  subscription.region.region.push_back(GridBox{{{0, 0, 0}}, {{kWhole, kWhole, kWhole}}});
  subscription.region.max_splits = 1500;
  ASSERT_NO_FATAL_FAILURE(ask(subscription));
  // Another, as large as requests may be: in fragments both ways.
  subscription.request = 2;
  subscription.acknowledged_sequence = batches.back().sequence;
  subscription.region.region.assign(kMaxRegionBoxes, subscription.region.region[0]);
  subscription.region.max_splits = 300;
  ASSERT_NO_FATAL_FAILURE(ask(subscription));
  // A refusal is an answer as well.
  subscription.request = 3;
  subscription.content_hash.low ^= 1;
  ASSERT_NO_FATAL_FAILURE(ask(subscription));
  EXPECT_TRUE(batches.back().refused);
  EXPECT_GT(batches.size(), 8U);

  // Hello and header come in any order; batches are numbered.
  std::vector<std::string> by_cyclone = ask_by_cyclone(), by_fast_dds = received_by_fast_dds();
  std::sort(by_cyclone.begin(), by_cyclone.end());
  std::sort(by_fast_dds.begin(), by_fast_dds.end());
  EXPECT_EQ(by_cyclone, by_fast_dds);
}

}  // namespace
}  // namespace nearmesh
