#include "cli/replay_report.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

namespace mapp {
namespace {

using testing::HasSubstr;

ReplayReport SecondDevice() {
  ReplayReport report;
  report.device = "second";
  report.frames = 50;
  report.frames_tracked = 49;
  report.frames_on_shared_map = 30;
  report.keyframes = 4;
  report.keyframe_equivalents = 6;
  report.aligned_at_keyframe = 3;
  report.upload_bytes = 80'000;
  report.full_bytes = 400'000;
  report.errors.ate_joint_m = 0.031;
  return report;
}

TEST(ReplayReportTest, CountsSharedFramesAsKeyframesInFiguresPerKeyframe) {
  EXPECT_DOUBLE_EQ(SecondDevice().UploadBytesPerKeyframe().value(), 8'000);
  EXPECT_DOUBLE_EQ(SecondDevice().FullBytesPerKeyframe().value(), 40'000);
  EXPECT_DOUBLE_EQ(SecondDevice().UploadShare().value(), 0.2);
}

TEST(ReplayReportTest, FreshnessIsWhatTheMapDidNotHold) {
  ReplayReport report;
  EXPECT_FALSE(report.Freshness().has_value());
  report.overlap_mean = 0.75;
  EXPECT_DOUBLE_EQ(report.Freshness().value(), 0.25);
}

TEST(ReplayReportTest, JsonTellsTrafficByKindAndKeyframe) {
  ReplayReport report = SecondDevice();
  report.traffic.update_report = {.count = 2, .bytes = 5'000};
  const std::string json = FormatJson(report);
  const size_t kind = json.find("\"update_report\": {");
  ASSERT_NE(kind, std::string::npos);
  const std::string figures = json.substr(kind, json.find('}', kind) - kind);
  EXPECT_THAT(figures, HasSubstr("\"count\": 2"));
  EXPECT_THAT(figures, HasSubstr("\"bytes\": 5000"));
  EXPECT_THAT(figures, HasSubstr("\"bytes_per_keyframe\": 500"));
}

TEST(ReplayReportTest, JsonSetsTheDevicesCpuApartFromReadingItsFrames) {
  ReplayReport report;
  report.cpu.process_s = 10;
  report.cpu.reading_s = 7.5;
  EXPECT_THAT(FormatJson(report), HasSubstr("\"device\": 2.5"));
}

TEST(ReplayReportTest, HasNoFigurePerKeyframeWithoutKeyframes) {
  EXPECT_FALSE(ReplayReport().UploadBytesPerKeyframe().has_value());
  EXPECT_FALSE(ReplayReport().UploadShare().has_value());
}

TEST(ReplayReportTest, JsonHasEveryPromisedKey) {
  const std::string json = FormatJson(SecondDevice());
  for (const char* key : {"frames",
                          "frames_tracked",
                          "keyframes",
                          "aligned_at_keyframe",
                          "overlap_mean",
                          "upload_bytes_per_keyframe",
                          "full_bytes_per_keyframe",
                          "query_bytes",
                          "response_bytes_mean",
                          "download_bytes",
                          "shared_map_requests",
                          "frames_on_shared_map",
                          "shared_matches_mean",
                          "tracking_ms",
                          "p50",
                          "p95",
                          "local_mapping_ms_total",
                          "ate_m",
                          "ate_scale",
                          "ate_joint_m",
                          "ate_together_m",
                          "ate_uncorrected_m",
                          "ate_joint_uncorrected_m",
                          "sampler",
                          "injection",
                          "sharing",
                          "alpha",
                          "freshness",
                          "full_features",
                          "full_points",
                          "sharing_started_ns",
                          "traffic",
                          "shared_map_request",
                          "first_shared_tile",
                          "cached_tiles",
                          "look_ahead_m",
                          "extraction",
                          "latency_ms",
                          "overlap_assessment",
                          "redundancy_control",
                          "keyframe_upload",
                          "localization",
                          "local_mapping",
                          "cpu_s",
                          "peak_rss_bytes"}) {
    EXPECT_THAT(json, HasSubstr(fmt::format("\"{}\": ", key)));
  }
  EXPECT_THAT(json, HasSubstr("\"aligned_at_keyframe\": 3"));
  EXPECT_THAT(json, HasSubstr("\"ate_m\": null"));
}

TEST(ReplayReportTest, JsonTellsAFounderFromASessionThatWasNeverAligned) {
  ReplayReport report;
  EXPECT_THAT(FormatJson(report), HasSubstr("\"aligned_at_keyframe\": null"));
  report.aligned_at_keyframe = 0;
  EXPECT_THAT(FormatJson(report), HasSubstr("\"aligned_at_keyframe\": 0"));
}

TEST(ReplayReportTest, TwoTablesFitSideBySide) {
  ReplayReport report = SecondDevice();
  const LatencySummary slow{.count = 7, .mean_ms = 1300, .p50_ms = 1234.5, .p95_ms = 12345.6};
  report.latency.participant = {slow, slow, slow, slow, slow, slow};
  report.latency.tracking = report.latency.localization = report.latency.local_mapping = slow;
  report.interrupted = true;
  std::istringstream text(FormatText(report));
  for (std::string line; std::getline(text, line);) EXPECT_LE(line.size(), 52) << line;
}

}  // namespace
}  // namespace mapp
