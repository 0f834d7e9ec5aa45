#pragma once

#include "mapp/base/status.h"
#include "sim/scene.h"
#include "sim/world/world.h"

#include <string>

namespace mapp::sim {

// Both replace the file. RESOURCE_EXHAUSTED or FAILED_PRECONDITION naming the file that cannot be written; nothing
// half-written stays.

/// The surfaces as a binary little-endian PLY: four vertices (float x, y, z; metres, the scene's frame) and two
/// triangles a quad, whose corners run anticlockwise as seen from the front.
Status WriteMesh(const Scene& scene, const std::string& file);

/// All changes as JSON: {"setting", "seed", "changes": [{"time_s", "stamp_ns", "object", "kind", "model", "change",
/// "before", "after"}]}. `change` is "appeared", "vanished" or "moved"; `before` and `after` are the oriented box
/// {"center": [x, y, z], "size": [x, y, z], "yaw"} in metres and radians in the world frame, or null while away.
Status WriteChanges(const World& world, const std::string& file);

}  // namespace mapp::sim
