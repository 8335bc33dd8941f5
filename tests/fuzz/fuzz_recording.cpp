// SPDX-License-Identifier: Apache-2.0
// The bytes are an MCAP file that is opened as a recording.
// Holds: it is refused, or what it unpacks to is read to its end; checksums are put right by none,
// so seeds have none (0).

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "core/recording/mcap.hpp"
#include "fuzz_input.hpp"
#include "nearmesh/core/recording/recording.hpp"

using namespace nearmesh;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  // In memory: a folder on a disk would make it ten times slower.
  static const std::string folder = [] {
    std::string name = "/dev/shm/nearmesh-fuzz-XXXXXX";
    FUZZ_CHECK(::mkdtemp(name.data()) != nullptr);
    ::setenv("TMPDIR", name.c_str(), 1);
    return name;
  }();
  struct Remove {
    ~Remove() { std::filesystem::remove_all(folder); }
  };
  static const Remove at_exit;
  const std::string path = folder + "/input.mcap";
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));

  std::uint64_t messages = 0;
  const Status walked = mcap::read(
      path,
      {.channel = [](std::uint16_t, const mcap::Channel&,
                     const mcap::Schema&) { return Status::ok(); },
       .message =
           [&](const mcap::Message& message) {
             FUZZ_CHECK(message.data.size() <= size);
             ++messages;
             return Status::ok();
           },
       .metadata = [](std::string_view, const mcap::Texts&) { return Status::ok(); },
       .attachment = [](std::string_view, std::span<const std::uint8_t>) { return Status::ok(); }});
  if (!mcap::is_mcap(path)) return 0;
  const auto opened = RecordingReader::open(path);
  FUZZ_CHECK(!opened.is_ok() || walked.is_ok());
  if (!opened.is_ok()) {
    FUZZ_CHECK(!opened.status().message().empty());
    return 0;
  }
  RecordingReader& recording = *opened.value();
  FUZZ_CHECK(static_cast<std::uint64_t>(recording.message_count()) <= messages);
  std::int64_t read = 0;
  FUZZ_CHECK(recording
                 .read(1, recording.message_count() + 1,
                       [&](std::int64_t, const RecordedMessage& message) {
                         FUZZ_CHECK(message.writer < recording.writers().size());
                         ++read;
                         return true;
                       })
                 .is_ok());
  FUZZ_CHECK(read == recording.message_count());
  for (std::uint32_t key = 0; key < recording.keys().size(); ++key)
    FUZZ_CHECK(recording.ids_of(key).is_ok());
  return 0;
}
