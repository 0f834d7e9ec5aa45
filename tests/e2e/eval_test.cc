// `mapp eval`: what it refuses, and that its lab measures real runs.

#include "eval/harness/lab.h"
#include "eval/harness/results.h"
#include "tests/e2e/service_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace mapp {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string ReadAll(const std::filesystem::path& file) {
  std::ostringstream content;
  content << std::ifstream(file).rdbuf();
  return content.str();
}

std::string Results(int format, const std::string& scale) {
  std::ostringstream json;
  json << "{\"format\": " << format << R"(, "version": "1", "commit": "c", "machine": "m", "command": "mapp eval all",)"
       << "\"scale\": \"" << scale << "\", \"seed\": 1, \"experiments\": []}\n";
  return json.str();
}

class EvalBadInputTest : public testing::Test {
 protected:
  std::string Out() const { return (folder_.path() / "out").string(); }
  TempFolder folder_;
};

TEST_F(EvalBadInputTest, AnUnknownExperimentIsToldWhichThereAre) {
  EXPECT_THAT(ExpectFailure({"eval", "speed", "--quick", "--out", Out()}),
              AllOf(HasSubstr("speed"), HasSubstr("traffic"), HasSubstr("changes"), HasSubstr("overlap")));
  EXPECT_FALSE(std::filesystem::exists(Out())) << "nothing is made for nothing";
}

TEST_F(EvalBadInputTest, AnExperimentThatNeedsAnotherSettingIsRefused) {
  EXPECT_THAT(ExpectFailure({"eval", "hall", "latency", "--setting", "garage", "--quick", "--out", Out()}),
              AllOf(HasSubstr("hall, latency"), HasSubstr("garage")));
  EXPECT_FALSE(std::filesystem::exists(Out()));
  EXPECT_EQ(RunMapp({"eval", "all", "--setting", "moon", "--out", Out()}).exit_code, 2) << "not a setting: usage";
}

TEST_F(EvalBadInputTest, AnExperimentThatNeedsARecordingSaysSo) {
  EXPECT_THAT(ExpectFailure({"eval", "adapter", "--quick", "--out", Out()}),
              AllOf(HasSubstr("adapter"), HasSubstr("--recorded")));
  EXPECT_THAT(ExpectFailure({"eval", "adapter", "--quick", "--recorded", "/nowhere", "--out", Out()}),
              HasSubstr("/nowhere"));
  EXPECT_FALSE(std::filesystem::exists(Out()));
}

TEST_F(EvalBadInputTest, AFolderThatCannotBeMadeIsNamed) {
  EXPECT_THAT(ExpectFailure({"eval", "traffic", "--quick", "--out", "/proc/nowhere"}), HasSubstr("/proc/nowhere"));
}

TEST_F(EvalBadInputTest, ResultsOfAnotherFormatAreRefusedAndLeftAlone) {
  WriteFile(folder_.path() / "out" / "results.json", Results(9, "quick"));
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"eval", "traffic", "--quick", "--out", Out()},
        std::vector<std::string>{"eval", "report", "--out", Out()}}) {
    EXPECT_THAT(ExpectFailure(command), AllOf(HasSubstr("results.json"), HasSubstr("format 9")));
  }
  EXPECT_EQ(ReadAll(folder_.path() / "out" / "results.json"), Results(9, "quick"));
}

TEST_F(EvalBadInputTest, ResultsOfAnotherScaleAreNotMixed) {
  WriteFile(folder_.path() / "out" / "results.json", Results(1, "full"));
  EXPECT_THAT(ExpectFailure({"eval", "traffic", "--quick", "--out", Out()}),
              AllOf(HasSubstr("full"), HasSubstr("--out")));
}

TEST_F(EvalBadInputTest, AReportNeedsResults) {
  EXPECT_THAT(ExpectFailure({"eval", "report", "--out", Out()}), HasSubstr("results.json"));
}

TEST(EvalReportTest, IsWrittenAnewFromResults) {
  const TempFolder folder;
  WriteFile(folder.path() / "results.json", Results(1, "quick"));
  const Finished finished = RunMapp({"eval", "report", "--out", folder.path().string()});
  EXPECT_EQ(finished.exit_code, 0) << finished.err;
  EXPECT_THAT(ReadAll(folder.path() / "REPORT.md"), AllOf(HasSubstr("mapp eval all"), HasSubstr("quick scale")));
}

TEST(LabTest, MeasuresDevicesOnARealServerOnce) {
  const TempFolder folder;
  LabOptions options;
  options.programs = {MappBinary(), MappServerBinary()};
  options.work_folder = folder.path().string();
  Lab lab(options, std::stop_token());
  sim::SimulationOptions world;
  world.setting = "hall";
  world.num_users = 1;
  world.path_m = 5;
  world.rate_hz = 5;
  world.sensor = SensorKind::kStereo;
  FleetSpec spec = FleetOf(world, Level::kRendered, "depth_sketch");
  spec.reconstruct = true;
  const auto fleet = lab.Run(spec);
  ASSERT_TRUE(fleet.ok()) << fleet.status();
  ASSERT_EQ((*fleet)->devices.size(), 1U);
  const DeviceFigures& device = (*fleet)->devices[0];
  EXPECT_GT(device.report.Get("keyframes"), 0);
  EXPECT_GT(device.report.Get("upload_bytes"), 0);
  EXPECT_LT(device.report.Get("ate_m"), 0.5);
  EXPECT_GT(device.server.Get("steps.integration.num_runs"), 0);
  EXPECT_GT(device.server_usage.rss_bytes, 1'000'000U);
  ASSERT_TRUE(device.reconstruction.has_value());
  EXPECT_GT(device.reconstruction->distance_m.count, 100U);
  EXPECT_LT(device.reconstruction->distance_m.median, 0.2);
  EXPECT_GT((*fleet)->database_bytes, 10'000U);

  const auto again = lab.Run(spec);
  ASSERT_TRUE(again.ok());
  EXPECT_EQ(again->get(), fleet->get()) << "the same fleet is not run twice";
}

TEST(LabTest, AFailingDeviceIsNamedWithItsLog) {
  const TempFolder folder;
  LabOptions options;
  options.programs = {"/bin/false", MappServerBinary()};
  options.work_folder = folder.path().string();
  Lab lab(options, std::stop_token());
  sim::SimulationOptions world;
  world.setting = "hall";
  world.num_users = 1;
  world.path_m = 5;
  const auto fleet = lab.Run(FleetOf(world, Level::kRendered, "upload_all"));
  EXPECT_EQ(fleet.status().code(), absl::StatusCode::kAborted);
  EXPECT_THAT(std::string(fleet.status().message()),
              AllOf(HasSubstr("device 0"), HasSubstr("upload_all"), HasSubstr("device_000.log")));
}

/// A figure of the first row of an experiment's first table.
std::optional<double> FirstRow(const ExperimentResult& result, const std::string& column) {
  const ResultTable& table = result.tables.front();
  for (size_t i = 0; i < table.columns.size(); ++i) {
    if (table.columns[i].name == column) return table.rows.front()[i].number;
  }
  return std::nullopt;
}

TEST(ChangesTest, WhatLeftIsFoundInTheHistory) {
  const TempFolder folder;
  // A minute on an idle machine.
  const Finished finished = RunCommand({MappBinary(), "eval", "changes", "--quick", "--out", folder.path().string()},
                                       std::chrono::minutes(5));
  ASSERT_EQ(finished.exit_code, 0) << finished.err;
  const auto results = ParseResults(ReadAll(folder.path() / "results.json"), "results.json");
  ASSERT_TRUE(results.ok()) << results.status();
  const ExperimentResult& changes = results->experiments.front();
  EXPECT_EQ(FirstRow(changes, "true"), 2);
  EXPECT_GE(FirstRow(changes, "found"), 1);
  EXPECT_GE(FirstRow(changes, "precision"), 0.5);
  ASSERT_EQ(changes.tables.size(), 3U);
  const ResultTable& times = changes.tables[2];
  ASSERT_EQ(times.rows.size(), 1U);
  EXPECT_EQ(times.columns[6].name, "sessions read after one more");
  EXPECT_GE(times.rows[0][6].number, 1);
  EXPECT_LE(times.rows[0][6].number, times.rows[0][2].number) << "earlier sessions are not read again";
}

TEST(ChangesTest, TheNextDeviceLocalizesAsOnAFreshMap) {
  const TempFolder folder;
  // A third of a minute on an idle machine.
  const Finished finished = RunCommand({MappBinary(), "eval", "accepted", "--quick", "--out", folder.path().string()},
                                       std::chrono::minutes(5));
  ASSERT_EQ(finished.exit_code, 0) << finished.err;
  const auto results = ParseResults(ReadAll(folder.path() / "results.json"), "results.json");
  ASSERT_TRUE(results.ok()) << results.status();
  const ResultTable& table = results->experiments.front().tables.front();
  ASSERT_EQ(table.rows.size(), 3U);
  const std::vector<Cell>&accepted = table.rows[1], &fresh = table.rows[2];
  ASSERT_EQ(table.columns[3].name, "changes accepted");
  EXPECT_EQ(accepted[3].number, 1);
  ASSERT_EQ(table.columns[5].name, "matches a frame");
  EXPECT_GE(accepted[5].number, 0.95 * fresh[5].number.value_or(1e9));
  ASSERT_EQ(table.columns[7].name, "update reports");
  EXPECT_EQ(accepted[7].number, 0);
}

TEST(AdapterTest, SessionsOfAForeignSystemBecomeOneTrueMap) {
  const auto recorded = DataFolder("euroc_v101/keyframes_stereo");
  if (!recorded) GTEST_SKIP() << "recorded data euroc_v101/keyframes_stereo is not here";
  const TempFolder folder;
  const Finished finished =
      RunMapp({"eval", "adapter", "--quick", "--recorded", *recorded, "--out", folder.path().string()});
  ASSERT_EQ(finished.exit_code, 0) << finished.err;
  const auto results = ParseResults(ReadAll(folder.path() / "results.json"), "results.json");
  ASSERT_TRUE(results.ok()) << results.status();
  const ExperimentResult& adapter = results->experiments.front();
  EXPECT_EQ(FirstRow(adapter, "sessions merged"), 3);
  EXPECT_EQ(FirstRow(adapter, "keyframes in the map"), 100);
  const std::optional<double> odometry_m = FirstRow(adapter, "odometry, mean ATE of a session, m");
  const std::optional<double> whole_m = FirstRow(adapter, "joint ATE, whole map optimized, m");
  ASSERT_TRUE(odometry_m && whole_m);
  // What sessions are left with when they close depends on which keyframes were associated by then.
  EXPECT_LT(*whole_m, 0.5 * *odometry_m);
  EXPECT_LT(*whole_m, 0.022);
}

}  // namespace
}  // namespace mapp
