#include "vision/bundle_adjustment.h"

#include "vision/pose_block.h"
#include "vision/reprojection.h"

#include <Eigen/Geometry>
#include <ceres/ceres.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

namespace mapp {
namespace {

using internal::FromPose;
using internal::kPoseSize;
using internal::PoseBlock;
using internal::RelativePoseCost;
using internal::RightPerturbation;
using internal::RowMajor;
using internal::ToPose;

/// kRows = 2: pixel. kRows = 3: pixel and disparity.
template <int kRows>
class ReprojectionCost final : public ceres::SizedCostFunction<kRows, kPoseSize, 3> {
 public:
  ReprojectionCost(const PinholeCamera& camera, const internal::ReprojectionMeasurement& measured)
      : camera_(camera), measured_(measured) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Pose3 T_camera_world = ToPose(parameters[0]).Inverse();
    const Eigen::Matrix3d R_camera_world = T_camera_world.RotationMatrix();
    const Eigen::Vector3d p_camera =
        R_camera_world * Eigen::Map<const Eigen::Vector3d>(parameters[1]) + T_camera_world.translation();
    Eigen::Map<Eigen::Matrix<double, kRows, 1>> residual(residuals);
    const bool is_behind = p_camera.z() < internal::kMinDepth_m;
    if (is_behind) {
      const double bound = kRows == 3 ? internal::kChi2Depth : internal::kChi2Mono;
      residual.setConstant(std::sqrt(internal::kBehindCameraPenalty * bound / kRows));
    } else {
      residual = internal::ReprojectionError(camera_, measured_, p_camera).template head<kRows>();
    }
    if (jacobians == nullptr) return true;

    const Eigen::Matrix3d by_point_camera = is_behind ? Eigen::Matrix3d(Eigen::Matrix3d::Zero())
                                                      : internal::ReprojectionByPoint(camera_, measured_, p_camera);
    if (jacobians[0] != nullptr) {
      Eigen::Map<RowMajor<kRows, kPoseSize>> by_pose(jacobians[0]);
      by_pose.template leftCols<6>() = internal::ByPose(by_point_camera, p_camera).template topRows<kRows>();
      by_pose.template rightCols<1>().setZero();
    }
    if (jacobians[1] != nullptr) {
      Eigen::Map<RowMajor<kRows, 3>> by_point(jacobians[1]);
      by_point = (by_point_camera * R_camera_world).template topRows<kRows>();
    }
    return true;
  }

 private:
  PinholeCamera camera_;
  internal::ReprojectionMeasurement measured_;
};

/// Hands iterations on to the caller and stops when asked to.
class IterationObserver final : public ceres::IterationCallback {
 public:
  explicit IterationObserver(const BundleOptions& options) : options_(options) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    num_iterations_ = summary.iteration;  // 0 is the evaluation of the start.
    if (options_.on_iteration && summary.iteration > 0) options_.on_iteration(summary.iteration, summary.cost);
    if (options_.is_cancelled && options_.is_cancelled()) {
      cancelled_ = true;
      return ceres::SOLVER_TERMINATE_SUCCESSFULLY;  // SOLVER_ABORT would lose the best state.
    }
    return ceres::SOLVER_CONTINUE;
  }
  bool cancelled() const { return cancelled_; }
  int num_iterations() const { return num_iterations_; }

 private:
  const BundleOptions& options_;
  bool cancelled_ = false;
  int num_iterations_ = 0;
};

Status ValidateFrames(const BundleProblem& problem) {
  for (size_t i = 0; i < problem.frames.size(); ++i) {
    const BundleProblem::Frame& frame = problem.frames[i];
    if (!frame.T_world_camera.IsFinite()) {
      return absl::InvalidArgumentError(fmt::format("frames[{}].T_world_camera: must be finite", i));
    }
    if (!problem.observations.empty() && (!(frame.camera.fx > 0) || !(frame.camera.fy > 0))) {
      return absl::InvalidArgumentError(fmt::format("frames[{}].camera: focal lengths must be positive, got {} and {}",
                                                    i, frame.camera.fx, frame.camera.fy));
    }
  }
  if (std::none_of(problem.frames.begin(), problem.frames.end(), [](const auto& frame) { return frame.fixed; })) {
    return absl::InvalidArgumentError("frames: at least one must be fixed");
  }
  return absl::OkStatus();
}

Status ValidateObservations(const BundleProblem& problem) {
  const auto num_frames = static_cast<int>(problem.frames.size());
  const auto num_points = static_cast<int>(problem.points.size());
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    const BundleProblem::Observation& observation = problem.observations[i];
    if (observation.frame_idx < 0 || observation.frame_idx >= num_frames) {
      return absl::InvalidArgumentError(
          fmt::format("observations[{}].frame_idx: must be in [0, {}), got {}", i, num_frames, observation.frame_idx));
    }
    if (observation.point_idx < 0 || observation.point_idx >= num_points) {
      return absl::InvalidArgumentError(
          fmt::format("observations[{}].point_idx: must be in [0, {}), got {}", i, num_points, observation.point_idx));
    }
    if (!observation.pixel.allFinite() || !std::isfinite(observation.depth_m)) {
      return absl::InvalidArgumentError(fmt::format("observations[{}].pixel: pixel and depth must be finite", i));
    }
    if (!(observation.sigma_px > 0) || !std::isfinite(observation.sigma_px)) {
      return absl::InvalidArgumentError(
          fmt::format("observations[{}].sigma_px: must be positive, got {}", i, observation.sigma_px));
    }
  }
  return absl::OkStatus();
}

Status ValidateRelativePoses(const BundleProblem& problem) {
  const auto num_frames = static_cast<int>(problem.frames.size());
  const auto is_frame = [num_frames](int idx) { return idx >= 0 && idx < num_frames; };
  for (size_t i = 0; i < problem.relative_poses.size(); ++i) {
    const BundleProblem::RelativePose& relative = problem.relative_poses[i];
    if (!is_frame(relative.from_idx) || !is_frame(relative.to_idx) || relative.from_idx == relative.to_idx) {
      return absl::InvalidArgumentError(fmt::format("relative_poses[{}]: must join two frames of {}, joins {} and {}",
                                                    i, num_frames, relative.from_idx, relative.to_idx));
    }
    if (!relative.T_from_to.IsFinite() || !(relative.sigma_m > 0) || !(relative.sigma_rad > 0)) {
      return absl::InvalidArgumentError(
          fmt::format("relative_poses[{}]: must be finite with positive sigma_m and sigma_rad", i));
    }
  }
  return absl::OkStatus();
}

Status Validate(const BundleProblem& problem, const BundleOptions& options) {
  if (options.max_iterations < 0) {
    return absl::InvalidArgumentError(
        fmt::format("max_iterations: must not be negative, got {}", options.max_iterations));
  }
  MAPP_RETURN_IF_ERROR(ValidateFrames(problem));
  for (size_t i = 0; i < problem.points.size(); ++i) {
    if (!problem.points[i].p_world.allFinite()) {
      return absl::InvalidArgumentError(fmt::format("points[{}].p_world: must be finite", i));
    }
  }
  MAPP_RETURN_IF_ERROR(ValidateObservations(problem));
  return ValidateRelativePoses(problem);
}

internal::ReprojectionMeasurement Measured(const BundleProblem& problem,
                                           const BundleProblem::Observation& observation) {
  const BundleProblem::Frame& frame = problem.frames[static_cast<size_t>(observation.frame_idx)];
  return {observation.pixel, observation.sigma_px, observation.depth_m, frame.bf_px_m};
}

/// Errors of all observations at the problem's present state.
struct Assessment {
  double rmse_px = 0;
  std::vector<bool> outliers;
};

Assessment Assess(const BundleProblem& problem) {
  std::vector<Pose3> T_camera_world;
  T_camera_world.reserve(problem.frames.size());
  for (const BundleProblem::Frame& frame : problem.frames) T_camera_world.push_back(frame.T_world_camera.Inverse());
  Assessment assessment;
  double sum = 0;
  int count = 0;
  for (const BundleProblem::Observation& observation : problem.observations) {
    const auto frame_idx = static_cast<size_t>(observation.frame_idx);
    const Eigen::Vector3d p_camera =
        T_camera_world[frame_idx] * problem.points[static_cast<size_t>(observation.point_idx)].p_world;
    if (p_camera.z() < internal::kMinDepth_m) {
      assessment.outliers.push_back(true);
      continue;
    }
    const Eigen::Vector3d error =
        internal::ReprojectionError(problem.frames[frame_idx].camera, Measured(problem, observation), p_camera);
    sum += error.head<2>().squaredNorm();
    ++count;
    const double bound = observation.depth_m > 0 ? internal::kChi2Depth : internal::kChi2Mono;
    assessment.outliers.push_back(error.squaredNorm() > bound);
  }
  assessment.rmse_px = count > 0 ? std::sqrt(sum / count) : 0.0;
  return assessment;
}

/// Share of free frame pairs that see a common point: the fill of the reduced camera matrix.
double CovisibilityDensity(const BundleProblem& problem) {
  const size_t num_frames = problem.frames.size();
  std::vector<std::vector<size_t>> observers(problem.points.size());
  for (const BundleProblem::Observation& observation : problem.observations) {
    const auto frame_idx = static_cast<size_t>(observation.frame_idx);
    if (!problem.frames[frame_idx].fixed) observers[static_cast<size_t>(observation.point_idx)].push_back(frame_idx);
  }
  std::vector<bool> covisible(num_frames * num_frames, false);
  for (const std::vector<size_t>& frames : observers) {
    for (const size_t a : frames) {
      for (const size_t b : frames) covisible[a * num_frames + b] = true;
    }
  }
  const auto num_filled = static_cast<double>(std::count(covisible.begin(), covisible.end(), true));
  const auto num_free = static_cast<double>(
      std::count_if(problem.frames.begin(), problem.frames.end(), [](const auto& frame) { return !frame.fixed; }));
  return num_filled / (num_free * num_free);
}

void ChooseLinearSolver(const BundleProblem& problem, ceres::Solver::Options& options) {
  if (problem.observations.empty()) {
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;  // a graph of poses has nothing to eliminate
    return;
  }
  constexpr int kMaxDenseFrames = 100;
  constexpr int kMaxExplicitFrames = 1500;
  // Above, the matrix of densities costs more memory than it helps.
  constexpr size_t kMaxDensityFrames = 10000;
  // Sparse factorization fills in: with 500 frames that mostly see each other it took four times as long as conjugate
  // gradients, and less where each sees only its neighbors.
  constexpr double kMaxSparseDensity = 0.2;
  const auto num_free =
      std::count_if(problem.frames.begin(), problem.frames.end(), [](const auto& frame) { return !frame.fixed; });
  if (num_free < kMaxDenseFrames) {
    options.linear_solver_type = ceres::DENSE_SCHUR;
  } else if (problem.frames.size() <= kMaxDensityFrames && CovisibilityDensity(problem) <= kMaxSparseDensity) {
    options.linear_solver_type = ceres::SPARSE_SCHUR;
  } else {
    options.linear_solver_type = ceres::ITERATIVE_SCHUR;
    options.preconditioner_type = ceres::SCHUR_JACOBI;
    // 67 s instead of 72 for a map of 776 frames and 210 thousand observations; its memory grows with the square of the
    // frames.
    options.use_explicit_schur_complement = num_free < kMaxExplicitFrames;
  }
}

/// The Ceres problem over copies of the caller's states, which stay untouched until the solution is known to be usable.
class BundleSolver {
 public:
  explicit BundleSolver(const BundleProblem& problem) : input_(problem), problem_(ProblemOptions()) {
    poses_.resize(problem.frames.size());
    points_.resize(problem.points.size());
    for (size_t i = 0; i < poses_.size(); ++i) FromPose(problem.frames[i].T_world_camera, poses_[i].data());
    for (size_t i = 0; i < points_.size(); ++i) points_[i] = problem.points[i].p_world;
    for (const BundleProblem::Observation& observation : problem.observations) AddObservation(observation);
    for (const BundleProblem::RelativePose& relative : problem.relative_poses) AddRelativePose(relative);
    FixAndOrder();
  }

  ceres::Solver::Summary Solve(const BundleOptions& options, ceres::IterationCallback& observer) {
    ceres::Solver::Options solver_options;
    ChooseLinearSolver(input_, solver_options);
    solver_options.max_num_iterations = options.max_iterations;
    solver_options.num_threads = std::max(1, options.num_threads);
    solver_options.max_solver_time_in_seconds = options.max_seconds;
    solver_options.logging_type = ceres::SILENT;
    if (!input_.observations.empty()) solver_options.linear_solver_ordering = ordering_;
    solver_options.callbacks.push_back(&observer);
    ceres::Solver::Summary summary;
    ceres::Solve(solver_options, &problem_, &summary);
    return summary;
  }

  void WriteTo(BundleProblem& problem) const {
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (!problem.frames[i].fixed) problem.frames[i].T_world_camera = ToPose(poses_[i].data());
    }
    for (size_t i = 0; i < points_.size(); ++i) {
      if (!problem.points[i].fixed) problem.points[i].p_world = points_[i];
    }
  }

 private:
  static ceres::Problem::Options ProblemOptions() {
    ceres::Problem::Options options;
    // Shared by all residuals and owned by this object.
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  void AddObservation(const BundleProblem::Observation& observation) {
    const auto frame_idx = static_cast<size_t>(observation.frame_idx);
    const internal::ReprojectionMeasurement measured = Measured(input_, observation);
    const PinholeCamera& camera = input_.frames[frame_idx].camera;
    double* pose = poses_[frame_idx].data();
    double* point = points_[static_cast<size_t>(observation.point_idx)].data();
    if (observation.depth_m > 0) {
      problem_.AddResidualBlock(new ReprojectionCost<3>(camera, measured), &depth_loss_, pose, point);
    } else {
      problem_.AddResidualBlock(new ReprojectionCost<2>(camera, measured), &mono_loss_, pose, point);
    }
  }

  void AddRelativePose(const BundleProblem::RelativePose& relative) {
    problem_.AddResidualBlock(new RelativePoseCost(relative.T_from_to, relative.sigma_m, relative.sigma_rad),
                              relative.robust ? &relative_loss_ : nullptr,
                              poses_[static_cast<size_t>(relative.from_idx)].data(),
                              poses_[static_cast<size_t>(relative.to_idx)].data());
  }

  /// Points are eliminated first (Schur complement). Frames and points without observations take no part.
  void FixAndOrder() {
    ordering_ = std::make_shared<ceres::ParameterBlockOrdering>();
    for (size_t i = 0; i < points_.size(); ++i) {
      double* point = points_[i].data();
      if (!problem_.HasParameterBlock(point)) continue;
      if (input_.points[i].fixed) problem_.SetParameterBlockConstant(point);
      ordering_->AddElementToGroup(point, 0);
    }
    for (size_t i = 0; i < poses_.size(); ++i) {
      double* pose = poses_[i].data();
      if (!problem_.HasParameterBlock(pose)) continue;
      problem_.SetManifold(pose, &manifold_);
      if (input_.frames[i].fixed) problem_.SetParameterBlockConstant(pose);
      ordering_->AddElementToGroup(pose, 1);
    }
  }

  const BundleProblem& input_;
  RightPerturbation manifold_;
  ceres::HuberLoss mono_loss_{std::sqrt(internal::kChi2Mono)};
  // Odometry that has slipped once is off by any amount there.
  ceres::CauchyLoss relative_loss_{std::sqrt(internal::kChi2RelativePose)};
  ceres::HuberLoss depth_loss_{std::sqrt(internal::kChi2Depth)};
  std::vector<PoseBlock> poses_;
  std::vector<Eigen::Vector3d> points_;
  std::shared_ptr<ceres::ParameterBlockOrdering> ordering_;
  ceres::Problem problem_;  // Last: it refers to the members above.
};

}  // namespace

StatusOr<BundleResult> AdjustBundle(BundleProblem& problem, const BundleOptions& options) {
  MAPP_RETURN_IF_ERROR(Validate(problem, options));
  BundleResult result;
  Assessment assessment = Assess(problem);
  result.initial_rmse_px = assessment.rmse_px;
  if (!problem.observations.empty() || !problem.relative_poses.empty()) {
    BundleSolver solver(problem);
    IterationObserver observer(options);
    const ceres::Solver::Summary summary = solver.Solve(options, observer);
    if (!summary.IsSolutionUsable()) {
      return absl::InternalError(fmt::format("adjust bundle: {}", summary.message));
    }
    solver.WriteTo(problem);
    assessment = Assess(problem);
    result.initial_cost = summary.initial_cost;
    result.final_cost = summary.final_cost;
    result.num_iterations = observer.num_iterations();
    result.cancelled = observer.cancelled();
  }
  result.final_rmse_px = assessment.rmse_px;
  result.outliers = std::move(assessment.outliers);
  return result;
}

}  // namespace mapp
