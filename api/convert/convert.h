#pragma once

#include "mapp/base/id.h"
#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/feature/feature_settings.h"
#include "mapp/geometry/oriented_box.h"
#include "mapp/geometry/pose3.h"
#include "mapp/map/tile.h"
#include "mapp/v1/types.pb.h"

#include <string>

/// proto <-> core. What comes from outside is validated here: every FromProto gives INVALID_ARGUMENT with a message
/// that begins with the path of the offending field and a colon. `field` is the path of the message converted.
namespace mapp {

v1::Pose ToProto(const Pose3& pose);
/// Refuses non-finite values, coordinates beyond kMaxCoordinateM and quaternions whose length is off by over 1e-3.
StatusOr<Pose3> FromProto(const v1::Pose& pose, const std::string& field);

/// Of `scale_map_session`: 0 means 1. Refuses what is not finite or negative.
StatusOr<double> ScaleFromProto(double scale, const std::string& field);

v1::Point3 ToProto(const Eigen::Vector3d& point);
v1::Box ToProto(const Aabb& box);
v1::OrientedBox ToProto(const OrientedBox& box);

v1::SensorKind ToProto(SensorKind kind);
StatusOr<SensorKind> FromProto(v1::SensorKind kind, const std::string& field);

v1::Camera ToProto(const Camera& camera);
/// Camera::Validate() included.
StatusOr<Camera> FromProto(const v1::Camera& camera, const std::string& field);

v1::FeatureSettings ToProto(const FeatureSettings& settings);
/// FeatureSettings::Validate() included.
StatusOr<FeatureSettings> FromProto(const v1::FeatureSettings& settings, const std::string& field);

/// Session ids count from 1; 0 is a field that was not set.
StatusOr<SessionId> SessionIdFromProto(uint32_t id, const std::string& field);
/// Refuses bits that TileKey::Packed never sets.
StatusOr<TileKey> TileKeyFromProto(uint64_t packed, const std::string& field);

/// INVALID_ARGUMENT unless `value` is finite and within [low, high].
Status ValidateRange(double value, double low, double high, const std::string& field);

}  // namespace mapp
