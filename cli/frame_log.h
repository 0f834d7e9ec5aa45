#pragma once

#include "mapp/base/status.h"
#include "mapp/geometry/pose3.h"

#include <cstdint>
#include <string>
#include <vector>

namespace mapp {

/// What became of a frame beyond its pose.
enum class FrameRole {
  kOrdinary,
  kKeyframe,        ///< the device made a keyframe of it
  kSharedKeyframe,  ///< on a shared map; mapping for itself, the device would have made a keyframe of it
};

struct LoggedFrame {
  int64_t stamp_ns = 0;
  Pose3 T_map_camera;
  bool on_shared_map = false;
  FrameRole role = FrameRole::kOrdinary;
};

/// The tracked frames of one session in the map's frame, for `mapp render`.
struct FrameLog {
  uint64_t session_id = 0;
  std::vector<LoggedFrame> frames;
};

/// CSV: for each session a line `# session N`, a line of column names, then
/// `stamp_ns,tx_m,ty_m,tz_m,qw,qx,qy,qz,on_shared_map,role` for each frame, `role` being one of `ordinary`,
/// `keyframe`, `shared`.
std::string FormatFrameLogs(const std::vector<FrameLog>& logs);
/// At least one. INVALID_ARGUMENT naming the line that does not parse. `name` stands for the file in errors.
StatusOr<std::vector<FrameLog>> ParseFrameLogs(const std::string& name, const std::string& text);

}  // namespace mapp
