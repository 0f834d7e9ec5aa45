// Compares the absolute trajectory error with that of an independent program (numpy), where that is present.
#include "eval/metrics/trajectory_metrics.h"
#include "tests/support/process.h"
#include "tests/unit/eval/metrics/trajectories.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

namespace mapp {
namespace {

namespace fs = std::filesystem;
using std::chrono_literals::operator""s;

constexpr char kPython[] = "/usr/bin/python3";
constexpr double kTolerance = 1e-6;

fs::path ToolFile() {
  const char* data_folder = std::getenv("MAPP_DATA_DIR");
  const fs::path shared =
      data_folder != nullptr ? fs::path(data_folder) / ".." : fs::path(MAPP_SOURCE_DIR) / "../shared";
  return shared / "tools" / "ate.py";
}

/// The number that follows `"key": ` in the tool's one line of JSON.
double ValueOf(const std::string& json, const std::string& key) {
  const size_t start = json.find(fmt::format("\"{}\": ", key));
  if (start == std::string::npos) {
    ADD_FAILURE() << key << " is not in " << json;
    return 0;
  }
  return std::stod(json.substr(start + key.size() + 4));
}

class AteToolTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(ToolFile())) GTEST_SKIP() << "no " << ToolFile() << " (set MAPP_DATA_DIR)";
    if (!fs::exists(kPython) || RunCommand({kPython, "-c", "import numpy"}, 60s).exit_code != 0) {
      GTEST_SKIP() << kPython << " has no numpy";
    }
  }

  /// Writes the trajectory and reads it back, so that both programs see the same digits.
  std::vector<StampedPose> Store(const std::string& name, const std::vector<StampedPose>& poses) {
    EXPECT_TRUE(WriteTumTrajectory(folder_.File(name), poses).ok());
    auto stored = ReadTumTrajectory(folder_.File(name));
    EXPECT_TRUE(stored.ok()) << stored.status();
    return std::move(stored).value();
  }

  std::string RunTool(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {kPython, ToolFile().string()});
    const Finished finished = RunCommand(arguments, 60s);
    EXPECT_EQ(finished.exit_code, 0) << finished.err;
    return finished.out;
  }

  static void ExpectEqual(const std::string& json, const StatusOr<TrajectoryError>& error) {
    ASSERT_TRUE(error.ok()) << error.status();
    EXPECT_NEAR(error->rmse_m, ValueOf(json, "rmse_m"), kTolerance);
    EXPECT_NEAR(error->mean_m, ValueOf(json, "mean_m"), kTolerance);
    EXPECT_NEAR(error->median_m, ValueOf(json, "median_m"), kTolerance);
    EXPECT_NEAR(error->max_m, ValueOf(json, "max_m"), kTolerance);
    EXPECT_NEAR(error->T_truth_estimate.scale, ValueOf(json, "scale"), kTolerance);
    EXPECT_EQ(static_cast<double>(error->num_paired), ValueOf(json, "paired"));
  }

  TempFolder folder_;
};

TEST_F(AteToolTest, AgreesOnNoisyTrajectories) {
  for (const uint64_t seed : {1, 2, 3}) {
    Rng rng(seed);
    const Pose3 T_estimate_world(ExpSo3({rng.Normal(), rng.Normal(), rng.Normal()}),
                                 {10 * rng.Normal(), rng.Normal(), rng.Normal()});
    auto moved = Moved(T_estimate_world, 0.8, Shaken(Curve(150), 0.03 * static_cast<double>(seed), rng));
    // Some come too late to be paired; none exactly at the bound, where the tool's floating seconds decide by rounding.
    for (StampedPose& pose : moved) pose.stamp_ns += static_cast<int64_t>(rng.Below(30)) * 1'000'000 + 500'000;
    const auto truth = Store("truth.txt", Curve(150));
    const auto estimate = Store("estimate.txt", moved);
    const std::vector<std::string> files = {folder_.File("truth.txt"), folder_.File("estimate.txt")};
    ExpectEqual(RunTool(files), AbsoluteTrajectoryError(truth, estimate, /*with_scale=*/false));
    ExpectEqual(RunTool({files[0], files[1], "--scale"}), AbsoluteTrajectoryError(truth, estimate, true));
    ExpectEqual(RunTool({files[0], files[1], "--no-align"}), TrajectoryErrorUnder(Sim3(), truth, estimate));
  }
}

TEST_F(AteToolTest, AgreesOnTheAlignmentOfAnotherSession) {
  Rng rng(9);
  const Pose3 T_map_world(ExpSo3({0.2, 1.0, -0.4}), {3, -1, 2});
  const auto whole = Curve(200);
  const auto truth_0 = Store("truth_0.txt", {whole.begin(), whole.begin() + 120});
  const auto truth_1 = Store("truth_1.txt", {whole.begin() + 100, whole.end()});
  const auto estimate_0 = Store("estimate_0.txt", Moved(T_map_world, 1.0, Shaken(truth_0, 0.02, rng)));
  const auto estimate_1 = Store("estimate_1.txt", Moved(T_map_world, 1.0, Shaken(truth_1, 0.05, rng)));
  const auto joint = AbsoluteTrajectoryError(truth_0, estimate_0, /*with_scale=*/false);
  ASSERT_TRUE(joint.ok()) << joint.status();
  const std::string json = RunTool({folder_.File("truth_1.txt"), folder_.File("estimate_1.txt"), "--align-by",
                                    folder_.File("truth_0.txt"), folder_.File("estimate_0.txt")});
  ExpectEqual(json, TrajectoryErrorUnder(joint->T_truth_estimate, truth_1, estimate_1));
}

}  // namespace
}  // namespace mapp
