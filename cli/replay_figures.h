#pragma once

#include "cli/replay_player.h"
#include "cli/replay_report.h"
#include "cli/replay_source.h"

#include <vector>

namespace mapp {

/// What the played frames and the device's participation come to, put into the report.
void FillFrames(const std::vector<PlayedFrame>& frames, ReplayReport& report);
void FillFragments(const std::vector<DeviceFragment>& fragments, ReplayReport& report);
void FillParticipation(const ReplayDevice& device, ReplayReport& report);

}  // namespace mapp
