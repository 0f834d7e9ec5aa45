#include "client_sdk/src/tracker/keyframe_export.h"

#include "mapp/map/keyframe.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace mapp::tracker {
namespace {

TEST(KeyframeExportTest, LeavesOutPointsAtDepthsThatTheServiceRefuses) {
  const std::vector<double> depths_m = {2.0, 9999.0, 9999.9999, 22745.0, -3.0, 0.01};
  auto frame = std::make_shared<Frame>();
  frame->features.resize(depths_m.size());
  frame->pixels.resize(depths_m.size(), Eigen::Vector2d::Zero());
  frame->depths_m.resize(depths_m.size(), 0.0F);
  SessionMap map;
  const int keyframe = map.AddKeyframe(frame, Pose3(), std::vector<int>(depths_m.size(), kNone), /*generation=*/0);
  for (size_t i = 0; i < depths_m.size(); ++i) map.AddPoint({0, 0, depths_m[i]}, keyframe, static_cast<int>(i));

  TrackingCamera camera;
  camera.min_point_depth_m = 0.1;
  const Keyframe exported = ExportKeyframe(map, camera, keyframe);
  ASSERT_EQ(exported.features.size(), depths_m.size());
  std::vector<bool> has_point;
  for (const KeyframeFeature& feature : exported.features) {
    has_point.push_back(feature.point.has_value());
    if (feature.point) {
      EXPECT_LT(feature.point->depth_m, kMaxPointDepthM);
    }
  }
  EXPECT_EQ(has_point, (std::vector<bool>{true, true, false, false, false, false}));
}

}  // namespace
}  // namespace mapp::tracker
