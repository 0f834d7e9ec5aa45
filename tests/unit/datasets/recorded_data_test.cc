// Opens the recorded sequences of the data folder, where that is present.
#include "datasets/sequence.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

namespace mapp {
namespace {

namespace fs = std::filesystem;

fs::path DataFolder() {
  const char* folder = std::getenv("MAPP_DATA_DIR");
  return folder != nullptr ? fs::path(folder) : fs::path(MAPP_SOURCE_DIR) / ".." / "shared" / "data";
}

struct RecordedCase {
  std::string folder;
  SensorKind sensor;
  size_t num_frames;
  int width_px;
};

class RecordedDataTest : public testing::TestWithParam<RecordedCase> {};

TEST_P(RecordedDataTest, OpensAndReadsFirstAndLastFrame) {
  const fs::path folder = DataFolder() / GetParam().folder;
  if (!fs::is_directory(folder)) GTEST_SKIP() << "no recorded data at " << folder << " (set MAPP_DATA_DIR)";
  const auto opened = OpenSequence(folder.string());
  ASSERT_TRUE(opened.ok()) << opened.status();
  const Sequence& sequence = **opened;
  EXPECT_EQ(sequence.sensor(), GetParam().sensor);
  EXPECT_EQ(sequence.num_frames(), GetParam().num_frames);
  EXPECT_EQ(sequence.ground_truth().size(), GetParam().num_frames);
  for (const size_t frame_idx : {size_t{0}, sequence.num_frames() - 1}) {
    const auto frame = sequence.Read(frame_idx);
    ASSERT_TRUE(frame.ok()) << frame.status();
    EXPECT_EQ(frame->gray.width, GetParam().width_px);
    EXPECT_EQ(frame->gray.height, 480);
    EXPECT_EQ(frame->depth_m.empty(), GetParam().sensor != SensorKind::kRgbd);
    EXPECT_EQ(frame->right_gray.empty(), GetParam().sensor != SensorKind::kStereo);
    // Ground truth is listed at the image times, to the microsecond.
    EXPECT_NEAR(static_cast<double>(sequence.ground_truth()[frame_idx].stamp_ns - frame->stamp_ns), 0, 1000);
  }
}

INSTANTIATE_TEST_SUITE_P(Folders, RecordedDataTest,
                         testing::Values(RecordedCase{"redkitchen/a", SensorKind::kRgbd, 125, 640},
                                         RecordedCase{"redkitchen/b", SensorKind::kRgbd, 125, 640},
                                         RecordedCase{"redkitchen/c", SensorKind::kRgbd, 50, 640},
                                         RecordedCase{"euroc_mh05/a", SensorKind::kMonoInertial, 200, 752},
                                         RecordedCase{"euroc_mh05/b", SensorKind::kMonoInertial, 200, 752},
                                         RecordedCase{"euroc_v101/keyframes_stereo", SensorKind::kStereo, 100, 752},
                                         RecordedCase{"euroc_v101/clip_mono", SensorKind::kMonoInertial, 90, 752},
                                         RecordedCase{"uzh_parking/a", SensorKind::kMono, 150, 640},
                                         RecordedCase{"uzh_parking/b", SensorKind::kMono, 150, 640}),
                         [](const auto& suite) {
                           std::string name = suite.param.folder;
                           for (char& c : name) c = c == '/' ? '_' : c;
                           return name;
                         });

TEST(RecordedTrajectoryTest, ReadsTheFlights) {
  const fs::path file = DataFolder() / "trajectories" / "MH_01_easy.cam0.txt";
  if (!fs::exists(file)) GTEST_SKIP() << "no recorded data at " << file << " (set MAPP_DATA_DIR)";
  const auto poses = ReadTumTrajectory(file.string());
  ASSERT_TRUE(poses.ok()) << poses.status();
  EXPECT_GT(poses->size(), 1000);
}

}  // namespace
}  // namespace mapp
