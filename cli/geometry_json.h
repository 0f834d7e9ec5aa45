#pragma once

#include "mapp/geometry/pose3.h"
#include "text/json_writer.h"

#include <optional>

namespace mapp {

/// `key` and [x, y, z].
inline void AppendPoint(const Eigen::Vector3d& p, const char* key, JsonWriter& json) {
  json.Key(key).BeginArray().Value(p.x()).Value(p.y()).Value(p.z()).EndArray();
}

/// `key` and the pose, its unit quaternion by parts; null without one.
inline void AppendPose(const std::optional<Pose3>& pose, const char* key, JsonWriter& json) {
  json.Key(key);
  if (!pose) {
    json.Null();
    return;
  }
  const Eigen::Vector3d& t = pose->translation();
  const Eigen::Quaterniond& q = pose->rotation();
  json.BeginObject().Field("tx_m", t.x()).Field("ty_m", t.y()).Field("tz_m", t.z());
  json.Field("qw", q.w()).Field("qx", q.x()).Field("qy", q.y()).Field("qz", q.z()).EndObject();
}

}  // namespace mapp
