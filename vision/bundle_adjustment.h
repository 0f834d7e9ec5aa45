#pragma once

#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/geometry/pose3.h"

#include <Eigen/Core>

#include <functional>
#include <vector>

namespace mapp {

/// Poses and points to adjust together; indices refer to the vectors here.
struct BundleProblem {
  struct Frame {
    PinholeCamera camera;  ///< undistorted; not asked for in a graph of poses alone
    Pose3 T_world_camera;
    bool fixed = false;
    double bf_px_m = 40.0;  ///< weight of depths, as PoseOptions::bf_px_m
  };
  struct Point {
    Eigen::Vector3d p_world;
    bool fixed = false;
  };
  struct Observation {
    int frame_idx = 0;
    int point_idx = 0;
    Eigen::Vector2d pixel;  ///< undistorted
    double sigma_px = 1.0;
    double depth_m = 0;  ///< 0 = none
  };
  /// Odometry between two frames: what holds those that share too few points.
  struct RelativePose {
    int from_idx = 0;
    int to_idx = 0;
    Pose3 T_from_to;
    double sigma_m = 0.01;     ///< of each coordinate
    double sigma_rad = 0.005;  ///< of each axis
    bool robust = true;        ///< false: taken at its word, however far it is off
  };
  std::vector<Frame> frames;
  std::vector<Point> points;
  std::vector<Observation> observations;
  std::vector<RelativePose> relative_poses;  ///< without observations, the problem is a graph of poses
};

struct BundleOptions {
  int max_iterations = 10;
  int num_threads = 1;
  double max_seconds = 60;
  /// Asked before every iteration; true stops and keeps the best state so far.
  std::function<bool()> is_cancelled = {};
  /// Called after every iteration with iteration and cost.
  std::function<void(int, double)> on_iteration = {};
};

struct BundleResult {
  double initial_cost = 0;
  double final_cost = 0;
  double initial_rmse_px = 0;  ///< of u, v over sigma_px; all observations before the camera
  double final_rmse_px = 0;
  int num_iterations = 0;
  bool cancelled = false;
  /// Per observation: beyond the chi-square bound or behind the camera after adjustment.
  std::vector<bool> outliers;
};

/// Observations and relative poses together; rmse and outliers are of observations alone. Ceres, Huber loss, Schur
/// elimination of the points, analytic Jacobians; solver chosen by size (dense Schur below 100 free frames, else sparse
/// or iterative). The caller fixes the gauge: at least one frame must be fixed. Writes poses and points in place;
/// untouched on error. INVALID_ARGUMENT for indices out of range or no fixed frame.
StatusOr<BundleResult> AdjustBundle(BundleProblem& problem, const BundleOptions& options);

}  // namespace mapp
