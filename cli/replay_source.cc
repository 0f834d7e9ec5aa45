#include "cli/replay_source.h"

#include "cli/feature_source.h"
#include "cli/image_source.h"
#include "cli/sequence_source.h"
#include "sim/room.h"

#include <fmt/format.h>

#include <utility>

namespace mapp {
namespace {

StatusOr<std::unique_ptr<ReplaySource>> OpenRoomFeatures(const std::string& name, const RoomSpec& room) {
  MAPP_ASSIGN_OR_RETURN(const auto scene, sim::BuildRoom(room.seed));
  auto world = std::make_shared<sim::World>();
  world->setting = "room";
  world->seed = room.seed;
  world->surroundings = *scene;
  sim::Visit visit;
  visit.user = static_cast<int>(room.session);
  visit.rig.name = "room";
  visit.rig.camera = sim::RoomCamera();
  visit.poses = sim::RoomTrajectory(visit.user);
  return MakeFeatureSource(name, std::make_shared<const sim::FeatureWorld>(std::move(world)), std::move(visit),
                           room.session);
}

}  // namespace

StatusOr<std::unique_ptr<ReplaySource>> OpenReplaySource(const std::string& name, ReplayLevel level) {
  if (level == ReplayLevel::kImages) {
    MAPP_ASSIGN_OR_RETURN(auto sequence, OpenSequenceSource(name));
    return MakeImageSource(std::move(sequence));
  }
  if (const std::optional<RoomSpec> room = ParseRoomSpec(name)) return OpenRoomFeatures(name, *room);
  return absl::InvalidArgumentError(fmt::format("--level features: {} is not simulated", name));
}

}  // namespace mapp
