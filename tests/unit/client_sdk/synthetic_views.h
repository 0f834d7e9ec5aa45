#pragma once

#include "mapp/map/keyframe.h"
#include "mapp/map/tile.h"

#include <vector>

namespace mapp {

/// 640x480 pinhole camera, 500 px focal length.
Camera TestCamera();

/// A whole keyframe at `T_session_camera` with `num_points` features spread over the image, each with a session point
/// between 2 and 4 m away, and one feature in ten more without a point. Point i has been observed 1 + i % 5 times.
Keyframe TestKeyframe(uint32_t number, const Pose3& T_session_camera, int num_points = 200);

/// T_map_session of the tests: the session's origin stands in the middle of tile 0/0/0's lower face, looking along +z.
Pose3 TestAlignment();

/// Tile 0/0/0 with `num_points` points, all in view of a camera at the session's origin under TestAlignment().
Tile TestTile(Revision revision, int num_points = 300);

}  // namespace mapp
