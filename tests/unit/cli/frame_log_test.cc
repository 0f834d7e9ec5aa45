#include "cli/frame_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

constexpr char kHeader[] = "# session 3\nstamp_ns,tx_m,ty_m,tz_m,qw,qx,qy,qz,on_shared_map,role\n";

TEST(FrameLogTest, ReadsBackWhatItWrote) {
  FrameLog log{42, {}};
  const Eigen::Quaterniond rotation(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, -2, 3).normalized()));
  log.frames.push_back(
      {1'403'636'579'763'555'584, Pose3(rotation, {1.5, -2.25, 100.125}), true, FrameRole::kSharedKeyframe});
  log.frames.push_back({1'403'636'579'813'555'456, Pose3(), false, FrameRole::kKeyframe});

  const FrameLog other{43, {log.frames[1]}};
  const StatusOr<std::vector<FrameLog>> all = ParseFrameLogs("frames.csv", FormatFrameLogs({log, other}));
  ASSERT_TRUE(all.ok()) << all.status();
  ASSERT_EQ(all->size(), 2);
  EXPECT_EQ(all->at(1).session_id, 43);
  ASSERT_EQ(all->at(1).frames.size(), 1);
  EXPECT_EQ(all->at(1).frames[0].role, FrameRole::kKeyframe);
  const FrameLog* read = &all->front();
  EXPECT_EQ(read->session_id, 42);
  ASSERT_EQ(read->frames.size(), 2);
  EXPECT_EQ(read->frames[0].stamp_ns, log.frames[0].stamp_ns);
  EXPECT_TRUE(read->frames[0].on_shared_map);
  EXPECT_EQ(read->frames[0].role, FrameRole::kSharedKeyframe);
  EXPECT_LT(Distance(read->frames[0].T_map_camera, log.frames[0].T_map_camera), 1e-6);
  EXPECT_LT(RotationAngle(read->frames[0].T_map_camera, log.frames[0].T_map_camera), 1e-6);
  EXPECT_EQ(read->frames[1].role, FrameRole::kKeyframe);
}

struct BadLog {
  std::string name;
  std::string text;
  std::string where;  ///< what the error begins with
};

class FrameLogErrorTest : public testing::TestWithParam<BadLog> {};

TEST_P(FrameLogErrorTest, NamesFileAndLine) {
  const StatusOr<std::vector<FrameLog>> read = ParseFrameLogs("f.csv", GetParam().text);
  ASSERT_EQ(read.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(read.status().message()), StartsWith(GetParam().where));
}

INSTANTIATE_TEST_SUITE_P(
    Logs, FrameLogErrorTest,
    testing::Values(BadLog{"Empty", "", "f.csv:1:"}, BadLog{"OtherFile", "hello\n", "f.csv:1:"},
                    BadLog{"NoColumns", "# session 3\n1,2\n", "f.csv:2:"},
                    BadLog{"CutLine", std::string(kHeader) + "1,0,0,0,1,0,0\n", "f.csv:3:"},
                    BadLog{"NotARotation", std::string(kHeader) + "1,0,0,0,2,0,0,0,0,keyframe\n", "f.csv:3:"},
                    BadLog{"NotANumber", std::string(kHeader) + "1,nan,0,0,1,0,0,0,0,keyframe\n", "f.csv:3:"},
                    BadLog{"UnknownRole", std::string(kHeader) + "1,0,0,0,1,0,0,0,0,king\n", "f.csv:3:"},
                    BadLog{"SecondFrame", std::string(kHeader) + "1,0,0,0,1,0,0,0,0,keyframe\nx\n", "f.csv:4:"},
                    BadLog{"SecondLog", std::string(kHeader) + "# session 4\nx\n", "f.csv:4:"}),
    [](const auto& suite_info) { return suite_info.param.name; });

}  // namespace
}  // namespace mapp
