#include "server/changes/thing_stay.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace mapp {
namespace {

/// The longest unbroken stretch of a sequence of times.
class Stretch {
 public:
  void Add(int64_t time_ns, double max_break_s) {
    if (!goes_on_ || 1e-9 * static_cast<double>(time_ns - until_ns_) > max_break_s) since_ns_ = time_ns;
    goes_on_ = true;
    until_ns_ = time_ns;
    longest_ns_ = std::max(longest_ns_, until_ns_ - since_ns_);
  }
  void Break() { goes_on_ = false; }
  bool empty() const { return longest_ns_ < 0; }
  double longest_s() const { return 1e-9 * static_cast<double>(longest_ns_); }

 private:
  int64_t since_ns_ = 0, until_ns_ = 0;
  int64_t longest_ns_ = -1;
  bool goes_on_ = false;
};

struct PointStay {
  Stretch in_view;
  Stretch seen;
};

double MedianOf(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void LookAt(const WitnessView& view, std::span<const Eigen::Vector3f> p_map, double max_break_s,
            std::vector<PointStay>& stays) {
  const Pose3 T_camera_map = view.T_map_camera.Inverse();
  const PinholeCamera pinhole = view.camera.Undistorted();
  for (size_t i = 0; i < p_map.size(); ++i) {
    const Eigen::Vector3d p_camera = T_camera_map * p_map[i].cast<double>();
    if (p_camera.z() <= 0 || p_camera.z() > view.geometry.farthest_depth_m()) continue;
    if (!view.camera.Contains(pinhole.Project(p_camera))) continue;
    stays[i].in_view.Add(view.stamp_ns, max_break_s);
    const SurfaceSighting sighting = view.geometry.At(p_camera.cast<float>());
    if (sighting == SurfaceSighting::kSeen) stays[i].seen.Add(view.stamp_ns, max_break_s);
    if (sighting == SurfaceSighting::kMissed) stays[i].seen.Break();
  }
}

}  // namespace

StatusOr<std::optional<double>> ShareOfStay(const ThingPoints& points, SessionId session, FindingsMaker& maker,
                                            const StayOptions& options) {
  MAPP_ASSIGN_OR_RETURN(auto views, maker.ViewsInto(session, points.BoxMap(), options.max_views));
  std::ranges::stable_sort(views, {}, [](const auto& view) { return view->stamp_ns; });
  std::vector<PointStay> stays(points.p_map.size());
  for (const auto& view : views) LookAt(*view, points.p_map, options.max_break_s, stays);
  std::vector<double> shares, in_view_s;
  for (const auto& [in_view, seen] : stays) {
    if (seen.empty()) continue;
    in_view_s.push_back(in_view.longest_s());
    shares.push_back(seen.longest_s() / std::clamp(in_view.longest_s(), options.least_view_s, options.greatest_view_s));
  }
  if (shares.empty() || MedianOf(std::move(in_view_s)) < options.too_short_s) return std::nullopt;
  return MedianOf(std::move(shares));
}

StatusOr<bool> IsStanding(const ThingPoints& points, std::span<const SessionId> seen_by, FindingsMaker& maker,
                          const StayOptions& options) {
  std::vector<double> shares;
  for (const SessionId session : seen_by) {
    if (shares.size() == options.max_sessions) break;
    MAPP_ASSIGN_OR_RETURN(const std::optional<double> share, ShareOfStay(points, session, maker, options));
    if (share) shares.push_back(*share);
  }
  return !shares.empty() && MedianOf(std::move(shares)) >= options.min_share;
}

}  // namespace mapp
