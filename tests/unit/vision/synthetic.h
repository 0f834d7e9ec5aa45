#pragma once

#include "mapp/base/rng.h"
#include "mapp/camera/camera_model.h"
#include "mapp/feature/feature.h"
#include "mapp/geometry/pose3.h"
#include "mapp/image/image.h"

#include <Eigen/Core>

#include <vector>

namespace mapp::test {

inline constexpr int kWidth_px = 640;
inline constexpr int kHeight_px = 480;
inline constexpr PinholeCamera kCamera{525, 520, 320, 240};

/// Gray level of an endless texture of blurred random squares with unit edge; full of corners.
double TextureAt(double x, double y);
/// Image of that texture, `square_px` pixels a square, its origin at pixel (-shift_x, -shift_y).
GrayImage TexturedImage(int width_px, int height_px, double square_px, int shift_x = 0, int shift_y = 0);

OrbDescriptor RandomDescriptor(Rng& rng);
/// The descriptor with `num_flips` distinct bits inverted.
OrbDescriptor FlipBits(OrbDescriptor descriptor, int num_flips, Rng& rng);
std::vector<OrbDescriptor> RandomDescriptors(size_t count, Rng& rng);

Eigen::Vector3d RandomVector(double half_range, Rng& rng);
/// A rotation by up to `max_angle` about a random axis and a translation of up to `max_offset_m` per axis.
Pose3 RandomPose(double max_angle, double max_offset_m, Rng& rng);
/// A point of kCamera's view between 1 and 5 m, in the camera's frame.
Eigen::Vector3d RandomVisiblePoint(Rng& rng);

}  // namespace mapp::test
