#pragma once

#include "mapp/camera/camera_model.h"
#include "mapp/map/keyframe.h"
#include "storage/records.h"

#include <span>
#include <string>
#include <vector>

namespace mapp {

/// What a keyframe says about its session's truth (docs/decisions/0011).
enum class Finding {
  kSilent,      ///< nothing: the map does not know the place, and nor does the keyframe's session
  kConsistent,  ///< its own points lie where it sees them; of the map it says nothing
  kAgrees,      ///< it sees what other sessions saw, where they saw it
  kDoubtful,    ///< the map knows this view, and the keyframe shows little of it: to be looked at closely
  // Contradictions, of which an honest session in a changed world gives none.
  kBadDepths,       ///< depths that no such sensor measures
  kOwnPoints,       ///< its own points are not where it sees them
  kOwnDescriptors,  ///< its own points do not look as it says
  kMapDepths,       ///< sees the map's points in their pixels, but at other depths
  kElsewhere,       ///< fits the map well, but not where its session says
  // One that a changed world gives, too.
  kUnlike,  ///< shows something else than the map holds here
};

/// One of the first group of contradictions.
bool IsFalse(Finding finding);
/// "own-points": for logs and metrics.
const char* FindingName(Finding finding);

/// A finding and the figures it rests on, as a clause for operators.
struct KeyframeEvidence {
  Finding finding = Finding::kSilent;
  std::string figures;
};

/// Feature whose reference leads to a point that the server holds, in the frame of the keyframe's pose.
struct KnownPoint {
  size_t feature_idx = 0;
  const PointRecord* point = nullptr;
};

/// How the keyframe meets the points that other sessions saw before it.
struct MapComparison {
  int num_expected = 0;   ///< such points that a camera at its pose should see, hidden ones included
  int num_confirmed = 0;  ///< those that it sees where they are
  /// Per point that has the pixel and the looks of a feature: the feature's depth over the point's.
  std::vector<double> depth_ratios;
};

struct EvidenceOptions {
  /// RGB-D and stereo cameras measure neither farther nor nearer than these; medians over the keyframe's points.
  double max_median_depth_m = 500;
  double min_median_depth_m = 0.02;
  /// Fewer points say nothing.
  int min_points = 20;
  /// An own point further aside than the greater of these, or that much off in depth, or behind the camera, is astray.
  double max_aside_m = 0.15;
  double max_aside_ratio = 0.05;
  double max_depth_off_m = 0.3;
  double max_depth_off_ratio = 0.25;
  /// Hamming distance between descriptors of different things (128 on average).
  int unlike_distance = 100;
  /// Share of the points astray, or unlike, from which the keyframe contradicts itself.
  double max_bad_ratio = 0.6;
  /// Points of other sessions that a keyframe has to confirm.
  int min_confirmed = 15;
  /// With so many expected and too few confirmed, the keyframe is doubtful.
  int min_expected = 60;
  /// A depth ratio may be off by this ...
  double depth_tolerance = 0.1;
  /// ... and contradicts with this share of them off to the same side.
  double min_depths_off = 0.7;
};

/// A keyframe by itself: depths that an RGB-D or stereo sensor cannot have measured. Silent for other sensors.
KeyframeEvidence JudgeDepths(const Keyframe& keyframe, SensorKind sensor, const EvidenceOptions& options);

/// A keyframe against the points that it says it sees. `T_frame_camera`: in the points' frame.
KeyframeEvidence JudgeKnownPoints(const Keyframe& keyframe, const Camera& camera, const Pose3& T_frame_camera,
                                  std::span<const KnownPoint> known, const EvidenceOptions& options);

/// A keyframe against the points of others.
KeyframeEvidence JudgeComparison(const MapComparison& comparison, const EvidenceOptions& options);

}  // namespace mapp
