#include "api/convert/convert.h"

#include "mapp/map/keyframe.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace mapp {
namespace {

/// Quaternions travel as doubles, but many devices compute them in float: 1e-3 forgives those and nothing worse.
constexpr double kQuaternionTolerance = 1e-3;
/// TileKey::Packed uses 3 x 21 bits.
constexpr int kTileKeyBits = 63;

Status Invalid(const std::string& field, const std::string& what) {
  return absl::InvalidArgumentError(fmt::format("{}: {}", field, what));
}

/// `status` of a core validator whose messages name the field from `own_path` on ("camera.fx: ...") under `field`.
Status UnderField(const Status& status, std::string_view own_path, const std::string& field) {
  const std::string message(status.message().data(), status.message().size());
  if (message.starts_with(own_path)) return Status(status.code(), field + message.substr(own_path.size()));
  return Status(status.code(), fmt::format("{}: {}", field, message));
}

/// Numbers beyond int would wrap; every Validate() refuses what is this large.
int ClampedInt(uint32_t number) {
  constexpr uint32_t kLargest = 1U << 30;
  return static_cast<int>(std::min(number, kLargest));
}

}  // namespace

v1::Pose ToProto(const Pose3& pose) {
  v1::Pose proto;
  proto.set_tx_m(pose.translation().x());
  proto.set_ty_m(pose.translation().y());
  proto.set_tz_m(pose.translation().z());
  proto.set_qw(pose.rotation().w());
  proto.set_qx(pose.rotation().x());
  proto.set_qy(pose.rotation().y());
  proto.set_qz(pose.rotation().z());
  return proto;
}

StatusOr<Pose3> FromProto(const v1::Pose& pose, const std::string& field) {
  const Eigen::Vector3d translation(pose.tx_m(), pose.ty_m(), pose.tz_m());
  const Eigen::Quaterniond rotation(pose.qw(), pose.qx(), pose.qy(), pose.qz());
  if (!translation.allFinite()) return Invalid(field, "coordinates must be finite");
  if (translation.cwiseAbs().maxCoeff() > kMaxCoordinateM) {
    return Invalid(field, fmt::format("coordinates must be within {} m", kMaxCoordinateM));
  }
  const double length = rotation.norm();
  if (!(std::abs(length - 1) <= kQuaternionTolerance)) {
    return Invalid(field, fmt::format("the quaternion must have length 1, got {}", length));
  }
  return Pose3(rotation, translation);
}

StatusOr<double> ScaleFromProto(double scale, const std::string& field) {
  if (scale == 0) return 1.0;
  if (!std::isfinite(scale) || scale < 0) return Invalid(field, fmt::format("must be positive, got {}", scale));
  return scale;
}

v1::Point3 ToProto(const Eigen::Vector3d& point) {
  v1::Point3 proto;
  proto.set_x_m(point.x());
  proto.set_y_m(point.y());
  proto.set_z_m(point.z());
  return proto;
}

v1::Box ToProto(const Aabb& box) {
  v1::Box proto;
  *proto.mutable_min() = ToProto(Eigen::Vector3d(box.min()));
  *proto.mutable_max() = ToProto(Eigen::Vector3d(box.max()));
  return proto;
}

v1::OrientedBox ToProto(const OrientedBox& box) {
  v1::OrientedBox out;
  *out.mutable_pose() = ToProto(box.T_frame_box);
  out.set_size_x_m(box.size_m.x());
  out.set_size_y_m(box.size_m.y());
  out.set_size_z_m(box.size_m.z());
  return out;
}

v1::SensorKind ToProto(SensorKind kind) {
  switch (kind) {
    case SensorKind::kMono:
      return v1::SENSOR_KIND_MONO;
    case SensorKind::kMonoInertial:
      return v1::SENSOR_KIND_MONO_INERTIAL;
    case SensorKind::kStereo:
      return v1::SENSOR_KIND_STEREO;
    case SensorKind::kRgbd:
      return v1::SENSOR_KIND_RGBD;
  }
  return v1::SENSOR_KIND_UNSPECIFIED;
}

StatusOr<SensorKind> FromProto(v1::SensorKind kind, const std::string& field) {
  switch (kind) {
    case v1::SENSOR_KIND_MONO:
      return SensorKind::kMono;
    case v1::SENSOR_KIND_MONO_INERTIAL:
      return SensorKind::kMonoInertial;
    case v1::SENSOR_KIND_STEREO:
      return SensorKind::kStereo;
    case v1::SENSOR_KIND_RGBD:
      return SensorKind::kRgbd;
    default:
      return Invalid(field, fmt::format("unknown sensor kind {}", static_cast<int>(kind)));
  }
}

v1::Camera ToProto(const Camera& camera) {
  v1::Camera proto;
  proto.set_model(ModelName(camera.projection));
  for (const double coefficient : Coefficients(camera.projection)) proto.add_coefficients(coefficient);
  proto.set_width_px(static_cast<uint32_t>(camera.width_px));
  proto.set_height_px(static_cast<uint32_t>(camera.height_px));
  proto.set_stereo_baseline_m(camera.stereo_baseline_m);
  return proto;
}

StatusOr<Camera> FromProto(const v1::Camera& proto, const std::string& field) {
  const std::vector<double> coefficients(proto.coefficients().begin(), proto.coefficients().end());
  StatusOr<Projection> projection = MakeProjection(proto.model(), coefficients);
  if (!projection.ok()) return UnderField(projection.status(), "camera", field);
  Camera camera;
  camera.projection = *projection;
  camera.width_px = ClampedInt(proto.width_px());
  camera.height_px = ClampedInt(proto.height_px());
  camera.stereo_baseline_m = proto.stereo_baseline_m();
  if (const Status status = camera.Validate(); !status.ok()) return UnderField(status, "camera", field);
  return camera;
}

v1::FeatureSettings ToProto(const FeatureSettings& settings) {
  v1::FeatureSettings proto;
  proto.set_descriptor_kind(settings.descriptor_kind);
  proto.set_scale_factor(settings.scale_factor);
  proto.set_num_levels(static_cast<uint32_t>(settings.num_levels));
  proto.set_patch_size_px(static_cast<uint32_t>(settings.patch_size_px));
  return proto;
}

StatusOr<FeatureSettings> FromProto(const v1::FeatureSettings& proto, const std::string& field) {
  const FeatureSettings settings{.descriptor_kind = proto.descriptor_kind(),
                                 .scale_factor = proto.scale_factor(),
                                 .num_levels = ClampedInt(proto.num_levels()),
                                 .patch_size_px = ClampedInt(proto.patch_size_px())};
  const Status status = settings.Validate();
  if (!status.ok()) return UnderField(status, "feature_settings", field);
  return settings;
}

StatusOr<SessionId> SessionIdFromProto(uint32_t id, const std::string& field) {
  if (id == 0) return Invalid(field, "must be set");
  return SessionId(id);
}

StatusOr<TileKey> TileKeyFromProto(uint64_t packed, const std::string& field) {
  if (packed >> kTileKeyBits != 0) return Invalid(field, fmt::format("{:#x} is not a tile key", packed));
  return TileKey::FromPacked(packed);
}

Status ValidateRange(double value, double low, double high, const std::string& field) {
  if (value >= low && value <= high) return absl::OkStatus();
  return Invalid(field, fmt::format("must be in [{}, {}], got {}", low, high, value));
}

}  // namespace mapp
