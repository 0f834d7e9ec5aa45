#pragma once

#include "mapp/base/status.h"

#include <Eigen/Core>

#include <string>
#include <vector>

namespace mapp {

/// The positions in a PLY file of text, as `mapp export --ascii` writes it: x, y, z are its vertices' first properties.
/// NOT_FOUND, or DATA_LOSS naming the file and line.
StatusOr<std::vector<Eigen::Vector3d>> ReadAsciiPly(const std::string& file);

}  // namespace mapp
