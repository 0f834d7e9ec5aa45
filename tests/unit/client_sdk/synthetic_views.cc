#include "synthetic_views.h"

#include "mapp/base/rng.h"

namespace mapp {
namespace {

OrbDescriptor RandomDescriptor(Rng& rng) {
  OrbDescriptor descriptor;
  for (uint64_t& word : descriptor.words) word = rng.Next();
  return descriptor;
}

KeyframeFeature RandomFeature(Rng& rng) {
  KeyframeFeature feature;
  feature.keypoint.u_px = static_cast<float>(rng.Uniform(5, 634));
  feature.keypoint.v_px = static_cast<float>(rng.Uniform(5, 474));
  feature.descriptor = RandomDescriptor(rng);
  return feature;
}

}  // namespace

Camera TestCamera() {
  Camera camera;
  camera.projection = PinholeCamera{.fx = 500, .fy = 500, .cx = 319.5, .cy = 239.5};
  camera.width_px = 640;
  camera.height_px = 480;
  return camera;
}

Keyframe TestKeyframe(uint32_t number, const Pose3& T_session_camera, int num_points) {
  Rng rng(number + 1);
  Keyframe keyframe;
  keyframe.number = number;
  keyframe.stamp_ns = int64_t{number} * 1'000'000'000;
  keyframe.T_frame_camera = T_session_camera;
  for (int i = 0; i < num_points; ++i) {
    KeyframeFeature feature = RandomFeature(rng);
    feature.point = PointReference{.kind = PointReference::Kind::kSessionPoint,
                                   .id = uint64_t{number} * 10'000 + static_cast<uint64_t>(i),
                                   .depth_m = static_cast<float>(rng.Uniform(2, 4)),
                                   .num_observations = static_cast<uint16_t>(1 + i % 5)};
    keyframe.features.push_back(feature);
  }
  for (int i = 0; i < num_points / 10; ++i) keyframe.features.push_back(RandomFeature(rng));
  return keyframe;
}

Pose3 TestAlignment() { return Pose3(Eigen::Quaterniond::Identity(), {4, 4, 0.5}); }

Tile TestTile(Revision revision, int num_points) {
  Rng rng(revision.value());
  const Camera camera = TestCamera();
  Tile tile;
  tile.key = {.x = 0, .y = 0, .z = 0};
  tile.revision = revision;
  tile.frames.push_back(
      {.id = FrameId(1), .T_map_camera = TestAlignment(), .field_of_view = static_cast<float>(camera.FieldOfView())});
  for (int i = 0; i < num_points; ++i) {
    const Eigen::Vector3d p_camera = rng.Uniform(2, 4) * camera.Unproject({rng.Uniform(5, 634), rng.Uniform(5, 474)});
    TilePoint point;
    point.id = MapPointId(static_cast<uint64_t>(i) + 1);
    point.p_map = (TestAlignment() * p_camera).cast<float>();
    point.view_direction = p_camera.normalized().cast<float>();
    point.descriptor = RandomDescriptor(rng);
    point.num_observations = 3;
    point.observers = {0};
    tile.points.push_back(point);
  }
  return tile;
}

}  // namespace mapp
