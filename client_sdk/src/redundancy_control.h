#pragma once

#include "mapp/base/rng.h"
#include "mapp/client/participant.h"
#include "mapp/map/keyframe.h"

#include <Eigen/Core>

#include <vector>

namespace mapp {

/// The map points of a keyframe, in its camera's frame.
struct OwnPoints {
  std::vector<Eigen::Vector3d> p_camera;  ///< metres
  std::vector<size_t> feature_idx;        ///< of the keyframe's features, same order
};
OwnPoints OwnPointsOf(const Keyframe& keyframe, const Camera& camera);

/// What is left of a keyframe, and how much of it the map does not know yet.
struct Reduced {
  Keyframe keyframe;     ///< partial; its features are in the whole keyframe's order
  size_t num_fresh = 0;  ///< features whose point is not redundant
};

/// Redundancy control (paper section 4.2; DESIGN 6). Removal drops the features whose point is redundant, and those
/// without a point, which tell the map nothing once the session is aligned. Injection keeps some of the redundant:
/// kOften those observed more often than the keyframe's points are on average, kRandom equally many at random.
/// `redundant` has one entry per own point.
Reduced RemoveRedundant(const Keyframe& whole, const OwnPoints& own, const std::vector<bool>& redundant,
                        Injection injection, Rng& rng);

}  // namespace mapp
