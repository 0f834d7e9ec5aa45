#include "sim/world/visit_plan.h"

#include "mapp/base/rng.h"
#include "sim/world/motion_spline.h"
#include "sim/world/route_walk.h"
#include "sim/world/user_motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace mapp::sim {
namespace {

constexpr int64_t kSecondNs = 1'000'000'000;
constexpr int64_t kHourNs = 3600 * kSecondNs;
constexpr int kMaxUsers = 10'000;
constexpr double kMaxPath_m = 10'000;
constexpr double kMaxRateHz = 1000;
/// Even through many corners nobody is slower than this on the whole.
constexpr double kSlowest_m_s = 0.2;

/// Independent random numbers for each use.
enum class Purpose : uint64_t { kWalks = 1, kGait, kMotion, kImu };
uint64_t SeedOf(uint64_t seed, Purpose purpose, int user) {
  Rng rng(seed);
  Rng of_purpose(rng.Next() + static_cast<uint64_t>(purpose));
  return Rng(of_purpose.Next() + static_cast<uint64_t>(user)).Next();
}

bool IsFlown(const std::string& setting) { return setting == "hall" || setting == "city"; }

std::vector<std::string> CamerasOf(const SimulationOptions& options) {
  if (!options.cameras.empty()) return options.cameras;
  if (options.setting == "hall") return {"euroc"};
  if (options.setting == "city") return {"city"};
  return {"d455-1280", "d455-848", "d455-640"};
}

Status CheckOptions(const SimulationOptions& options) {
  if (options.num_users < 1 || options.num_users > kMaxUsers) {
    return absl::InvalidArgumentError(
        fmt::format("num_users: must be in [1, {}], got {}", kMaxUsers, options.num_users));
  }
  if (!(options.path_m > 0 && options.path_m <= kMaxPath_m)) {
    return absl::InvalidArgumentError(fmt::format("path_m: must be in (0, {}], got {}", kMaxPath_m, options.path_m));
  }
  if (!(options.rate_hz == 0 || (options.rate_hz >= 0.1 && options.rate_hz <= kMaxRateHz))) {
    return absl::InvalidArgumentError(
        fmt::format("rate_hz: must be 0 or in [0.1, {}], got {}", kMaxRateHz, options.rate_hz));
  }
  if (options.num_routes < 0 || options.num_routes > options.num_users) {
    return absl::InvalidArgumentError(fmt::format("num_routes: must be in [0, {}], the number of users, got {}",
                                                  options.num_users, options.num_routes));
  }
  if (!(options.max_duration_s >= 0)) {
    return absl::InvalidArgumentError(
        fmt::format("max_duration_s: must be at least 0, got {}", options.max_duration_s));
  }
  for (const std::string& camera : options.cameras) {
    MAPP_RETURN_IF_ERROR(MakeRig(camera, options.sensor).status());
  }
  return absl::OkStatus();
}

StatusOr<std::vector<StampedPose>> ReadTrajectory(const std::string& file, double max_duration_s) {
  MAPP_ASSIGN_OR_RETURN(std::vector<StampedPose> poses, ReadTumTrajectory(file));
  MAPP_RETURN_IF_ERROR(Annotate(MotionSpline::Through(poses).status(), file));
  const int64_t first_ns = poses.front().stamp_ns;
  for (StampedPose& pose : poses) pose.stamp_ns -= first_ns;
  if (max_duration_s > 0) {
    std::erase_if(poses,
                  [&](const StampedPose& pose) { return static_cast<double>(pose.stamp_ns) * 1e-9 > max_duration_s; });
    MAPP_RETURN_IF_ERROR(Annotate(MotionSpline::Through(poses).status(), file));
  }
  return poses;
}

/// The poses with `other` multiplied from the right, `shift_ns` later.
std::vector<StampedPose> Moved(const std::vector<StampedPose>& poses, const Pose3& other, int64_t shift_ns) {
  std::vector<StampedPose> moved;
  moved.reserve(poses.size());
  for (const StampedPose& pose : poses) moved.push_back({pose.stamp_ns + shift_ns, pose.T_world_camera * other});
  return moved;
}

std::vector<StampedPose> SampleAtRate(const MotionSpline& motion, const Pose3& T_body_camera, double rate_hz) {
  std::vector<StampedPose> poses;
  for (int64_t i = 0;; ++i) {
    const int64_t stamp_ns = motion.start_ns() + std::llround(static_cast<double>(i) * 1e9 / rate_hz);
    if (stamp_ns > motion.end_ns()) return poses;
    poses.push_back({stamp_ns, motion.At(stamp_ns).T_world_body * T_body_camera});
  }
}

double PathLength(const std::vector<StampedPose>& poses) {
  double length_m = 0;
  for (size_t i = 1; i < poses.size(); ++i) length_m += Distance(poses[i - 1].T_world_camera, poses[i].T_world_camera);
  return length_m;
}

Status CheckInside(const Aabb& bounds_world, const std::vector<StampedPose>& poses, int64_t start_ns) {
  for (const StampedPose& pose : poses) {
    const Eigen::Vector3d& p_world = pose.T_world_camera.translation();
    if (bounds_world.contains(p_world)) continue;
    const Eigen::Vector3d& low = bounds_world.min();
    const Eigen::Vector3d& high = bounds_world.max();
    return absl::InvalidArgumentError(fmt::format(
        "leaves the world {:.2f} s after its start, at ({:.2f}, {:.2f}, {:.2f}) m: the world reaches from ({:.2f}, "
        "{:.2f}, {:.2f}) to ({:.2f}, {:.2f}, {:.2f}) m",
        static_cast<double>(pose.stamp_ns - start_ns) * 1e-9, p_world.x(), p_world.y(), p_world.z(), low.x(), low.y(),
        low.z(), high.x(), high.y(), high.z()));
  }
  return absl::OkStatus();
}

/// Everything of a visit that follows from how the camera moves; images at the poses' own times if `rate_hz` is 0.
StatusOr<Visit> MakeVisit(const std::vector<StampedPose>& T_world_camera, double rate_hz, int user, CameraRig rig,
                          uint64_t seed) {
  Visit visit;
  visit.user = user;
  MAPP_ASSIGN_OR_RETURN(const MotionSpline motion,
                        MotionSpline::Through(Moved(T_world_camera, rig.T_body_camera.Inverse(), 0)));
  visit.poses = rate_hz == 0 ? T_world_camera : SampleAtRate(motion, rig.T_body_camera, rate_hz);
  visit.path_m = PathLength(visit.poses);
  if (rate_hz > 0) rig.rate_hz = rate_hz;
  if (rig.sensor == SensorKind::kStereo || rig.sensor == SensorKind::kMonoInertial) {
    visit.imu = ReadImu(motion, rig.imu_rate_hz, ImuNoise(), SeedOf(seed, Purpose::kImu, user));
  }
  visit.rig = std::move(rig);
  return visit;
}

}  // namespace

StatusOr<VisitPlan> MakeVisitPlan(const SimulationOptions& options) {
  MAPP_RETURN_IF_ERROR(CheckOptions(options));
  VisitPlan plan;
  for (const std::string& file : options.trajectory_files) {
    MAPP_ASSIGN_OR_RETURN(plan.trajectories.emplace_back(), ReadTrajectory(file, options.max_duration_s));
    plan.longest_ns = std::max(plan.longest_ns, plan.trajectories.back().back().stamp_ns);
  }
  if (plan.trajectories.empty()) {
    plan.longest_ns = 10 * kSecondNs + std::llround(options.path_m / kSlowest_m_s) * kSecondNs;
  }
  const int64_t pause_ns = kHourNs / 10;  // when nobody is there
  plan.period_ns = (plan.longest_ns + pause_ns + kHourNs - 1) / kHourNs * kHourNs;
  return plan;
}

StatusOr<std::vector<Visit>> PlanVisits(const World& world, const SimulationOptions& options, const VisitPlan& plan) {
  const std::vector<std::string> cameras = CamerasOf(options);
  std::vector<std::vector<size_t>> walks;
  if (plan.trajectories.empty()) {
    MAPP_ASSIGN_OR_RETURN(
        walks, PlanWalks(world.routes, options.num_users, options.path_m, SeedOf(options.seed, Purpose::kWalks, 0)));
  }
  std::vector<Visit> visits;
  for (int user = 0; user < options.num_users; ++user) {
    const auto idx = static_cast<size_t>(user);
    const int64_t start_ns = plan.StartOf(user);
    MAPP_ASSIGN_OR_RETURN(CameraRig rig, MakeRig(cameras[idx % cameras.size()], options.sensor));
    if (walks.empty()) {
      const size_t file_idx = idx % plan.trajectories.size();
      const auto poses = Moved(plan.trajectories[file_idx], Pose3(), start_ns);
      MAPP_RETURN_IF_ERROR(
          Annotate(CheckInside(world.bounds_world, poses, start_ns), options.trajectory_files[file_idx]));
      MAPP_ASSIGN_OR_RETURN(visits.emplace_back(),
                            MakeVisit(poses, options.rate_hz, user, std::move(rig), options.seed));
      continue;
    }
    const uint64_t gait_seed = SeedOf(options.seed, Purpose::kGait, user);
    const Gait gait = IsFlown(options.setting) ? FlyingGait(gait_seed) : WalkingGait(gait_seed);
    const size_t route = options.num_routes > 0 ? idx % static_cast<size_t>(options.num_routes) : idx;
    const auto poses = MoveAlong(world.routes, walks[route], options.path_m, gait, start_ns,
                                 SeedOf(options.seed, Purpose::kMotion, user));
    const double rate_hz = options.rate_hz > 0 ? options.rate_hz : rig.rate_hz;
    MAPP_ASSIGN_OR_RETURN(visits.emplace_back(), MakeVisit(poses, rate_hz, user, std::move(rig), options.seed));
  }
  return visits;
}

StatusOr<std::vector<Visit>> PlanVisits(const World& world, const SimulationOptions& options) {
  MAPP_ASSIGN_OR_RETURN(const VisitPlan plan, MakeVisitPlan(options));
  return PlanVisits(world, options, plan);
}

}  // namespace mapp::sim
