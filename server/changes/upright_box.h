#pragma once

#include "mapp/geometry/oriented_box.h"
#include "storage/records.h"

#include <Eigen/Core>

#include <span>
#include <vector>

namespace mapp {

/// Which way is up in a map: against the mean of the cameras' y axes, which point down for phones, cars and robots that
/// are held upright. A map knows no gravity; sessions that roll and pitch average out. Unit. -Y without frames.
Eigen::Vector3d UpDirection(std::span<const FrameRecord> frames);

/// The smallest box with one axis along `up_map` around the points but for strays: of each direction the share
/// `stray_share` at either end is left out (and a side is made longer by what an even spread has lost so). Sides are at
/// least `min_side_m` long. Requires points.
OrientedBox UprightBox(std::span<const Eigen::Vector3f> p_map, const Eigen::Vector3d& up_map, double stray_share,
                       double min_side_m);

/// The box made deeper along one of its sides on the ground, away from who looks along `view_map` (mean of the unit
/// vectors from cameras to points): of a thing seen from one side the far part shows no points. What is as wide and
/// high as a vehicle is taken to be as long as one, other things to be as deep as they are wide. One box for each side
/// along which something may be hidden, the shorter side's first; the box itself when that is none.
std::vector<OrientedBox> WithHiddenPart(const OrientedBox& box_map, const Eigen::Vector3d& view_map);

}  // namespace mapp
