#include "server/service/alignment_consensus.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mapp {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix67 = Eigen::Matrix<double, 6, 7>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;
using Vector7 = Eigen::Matrix<double, 7, 1>;

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
/// Keyframes nearer than both of these show the same view, and repeat each other's mistakes.
constexpr double kDistinctM = 0.05;
constexpr double kDistinctRad = 3.0 * kRadPerDeg;
/// Odometry drift within a fragment, one sigma: a keyframe's word on T_map_session is no better than this.
constexpr double kDriftM = 0.02;
constexpr double kDriftRad = 0.5 * kRadPerDeg;
/// One sigma of the scale that triangulated depths tell, all of a fragment's keyframes together: far points, and there
/// are many, come out too near or too far in all of them.
constexpr double kDepthScaleSigma = 0.1;
/// How far keyframes' depths may be off the scale that they agree on, and one sigma at which it is known.
constexpr double kMaxScaleRatio = 1.2;
constexpr double kMaxScaleSigma = 0.025;

/// (information^-1 + drift covariance)^-1, written so that a singular information does not matter.
Matrix6 LimitByDrift(const Matrix6& information) {
  Vector6 variances;
  variances << Eigen::Vector3d::Constant(kDriftM * kDriftM), Eigen::Vector3d::Constant(kDriftRad * kDriftRad);
  const Matrix6 damped = Matrix6::Identity() + information * variances.asDiagonal();
  return damped.partialPivLu().solve(information);
}

/// Whether its depths have the map's unit.
bool HasScale(const KeyframeAlignment& alignment) { return alignment.match.scale == 1; }

bool AreDistinctViews(const KeyframeAlignment& a, const KeyframeAlignment& b) {
  return a.match.scale * Distance(a.T_session_camera, b.T_session_camera) > kDistinctM ||
         RotationAngle(a.T_session_camera, b.T_session_camera) > kDistinctRad;
}

/// Residual of one alignment under S_map_session, [rho; phi], then its derivative by the perturbation of
/// S_map_session: [rho; phi] of the pose on the right, and the logarithm of the scale.
struct Linearized {
  Vector6 error;
  Matrix67 jacobian;
};

Linearized Linearize(const KeyframeAlignment& alignment, const Sim3& S_map_session) {
  // Lengths of the session in the map's unit, as if the device had told them so.
  const Eigen::Vector3d way = S_map_session.scale * alignment.T_session_camera.translation();
  const Pose3 T_session_camera(alignment.T_session_camera.rotation(), way);
  // e = Log(T_camera_map * T_map_session * T_session_camera); perturbing T_map_session on the right gives
  // de/dd = Ad(T_camera_session) to first order in e.
  Linearized result;
  result.error = (alignment.match.T_map_camera.Inverse() * S_map_session.pose * T_session_camera).Log();
  result.jacobian.leftCols<6>() = Adjoint(T_session_camera.Inverse());
  result.jacobian.col(6) << T_session_camera.rotation().conjugate() * way, Eigen::Vector3d::Zero();
  return result;
}

/// The most alignments, taken in order, whose views all differ.
std::vector<const KeyframeAlignment*> DistinctViews(std::span<const KeyframeAlignment* const> alignments) {
  std::vector<const KeyframeAlignment*> distinct;
  for (const KeyframeAlignment* alignment : alignments) {
    const bool is_new = std::all_of(distinct.begin(), distinct.end(), [&](const KeyframeAlignment* other) {
      return AreDistinctViews(*alignment, *other);
    });
    if (is_new) distinct.push_back(alignment);
  }
  return distinct;
}

}  // namespace

bool AgreesWith(const KeyframeAlignment& alignment, const Sim3& S_map_session, const RegistrarOptions& options) {
  // Compared at the keyframe: at the session's origin, far away perhaps, a small turn would look like a large shift.
  const Pose3 T_map_camera = S_map_session * alignment.T_session_camera;
  const double ratio = S_map_session.scale / alignment.match.scale;
  return ratio < kMaxScaleRatio && ratio > 1 / kMaxScaleRatio &&
         Distance(T_map_camera, alignment.match.T_map_camera) <= options.max_disagreement_m &&
         RotationAngle(T_map_camera, alignment.match.T_map_camera) <= options.max_disagreement_deg * kRadPerDeg;
}

int AlignmentConsensus::Add(KeyframeAlignment alignment) {
  const uint32_t number = alignment.number;
  alignments_.insert_or_assign(number, std::move(alignment));
  return static_cast<int>(AgreeingWith(alignments_.at(number)).size());
}

bool AlignmentConsensus::Agree(const KeyframeAlignment& a, const KeyframeAlignment& b) const {
  if (!HasScale(a) || !HasScale(b)) {
    // Between two keyframes' own scales a long way differs by much: judged by the one that explains both.
    const KeyframeAlignment* const both[] = {&a, &b};
    const Sim3 S_map_session = FuseAlignments(both).S_map_session;
    return AgreesWith(a, S_map_session, options_) && AgreesWith(b, S_map_session, options_);
  }
  return AgreesWith(a, b.S_map_session(), options_) && AgreesWith(b, a.S_map_session(), options_);
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

std::optional<Sim3> AlignmentConsensus::Decide() const {
  std::vector<const KeyframeAlignment*> best;
  for (const auto& [number, alignment] : alignments_) {
    std::vector<const KeyframeAlignment*> agreeing = AgreeingWith(alignment);
    if (agreeing.size() > best.size()) best = std::move(agreeing);
  }
  if (!Suffices(best)) return std::nullopt;
  const FusedAlignment fused = FuseAlignments(best);
  if (fused.scale_sigma > kMaxScaleSigma) return std::nullopt;
  return fused.S_map_session;
}

FusedAlignment FuseAlignments(std::span<const KeyframeAlignment* const> alignments) {
  constexpr int kIterations = 5;
  const double depth_weight = 1 / (kDepthScaleSigma * kDepthScaleSigma * static_cast<double>(alignments.size()));
  const bool has_scale = std::ranges::all_of(alignments, [](const auto* alignment) { return HasScale(*alignment); });
  FusedAlignment fused{.S_map_session = alignments.front()->S_map_session()};
  Sim3& S_map_session = fused.S_map_session;
  for (int i = 0; i < kIterations; ++i) {
    Matrix7 hessian = Matrix7::Zero();
    Vector7 gradient = Vector7::Zero();
    for (const KeyframeAlignment* alignment : alignments) {
      const Linearized at = Linearize(*alignment, S_map_session);
      const Matrix6 weight = LimitByDrift(alignment->match.information);
      hessian += at.jacobian.transpose() * weight * at.jacobian;
      gradient += at.jacobian.transpose() * weight * at.error;
      hessian(6, 6) += depth_weight;
      gradient(6) += depth_weight * std::log(S_map_session.scale / alignment->match.scale);
    }
    if (has_scale) {
      hessian.row(6).setZero();
      hessian.col(6).setZero();
      hessian(6, 6) = 1;
      gradient(6) = 0;
    }
    const Eigen::LDLT<Matrix7> solver(hessian);
    const Vector7 step = -solver.solve(gradient);
    if (!step.allFinite()) break;
    S_map_session.pose = S_map_session.pose * Pose3::Exp(step.head<6>());
    S_map_session.scale *= std::exp(step(6));
    if (!has_scale) fused.scale_sigma = std::sqrt(solver.solve(Vector7::Unit(6))(6));
  }
  return fused;
}

}  // namespace mapp
