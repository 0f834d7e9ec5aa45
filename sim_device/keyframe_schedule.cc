#include "sim_device/keyframe_schedule.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace mapp::sim {
namespace {

constexpr int kMinFramesBetween = 2;  // as KeyframePolicy
/// Features lie this far from the image's border.
constexpr double kBorder_px = 19;
/// Angle between two views of a point at which 1/e of the matches are left; measured with ORB in rendered rooms.
constexpr double kViewAngle_rad = 0.4;

}  // namespace

bool KeyframeSchedule::IsDue(const Pose3& T_session_camera) {
  ++frames_since_keyframe_;
  const double num_matches = ExpectedMatches(T_session_camera);
  most_matches_ = std::max(most_matches_, num_matches);
  if (forced_) return true;
  const bool starting = num_keyframes_ < options_.num_start_keyframes;
  if (frames_since_keyframe_ >=
      (starting ? options_.max_frames_between_start_keyframes : options_.max_frames_between_keyframes)) {
    return true;
  }
  if (frames_since_keyframe_ < kMinFramesBetween) return false;
  return num_matches < options_.min_reference_ratio * most_matches_;
}

void KeyframeSchedule::OnKeyframe(std::vector<tracker::PointView> reference) {
  SetReference(std::move(reference));
  ++num_keyframes_;
  frames_since_keyframe_ = 0;
  forced_ = false;
}

void KeyframeSchedule::SetReference(std::vector<tracker::PointView> reference) {
  reference_ = std::move(reference);
  most_matches_ = 0;
}

double KeyframeSchedule::ExpectedMatches(const Pose3& T_session_camera) const {
  const Pose3 T_camera_session = T_session_camera.Inverse();
  const Eigen::Matrix3d R_camera_session = T_camera_session.RotationMatrix();
  double sum = 0;
  for (const tracker::PointView& point : reference_) {
    const Eigen::Vector3d p_camera = R_camera_session * point.p_session + T_camera_session.translation();
    if (p_camera.z() < tracker::kMinPointDepthM) continue;
    const Eigen::Vector2d pixel = camera_.pinhole.Project(p_camera);
    if ((pixel - camera_.min_px).minCoeff() < kBorder_px || (camera_.max_px - pixel).minCoeff() < kBorder_px) continue;
    const Eigen::Vector3d ray_session = point.p_session - T_session_camera.translation();
    const double cosine = ray_session.dot(point.view_direction.cast<double>()) / ray_session.norm();
    sum += std::exp(-std::acos(std::clamp(cosine, -1.0, 1.0)) / kViewAngle_rad);
  }
  return sum;
}

}  // namespace mapp::sim
