#include "sim/world/user_motion.h"

#include "mapp/base/check.h"
#include "mapp/base/rng.h"
#include "sim/gaze.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace mapp::sim {
namespace {

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr int64_t kKnotStepNs = 50'000'000;
constexpr double kKnotStep_s = 0.05;
constexpr double kTableStep_m = 0.01;
constexpr double kStartSpeed_m_s = 0.15;
constexpr double kMinSpeed_m_s = 0.1;
constexpr double kAcceleration_m_s2 = 0.6;
constexpr double kLookRate = 0.17;  ///< of kMaxYawRate, spent on looking around

/// Two slow waves: a value in [-1, 1] that does not repeat soon.
class Wander {
 public:
  Wander(Rng& rng, double shortest_period, double longest_period) {
    for (Wave& wave : waves_) {
      wave = {kTwoPi / rng.Uniform(shortest_period, longest_period), rng.Uniform(0, kTwoPi)};
    }
  }
  double At(double x) const {
    double sum = 0;
    for (const Wave& wave : waves_) sum += std::sin(wave.frequency * x + wave.phase) / kNumWaves;
    return sum;
  }

 private:
  static constexpr size_t kNumWaves = 2;
  struct Wave {
    double frequency = 0;
    double phase = 0;
  };
  std::array<Wave, kNumWaves> waves_;
};

/// Points at equal distances along the walk's edges, moved sideways a little.
std::vector<Eigen::Vector3d> ControlPoints(const RouteGraph& graph, const std::vector<size_t>& walk, double spacing_m,
                                           double wander_m, double rise_m, Rng& rng) {
  const Wander sideways(rng, 7, 15);
  const Wander upwards(rng, 9, 20);
  std::vector<Eigen::Vector3d> points;
  double next_m = 0;  // where the next point lies, from the edge's begin
  double walked_m = 0;
  for (size_t i = 1; i < walk.size(); ++i) {
    const Eigen::Vector3d& from = graph.nodes_world[walk[i - 1]];
    const Eigen::Vector3d edge = graph.nodes_world[walk[i]] - from;
    const double length_m = edge.norm();
    Eigen::Vector3d side = Eigen::Vector3d::UnitZ().cross(edge);
    side = side.norm() > 1e-6 * length_m ? Eigen::Vector3d(side.normalized()) : Eigen::Vector3d::UnitX();
    for (; next_m <= length_m; next_m += spacing_m) {
      const double s = walked_m + next_m;
      points.push_back(from + edge * (next_m / length_m) + wander_m * sideways.At(s) * side +
                       rise_m * upwards.At(s) * Eigen::Vector3d::UnitZ());
    }
    next_m -= length_m;
    walked_m += length_m;
  }
  return points;
}

/// A uniform cubic B-spline: twice continuously differentiable, inside the hull of four neighboring control points.
class SmoothWay {
 public:
  SmoothWay(std::vector<Eigen::Vector3d> control_points, double max_length_m) : points_(std::move(control_points)) {
    MAPP_CHECK(points_.size() >= 4);
    const double end_u = static_cast<double>(points_.size() - 3);
    const double step_u = kTableStep_m / (points_[1] - points_[0]).norm();
    Eigen::Vector3d last = AtParameter(0);
    s_.push_back(0);
    for (double u = step_u; u < end_u && s_.back() < max_length_m; u += step_u) {
      const Eigen::Vector3d p_world = AtParameter(u);
      s_.push_back(s_.back() + (p_world - last).norm());
      last = p_world;
    }
    step_u_ = step_u;
  }

  size_t num_rows() const { return s_.size(); }
  double s_m(size_t row) const { return s_[row]; }
  /// `row` may lie between two rows.
  Eigen::Vector3d AtRow(double row) const {
    return AtParameter(std::clamp(row, 0.0, static_cast<double>(s_.size() - 1)) * step_u_);
  }
  /// 1/m, by differences over a few rows.
  double Curvature(size_t row) const {
    constexpr double kRows = 5;
    const auto middle = static_cast<double>(row);
    const Eigen::Vector3d a = AtRow(middle - kRows);
    const Eigen::Vector3d b = AtRow(middle);
    const Eigen::Vector3d c = AtRow(middle + kRows);
    const double product = (b - a).norm() * (c - b).norm() * (c - a).norm();
    // The circle through three points; where the way turns back on itself they fall together.
    if ((b - a).dot(c - b) <= 0) return (b - a).norm() < 1e-9 || (c - b).norm() < 1e-9 ? 0 : 1 / kTableStep_m;
    return 2 * (b - a).cross(c - a).norm() / std::max(product, 1e-12);
  }

 private:
  Eigen::Vector3d AtParameter(double u) const {
    const auto i = std::min(static_cast<size_t>(u), points_.size() - 4);
    const double t = u - static_cast<double>(i);
    const double t2 = t * t;
    const double t3 = t2 * t;
    return ((1 - 3 * t + 3 * t2 - t3) * points_[i] + (4 - 6 * t2 + 3 * t3) * points_[i + 1] +
            (1 + 3 * t + 3 * t2 - 3 * t3) * points_[i + 2] + t3 * points_[i + 3]) /
           6;
  }

  std::vector<Eigen::Vector3d> points_;
  std::vector<double> s_;  ///< metres walked at row * step_u_
  double step_u_ = 1;
};

/// Mean over 2 * half + 1 neighbors; at the ends over those that there are.
std::vector<double> Smoothed(const std::vector<double>& values, size_t half) {
  std::vector<double> sums(values.size() + 1, 0.0);
  for (size_t i = 0; i < values.size(); ++i) sums[i + 1] = sums[i] + values[i];
  std::vector<double> smooth(values.size());
  for (size_t i = 0; i < values.size(); ++i) {
    const size_t reach = std::min({half, i, values.size() - 1 - i});
    smooth[i] = (sums[i + reach + 1] - sums[i - reach]) / static_cast<double>(2 * reach + 1);
  }
  return smooth;
}

/// Seconds at which each row is passed.
std::vector<double> Timetable(const SmoothWay& way, const Gait& gait) {
  std::vector<double> speed(way.num_rows());
  for (size_t i = 0; i < speed.size(); ++i) {
    const double in_curve = std::sqrt(gait.max_lateral_m_s2 / std::max(way.Curvature(i), 1e-6));
    speed[i] = std::clamp(in_curve, kMinSpeed_m_s, gait.speed_m_s);
  }
  speed.front() = kStartSpeed_m_s;
  const auto reachable = [&](double from, size_t a, size_t b) {
    return std::sqrt(from * from + 2 * kAcceleration_m_s2 * std::abs(way.s_m(b) - way.s_m(a)));
  };
  for (size_t i = 1; i < speed.size(); ++i) speed[i] = std::min(speed[i], reachable(speed[i - 1], i - 1, i));
  for (size_t i = speed.size() - 1; i-- > 0;) speed[i] = std::min(speed[i], reachable(speed[i + 1], i + 1, i));
  constexpr size_t kSmoothingRows = 20;
  speed = Smoothed(speed, kSmoothingRows);
  std::vector<double> time_s(speed.size(), 0.0);
  for (size_t i = 1; i < speed.size(); ++i) {
    time_s[i] = time_s[i - 1] + 2 * (way.s_m(i) - way.s_m(i - 1)) / (speed[i] + speed[i - 1]);
  }
  return time_s;
}

/// The (fractional) row that is passed at each knot.
std::vector<double> RowsAtKnots(const std::vector<double>& time_s) {
  std::vector<double> rows;
  size_t row = 0;
  for (size_t knot = 0;; ++knot) {
    const double t = static_cast<double>(knot) * kKnotStep_s;
    while (row + 1 < time_s.size() && time_s[row + 1] <= t) ++row;
    if (row + 1 >= time_s.size()) break;
    rows.push_back(static_cast<double>(row) + (t - time_s[row]) / (time_s[row + 1] - time_s[row]));
  }
  // A spline needs two knots, however short the way.
  while (rows.size() < 2) rows.push_back(static_cast<double>(time_s.size() - 1));
  return rows;
}

/// Follows `angles` at no more than `max_step` from one to the next, beginning to turn in time.
std::vector<double> RateLimited(const std::vector<double>& angles, double max_step) {
  std::vector<double> forward = angles;
  std::vector<double> backward = angles;
  for (size_t i = 1; i < angles.size(); ++i) {
    forward[i] = forward[i - 1] + std::clamp(angles[i] - forward[i - 1], -max_step, max_step);
  }
  for (size_t i = angles.size() - 1; i-- > 0;) {
    backward[i] = backward[i + 1] + std::clamp(angles[i] - backward[i + 1], -max_step, max_step);
  }
  std::vector<double> limited(angles.size());
  std::ranges::transform(forward, backward, limited.begin(), [](double a, double b) { return (a + b) / 2; });
  return limited;
}

/// Directions of the way at each knot, radians about z, without jumps of a full turn, smooth.
std::vector<double> Headings(const SmoothWay& way, const std::vector<double>& rows) {
  constexpr double kBehindRows = 30;
  constexpr double kAheadRows = 70;
  constexpr size_t kSmoothingKnots = 8;
  std::vector<double> yaw;
  for (const double row : rows) {
    const Eigen::Vector3d along = way.AtRow(row + kAheadRows) - way.AtRow(row - kBehindRows);
    const double last = yaw.empty() ? 0 : yaw.back();
    const bool upright = along.head<2>().norm() < 0.1 * along.norm() || along.norm() < 1e-6;
    const double direction = upright ? last : std::atan2(along.y(), along.x());
    yaw.push_back(yaw.empty() ? direction : last + std::remainder(direction - last, kTwoPi));
  }
  // Means of values that change by at most so much change by at most so much.
  return Smoothed(RateLimited(yaw, (kMaxYawRate - kLookRate) * kKnotStep_s), kSmoothingKnots);
}

}  // namespace

Gait WalkingGait(uint64_t seed) {
  Rng rng(seed);
  Gait gait;
  gait.speed_m_s = rng.Uniform(1.3, 1.5);
  gait.pitch_down = rng.Uniform(0.04, 0.12);
  gait.bob_m = 0.01;
  return gait;
}

Gait FlyingGait(uint64_t seed) {
  Rng rng(seed);
  Gait gait;
  gait.speed_m_s = rng.Uniform(1.5, 2.0);
  gait.max_lateral_m_s2 = 1.8;
  gait.pitch_down = rng.Uniform(0.12, 0.22);
  gait.pitch_swing = 0.04;
  gait.roll_swing = 0.02;
  gait.rise_m = 0.1;
  return gait;
}

std::vector<StampedPose> MoveAlong(const RouteGraph& graph, const std::vector<size_t>& walk, double path_m,
                                   const Gait& gait, int64_t start_ns, uint64_t seed) {
  Rng rng(seed);
  // In a corner the curve leaves the edges by up to 0.27 of the spacing; that and the wandering keep to the clearance.
  const double spacing_m = std::clamp(2.0 * graph.clearance_m, 0.2, 1.5);
  const SmoothWay way(ControlPoints(graph, walk, spacing_m, 0.3 * graph.clearance_m,
                                    std::min(gait.rise_m, 0.3 * graph.clearance_m), rng),
                      path_m);
  const std::vector<double> rows = RowsAtKnots(Timetable(way, gait));
  const std::vector<double> headings = Headings(way, rows);
  const double steps_per_s = rng.Uniform(1.7, 1.9);
  const Wander look(rng, 8, 14);
  const Wander nod(rng, 4, 8);
  const Wander lean(rng, 3, 5);
  // At most the look's own share of the yaw rate, whatever its shortest period is.
  const double yaw_swing = std::min(gait.yaw_swing, kLookRate * 8 / kTwoPi);
  std::vector<StampedPose> poses;
  for (size_t i = 0; i < rows.size(); ++i) {
    const double t = static_cast<double>(i) * kKnotStep_s;
    // People stand still before they walk: the first second sways in gently.
    const double sway = std::min(t, 1.0);
    const double bob = gait.bob_m * sway * std::sin(kTwoPi * steps_per_s * t);
    const double yaw = headings[i] + yaw_swing * look.At(t);
    const double pitch_down = gait.pitch_down + gait.pitch_swing * nod.At(t);
    const double roll = gait.roll_swing * (lean.At(t) + sway * std::sin(kTwoPi * 0.5 * steps_per_s * t)) / 2;
    poses.push_back({start_ns + static_cast<int64_t>(i) * kKnotStepNs,
                     Pose3(LookAlong(yaw, pitch_down, roll), way.AtRow(rows[i]) + bob * Eigen::Vector3d::UnitZ())});
  }
  return poses;
}

}  // namespace mapp::sim
