#include "client_sdk/src/tracker/shared_localizer.h"

#include <algorithm>
#include <array>
#include <numbers>
#include <utility>

namespace mapp::tracker {
namespace {

/// Half the search window once the session's poses are on the map ...
constexpr double kTrackedRadiusPx = 6.0;
/// ... and before, as the alignment may be off: 10 cm at 1.5 m and 525 px. A wide window needs a strict descriptor.
constexpr double kFirstRadiusPx = 35.0;
constexpr int kFirstMaxDistance = 64;
/// The last refinement of either.
constexpr double kLastRadiusPx = 5.0;
constexpr double kMinFeatureShare = 0.4;

/// So many frames in a row adopt a map, if they agree about the device's own poses this well.
constexpr size_t kFramesToAdopt = 3;
constexpr double kMaxDisagreementM = 0.04;
constexpr double kMaxDisagreementRad = 0.6 * std::numbers::pi / 180;
/// After so many in vain the map is one that the device cannot use.
constexpr int kMaxUndecided = 12;

/// The image in 4 x 4 cells: those with features enough to say something, and those of them that the map explains.
constexpr int kCells = 4;
constexpr int kMinCellFeatures = 10;
constexpr int kMinCellMatches = 3;
constexpr double kMinCoveredCells = 0.5;

/// Whether the matches cover at least half of what the image shows. Many matches in one corner hold a pose only
/// loosely: where the device turns to what the map does not know, it drifts long before fewer than 75 are left.
bool CoversView(const Frame& frame, const std::vector<int>& points, const Camera& camera) {
  std::array<int, kCells * kCells> num_features{};
  std::array<int, kCells * kCells> num_matches{};
  for (size_t i = 0; i < frame.size(); ++i) {
    const Keypoint& keypoint = frame.features[i].keypoint;
    const int column = std::clamp(static_cast<int>(keypoint.u_px) * kCells / camera.width_px, 0, kCells - 1);
    const int row = std::clamp(static_cast<int>(keypoint.v_px) * kCells / camera.height_px, 0, kCells - 1);
    const auto cell = static_cast<size_t>(row * kCells + column);
    ++num_features[cell];
    num_matches[cell] += points[i] != kNone ? 1 : 0;
  }
  int num_telling = 0, num_covered = 0;
  for (size_t cell = 0; cell < num_features.size(); ++cell) {
    if (num_features[cell] < kMinCellFeatures) continue;
    ++num_telling;
    num_covered += num_matches[cell] >= kMinCellMatches ? 1 : 0;
  }
  return num_covered >= kMinCoveredCells * num_telling;
}

}  // namespace

int SharedLocalizer::RequiredMatches(size_t num_features, const OrbTrackerOptions& options) {
  const int by_share = static_cast<int>(kMinFeatureShare * static_cast<double>(num_features));
  return std::max(options.min_tracked_points, std::min(options.min_shared_matches, by_share));
}

std::optional<int> SharedLocalizer::Take(const SharedMap& map) {
  std::optional<int> retired;
  if (tried_) retired = tried_->generation;
  tried_ = Loaded{map.number, ++last_generation_, map.T_map_session, {}};
  tried_->points.reserve(map.points.size());
  MutexLock lock(shared_.mutex);
  for (const SharedPoint& point : map.points) {
    PointView view;
    view.p_session = point.p_session;
    view.view_direction = point.view_direction_session;
    view.reference_distance_m = point.reference_distance_m;
    view.descriptor = point.descriptor;
    view.from_server = true;
    view.point_idx = shared_.map.AddSharedPoint(view, point.id, tried_->generation);
    tried_->points.push_back(view);
  }
  in_use_ = true;
  first_frame_ = true;
  corrections_.clear();
  num_undecided_ = 0;
  return retired;
}

std::optional<int> SharedLocalizer::Leave(bool* was_adopted) {
  std::optional<int> retired;
  if (tried_) retired = tried_->generation;
  *was_adopted = in_use_ && !tried_;
  tried_.reset();
  in_use_ = false;
  return retired;
}

SharedLocalizer::Outcome SharedLocalizer::Localize(const Frame& frame,
                                                   const std::optional<Pose3>& T_session_camera_guess,
                                                   const PoseBound& bound, const Relocalizer& relocalizer) {
  Outcome outcome;
  const Loaded& map = tried_ ? *tried_ : *adopted_;
  outcome.shared_map_number = map.number;
  outcome.estimate = EstimateOn(map, frame, T_session_camera_guess, bound, relocalizer);
  outcome.num_matches = outcome.estimate.num_inliers;
  outcome.localized = outcome.num_matches >= RequiredMatches(frame.size(), options_) &&
                      CoversView(frame, outcome.estimate.points, camera_.recorded);
  first_frame_ = false;
  if (!tried_) return outcome;
  if (!outcome.localized) {
    corrections_.clear();
  } else if (Confirms(outcome.estimate.T_session_camera, T_session_camera_guess)) {
    outcome.newly_adopted = true;
    adopted_ = std::exchange(tried_, std::nullopt);
  } else {
    outcome.localized = false;
    outcome.undecided = ++num_undecided_ < kMaxUndecided;
  }
  return outcome;
}

bool SharedLocalizer::Confirms(const Pose3& T_session_camera, const std::optional<Pose3>& T_session_camera_guess) {
  // Whoever has lost his own place has nothing to compare with.
  if (!T_session_camera_guess) return true;
  const Pose3 correction = T_session_camera * T_session_camera_guess->Inverse();
  corrections_.push_back(correction);
  if (corrections_.size() < kFramesToAdopt) return false;
  if (corrections_.size() > kFramesToAdopt) corrections_.erase(corrections_.begin());
  // Compared at the camera: the session's origin may be far away.
  return std::ranges::all_of(corrections_, [&](const Pose3& earlier) {
    const Pose3 by_earlier = earlier * *T_session_camera_guess;
    return Distance(by_earlier, T_session_camera) <= kMaxDisagreementM &&
           RotationAngle(by_earlier, T_session_camera) <= kMaxDisagreementRad;
  });
}

PoseEstimate SharedLocalizer::EstimateOn(const Loaded& map, const Frame& frame,
                                         const std::optional<Pose3>& T_session_camera_guess, const PoseBound& bound,
                                         const Relocalizer& relocalizer) {
  const int required = RequiredMatches(frame.size(), options_);
  PoseEstimate estimate;
  estimate.points.assign(frame.size(), kNone);
  if (T_session_camera_guess) {
    SearchOptions coarse;
    coarse.radius_px = kTrackedRadiusPx;
    if (tried_) {
      coarse.radius_px = kFirstRadiusPx;
      coarse.max_distance = kFirstMaxDistance;
    }
    estimate =
        SearchAndRefine(frame, camera_, camera_.shared_map, *T_session_camera_guess, map.points, coarse, required);
  }
  // Descriptors alone find the pose where the guess is off by more than the window, but cost a comparison with every
  // point: worth it at a new map and when there is no guess.
  if (estimate.num_inliers < required && (first_frame_ || !T_session_camera_guess)) {
    if (auto found = relocalizer.FindAmongPoints(frame, camera_.shared_map, map.points, bound))
      estimate = *std::move(found);
  }
  if (estimate.num_inliers < options_.min_tracked_points) return estimate;
  SearchOptions fine;
  fine.radius_px = kLastRadiusPx;
  PoseEstimate refined =
      SearchAndRefine(frame, camera_, camera_.shared_map, estimate.T_session_camera, map.points, fine, 0);
  return refined.num_inliers > estimate.num_inliers ? refined : estimate;
}

std::span<const PointView> SharedLocalizer::known_points() const {
  if (!adopted_) return {};
  return adopted_->points;
}

}  // namespace mapp::tracker
