// SPDX-License-Identifier: Apache-2.0
// Detail that is kept in a folder from one session to the next.
#include "subscriber/peer/detail_cache.hpp"

#include <filesystem>
#include <fstream>

#include "nearmesh/core/spm/detail/codec.hpp"
#include "subscriber/peer/replicas.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;
using subscriber::Batches;
using subscriber::Session;
using subscriber::SessionOptions;
using test::Flight;
using test::make_flight;
using test::World;

constexpr ContentHash kContent{1, 2};

class CacheFolder {
 public:
  CacheFolder() : beside_(".cache") { fs::create_directories(path()); }
  ~CacheFolder() { fs::remove_all(path()); }
  [[nodiscard]] std::string path() const { return beside_.path() + ".folder"; }
  [[nodiscard]] std::vector<fs::path> files() const {
    std::vector<fs::path> found;
    for (const auto& entry : fs::directory_iterator(path())) found.push_back(entry.path());
    std::sort(found.begin(), found.end());
    return found;
  }

 private:
  test::TempFile beside_;
};

std::string read_all(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}
void write_all(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

Batches some_batches() { return {{1, 2, 3}, {}, {7}}; }

TEST(DetailCache, GivesBackWhatWasWritten) {
  const CacheFolder folder;
  EXPECT_FALSE(subscriber::read_cached(folder.path(), kContent).value().has_value());
  ASSERT_TRUE(subscriber::write_cached(folder.path(), kContent, some_batches()).is_ok());
  EXPECT_EQ(subscriber::read_cached(folder.path(), kContent).value(), some_batches());
  EXPECT_EQ(folder.files().size(), 1U);
  ASSERT_TRUE(subscriber::write_cached(folder.path(), kContent, {}).is_ok());
  EXPECT_TRUE(folder.files().empty());
}

TEST(DetailCache, EveryDamageIsSeen) {
  const CacheFolder folder;
  ASSERT_TRUE(subscriber::write_cached(folder.path(), kContent, some_batches()).is_ok());
  const fs::path path = folder.files().at(0);
  const std::string whole = read_all(path);
  const auto code = [&](const std::string& bytes) {
    write_all(path, bytes);
    return subscriber::read_cached(folder.path(), kContent).status().code();
  };
  for (std::size_t i = 0; i < whole.size(); ++i) {
    std::string changed = whole;
    changed[i] = static_cast<char>(changed[i] ^ 1);
    EXPECT_EQ(code(changed), StatusCode::kCorrupt) << "byte " << i;
    EXPECT_EQ(code(whole.substr(0, i)), StatusCode::kCorrupt) << "cut at " << i;
  }
  EXPECT_EQ(code(whole + "x"), StatusCode::kCorrupt);
  EXPECT_EQ(code(std::string(subscriber::kMaxCachedBytes + 100'000, 'x')), StatusCode::kCorrupt);
  EXPECT_EQ(code("a letter"), StatusCode::kCorrupt);
  EXPECT_EQ(subscriber::write_cached(folder.path(), kContent, some_batches()).code(),
            StatusCode::kConflict)
      << "a file of another kind is left alone";
  EXPECT_EQ(read_all(path), "a letter");
}

TEST(DetailCache, AFileOfAnotherContentIsNotTaken) {
  const CacheFolder folder;
  ASSERT_TRUE(subscriber::write_cached(folder.path(), kContent, some_batches()).is_ok());
  const fs::path path = folder.files().at(0);
  fs::rename(path, path.parent_path() / (to_hex(ContentHash{3, 4}) + path.extension().string()));
  EXPECT_EQ(subscriber::read_cached(folder.path(), {3, 4}).status().code(), StatusCode::kCorrupt);
}

// ---- sessions -----------------------------------------------------------------------------------

SessionOptions options_of(const CacheFolder& folder) {
  SessionOptions options = test::quick_options();
  options.cache_folder = folder.path();
  return options;
}

/// What a peer that flies is sent.
struct Sent {
  std::size_t certified = 0, refused_state = 0;
  std::uint64_t splits = 0, batches = 0, requests = 0;
};
Sent fly_once(World& world, const SessionOptions& options, const Flight& flight) {
  Sent sent;
  world.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& message) {
    sent.refused_state += message.wants_held ? 1 : 0;
    return true;
  };
  const auto session = world.make_peer(options);
  sent.certified = world.fly(*session, flight);
  const auto stats = session->stats();
  sent.splits = stats.held_splits;
  sent.batches = stats.batch_bytes;
  sent.requests = stats.requests;
  return sent;
}

TEST(DetailCache, APeerThatWasThereIsSentNothingAgain) {
  const CacheFolder folder;
  World world;
  world.start_publisher();
  const Flight flight = make_flight(3);
  const Sent first = fly_once(world, options_of(folder), flight);
  EXPECT_EQ(first.certified, flight.frames());
  ASSERT_EQ(folder.files().size(), 2U);
  const Sent second = fly_once(world, options_of(folder), flight);
  EXPECT_EQ(second.certified, flight.frames());
  EXPECT_EQ(second.batches, 0U);
  EXPECT_EQ(second.splits, first.splits);
  EXPECT_TRUE(world.complaints.empty()) << world.complaints.front();
}

TEST(DetailCache, ThePublisherIsToldWhatIsHeldAtOnce) {
  const CacheFolder folder;
  World world;
  world.start_publisher();
  static_cast<void>(fly_once(world, options_of(folder), make_flight(3)));
  const Flight elsewhere = make_flight(4);
  const Sent cached = fly_once(world, options_of(folder), elsewhere);
  EXPECT_EQ(cached.certified, elsewhere.frames());
  EXPECT_EQ(cached.refused_state, 0U) << "a round trip";
  const Sent fresh = fly_once(world, test::quick_options(), elsewhere);
  EXPECT_GT(cached.splits, fresh.splits);
}

TEST(DetailCache, DamagedFilesAreComplainedOfOnceAndReplaced) {
  const CacheFolder folder;
  World world;
  world.start_publisher();
  const Flight flight = make_flight(3);
  static_cast<void>(fly_once(world, options_of(folder), flight));
  const fs::path path = folder.files().at(0);
  std::string bytes = read_all(path);
  bytes[bytes.size() / 2] = static_cast<char>(~bytes[bytes.size() / 2]);
  write_all(path, bytes);
  EXPECT_EQ(fly_once(world, options_of(folder), flight).certified, flight.frames());
  ASSERT_EQ(world.complaints.size(), 1U);
  EXPECT_TRUE(world.has_complaint("the cache is not used"));
  EXPECT_EQ(fly_once(world, options_of(folder), flight).batches, 0U);
  EXPECT_EQ(world.complaints.size(), 1U);
}

// A file in order whose batches lie: nobody who is there can be blamed.
TEST(DetailCache, LiesOutOfTheCacheAreForgottenAndBlameNobody) {
  const CacheFolder folder;
  World world;
  world.start_publisher();
  const Flight flight = make_flight(3);
  static_cast<void>(fly_once(world, options_of(folder), flight));
  for (const test::ServedModel* model : {&test::terrain(), &test::aircraft()}) {
    const ContentHash content = model->open().content_hash();
    Batches batches = std::move(subscriber::read_cached(folder.path(), content).value()).value();
    for (auto& batch : batches) {  // as one who knows how to seal
      batch = {batch.begin(), batch.end() - static_cast<std::ptrdiff_t>(kSealBytes)};
      batch[batch.size() / 2] = static_cast<std::uint8_t>(batch[batch.size() / 2] ^ 16);
      seal_batch(content, batch);
    }
    ASSERT_TRUE(subscriber::write_cached(folder.path(), content, batches).is_ok());
  }
  EXPECT_EQ(fly_once(world, options_of(folder), flight).certified, flight.frames());
  EXPECT_TRUE(world.has_complaint("detail out of the cache"));
  EXPECT_FALSE(world.has_complaint("publisher"));
  world.complaints.clear();
  EXPECT_EQ(fly_once(world, options_of(folder), flight).certified, flight.frames());
  EXPECT_TRUE(world.complaints.empty()) << "it is replaced";
}

TEST(DetailCache, AFullFileTakesNoMore) {
  subscriber::PeerModel::Cache cache;
  for (std::size_t i = 0; i < subscriber::kMaxCachedBatches + 5; ++i) cache.keep({1}, true);
  EXPECT_EQ(cache.batches.size(), subscriber::kMaxCachedBatches);
  subscriber::PeerModel::Cache large;
  large.keep(std::vector<std::uint8_t>(subscriber::kMaxCachedBytes), true);
  large.has_news = false;
  large.keep({1}, true);
  EXPECT_EQ(large.batches.size(), 1U);
  EXPECT_FALSE(large.has_news);
}

}  // namespace
}  // namespace nearmesh
