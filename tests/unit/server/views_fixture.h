#pragma once

#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/tile_codec.h"
#include "tests/unit/server/service_fixture.h"

#include <string>
#include <utility>
#include <vector>

namespace mapp::testing {

/// A map of the half of the room around the cabinet: three views towards +z.
class ViewsTest : public ServiceFixture {
 protected:
  ViewsTest() : session_(Open()) {
    MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), session_, 0);
    MustUpload(world_, SyntheticWorld::Stand(-1, -2, 0.2), session_, 1);
    MustUpload(world_, SyntheticWorld::Stand(1, -2, -0.2), session_, 2);
  }

  std::string Packet(const SyntheticWorld& world, const Pose3& T_world_camera) {
    return EncodeKeyframe(world.View(T_world_camera, session_, 10, rng_, 100'000));
  }

  SharedMapInput Request(const Pose3& T_world_camera) const {
    SharedMapInput input;
    input.session = session_;
    input.view.T_frame_camera = T_world_camera;
    return input;
  }

  SharedMapResult MustReceive(const SharedMapInput& input, std::vector<Tile>* tiles) {
    const StatusOr<SharedMapResult> result =
        service_->RequestSharedMap(context_, input, [&](const std::string& bytes) -> Status {
          MAPP_ASSIGN_OR_RETURN(Tile tile, DecodeTile(bytes));
          tiles->push_back(std::move(tile));
          return absl::OkStatus();
        });
    EXPECT_TRUE(result.ok()) << result.status();
    return *result;
  }

  SessionId session_;
  const Pose3 seen_ = SyntheticWorld::Stand(0.1, -1.9, 0.03);
  const Pose3 opposite_ = SyntheticWorld::Stand(0, 0, 3.14159);
};

}  // namespace mapp::testing
