#include "cli/replay_source.h"

#include "cli/feature_source.h"
#include "cli/image_source.h"
#include "cli/sequence_source.h"
#include "cli/visit_spec.h"
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

StatusOr<std::unique_ptr<ReplaySource>> OpenVisitFeatures(const std::string& name) {
  MAPP_ASSIGN_OR_RETURN(const VisitSpec spec, ParseVisitSpec(name));
  MAPP_ASSIGN_OR_RETURN(const auto simulation, sim::Simulate(spec.simulation));
  const sim::Visit& visit = simulation->visits.at(static_cast<size_t>(spec.user));
  return MakeFeatureSource(name, std::make_shared<const sim::FeatureWorld>(simulation->world), visit,
                           static_cast<uint64_t>(visit.poses.front().stamp_ns));
}

}  // namespace

StatusOr<std::unique_ptr<ReplaySource>> OpenReplaySource(const std::string& name, ReplayLevel level) {
  if (level == ReplayLevel::kImages) {
    MAPP_ASSIGN_OR_RETURN(auto sequence, OpenSequenceSource(name));
    return MakeImageSource(std::move(sequence));
  }
  if (const std::optional<RoomSpec> room = ParseRoomSpec(name)) return OpenRoomFeatures(name, *room);
  if (name.starts_with("sim:")) return OpenVisitFeatures(name);
  return absl::InvalidArgumentError(fmt::format("--level features: {} is not simulated", name));
}

}  // namespace mapp
