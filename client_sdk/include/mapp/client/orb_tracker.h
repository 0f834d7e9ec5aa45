#pragma once

#include "mapp/base/latency.h"
#include "mapp/base/status.h"
#include "mapp/camera/camera_model.h"
#include "mapp/client/shared_map.h"
#include "mapp/client/slam_adapter.h"
#include "mapp/feature/feature_settings.h"
#include "mapp/image/image.h"
#include "mapp/map/keyframe.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

namespace mapp {

struct OrbTrackerOptions {
  int num_features = kMaxFeatures;  ///< per image; range [200, kMaxFeatures]
  /// RGB-D readings and stereo depths beyond this are not made into points at once, metres.
  double max_depth_m = 0;  ///< 0: 40 baselines for stereo, 6 m for RGB-D
  /// Fewer matched shared points than this is a localisation failure (ORB-SLAM3; DESIGN 3). An image with so
  /// few features that this would be more than 40 % of them needs 40 %, but at least `min_tracked_points`.
  /// The matches must also cover half of the image where it has features: in one corner they hold a pose only loosely.
  int min_shared_matches = 75;
  int min_tracked_points = 20;  ///< below this the frame is lost
  /// The first keyframes of a session come closer together, so that the server has the views that an alignment takes
  /// while the device is still near its start.
  int num_start_keyframes = 4;
  int max_frames_between_start_keyframes = 5;
  /// A keyframe is due at the latest after this many frames.
  int max_frames_between_keyframes = 15;
  /// ... or when less than this share of what the frame after it still saw of the last keyframe is found. 0.8 gives a
  /// keyframe about every fifth frame of a hand-held camera at 15 Hz.
  double min_reference_ratio = 0.8;
  int local_window = 10;  ///< keyframes adjusted by local bundle adjustment
  /// After searching its place for so long, seconds of the frames' stamps, a lost tracker gives its map up and begins a
  /// new fragment; 0: never. Frames that show too little to begin a map from do not count, nor does the time between
  /// frames beyond half a second. Shorter leaves a map that the next turn would have found again, longer leaves more of
  /// the way without poses. Range [0, 3600]. Source: ORB-SLAM3's 3 s; docs/decisions/0010.
  double max_search_s = 3;
  /// The same while the map has fewer than `num_young_keyframes`: it is hardly worth a search. Range [0, 3600].
  double max_young_search_s = 1;
  int num_young_keyframes = 10;  ///< range [0, 10000]
  /// Run local mapping inside Track() instead of its own thread: slower, but repeatable to the bit.
  bool synchronous = false;
  Status Validate() const;  ///< Names the first field out of range.
};

/// One camera frame. Images are borrowed for the call.
struct TrackerFrame {
  int64_t stamp_ns = 0;
  ImageView<uint8_t> gray;        ///< left or colour camera, as recorded (distorted)
  ImageView<float> depth_m;       ///< RGB-D: registered to `gray`, metres, 0 = none; else empty
  ImageView<uint8_t> right_gray;  ///< stereo: the right camera; else empty
};

enum class TrackingState { kNotStarted, kTracking, kLost };

struct TrackingResult {
  TrackingState state = TrackingState::kNotStarted;
  Pose3 T_session_camera;      ///< valid when kTracking
  int num_matches = 0;         ///< map points matched after pose optimisation
  uint32_t fragment = 0;       ///< that the frame was tracked or lost in; names the frame `session` of the pose
  bool on_shared_map = false;  ///< the pose comes from the shared map
  /// With which the shared map was received, when on_shared_map: T_map_session * T_session_camera is the pose in the
  /// map.
  std::optional<Pose3> T_map_session;
  /// Takes out the steps that poses make where the tracker takes over a shared map: T_odometry_session *
  /// T_session_camera goes on without a jump, drift and all, for as long as tracking is not lost. Begins as identity in
  /// each fragment.
  Pose3 T_odometry_session;
  int num_shared_matches = 0;      ///< when a shared map was in use for this frame, also where it failed
  uint32_t shared_map_number = 0;  ///< 0: no shared map was in use
  bool is_keyframe = false;
  /// On the shared map no keyframe is made; true where mapping for itself would have made one.
  bool would_be_keyframe = false;
  double tracking_ms = 0;      ///< this call, extraction included
  double tracking_cpu_ms = 0;  ///< CPU time of the calling thread in this call
  /// Of these, what making features of the images took: the same wherever the pose comes from.
  double extraction_cpu_ms = 0;
};

/// Pose of a frame, as it is now after all corrections to its reference keyframe.
struct TrajectoryPose {
  int64_t stamp_ns = 0;
  Pose3 T_session_camera;
  bool on_shared_map = false;
  /// With which the shared map was received that the frame was localised on: T_map_session * T_session_camera is its
  /// pose in the map, whatever the session's alignment has become since. Absent for other frames.
  std::optional<Pose3> T_map_session;
};

/// What is left of a fragment that the tracker has given up: final.
struct EndedFragment {
  uint32_t number = 0;                     ///< TrackingResult::fragment
  std::vector<Keyframe> keyframes;         ///< those that TakeKeyframes() has not handed out
  std::vector<TrajectoryPose> trajectory;  ///< all its tracked frames, in its own frame `session`
};

/// What local mapping has cost so far.
struct LocalMappingStats {
  LatencySummary latency;  ///< of each keyframe
  double cpu_s = 0;        ///< CPU time; part of tracking_cpu_ms when OrbTrackerOptions::synchronous
};

/// A complete ORB front end for RGB-D, stereo and a single camera (DESIGN 13): extraction, motion-model and local-map
/// tracking, relocalisation, keyframe choice, local bundle adjustment in its own thread, localisation on a shared map
/// with local mapping at rest. Poses are in the odometry frame `session`, which begins at the first tracked camera.
///
/// A tracker that has been lost for long (OrbTrackerOptions::max_search_s) begins again: with the next frame that shows
/// enough, a new *fragment* with a map and a frame `session` of its own, whose place relative to the fragments before
/// is not known. Nothing of one fragment may be used in another: hand its keyframes to a session of their own
/// (Participant::BeginFragment), then call LeaveSharedMap(), so that no map that was asked for before arrives after.
/// Device does all this.
///
/// A frame that fails on the shared map is tracked on the device's own map within the same call, with the shared points
/// as known ones; mapping goes on from there, so that a device whose server is silent does not get lost. From the first
/// frame that localises on a shared map, what the device had mapped before no longer serves: it may be off by the
/// alignment's error.
///
/// Track(), TakeKeyframes(), TakeEndedFragments() and Trajectory() belong to one thread; TakeSharedMap/LeaveSharedMap
/// may come from any.
/// For stereo, `camera` of the keyframes is the rectified left camera: ask camera().
class OrbTracker : public SlamAdapter {
 public:
  /// One camera and no depth. Scale comes from nothing: lengths are in session units, the median depth of the first
  /// view being 1. The first frames are kNotStarted, until the camera has moved enough for two of them to make a map
  /// and some more to prove it; Trajectory() then has all that were tracked, the session's frame is the first of the
  /// two.
  static StatusOr<std::unique_ptr<OrbTracker>> CreateMono(const Camera& camera, const OrbTrackerOptions& options);
  static StatusOr<std::unique_ptr<OrbTracker>> CreateRgbd(const Camera& camera, const OrbTrackerOptions& options);
  /// `T_left_right`: pose of the right camera in the left camera's frame.
  static StatusOr<std::unique_ptr<OrbTracker>> CreateStereo(const Camera& left, const Camera& right,
                                                            const Pose3& T_left_right,
                                                            const OrbTrackerOptions& options);
  ~OrbTracker() override;

  /// INVALID_ARGUMENT when an image is missing or has another size than the camera, or time goes backwards; the state
  /// is then as before. Never waits for the network or for local mapping.
  StatusOr<TrackingResult> Track(const TrackerFrame& frame);

  /// Keyframes of the present fragment finished by local mapping since the last call, in order, whole: features with
  /// their points. Numbered from 0 in each fragment; `session` is not set. Points that came from a shared map are named
  /// by the server's id.
  std::vector<Keyframe> TakeKeyframes();
  /// Fragments given up since the last call, in order. Take them before the present one's keyframes.
  std::vector<EndedFragment> TakeEndedFragments();
  /// A whole keyframe of the last frame, without adding it to the map: what ReportUpdate sends, and what upload_all
  /// would have sent where would_be_keyframe was set. Absent when the last frame was not tracked.
  std::optional<Keyframe> MakeKeyframeOfLastFrame() const;
  /// Waits until local mapping has nothing to do.
  void WaitForLocalMapping();

  void TakeSharedMap(std::shared_ptr<const SharedMap> map) override;
  void LeaveSharedMap() override;

  /// All tracked frames of the present fragment so far.
  std::vector<TrajectoryPose> Trajectory() const;
  /// The camera that keyframes and poses refer to, and the sensor kind.
  const Camera& camera() const;
  SensorKind sensor() const;
  /// Of its extractor: what the keyframes' features can be compared with.
  const FeatureSettings& feature_settings() const;
  LocalMappingStats local_mapping() const;  ///< of all fragments

 private:
  struct Impl;
  explicit OrbTracker(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
