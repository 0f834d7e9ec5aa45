#include "sim/world/motion_spline.h"

#include <fmt/format.h>

#include <algorithm>

namespace mapp::sim {
namespace {

double Seconds(int64_t duration_ns) { return static_cast<double>(duration_ns) * 1e-9; }

/// Vector part of conjugate(a) * b, coefficients in the order x, y, z, w.
Eigen::Vector3d ConjugateProduct(const Eigen::Vector4d& a, const Eigen::Vector4d& b) {
  return a.w() * b.head<3>() - b.w() * a.head<3>() - a.head<3>().cross(b.head<3>());
}

}  // namespace

StatusOr<MotionSpline> MotionSpline::Through(const std::vector<StampedPose>& T_world_body) {
  const size_t n = T_world_body.size();
  if (n < 2) return absl::InvalidArgumentError(fmt::format("at least 2 poses expected, got {}", n));
  MotionSpline spline;
  for (size_t i = 0; i < n; ++i) {
    const auto& [stamp_ns, pose] = T_world_body[i];
    if (!pose.IsFinite()) return absl::InvalidArgumentError(fmt::format("{:.6f} s: not finite", Seconds(stamp_ns)));
    if (i > 0 && stamp_ns <= spline.stamps_ns_.back()) {
      return absl::InvalidArgumentError(fmt::format("{:.6f} s: times must increase", Seconds(stamp_ns)));
    }
    Knot knot;
    knot << pose.translation(), pose.rotation().coeffs();
    // q and -q are the same rotation; the nearer one keeps the spline short.
    if (i > 0 && knot.tail<4>().dot(spline.values_.back().tail<4>()) < 0) knot.tail<4>() *= -1;
    spline.stamps_ns_.push_back(stamp_ns);
    spline.values_.push_back(knot);
  }
  // Tridiagonal system of the second derivatives, 0 at both ends (Press et al., Numerical Recipes, section 3.3).
  std::vector<Knot>& second = spline.second_derivatives_;
  second.assign(n, Knot::Zero());
  std::vector<double> upper(n, 0.0);
  const auto step_s = [&](size_t i) { return Seconds(spline.stamps_ns_[i + 1] - spline.stamps_ns_[i]); };
  for (size_t i = 1; i + 1 < n; ++i) {
    const double before_s = step_s(i - 1);
    const double after_s = step_s(i);
    const Knot slopes =
        (spline.values_[i + 1] - spline.values_[i]) / after_s - (spline.values_[i] - spline.values_[i - 1]) / before_s;
    const double pivot = 2 * (before_s + after_s) - before_s * upper[i - 1];
    upper[i] = after_s / pivot;
    second[i] = (6 * slopes - before_s * second[i - 1]) / pivot;
  }
  for (size_t i = n - 1; i-- > 1;) second[i] -= upper[i] * second[i + 1];
  return spline;
}

MotionState MotionSpline::At(int64_t stamp_ns) const {
  const int64_t clamped_ns = std::clamp(stamp_ns, start_ns(), end_ns());
  const auto after = std::upper_bound(stamps_ns_.begin() + 1, stamps_ns_.end() - 1, clamped_ns);
  const auto i = static_cast<size_t>(after - stamps_ns_.begin()) - 1;
  const double h = Seconds(stamps_ns_[i + 1] - stamps_ns_[i]);
  const double b = Seconds(clamped_ns - stamps_ns_[i]) / h;
  const double a = 1 - b;
  const Knot value =
      a * values_[i] + b * values_[i + 1] +
      ((a * a * a - a) * second_derivatives_[i] + (b * b * b - b) * second_derivatives_[i + 1]) * h * h / 6;
  const Knot first = (values_[i + 1] - values_[i]) / h +
                     ((1 - 3 * a * a) * second_derivatives_[i] + (3 * b * b - 1) * second_derivatives_[i + 1]) * h / 6;
  const Knot second = a * second_derivatives_[i] + b * second_derivatives_[i + 1];
  const Eigen::Vector4d q = value.tail<4>();
  // q' = q * (0, omega) / 2 for a unit q; the part of q' along q only changes the length.
  const Eigen::Vector3d omega = 2 * ConjugateProduct(q, first.tail<4>()) / q.squaredNorm();
  return {Pose3(Eigen::Quaterniond(q.w(), q.x(), q.y(), q.z()), value.head<3>()), first.head<3>(), second.head<3>(),
          omega};
}

}  // namespace mapp::sim
