#include "datasets/sequence.h"
#include "datasets/table_file.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <fstream>

namespace mapp {
namespace {

// Published trajectories round quaternions to a few decimals; more than this is not a rotation.
constexpr double kMaxQuaternionNormError = 0.01;

StatusOr<StampedPose> ParsePose(const std::string& file, const TableRow& row) {
  const std::optional<int64_t> stamp_ns = ParseSeconds(row.fields[0]);
  if (!stamp_ns) return BadLine(file, row.line, fmt::format("'{}' is not a time in seconds", row.fields[0]));
  std::array<double, 7> values{};
  for (size_t i = 0; i < values.size(); ++i) {
    const std::optional<double> value = ParseNumber(row.fields[i + 1]);
    if (!value) return BadLine(file, row.line, fmt::format("'{}' is not a number", row.fields[i + 1]));
    values[i] = *value;
  }
  const Eigen::Quaterniond rotation(values[6], values[3], values[4], values[5]);
  if (std::abs(rotation.norm() - 1.0) > kMaxQuaternionNormError) {
    return BadLine(file, row.line, fmt::format("quaternion must have norm 1, got {:.6g}", rotation.norm()));
  }
  return StampedPose{*stamp_ns, Pose3(rotation, {values[0], values[1], values[2]})};
}

}  // namespace

StatusOr<std::vector<StampedPose>> ReadTumTrajectory(const std::string& file) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<TableRow> rows, ReadTable(file, ' ', 8));
  std::vector<StampedPose> poses;
  poses.reserve(rows.size());
  for (const TableRow& row : rows) {
    MAPP_ASSIGN_OR_RETURN(poses.emplace_back(), ParsePose(file, row));
  }
  return poses;
}

Status WriteTumTrajectory(const std::string& file, const std::vector<StampedPose>& poses) {
  std::ofstream stream(file);
  if (!stream) return absl::NotFoundError(fmt::format("{}: cannot be created", file));
  stream << "# t[s] tx ty tz qx qy qz qw (metres)\n";
  for (const StampedPose& pose : poses) {
    const Eigen::Vector3d& t = pose.T_world_camera.translation();
    const Eigen::Quaterniond& q = pose.T_world_camera.rotation();
    stream << fmt::format("{}.{:09d} {:.6f} {:.6f} {:.6f} {:.7f} {:.7f} {:.7f} {:.7f}\n", pose.stamp_ns / 1'000'000'000,
                          pose.stamp_ns % 1'000'000'000, t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
  }
  stream.close();
  if (!stream) return absl::ResourceExhaustedError(fmt::format("{}: cannot be written to its end", file));
  return absl::OkStatus();
}

}  // namespace mapp
