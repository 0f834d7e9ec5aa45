#pragma once

#include "datasets/sequence.h"
#include "mapp/base/status.h"
#include "sim/scene.h"
#include "sim/sensor_noise.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace mapp::sim {

/// A furnished room of about 6 x 5 x 3 m. Its world frame stands on the middle of the floor, z up. Another seed gives
/// a room with other pictures, tones and places of things: another place. RESOURCE_EXHAUSTED without memory.
StatusOr<std::shared_ptr<const Scene>> BuildRoom(uint64_t seed);

/// The depth camera carried through the room: 640 x 480 pixels, without distortion.
Camera RoomCamera();

/// T_world_camera at 15 Hz, 150 poses, the same for every room; at most 4 cm and 2.5 degrees from one to the next.
/// Session 0 walks round the table and looks around, but never at one corner of the room. Session 1 starts elsewhere
/// and looks the other way, sees mostly what session 0 saw, and that corner in between. Each further session starts
/// at a place of its own. Times of different sessions do not overlap. `session` in
/// [0, 1000000].
std::vector<StampedPose> RoomTrajectory(int session);

struct RoomOptions {
  uint64_t seed = 1;  ///< of the room
  int session = 0;    ///< of the walk, and of the noise
  SensorNoise noise{};
  int num_threads = 2;  ///< that draw one frame; at least 1
};

/// The session as an RGB-D sequence called "room", drawn frame by frame when read; nothing touches the disk.
/// INVALID_ARGUMENT: an option out of range.
StatusOr<std::unique_ptr<Sequence>> MakeRoomSequence(const RoomOptions& options);

/// Writes the session as a TUM RGB-D folder that OpenSequence() reads; `folder` is created, files in it are
/// overwritten. `progress` as in SequenceWriterOptions. RESOURCE_EXHAUSTED naming the file when something cannot be
/// written.
Status WriteRoomSequence(const std::string& folder, const RoomOptions& options,
                         const std::function<bool(size_t num_written)>& progress = {});

}  // namespace mapp::sim
