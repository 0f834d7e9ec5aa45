#include "client_sdk/src/tracker/mono_initializer.h"

#include "vision/bundle_adjustment.h"
#include "vision/matching.h"

#include <algorithm>
#include <utility>

namespace mapp::tracker {
namespace {

/// Features and matches that two views need (Mur-Artal et al. 2015, section IV).
constexpr size_t kMinFeatures = 100;
constexpr size_t kMinMatches = 100;
/// Points that must stand the adjustment: a map begun on less is soon lost.
constexpr size_t kMinAdjustedPoints = 60;
constexpr int kMaxIterations = 20;

/// query_idx indexes the first frame's features.
std::vector<Match> MatchFrames(const Frame& first, const Frame& second) {
  return FilterByRotation(MatchDescriptors(DescriptorsOf(first), DescriptorsOf(second), MatchOptions()), first.features,
                          second.features);
}

double SigmaPx(const Frame& frame, int feature_idx) {
  return static_cast<double>(OctaveScale(frame.features[static_cast<size_t>(feature_idx)].keypoint.octave));
}

std::vector<TwoViewMatch> ToTwoView(const Frame& first, const Frame& second, const std::vector<Match>& matches) {
  std::vector<TwoViewMatch> pixels;
  pixels.reserve(matches.size());
  for (const Match& match : matches) {
    pixels.push_back({first.pixels[static_cast<size_t>(match.query_idx)],
                      second.pixels[static_cast<size_t>(match.train_idx)],
                      std::max(SigmaPx(first, match.query_idx), SigmaPx(second, match.train_idx))});
  }
  return pixels;
}

void AddObservation(const Frame& frame, int feature_idx, int frame_idx, int point_idx, BundleProblem& problem) {
  BundleProblem::Observation observation;
  observation.frame_idx = frame_idx;
  observation.point_idx = point_idx;
  observation.pixel = frame.pixels[static_cast<size_t>(feature_idx)];
  observation.sigma_px = SigmaPx(frame, feature_idx);
  problem.observations.push_back(observation);
}

/// Adjusts the second pose and the points together; drops the points that do not fit. False when it fails.
bool Adjust(const TrackingCamera& camera, TwoViewStart& start) {
  BundleProblem problem;
  problem.frames.push_back({camera.pinhole, Pose3(), /*fixed=*/true});
  problem.frames.push_back({camera.pinhole, start.T_session_second, /*fixed=*/false});
  for (const TwoViewStart::Point& point : start.points) {
    const auto point_idx = static_cast<int>(problem.points.size());
    problem.points.push_back({point.p_session, /*fixed=*/false});
    AddObservation(*start.first, point.first_feature_idx, 0, point_idx, problem);
    AddObservation(*start.second, point.second_feature_idx, 1, point_idx, problem);
  }
  BundleOptions options;
  options.max_iterations = kMaxIterations;
  const StatusOr<BundleResult> adjusted = AdjustBundle(problem, options);
  if (!adjusted.ok()) return false;
  start.T_session_second = problem.frames[1].T_world_camera;
  std::vector<TwoViewStart::Point> kept;
  for (size_t i = 0; i < start.points.size(); ++i) {
    if (adjusted->outliers[2 * i] || adjusted->outliers[2 * i + 1]) continue;
    kept.push_back(start.points[i]);
    kept.back().p_session = problem.points[i].p_world;
  }
  start.points = std::move(kept);
  return true;
}

/// Makes the median depth before the first camera 1.
void FixScale(TwoViewStart& start) {
  std::vector<double> depths;
  for (const TwoViewStart::Point& point : start.points) depths.push_back(point.p_session.z());
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  const double scale = 1 / *middle;
  for (TwoViewStart::Point& point : start.points) point.p_session *= scale;
  start.T_session_second = Pose3(start.T_session_second.rotation(), scale * start.T_session_second.translation());
}

}  // namespace

bool MonoInitializer::ShowsEnough(const Frame& frame) { return frame.size() >= kMinFeatures; }

std::optional<TwoViewStart> MonoInitializer::Try(const std::shared_ptr<const Frame>& frame) {
  if (!ShowsEnough(*frame)) return std::nullopt;
  const std::vector<Match> matches = first_ ? MatchFrames(*first_, *frame) : std::vector<Match>();
  if (matches.size() < kMinMatches) {
    first_ = frame;
    return std::nullopt;
  }
  const auto geometry = EstimateTwoViewGeometry(camera_.pinhole, ToTwoView(*first_, *frame, matches), TwoViewOptions());
  if (!geometry) return std::nullopt;

  TwoViewStart start;
  start.first = first_;
  start.second = frame;
  start.T_session_second = geometry->T_first_second;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!geometry->points_first[i]) continue;
    start.points.push_back({*geometry->points_first[i], matches[i].query_idx, matches[i].train_idx});
  }
  if (!Adjust(camera_, start) || start.points.size() < kMinAdjustedPoints) return std::nullopt;
  FixScale(start);
  first_.reset();
  return start;
}

}  // namespace mapp::tracker
