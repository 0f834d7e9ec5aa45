#include "eval/harness/figures.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

TEST(FiguresTest, NumbersGoByTheirPath) {
  const auto figures = Figures::Parse(
      R"({"a": 1, "b": {"c": 2.5, "t": "text", "n": null, "yes": true},
          "methods": [{"method": "Upload", "p95_ms": 7}, {"x": 8}], "list": [3, 4]})",
      "test");
  ASSERT_TRUE(figures.ok()) << figures.status();
  EXPECT_EQ(figures->Get("a"), 1);
  EXPECT_EQ(figures->Get("b.c"), 2.5);
  EXPECT_EQ(figures->Get("b.yes"), 1);
  EXPECT_EQ(figures->Get("b.t"), std::nullopt);
  EXPECT_EQ(figures->Get("b.n"), std::nullopt);
  EXPECT_EQ(figures->Get("methods.Upload.p95_ms"), 7);
  EXPECT_EQ(figures->Get("methods.1.x"), 8);
  EXPECT_EQ(figures->Get("list.1"), 4);
}

TEST(FiguresTest, WhatIsNoJsonIsNamed) {
  const auto figures = Figures::Parse("{\"a\": ", "device_3.json");
  EXPECT_EQ(figures.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_NE(std::string(figures.status().message()).find("device_3.json"), std::string::npos);
}

}  // namespace
}  // namespace mapp
