// What a frame costs at the feature level and rendered, CPU time, for the same frames of a garage: drawing and ORB
// extraction on one side; on the other the features straight from the world, with the textures met for the first time
// and once they are known.
//
//   feature_bench [CAMERA [EVERY]]   CAMERA as of `mapp simulate` (euroc: 752 x 480), each EVERY-th frame at 15 Hz

#include "bench/value_or_exit.h"
#include "mapp/base/process_usage.h"
#include "sim/features/feature_camera.h"
#include "sim/world/visit_sequence.h"
#include "vision/orb_extractor.h"

#include <fmt/format.h>

#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

namespace mapp::sim {
namespace {

/// CPU milliseconds of all threads since the last call.
class CpuClock {
 public:
  double Lap() {
    const double now_s = GetProcessUsage().cpu_s;
    return 1e3 * (now_s - std::exchange(last_s_, now_s));
  }

 private:
  double last_s_ = GetProcessUsage().cpu_s;
};

int Main(const std::string& camera, size_t every) {
  SimulationOptions options;
  options.path_m = 40;
  options.rate_hz = 15;
  options.cameras = {camera};
  const auto simulation = ValueOrExit(Simulate(options));
  const Visit& visit = simulation->visits.front();
  std::vector<StampedPose> poses;
  for (size_t i = 0; i < visit.poses.size(); i += every) poses.push_back(visit.poses[i]);
  const auto frames = static_cast<double>(poses.size());
  fmt::print("{} frames, {} x {}; CPU ms\n", poses.size(), visit.rig.camera.width_px, visit.rig.camera.height_px);

  CpuClock clock;
  const auto world = std::make_shared<const FeatureWorld>(simulation->world);
  world->At(poses.front().stamp_ns);
  const auto features = ValueOrExit(FeatureCamera::Create(world, visit.rig, {}, 1));
  fmt::print("features: world        {:8.1f}\n", clock.Lap());
  const auto observe = [&] {
    for (const StampedPose& pose : poses) features->Observe(pose.T_world_camera, pose.stamp_ns);
    return clock.Lap() / frames;
  };
  const double first_ms = observe();
  fmt::print("features: frame, first {:8.2f}\n", first_ms);
  const double again_ms = observe();
  fmt::print("features: frame, again {:8.2f}\n", again_ms);

  const auto sequence = ValueOrExit(OpenVisit(simulation, 0));
  const auto extractor = ValueOrExit(OrbExtractor::Create({}));
  SequenceFrame frame = ValueOrExit(sequence->Read(0));
  fmt::print("images: world          {:8.1f}\n", clock.Lap());
  double draw_ms = 0, extract_ms = 0;
  for (size_t i = 0; i < poses.size(); ++i) {
    frame = ValueOrExit(sequence->Read(every * i));
    draw_ms += clock.Lap() / frames;
    ValueOrExit(extractor->Extract(frame.gray.View()));
    extract_ms += clock.Lap() / frames;
  }
  fmt::print("images: draw a frame   {:8.2f}\nimages: ORB of it      {:8.2f}\n", draw_ms, extract_ms);
  const double images_ms = draw_ms + extract_ms;
  fmt::print("cheaper by {:.1f} with new textures, {:.1f} without\n", images_ms / first_ms, images_ms / again_ms);
  return 0;
}

}  // namespace
}  // namespace mapp::sim

int main(int argc, char** argv) {
  return mapp::sim::Main(argc > 1 ? argv[1] : "euroc", argc > 2 ? std::stoul(argv[2]) : 4);
}
