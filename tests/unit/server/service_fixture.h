#pragma once

#include "server/service/map_service.h"
#include "storage/map_store.h"
#include "tests/support/synthetic_world.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <string>

namespace mapp::testing {

/// A map service over a real database in a folder of its own.
class ServiceFixture : public ::testing::Test {
 protected:
  ServiceFixture();
  ~ServiceFixture() override;

  SessionId Open(SensorKind sensor = SensorKind::kRgbd, const std::string& map_name = "room",
                 const FeatureSettings& features = {});
  StatusOr<UploadResult> Upload(const Keyframe& keyframe);
  /// Uploads what the world shows at the pose, told in the map's frame of a founder (which the world's frame is).
  UploadResult MustUpload(const SyntheticWorld& world, const Pose3& T_world_camera, SessionId session, uint32_t number,
                          uint64_t first_session_point = 1);
  /// Overlap of a view by the device's own count, as DESIGN 5 has it.
  double Overlap(const SyntheticWorld& world, const Pose3& T_world_camera, SessionId session,
                 SamplerKind sampler = SamplerKind::kDepthSketch);
  /// Tells the store that the session's frame is the map's, as alignment would.
  void Align(SessionId session);

  MapRecord Map(const std::string& name = "room");
  SessionRecord Session(SessionId session);

  CallContext context_ = CallContext::WithTimeout(std::chrono::seconds(30));
  SyntheticWorld world_{1};
  Rng rng_{2};
  std::filesystem::path folder_;
  std::unique_ptr<MapStore> store_;
  std::unique_ptr<MapService> service_;
};

/// Folder that no other test uses.
std::filesystem::path MakeTestFolder();

}  // namespace mapp::testing
