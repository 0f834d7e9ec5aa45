#include "sim/sequence_writer.h"

#include "datasets/calibration.h"
#include "datasets/image_file.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <string_view>
#include <utility>

namespace mapp::sim {
namespace {

namespace fs = std::filesystem;

constexpr double kDepthUnitsPerMetre = 5000;  // the TUM data set's: 0.2 mm, up to 13 m

Status MakeFolder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return absl::ResourceExhaustedError(fmt::format("{}: {}", folder.string(), error.message()));
  return absl::OkStatus();
}

Status WriteText(const fs::path& file, std::string_view text) {
  std::ofstream stream(file, std::ios::binary);
  stream << text;
  stream.close();
  if (!stream) return absl::ResourceExhaustedError(fmt::format("{}: cannot be written", file.string()));
  return absl::OkStatus();
}

Status WriteCamera(const fs::path& file, const Camera& camera, const Pose3& T_body_camera, double rate_hz) {
  return WriteCameraCalibration(file.string(), {camera, T_body_camera, kDepthUnitsPerMetre}, rate_hz);
}

/// The left or colour image.
Status WriteImage(const fs::path& file, const ColoredFrame& frame) {
  if (frame.color.empty()) return WriteGrayImage(file.string(), frame.frame.gray);
  return WriteColorImage(file.string(), frame.color);
}

StatusOr<ColoredFrame> ReadFrame(const Sequence& sequence, size_t frame_idx, const SequenceWriterOptions& options) {
  if (options.read_colored) return options.read_colored(frame_idx);
  MAPP_ASSIGN_OR_RETURN(SequenceFrame frame, sequence.Read(frame_idx));
  return ColoredFrame{std::move(frame), {}};
}

/// Reads frame by frame, has `write` write each, and reports.
Status ForEachFrame(const Sequence& sequence, const SequenceWriterOptions& options,
                    const std::function<Status(size_t frame_idx, const ColoredFrame& frame)>& write) {
  for (size_t i = 0; i < sequence.num_frames(); ++i) {
    MAPP_ASSIGN_OR_RETURN(const ColoredFrame frame, ReadFrame(sequence, i, options));
    MAPP_RETURN_IF_ERROR(write(i, frame));
    if (options.progress && !options.progress(i + 1)) return absl::CancelledError("stopped");
  }
  return absl::OkStatus();
}

/// The list of one kind of image, "time folder/index.ending" a line.
std::string TumList(const std::string& kind, const std::string& ending, const Sequence& sequence) {
  std::string list = "# timestamp filename\n";
  for (size_t i = 0; i < sequence.num_frames(); ++i) {
    const int64_t stamp_ns = sequence.stamp_ns(i);
    list +=
        fmt::format("{}.{:09d} {}/{:06d}.{}\n", stamp_ns / 1'000'000'000, stamp_ns % 1'000'000'000, kind, i, ending);
  }
  return list;
}

Status WriteTum(const Sequence& sequence, const fs::path& root, const SequenceWriterOptions& options) {
  MAPP_RETURN_IF_ERROR(MakeFolder(root / "rgb"));
  MAPP_RETURN_IF_ERROR(MakeFolder(root / "depth"));
  MAPP_RETURN_IF_ERROR(WriteCamera(root / "camera.yaml", sequence.camera(), options.T_body_camera, options.rate_hz));
  MAPP_RETURN_IF_ERROR(WriteText(root / "rgb.txt", TumList("rgb", "jpg", sequence)));
  MAPP_RETURN_IF_ERROR(WriteText(root / "depth.txt", TumList("depth", "png", sequence)));
  return ForEachFrame(sequence, options, [&](size_t i, const ColoredFrame& frame) {
    MAPP_RETURN_IF_ERROR(WriteImage(root / "rgb" / fmt::format("{:06d}.jpg", i), frame));
    return WriteDepthImage((root / "depth" / fmt::format("{:06d}.png", i)).string(), frame.frame.depth_m,
                           kDepthUnitsPerMetre);
  });
}

std::string EurocName(int64_t stamp_ns) { return fmt::format("{}.jpg", stamp_ns); }

Status WriteEurocCamera(const Sequence& sequence, const fs::path& folder, const Camera& camera,
                        const Pose3& T_body_camera, double rate_hz) {
  MAPP_RETURN_IF_ERROR(MakeFolder(folder / "data"));
  MAPP_RETURN_IF_ERROR(WriteCamera(folder / "sensor.yaml", camera, T_body_camera, rate_hz));
  std::string list = "#timestamp [ns],filename\n";
  for (size_t i = 0; i < sequence.num_frames(); ++i) {
    list += fmt::format("{},{}\n", sequence.stamp_ns(i), EurocName(sequence.stamp_ns(i)));
  }
  return WriteText(folder / "data.csv", list);
}

Status WriteImu(const fs::path& folder, const SequenceWriterOptions& options) {
  MAPP_RETURN_IF_ERROR(MakeFolder(folder));
  const ImuNoise noise;
  MAPP_RETURN_IF_ERROR(WriteText(
      folder / "sensor.yaml",
      fmt::format("%YAML:1.0\nsensor_type: imu\n"
                  "T_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
                  "rate_hz: {}\n"
                  "gyroscope_noise_density: {} # rad/s/sqrt(Hz)\n"
                  "gyroscope_random_walk: {} # rad/s^2/sqrt(Hz)\n"
                  "accelerometer_noise_density: {} # m/s^2/sqrt(Hz)\n"
                  "accelerometer_random_walk: {} # m/s^3/sqrt(Hz)\n",
                  options.imu_rate_hz, noise.gyro_density, noise.gyro_walk, noise.accel_density, noise.accel_walk)));
  std::string rows =
      "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],"
      "a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n";
  for (const ImuSample& sample : options.imu) {
    const Eigen::Vector3d& w = sample.angular_velocity_body;
    const Eigen::Vector3d& a = sample.acceleration_body;
    rows += fmt::format("{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g}\n", sample.stamp_ns, w.x(), w.y(), w.z(), a.x(),
                        a.y(), a.z());
  }
  return WriteText(folder / "data.csv", rows);
}

Status WriteEuroc(const Sequence& sequence, const fs::path& root, const SequenceWriterOptions& options) {
  const fs::path left = root / "mav0" / "cam0";
  const fs::path right = root / "mav0" / "cam1";
  const std::optional<Camera>& right_camera = sequence.right_camera();
  MAPP_RETURN_IF_ERROR(WriteEurocCamera(sequence, left, sequence.camera(), options.T_body_camera, options.rate_hz));
  if (right_camera) {
    MAPP_RETURN_IF_ERROR(WriteEurocCamera(sequence, right, *right_camera,
                                          options.T_body_camera * sequence.T_left_right(), options.rate_hz));
  }
  if (!options.imu.empty()) MAPP_RETURN_IF_ERROR(WriteImu(root / "mav0" / "imu0", options));
  return ForEachFrame(sequence, options, [&](size_t, const ColoredFrame& frame) {
    const std::string name = EurocName(frame.frame.stamp_ns);
    MAPP_RETURN_IF_ERROR(WriteImage(left / "data" / name, frame));
    return right_camera ? WriteGrayImage((right / "data" / name).string(), frame.frame.right_gray) : absl::OkStatus();
  });
}

}  // namespace

Status WriteSequence(const Sequence& sequence, const std::string& folder, const SequenceWriterOptions& options) {
  const fs::path root(folder);
  MAPP_RETURN_IF_ERROR(MakeFolder(root));
  MAPP_RETURN_IF_ERROR(WriteTumTrajectory((root / "groundtruth.txt").string(), sequence.ground_truth()));
  return sequence.sensor() == SensorKind::kRgbd ? WriteTum(sequence, root, options)
                                                : WriteEuroc(sequence, root, options);
}

}  // namespace mapp::sim
