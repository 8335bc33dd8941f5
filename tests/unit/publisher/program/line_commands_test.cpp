// SPDX-License-Identifier: Apache-2.0
#include "publisher/program/line_commands.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace nearmesh::publisher::program {
namespace {

using Kind = Order::Kind;

TEST(ParseOrder, TakesWordsAndTimes) {
  for (const auto& [line, kind, seconds] :
       std::vector<std::tuple<const char*, Kind, double>>{{"pause", Kind::kPause, 0},
                                                          {"p", Kind::kPause, 0},
                                                          {"", Kind::kPause, 0},
                                                          {" \t\r", Kind::kPause, 0},
                                                          {" step\r", Kind::kStep, 0},
                                                          {"s", Kind::kStep, 0},
                                                          {"quit", Kind::kQuit, 0},
                                                          {"q ", Kind::kQuit, 0},
                                                          {"start", Kind::kSeek, 0},
                                                          {"12.5", Kind::kSeek, 12.5},
                                                          {"0", Kind::kSeek, 0},
                                                          {"+5", Kind::kMove, 5},
                                                          {"-60", Kind::kMove, -60}}) {
    SCOPED_TRACE(line);
    const Result<Order> order = parse_order(line);
    ASSERT_TRUE(order.is_ok()) << order.status().message();
    EXPECT_EQ(order.value().kind, kind);
    EXPECT_EQ(order.value().seconds, seconds);
  }
  EXPECT_EQ(parse_order("end").value().kind, Kind::kSeek);
  EXPECT_TRUE(std::isinf(parse_order("end").value().seconds));
}

TEST(ParseOrder, SaysWhatMayBeTyped) {
  for (const char* line : {"stop", "12.5 s", "nan", "+inf", "pause now", "1e999"}) {
    const Result<Order> order = parse_order(line);
    ASSERT_FALSE(order.is_ok()) << line;
    EXPECT_EQ(order.status().code(), StatusCode::kInvalidArgument);
    EXPECT_EQ(order.status().message(), "'" + std::string(line) + "': expected " + kKnownOrders);
  }
}

class LineInputTest : public ::testing::Test {
 protected:
  LineInputTest() { EXPECT_EQ(::pipe(ends), 0); }
  ~LineInputTest() override {
    ::close(ends[0]);
    close_writer();
  }
  void write(const std::string& text) {
    EXPECT_EQ(::write(ends[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
  }
  void close_writer() {
    if (ends[1] >= 0) ::close(ends[1]);
    ends[1] = -1;
  }
  int ends[2] = {-1, -1};
};

TEST_F(LineInputTest, GivesWholeLinesAndNeverBlocks) {
  LineInput input(ends[0]);
  EXPECT_EQ(input.read(), std::nullopt);
  write("pau");
  EXPECT_EQ(input.read(), std::nullopt);
  write("se\n\n+5");
  EXPECT_EQ(input.read(), "pause");
  EXPECT_EQ(input.read(), "");
  EXPECT_EQ(input.read(), std::nullopt);
  close_writer();
  EXPECT_EQ(input.read(), "+5");
  EXPECT_EQ(input.read(), std::nullopt);
  EXPECT_EQ(input.read(), std::nullopt);
}

TEST_F(LineInputTest, ALineWithoutAnEndTakesNoMemory) {
  LineInput input(ends[0]);
  for (int i = 0; i < 50; ++i) {
    write(std::string(1000, 'x'));
    EXPECT_EQ(input.read(), std::nullopt);
  }
  close_writer();
  std::optional<std::string> line;
  for (int i = 0; i < 1000 && !line; ++i) line = input.read();
  ASSERT_TRUE(line.has_value());
  EXPECT_LE(line->size(), 512U);
  EXPECT_FALSE(parse_order(*line).is_ok());
}

}  // namespace
}  // namespace nearmesh::publisher::program
