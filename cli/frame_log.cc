#include "cli/frame_log.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <sstream>

namespace mapp {
namespace {

constexpr const char* kColumns = "stamp_ns,tx_m,ty_m,tz_m,qw,qx,qy,qz,on_shared_map,role";
constexpr const char* kSessionPrefix = "# session ";

const char* RoleName(FrameRole role) {
  switch (role) {
    case FrameRole::kKeyframe:
      return "keyframe";
    case FrameRole::kSharedKeyframe:
      return "shared";
    case FrameRole::kOrdinary:
      break;
  }
  return "ordinary";
}

std::optional<FrameRole> ParseRole(const std::string& name) {
  for (const FrameRole role : {FrameRole::kOrdinary, FrameRole::kKeyframe, FrameRole::kSharedKeyframe}) {
    if (name == RoleName(role)) return role;
  }
  return std::nullopt;
}

std::optional<LoggedFrame> ParseLine(const std::string& line) {
  std::istringstream stream(line);
  LoggedFrame frame;
  Eigen::Vector3d t;
  Eigen::Quaterniond q;
  char comma = ',';
  const auto next = [&](auto& value) {
    char separator = 0;
    return static_cast<bool>(stream >> separator >> value) && separator == comma;
  };
  if (!(stream >> frame.stamp_ns)) return std::nullopt;
  const bool numbers = next(t.x()) && next(t.y()) && next(t.z()) && next(q.w()) && next(q.x()) && next(q.y()) &&
                       next(q.z()) && next(frame.on_shared_map);
  std::string role_name;
  if (!numbers || !next(role_name)) return std::nullopt;
  const std::optional<FrameRole> role = ParseRole(role_name);
  constexpr double kUnitTolerance = 1e-3;
  if (!role || !t.allFinite() || !(std::abs(q.norm() - 1) < kUnitTolerance)) return std::nullopt;
  frame.role = *role;
  frame.T_map_camera = Pose3(q, t);
  return frame;
}

std::optional<uint64_t> ParseSession(const std::string& line) {
  uint64_t session_id = 0;
  if (!line.starts_with(kSessionPrefix)) return std::nullopt;
  if (!(std::istringstream(line.substr(std::string(kSessionPrefix).size())) >> session_id)) return std::nullopt;
  return session_id;
}

}  // namespace

std::string FormatFrameLogs(const std::vector<FrameLog>& logs) {
  std::string text;
  for (const FrameLog& log : logs) {
    text += fmt::format("{}{}\n{}\n", kSessionPrefix, log.session_id, kColumns);
    for (const LoggedFrame& frame : log.frames) {
      const Eigen::Vector3d& t = frame.T_map_camera.translation();
      const Eigen::Quaterniond& q = frame.T_map_camera.rotation();
      text += fmt::format("{},{:.6f},{:.6f},{:.6f},{:.9f},{:.9f},{:.9f},{:.9f},{},{}\n", frame.stamp_ns, t.x(), t.y(),
                          t.z(), q.w(), q.x(), q.y(), q.z(), frame.on_shared_map ? 1 : 0, RoleName(frame.role));
    }
  }
  return text;
}

StatusOr<std::vector<FrameLog>> ParseFrameLogs(const std::string& name, const std::string& text) {
  std::istringstream stream(text);
  std::string line;
  std::vector<FrameLog> logs;
  size_t line_number = 1;
  for (; std::getline(stream, line); ++line_number) {
    if (const std::optional<uint64_t> session_id = ParseSession(line)) {
      logs.push_back({*session_id, {}});
      ++line_number;
      if (std::getline(stream, line) && line == kColumns) continue;
      return absl::InvalidArgumentError(fmt::format("{}:{}: expected the columns {}", name, line_number, kColumns));
    }
    if (logs.empty()) break;
    std::optional<LoggedFrame> frame = ParseLine(line);
    if (!frame) return absl::InvalidArgumentError(fmt::format("{}:{}: not a frame: {}", name, line_number, line));
    logs.back().frames.push_back(*std::move(frame));
  }
  if (logs.empty()) return absl::InvalidArgumentError(fmt::format("{}:1: expected '{}N'", name, kSessionPrefix));
  return logs;
}

}  // namespace mapp
