#include "server/service/alignment_consensus.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <numbers>

namespace mapp {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
/// Keyframes nearer than both of these show the same view, and repeat each other's mistakes.
constexpr double kDistinctM = 0.05;
constexpr double kDistinctRad = 3.0 * kRadPerDeg;
/// Odometry drift within a fragment, one sigma: a keyframe's word on T_map_session is no better than this.
constexpr double kDriftM = 0.02;
constexpr double kDriftRad = 0.5 * kRadPerDeg;

/// (information^-1 + drift covariance)^-1, written so that a singular information does not matter.
Matrix6 LimitByDrift(const Matrix6& information) {
  Vector6 variances;
  variances << Eigen::Vector3d::Constant(kDriftM * kDriftM), Eigen::Vector3d::Constant(kDriftRad * kDriftRad);
  const Matrix6 damped = Matrix6::Identity() + information * variances.asDiagonal();
  return damped.partialPivLu().solve(information);
}

bool AreDistinctViews(const Pose3& a, const Pose3& b) {
  return Distance(a, b) > kDistinctM || RotationAngle(a, b) > kDistinctRad;
}

/// The most alignments, taken in order, whose views all differ.
std::vector<const KeyframeAlignment*> DistinctViews(std::span<const KeyframeAlignment* const> alignments) {
  std::vector<const KeyframeAlignment*> distinct;
  for (const KeyframeAlignment* alignment : alignments) {
    const bool is_new = std::all_of(distinct.begin(), distinct.end(), [&](const KeyframeAlignment* other) {
      return AreDistinctViews(alignment->T_session_camera, other->T_session_camera);
    });
    if (is_new) distinct.push_back(alignment);
  }
  return distinct;
}

}  // namespace

int AlignmentConsensus::Add(KeyframeAlignment alignment) {
  const uint32_t number = alignment.number;
  alignments_.insert_or_assign(number, std::move(alignment));
  return static_cast<int>(AgreeingWith(alignments_.at(number)).size());
}

bool AlignmentConsensus::Agree(const KeyframeAlignment& a, const KeyframeAlignment& b) const {
  // Compared at the keyframes: at the session's origin, far away perhaps, a small turn would look like a large shift.
  const auto differ = [this](const Pose3& left, const Pose3& right) {
    return Distance(left, right) > options_.max_disagreement_m ||
           RotationAngle(left, right) > options_.max_disagreement_deg * kRadPerDeg;
  };
  return !differ(b.T_map_session() * a.T_session_camera, a.match.T_map_camera) &&
         !differ(a.T_map_session() * b.T_session_camera, b.match.T_map_camera);
}

std::vector<const KeyframeAlignment*> AlignmentConsensus::AgreeingWith(const KeyframeAlignment& alignment) const {
  std::vector<const KeyframeAlignment*> agreeing;
  for (const auto& [number, other] : alignments_) {
    if (number == alignment.number || Agree(alignment, other)) agreeing.push_back(&other);
  }
  return agreeing;
}

bool AlignmentConsensus::Suffices(std::span<const KeyframeAlignment* const> agreeing) const {
  if (2 * agreeing.size() <= alignments_.size()) return false;
  const std::vector<const KeyframeAlignment*> distinct = DistinctViews(agreeing);
  if (static_cast<int>(distinct.size()) >= options_.min_consistent_keyframes) return true;
  const auto num_strong = std::count_if(distinct.begin(), distinct.end(), [this](const KeyframeAlignment* alignment) {
    return static_cast<int>(alignment->match.inliers.size()) >= options_.strong_inliers;
  });
  return num_strong >= 2;
}

std::optional<Pose3> AlignmentConsensus::Decide() const {
  std::vector<const KeyframeAlignment*> best;
  for (const auto& [number, alignment] : alignments_) {
    std::vector<const KeyframeAlignment*> agreeing = AgreeingWith(alignment);
    if (agreeing.size() > best.size()) best = std::move(agreeing);
  }
  if (!Suffices(best)) return std::nullopt;
  return FuseAlignments(best);
}

Pose3 FuseAlignments(std::span<const KeyframeAlignment* const> alignments) {
  constexpr int kIterations = 5;
  Pose3 T_map_session = alignments.front()->T_map_session();
  for (int i = 0; i < kIterations; ++i) {
    Matrix6 hessian = Matrix6::Zero();
    Vector6 gradient = Vector6::Zero();
    for (const KeyframeAlignment* alignment : alignments) {
      const Pose3& T_session_camera = alignment->T_session_camera;
      // e = Log(T_camera_map * T_map_session * T_session_camera); perturbing T_map_session on the right gives
      // de/dd = Ad(T_camera_session) to first order in e.
      const Vector6 error = (alignment->match.T_map_camera.Inverse() * T_map_session * T_session_camera).Log();
      const Matrix6 jacobian = Adjoint(T_session_camera.Inverse());
      const Matrix6 weight = LimitByDrift(alignment->match.information);
      hessian += jacobian.transpose() * weight * jacobian;
      gradient += jacobian.transpose() * weight * error;
    }
    const Vector6 step = -hessian.ldlt().solve(gradient);
    if (!step.allFinite()) break;
    T_map_session = T_map_session * Pose3::Exp(step);
  }
  return T_map_session;
}

}  // namespace mapp
