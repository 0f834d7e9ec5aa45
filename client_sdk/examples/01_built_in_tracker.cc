// A device with the built-in tracker: plays a recorded sequence into a shared map and prints where it is.
//
//   mapp-server --db maps.db &
//   01_built_in_tracker SEQUENCE_FOLDER MAP_NAME [SERVER]

#include "datasets/sequence.h"
#include "mapp/client/device.h"

#include <cstdio>
#include <string>

namespace {

using std::chrono::seconds;

mapp::StatusOr<std::unique_ptr<mapp::OrbTracker>> MakeTracker(const mapp::Sequence& sequence) {
  const mapp::OrbTrackerOptions options;
  if (sequence.sensor() == mapp::SensorKind::kRgbd) return mapp::OrbTracker::CreateRgbd(sequence.camera(), options);
  if (!sequence.right_camera()) return mapp::OrbTracker::CreateMono(sequence.camera(), options);
  return mapp::OrbTracker::CreateStereo(sequence.camera(), *sequence.right_camera(), sequence.T_left_right(), options);
}

void Print(int64_t stamp_ns, const mapp::DevicePose& pose) {
  if (!pose.T_map_camera) return;  // not aligned with the map yet, or lost
  const Eigen::Vector3d& p_map = pose.T_map_camera->translation();
  std::printf("%.3f  %.3f %.3f %.3f%s\n", static_cast<double>(stamp_ns) * 1e-9, p_map.x(), p_map.y(), p_map.z(),
              pose.tracking.on_shared_map ? "  (on the shared map)" : "");
}

mapp::Status Run(const std::string& folder, const std::string& map_name, const std::string& server) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<mapp::Sequence> sequence, mapp::OpenSequence(folder));
  MAPP_ASSIGN_OR_RETURN(std::unique_ptr<mapp::OrbTracker> tracker, MakeTracker(*sequence));

  mapp::MapClientOptions client;
  client.server_address = server;
  mapp::ParticipantOptions options;
  options.map_name = map_name;
  options.device = "example 01";
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<mapp::Device> device,
                        mapp::Device::Open(std::move(tracker), client, options));

  for (size_t i = 0; i < sequence->num_frames(); ++i) {
    MAPP_ASSIGN_OR_RETURN(const mapp::SequenceFrame frame, sequence->Read(i));
    mapp::TrackerFrame images;
    images.stamp_ns = frame.stamp_ns;
    images.gray = frame.gray.View();
    if (!frame.depth_m.empty()) images.depth_m = frame.depth_m.View();
    if (!frame.right_gray.empty()) images.right_gray = frame.right_gray.View();
    // Never waits for the network: a server that is away costs the map some growth, not the device its pose.
    MAPP_ASSIGN_OR_RETURN(const mapp::DevicePose pose, device->Track(images));
    Print(frame.stamp_ns, pose);
  }
  return device->Close(seconds(60), /*wait_for_optimization=*/false);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3 || argc > 4) {
    std::fprintf(stderr, "usage: %s SEQUENCE_FOLDER MAP_NAME [SERVER]\n", argv[0]);
    return 2;
  }
  const mapp::Status status = Run(argv[1], argv[2], argc == 4 ? argv[3] : "127.0.0.1:7878");
  if (status.ok()) return 0;
  std::fprintf(stderr, "%s\n", status.ToString().c_str());
  return 1;
}
