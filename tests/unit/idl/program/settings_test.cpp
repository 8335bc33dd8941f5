// SPDX-License-Identifier: Apache-2.0
#include "idl/program/settings.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>

#include "idl/program/command.hpp"
#include "idl/program/logging.hpp"
#include "idl/program/metrics.hpp"

namespace nearmesh::wire::program {
namespace {

class SettingsTest : public ::testing::Test {
 protected:
  SettingsTest() {
    settings.add("lease_s", lease_s, 0.5, 100, "Lease");
    settings.add("peers", peers, 1, 1000, "Peers");
    settings.add("name", name, "Name");
    settings.add("addresses", addresses, "Addresses", "words", [](const std::string& text) {
      if (text != "bad") return Status::ok();
      return Status{StatusCode::kInvalidArgument, "expected a good one, found bad"};
    });
  }
  ~SettingsTest() override { std::remove(path.c_str()); }

  Status read(const std::string& text) {
    std::ofstream(path) << text;
    return settings.read_file(path);
  }
  Status read_variables(std::vector<const char*> variables) {
    variables.push_back(nullptr);
    return settings.read_environment(variables.data());
  }
  /// The layer refuses, with this in its line, and nothing of `lease_s` and `peers` is changed.
  void expect_refused(const Status& status, const std::string& expected) {
    ASSERT_FALSE(status.is_ok()) << expected;
    EXPECT_NE(status.message().find(expected), std::string::npos) << status.message();
    EXPECT_EQ(lease_s, 3);
    EXPECT_EQ(peers, 10U);
  }
  Settings::Shown shown(const std::string& key) const {
    for (const Settings::Shown& setting : settings.show())
      if (setting.key == key) return setting;
    ADD_FAILURE() << key;
    return {};
  }

  const std::string path =
      ::testing::TempDir() + "settings_" + std::to_string(::getpid()) + ".yaml";
  double lease_s = 3;
  std::uint32_t peers = 10;
  std::string name = "ship";
  std::vector<std::string> addresses;
  Settings settings;
};

TEST_F(SettingsTest, EachLayerBeatsTheOneBelow) {
  settings.set_preset("lease_s", 10, "thin");
  EXPECT_EQ(lease_s, 10);
  EXPECT_EQ(shown("lease_s").source, Source::kPreset);
  ASSERT_TRUE(read("# mine\n\nlease_s: 20\npeers: 7\naddresses: [a, b]\nname: 1e3\n").is_ok());
  EXPECT_EQ(lease_s, 20);
  EXPECT_EQ(name, "1e3");
  EXPECT_EQ(shown("lease_s").place, path + ":3");
  settings.set_preset("peers", 99, "thin");
  EXPECT_EQ(peers, 7U);
  ASSERT_TRUE(read_variables({"NEARMESH_LEASE_S=30", "NEARMESH_LEASE_SX=1",
                              "NEARMESH_ADDRESSES=c,d", "LEASE_S=5"})
                  .is_ok());
  EXPECT_EQ(lease_s, 30);
  EXPECT_EQ(addresses, (std::vector<std::string>{"c", "d"}));
  EXPECT_EQ(shown("addresses").place, "NEARMESH_ADDRESSES");
  ASSERT_TRUE(settings.set_flag("lease_s", {"40"}).is_ok());
  EXPECT_EQ(lease_s, 40);
  EXPECT_EQ(shown("lease_s").source, Source::kFlag);
  EXPECT_EQ(shown("lease_s").built_in, 3);
  EXPECT_EQ(peers, 7U);
}

TEST_F(SettingsTest, UnknownKeyNamesFileLineKeyAndTheNearest) {
  expect_refused(read("name: x\nleas_s: 5\n"),
                 path + ":2: unknown key leas_s; the nearest is lease_s");
  expect_refused(settings.set_flag("peer", {"1"}), "the nearest is peers");
}

TEST_F(SettingsTest, ValuesOutsideTheirRangeAreNamed) {
  expect_refused(read("lease_s: 0.4\n"),
                 path + ":1: lease_s: expected a number in [0.5, 100], found 0.4");
  expect_refused(read("lease_s: nan\n"), "found nan");
  expect_refused(read("lease_s: 5s\n"), "found 5s");
  expect_refused(read("lease_s:\n"), "lease_s: expected one value");
  expect_refused(read("peers: 1.5\n"), "expected a whole number in [1, 1000], found 1.5");
  expect_refused(read("peers: 1001\n"), "found 1001");
  expect_refused(read("peers: [1, 2]\n"), "expected one value");
  expect_refused(read("addresses: [a, bad]\n"), "expected a good one");
  EXPECT_TRUE(addresses.empty());
  expect_refused(read("addresses: {a: 1}\n"), "expected a list");
  expect_refused(read_variables({"NEARMESH_PEERS=0"}), "NEARMESH_PEERS: expected a whole number");
  expect_refused(settings.set_flag("lease_s", {"x"}), "--lease-s: expected a number");
}

TEST_F(SettingsTest, FilesThatAreNoMapsAreRefused) {
  expect_refused(settings.read_file(path + ".absent"), "cannot open");
  expect_refused(read("- a\n"), "expected a map");
  expect_refused(read("name: [\n"), path + ":");
  expect_refused(read("name: a\nname: b\n"), path + ":2: name is set twice");
  expect_refused(read("? [a]\n: b\n"), "expected the name of a setting");
  EXPECT_TRUE(read("# nothing\n").is_ok());
}

TEST_F(SettingsTest, WhatIsPrintedIsAFileThatSetsTheSame) {
  ASSERT_TRUE(settings.set_flag("name", {"odd: \"name\" # no comment"}).is_ok());
  ASSERT_TRUE(settings.set_flag("addresses", {"10.0.0.1", "x, y"}).is_ok());
  ASSERT_TRUE(settings.set_flag("lease_s", {"0.1e1"}).is_ok());
  const std::string printed = settings.as_yaml();
  const auto before = addresses;
  const std::string named = name;
  addresses.clear();
  name.clear();
  lease_s = 9;
  ASSERT_TRUE(read(printed).is_ok()) << printed;
  EXPECT_EQ(addresses, before);
  EXPECT_EQ(name, named);
  EXPECT_EQ(lease_s, 1);
}

TEST(TransportSettings, NamesAreCheckedAndThePresetFillsWhatNobodySet) {
  wire::TransportOptions transport;
  Settings settings;
  add_transport_settings(settings, transport);
  EXPECT_FALSE(settings.set_flag("transport", {"pigeon"}).is_ok());
  EXPECT_FALSE(settings.set_flag("prefix", {"/x"}).is_ok());
  EXPECT_FALSE(settings.set_flag("domain", {"233"}).is_ok());
  ASSERT_TRUE(settings.set_flag("transport", {"thin"}).is_ok());
  ASSERT_TRUE(settings.set_flag("heartbeat_s", {"0.05"}).is_ok());
  apply_preset(settings, transport);
  EXPECT_EQ(transport.transport, wire::Transport::kThin);
  EXPECT_EQ(transport.silence_s, 10);
  EXPECT_EQ(transport.heartbeat_s, 0.05);
}

TEST(TransportSettings, EveryPresetIsKnownByItsNameAndKeepsLeaseAboveLifeSigns) {
  for (const wire::Transport transport : wire::kTransports) {
    EXPECT_EQ(wire::transport_of(wire::to_string(transport)), transport);
    const wire::TransportOptions preset = wire::preset_of(transport);
    EXPECT_GE(preset.lease_s, 2 * preset.announcement_s);
    EXPECT_GT(preset.silence_s, 2 * preset.announcement_s);
  }
  EXPECT_FALSE(wire::transport_of("LAN"));
}

TEST(LogSetting, TakesLevelsForAllAndForRooms) {
  std::vector<std::string> levels;
  Settings settings;
  add_log_setting(settings, levels, {"session", "record"});
  EXPECT_TRUE(settings.set_flag("log", {"warning", "session=debug"}).is_ok());
  for (const char* bad : {"loud", "session=loud", "engine=debug", "session=", "=debug", ""})
    EXPECT_FALSE(settings.set_flag("log", {bad}).is_ok()) << bad;
}

TEST(MetricsSetting, TakesPortsAndAddresses) {
  std::string address;
  Settings settings;
  add_metrics_setting(settings, address);
  for (const char* good : {"", "9464", "0.0.0.0:1", "127.0.0.1:65535"})
    EXPECT_TRUE(settings.set_flag("metrics", {good}).is_ok()) << good;
  for (const char* bad : {"0", "65536", "host:1", "1.2.3.4", "1.2.3.4:", ":1", "9464 "})
    EXPECT_FALSE(settings.set_flag("metrics", {bad}).is_ok()) << bad;
}

}  // namespace
}  // namespace nearmesh::wire::program
