#include "sim/world/visit_sequence.h"

#include "sim/world/world_renderer.h"
#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace mapp::sim {
namespace {

/// A garage made once for all tests.
std::shared_ptr<const Simulation> Garage(SensorKind sensor, int num_users) {
  static std::map<std::pair<SensorKind, int>, std::shared_ptr<const Simulation>> made;
  std::shared_ptr<const Simulation>& garage = made[{sensor, num_users}];
  if (garage != nullptr) return garage;
  SimulationOptions options;
  options.num_users = num_users;
  options.path_m = 5;
  options.seed = 2;
  options.sensor = sensor;
  options.cameras = {"d455-640"};
  options.num_passers = 2;
  options.rate_hz = 5;
  auto simulation = Simulate(options);
  EXPECT_TRUE(simulation.ok()) << simulation.status();
  garage = std::move(simulation).value();
  return garage;
}

std::unique_ptr<VisitSequence> Open(const std::shared_ptr<const Simulation>& simulation, int user,
                                    const ImageOptions& options = {}) {
  auto sequence = OpenVisit(simulation, user, options);
  EXPECT_TRUE(sequence.ok()) << sequence.status();
  return std::move(sequence).value();
}

TEST(VisitSequenceTest, FramesAreTheSameEachTime) {
  const auto first = Open(Garage(SensorKind::kRgbd, 1), 0)->Read(7);
  const auto again = Open(Garage(SensorKind::kRgbd, 3), 0, {.num_threads = 1})->Read(7);
  ASSERT_TRUE(first.ok() && again.ok());
  EXPECT_EQ(first->gray.pixels, again->gray.pixels);
  EXPECT_EQ(first->depth_m.pixels, again->depth_m.pixels);
  const auto other = Open(Garage(SensorKind::kRgbd, 3), 1)->Read(7);
  ASSERT_TRUE(other.ok());
  EXPECT_NE(first->gray.pixels, other->gray.pixels);
}

TEST(VisitSequenceTest, GivesWhatTheSensorHas) {
  const auto rgbd = Open(Garage(SensorKind::kRgbd, 1), 0);
  EXPECT_EQ(rgbd->sensor(), SensorKind::kRgbd);
  EXPECT_EQ(rgbd->ground_truth().size(), rgbd->num_frames());
  const auto depth = rgbd->Read(0);
  ASSERT_TRUE(depth.ok());
  EXPECT_FALSE(depth->depth_m.empty());
  EXPECT_LE(*std::ranges::max_element(depth->depth_m.pixels), 10.0F);

  const auto stereo = Open(Garage(SensorKind::kStereo, 1), 0)->Read(0);
  ASSERT_TRUE(stereo.ok());
  EXPECT_TRUE(stereo->depth_m.empty());
  EXPECT_NE(stereo->gray.pixels, stereo->right_gray.pixels);
  EXPECT_EQ(rgbd->Read(rgbd->num_frames()).status().code(), absl::StatusCode::kOutOfRange);
}

TEST(VisitSequenceTest, BrightnessAndBlurDoWhatTheySay) {
  const auto simulation = Garage(SensorKind::kRgbd, 1);
  const SensorNoise none{0, 0, 1e9};
  const auto mean = [](const GrayImage& image) {
    double sum = 0;
    for (const uint8_t level : image.pixels) sum += level;
    return sum / static_cast<double>(image.pixels.size());
  };
  const auto gradient = [](const GrayImage& image) {
    double sum = 0;
    for (size_t i = 1; i < image.pixels.size(); ++i) sum += std::abs(int{image.pixels[i]} - int{image.pixels[i - 1]});
    return sum;
  };
  const size_t walking = simulation->visits[0].poses.size() / 2;
  const auto sharp = Open(simulation, 0, {.noise = none})->Read(walking);
  const auto dark = Open(simulation, 0, {.noise = none, .exposure = 0.5})->Read(walking);
  const auto blurred = Open(simulation, 0, {.noise = none, .motion_blur = 5, .exposure_s = 0.1})->Read(walking);
  ASSERT_TRUE(sharp.ok() && dark.ok() && blurred.ok());
  EXPECT_NEAR(mean(dark->gray), mean(sharp->gray) / 2, 1);
  EXPECT_NEAR(mean(blurred->gray), mean(sharp->gray), 3);
  EXPECT_LT(gradient(blurred->gray), 0.9 * gradient(sharp->gray));
  EXPECT_EQ(blurred->depth_m.pixels, sharp->depth_m.pixels);
}

TEST(VisitSequenceTest, ColorsAreThereWhenAskedFor) {
  const auto simulation = Garage(SensorKind::kRgbd, 1);
  const auto frame = Open(simulation, 0, {.with_color = true})->ReadColored(3);
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->color.pixels.size(), frame->frame.gray.pixels.size());
  EXPECT_EQ(Open(simulation, 0)->ReadColored(3).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST(VisitSequenceTest, AWrittenVisitReadsBack) {
  const test::TempFolder folder;
  const auto simulation = Garage(SensorKind::kMonoInertial, 1);
  ASSERT_TRUE(WriteVisit(simulation, 0, {}, folder.File("visit")).ok());
  const auto read = OpenSequence(folder.File("visit"));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ((*read)->sensor(), SensorKind::kMonoInertial);
  EXPECT_EQ((*read)->num_frames(), simulation->visits[0].poses.size());
}

TEST(VisitSequenceTest, RefusesBadOptionsByName) {
  const auto simulation = Garage(SensorKind::kRgbd, 1);
  const auto message = [&](int user, const ImageOptions& options) {
    const Status status = OpenVisit(simulation, user, options).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(status.message());
  };
  EXPECT_THAT(message(1, {}), testing::StartsWith("user: "));
  EXPECT_THAT(message(0, {.exposure = 0}), testing::StartsWith("exposure: "));
  EXPECT_THAT(message(0, {.motion_blur = 2}), testing::StartsWith("motion_blur: "));
  EXPECT_THAT(message(0, {.exposure_s = NAN}), testing::StartsWith("exposure_s: "));
  EXPECT_THAT(message(0, {.num_threads = 0}), testing::StartsWith("num_threads: "));
}

/// A wall, and a box before it that goes away after a minute.
TEST(WorldRendererTest, ShowsTheWorldAsItIsAtEachTime) {
  const auto texture = std::make_shared<const Texture>(GrayImage(8, 8, 200));
  World world;
  world.surroundings.quads = {{{5, 5, 5}, {0, -10, 0}, {0, 0, -10}, texture}};
  WorldObject box;
  box.id = 1;
  box.size_m = {1, 1, 1};
  box.quads_object = {{{-0.5, 0.5, 0.5}, {0, -1, 0}, {0, 0, -1}, texture}};
  box.placements = {{std::numeric_limits<int64_t>::min(), Pose3(Eigen::Quaterniond::Identity(), {3, 0, 0})},
                    {60, std::nullopt}};
  world.objects = {box};
  const WorldRenderer renderer(std::make_shared<const World>(world), 1, false);
  const Camera camera{PinholeCamera{32, 32, 15.5, 15.5}, 32, 32};
  const Pose3 T_world_camera(Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5), Eigen::Vector3d::Zero());
  for (const auto& [stamp_ns, depth_m] : {std::pair<int64_t, float>{59, 2.5F}, {60, 5.0F}, {10, 2.5F}}) {
    const auto frame = renderer.Render(camera, {&T_world_camera, 1}, stamp_ns);
    ASSERT_TRUE(frame.ok()) << frame.status();
    EXPECT_NEAR(frame->depth_m.at(16, 16), depth_m, 1e-3) << "at " << stamp_ns;
  }
}

}  // namespace
}  // namespace mapp::sim
