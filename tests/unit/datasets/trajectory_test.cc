#include "datasets/sequence.h"
#include "mapp/base/rng.h"
#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;

TEST(TrajectoryTest, WrittenPosesReadBack) {
  const test::TempFolder folder;
  Rng rng(1);
  std::vector<StampedPose> poses;
  for (int64_t i = 0; i < 20; ++i) {
    Eigen::Matrix<double, 6, 1> tangent;
    for (double& value : tangent) value = rng.Uniform(-2, 2);
    poses.push_back({1403638546077829376 + i * 50'000'001, Pose3::Exp(tangent)});
  }
  const std::string file = folder.File("trajectory.txt");
  ASSERT_TRUE(WriteTumTrajectory(file, poses).ok());
  const auto read = ReadTumTrajectory(file);
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), poses.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ((*read)[i].stamp_ns, poses[i].stamp_ns);
    EXPECT_LT(Distance((*read)[i].T_world_camera, poses[i].T_world_camera), 1e-6);
    EXPECT_LT(RotationAngle((*read)[i].T_world_camera, poses[i].T_world_camera), 1e-6);
  }
}

TEST(TrajectoryTest, ReadsScalarLast) {
  const test::TempFolder folder;
  const auto read = ReadTumTrajectory(folder.Write("t.txt", "# c\n1.5 1 2 3 0 0 0.7071068 0.7071068\n"));
  ASSERT_TRUE(read.ok()) << read.status();
  const Eigen::Vector3d p_world = read->at(0).T_world_camera * Eigen::Vector3d(1, 0, 0);
  EXPECT_LT((p_world - Eigen::Vector3d(1, 3, 3)).norm(), 1e-6);  // a quarter turn about z
}

struct BadTrajectory {
  std::string name;
  std::string line;
  std::string problem;
};

class BadTrajectoryTest : public testing::TestWithParam<BadTrajectory> {};

TEST_P(BadTrajectoryTest, NamesFileAndLine) {
  const test::TempFolder folder;
  const std::string file = folder.Write("t.txt", "# head\n0 0 0 0 0 0 0 1\n" + GetParam().line + "\n");
  const Status status = ReadTumTrajectory(file).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr(file + ":3: "));
  EXPECT_THAT(std::string(status.message()), HasSubstr(GetParam().problem));
}

INSTANTIATE_TEST_SUITE_P(Lines, BadTrajectoryTest,
                         testing::Values(BadTrajectory{"Short", "1 2 3", "8 fields expected"},
                                         BadTrajectory{"Word", "1 2 x 3 0 0 0 1", "'x' is not a number"},
                                         BadTrajectory{"NotFinite", "1 2 nan 3 0 0 0 1", "'nan' is not a number"},
                                         BadTrajectory{"Time", "one 2 3 3 0 0 0 1", "'one' is not a time"},
                                         BadTrajectory{"ZeroQuaternion", "1 2 3 4 0 0 0 0", "norm"}),
                         [](const auto& suite) { return suite.param.name; });

TEST(TrajectoryTest, ReportsAFileThatCannotBeCreated) {
  const Status status = WriteTumTrajectory("/nowhere/t.txt", {});
  EXPECT_THAT(std::string(status.message()), HasSubstr("/nowhere/t.txt"));
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace mapp
