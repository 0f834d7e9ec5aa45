#include "mapp/codec/keyframe_codec.h"
#include "server/service/map_scale.h"
#include "server/service/session_view.h"
#include "tests/unit/server/service_fixture.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <atomic>
#include <thread>

namespace mapp::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

class UploadTest : public ServiceFixture {};

const Pose3 kTowardsCabinet = SyntheticWorld::Stand(0, -2, 0);

TEST_F(UploadTest, FirstMetricSessionFoundsTheMap) {
  const SessionId session = Open();
  const UploadResult result = MustUpload(world_, kTowardsCabinet, session, 0);
  ASSERT_TRUE(result.T_map_session.has_value());
  EXPECT_LT(result.T_map_session->translation().norm(), 1e-12);
  EXPECT_EQ(Session(session).aligned_at_keyframe, 0U);
  EXPECT_EQ(Map().founder, session);
  EXPECT_EQ(Map().num_frames, 1);
  EXPECT_GT(Map().num_points, 200);
}

TEST_F(UploadTest, LaterSessionsStayFragmentsUntilAligned) {
  MustUpload(world_, kTowardsCabinet, Open(), 0);
  const int64_t num_points = Map().num_points;
  const SessionId second = Open();
  EXPECT_FALSE(MustUpload(SyntheticWorld(99), kTowardsCabinet, second, 0).T_map_session.has_value());
  EXPECT_EQ(Map().num_frames, 1);
  EXPECT_EQ(Map().num_points, num_points);
  EXPECT_EQ(Session(second).num_keyframes, 1);
}

TEST_F(UploadTest, ASessionWithoutScaleFoundsAMapOfUnknownScale) {
  constexpr double kUnit_m = 5;  // what the device calls 1
  const SessionId session = Open(SensorKind::kMono);
  const Pose3 second = SyntheticWorld::Stand(0.3, -2, 0);
  double scale = 0;
  for (const auto& [number, T_world_camera] : {std::pair(0U, kTowardsCabinet), std::pair(1U, second)}) {
    Keyframe keyframe = world_.View(T_world_camera, session, number, rng_);
    keyframe.pose_frame = PoseFrame::kSession;
    ScaleLengths(keyframe, 1 / kUnit_m);
    const StatusOr<UploadResult> result = Upload(keyframe);
    ASSERT_TRUE(result.ok()) << result.status();
    ASSERT_TRUE(result->T_map_session.has_value());
    scale = result->scale_map_session;
  }
  EXPECT_EQ(Map().founder, session);
  EXPECT_FALSE(Map().has_metric_scale);
  EXPECT_EQ(Map().num_frames, 2);
  EXPECT_EQ(Session(session).scale_map_session, scale);

  // All lengths are in the map's unit, of which the first view's median depth has kNominalDepthM.
  std::vector<double> depths;
  const auto reader = store_->Read();
  ASSERT_TRUE(reader.ok()) << reader.status();
  const auto frames = (*reader)->ListFrames(Map().id, session);
  ASSERT_TRUE(frames.ok()) << frames.status();
  EXPECT_NEAR(Distance(frames->at(0).T_frame_camera, frames->at(1).T_frame_camera), scale * 0.3 / kUnit_m, 1e-6);
  const Pose3 T_camera_map = frames->front().T_frame_camera.Inverse();
  const auto first_view = (*reader)->GetObservations(frames->front().id);
  ASSERT_TRUE(first_view.ok()) << first_view.status();
  for (const Observation& observation : *first_view) {
    EXPECT_EQ(observation.depth_m, 0) << "what was triangulated was not measured";
    const auto point = (*reader)->GetPoints(std::span(&observation.point, 1));
    ASSERT_TRUE(point.ok()) << point.status();
    depths.push_back((T_camera_map * point->front().position).z());
  }
  std::ranges::nth_element(depths, depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2));
  EXPECT_NEAR(depths[depths.size() / 2], kNominalDepthM, 0.01);

  // A session in metres does not found what is founded.
  EXPECT_FALSE(MustUpload(SyntheticWorld(99), kTowardsCabinet, Open(), 0).T_map_session.has_value());
}

TEST_F(UploadTest, ASessionWithoutScaleIsNotAskedAboutViews) {
  const SessionId session = Open(SensorKind::kMono);
  Keyframe keyframe = world_.View(kTowardsCabinet, session, 0, rng_);
  keyframe.pose_frame = PoseFrame::kSession;
  ASSERT_TRUE(Upload(keyframe).ok());
  const StatusOr<AssessedOverlap> assessed = service_->AssessOverlap(context_, session, ViewQuery(), 100);
  EXPECT_EQ(assessed.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(assessed.status().message()), HasSubstr("single camera"));
  SharedMapInput shared;
  shared.session = session;
  const auto never = [](const std::string&) -> Status { return absl::InternalError("sent"); };
  EXPECT_EQ(service_->RequestSharedMap(context_, shared, never).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(UploadTest, OfTwoSessionsThatRaceExactlyOneFounds) {
  const SessionId sessions[] = {Open(), Open()};
  std::vector<Keyframe> keyframes;
  for (const SessionId session : sessions) keyframes.push_back(world_.View(kTowardsCabinet, session, 0, rng_));
  std::atomic<int> num_founders = 0;
  {
    std::vector<std::jthread> devices;
    for (const Keyframe& keyframe : keyframes) {
      devices.emplace_back([&] {
        const StatusOr<UploadResult> result = Upload(keyframe);
        ASSERT_TRUE(result.ok()) << result.status();
        num_founders += result->T_map_session.has_value() ? 1 : 0;
      });
    }
  }
  EXPECT_EQ(num_founders, 1);
}

TEST_F(UploadTest, SentTwiceIsStoredOnce) {
  const SessionId session = Open();
  const Keyframe keyframe = world_.View(kTowardsCabinet, session, 0, rng_);
  const StatusOr<UploadResult> first = Upload(keyframe);
  const StatusOr<UploadResult> again = Upload(keyframe);
  ASSERT_TRUE(first.ok() && again.ok());
  EXPECT_FALSE(first->already_stored);
  EXPECT_TRUE(again->already_stored);
  EXPECT_EQ(first->frame, again->frame);
  EXPECT_EQ(first->map_revision, again->map_revision);
  EXPECT_EQ(Session(session).num_keyframes, 1);

  ASSERT_TRUE(service_->CloseSession(context_, session).ok());
  const StatusOr<UploadResult> after_closing = Upload(keyframe);
  ASSERT_TRUE(after_closing.ok()) << "a retry whose first answer was lost must not fail";
  EXPECT_TRUE(after_closing->already_stored);
}

TEST_F(UploadTest, OctavesBeyondTheMapsLevelsAreRefusedByName) {
  const SessionId session = Open(SensorKind::kRgbd, "low", {.num_levels = 3});
  Keyframe keyframe = world_.View(kTowardsCabinet, session, 0, rng_);
  for (KeyframeFeature& feature : keyframe.features)
    feature.keypoint.octave = std::min<uint8_t>(feature.keypoint.octave, 2);
  keyframe.features[1].keypoint.octave = 3;
  const Status status = Upload(keyframe).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), StartsWith("keyframe.features[1].octave: must be below num_levels 3"));
  EXPECT_EQ(Session(session).num_keyframes, 0);
  EXPECT_EQ(Map("low").num_points, 0);

  keyframe.features[1].keypoint.octave = 2;
  EXPECT_TRUE(Upload(keyframe).ok());
  EXPECT_EQ(Session(session).num_keyframes, 1);
}

TEST_F(UploadTest, SamePointIsObservedAgainByItsNumber) {
  const SessionId session = Open();
  MustUpload(world_, kTowardsCabinet, session, 0);
  const int64_t num_points = Map().num_points;
  const UploadResult second = MustUpload(world_, kTowardsCabinet, session, 1);
  // Noise moves a few landmarks across the image border.
  EXPECT_LE(Map().num_points - num_points, 5);
  StatusOr<std::unique_ptr<MapReader>> reader = store_->Read();
  ASSERT_TRUE(reader.ok());
  const StatusOr<std::vector<Observation>> observations = (*reader)->GetObservations(second.frame);
  ASSERT_TRUE(observations.ok());
  EXPECT_GT(observations->size(), 200U);
}

TEST_F(UploadTest, AssociationAddsNoDuplicates) {
  const SessionId founder = Open();
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), founder, 0);
  MustUpload(world_, SyntheticWorld::Stand(0.5, -2, 0.1), founder, 1);
  const int64_t num_points = Map().num_points;

  const SessionId second = Open();
  Align(second);
  MustUpload(world_, SyntheticWorld::Stand(0.25, -2, 0.05), second, 0, 50'000);
  const auto num_new = static_cast<double>(Map().num_points - num_points);
  EXPECT_LT(num_new, 0.05 * static_cast<double>(num_points));

  // The second session's numbers lead to the same points from now on.
  const int64_t num_points_then = Map().num_points;
  MustUpload(world_, SyntheticWorld::Stand(0.25, -2, 0.05), second, 1, 50'000);
  EXPECT_LE(Map().num_points - num_points_then, 2);
}

TEST_F(UploadTest, MapPointReferencesAreObservedOrPassedOver) {
  const SessionId founder = Open();
  const UploadResult first = MustUpload(world_, kTowardsCabinet, founder, 0);
  const SessionId elsewhere = Open(SensorKind::kRgbd, "other room");
  const UploadResult other = MustUpload(world_, kTowardsCabinet, elsewhere, 0);
  StatusOr<std::unique_ptr<MapReader>> reader = store_->Read();
  ASSERT_TRUE(reader.ok());
  const auto here = (*reader)->GetObservations(first.frame);
  const auto there = (*reader)->GetObservations(other.frame);
  ASSERT_TRUE(here.ok() && there.ok());

  Keyframe keyframe = world_.View(kTowardsCabinet, founder, 1, rng_);
  keyframe.features.resize(3);
  // Away from every landmark's projection, so that looks cannot stand in for the reference.
  for (KeyframeFeature& feature : keyframe.features) feature.descriptor = OrbDescriptor();
  const auto refer = [](uint64_t id) { return PointReference{PointReference::Kind::kMapPoint, id, 2.0F, 1}; };
  keyframe.features[0].point = refer(here->front().point.value());
  keyframe.features[1].point = refer(there->front().point.value());
  keyframe.features[2].point = refer(1'000'000'000);
  const int64_t num_points = Map().num_points;
  const StatusOr<UploadResult> result = Upload(keyframe);
  ASSERT_TRUE(result.ok()) << result.status();
  reader = store_->Read();
  ASSERT_TRUE(reader.ok());
  const auto observations = (*reader)->GetObservations(result->frame);
  ASSERT_TRUE(observations.ok());
  ASSERT_EQ(observations->size(), 1U);
  EXPECT_EQ(observations->front().point, here->front().point);
  EXPECT_EQ(Map().num_points, num_points);
}

struct BadUpload {
  std::string name;
  std::function<std::string(Keyframe)> make_packet;
  absl::StatusCode code;
  std::string message_start;
};

class BadUploadTest : public ServiceFixture, public ::testing::WithParamInterface<BadUpload> {};

TEST_P(BadUploadTest, IsRefusedAndNothingIsStored) {
  const SessionId session = Open();
  const std::string packet = GetParam().make_packet(world_.View(kTowardsCabinet, session, 0, rng_));
  const StatusOr<UploadResult> result = service_->UploadKeyframe(context_, packet);
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.status().code(), GetParam().code) << result.status();
  EXPECT_THAT(std::string(result.status().message()), StartsWith(GetParam().message_start));
  EXPECT_EQ(Session(session).num_keyframes, 0);
  EXPECT_EQ(Map().revision.value(), 0U);
  EXPECT_FALSE(Map().founder.has_value());
}

INSTANTIATE_TEST_SUITE_P(UploadTest, BadUploadTest,
                         ::testing::Values(BadUpload{"Empty", [](const Keyframe&) { return std::string(); },
                                                     absl::StatusCode::kInvalidArgument, "keyframe"},
                                           BadUpload{"Truncated",
                                                     [](const Keyframe& keyframe) {
                                                       const std::string packet = EncodeKeyframe(keyframe);
                                                       return packet.substr(0, packet.size() / 2);
                                                     },
                                                     absl::StatusCode::kInvalidArgument, "keyframe"},
                                           BadUpload{"FlippedBit",
                                                     [](const Keyframe& keyframe) {
                                                       std::string packet = EncodeKeyframe(keyframe);
                                                       packet[packet.size() / 2] =
                                                           static_cast<char>(packet[packet.size() / 2] ^ 1);
                                                       return packet;
                                                     },
                                                     absl::StatusCode::kInvalidArgument, "keyframe"},
                                           BadUpload{
                                               "TooLarge", [](const Keyframe&) { return std::string(70'000, 'x'); },
                                               absl::StatusCode::kInvalidArgument, "keyframe: at most 65536 bytes"},
                                           BadUpload{"AbsurdPose",
                                                     [](Keyframe keyframe) {
                                                       keyframe.T_frame_camera = Pose3(Eigen::Quaterniond::Identity(),
                                                                                       Eigen::Vector3d(0, 2e6, 0));
                                                       return EncodeKeyframe(keyframe);
                                                     },
                                                     absl::StatusCode::kInvalidArgument, "keyframe.pose"},
                                           BadUpload{"PixelOutsideTheSessionsImage",
                                                     [](Keyframe keyframe) {
                                                       keyframe.features[3].keypoint.u_px = 900;
                                                       return EncodeKeyframe(keyframe);
                                                     },
                                                     absl::StatusCode::kInvalidArgument, "keyframe.features[3].pixel"},
                                           BadUpload{"UnknownSession",
                                                     [](Keyframe keyframe) {
                                                       keyframe.session = SessionId(4711);
                                                       return EncodeKeyframe(keyframe);
                                                     },
                                                     absl::StatusCode::kNotFound, "session 4711"}),
                         [](const auto& test) { return test.param.name; });

TEST_F(UploadTest, ClosedSessionTakesNoMore) {
  const SessionId session = Open();
  MustUpload(world_, kTowardsCabinet, session, 0);
  ASSERT_TRUE(service_->CloseSession(context_, session).ok());
  const StatusOr<UploadResult> late = Upload(world_.View(kTowardsCabinet, session, 1, rng_));
  EXPECT_EQ(late.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(Session(session).num_keyframes, 1);
}

TEST_F(UploadTest, FragmentCannotTellPosesInTheMap) {
  MustUpload(world_, kTowardsCabinet, Open(), 0);
  Keyframe keyframe = world_.View(kTowardsCabinet, Open(), 0, rng_);
  keyframe.pose_frame = PoseFrame::kMap;
  const StatusOr<UploadResult> result = Upload(keyframe);
  EXPECT_EQ(result.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(result.status().message()), HasSubstr("not aligned"));
}

}  // namespace
}  // namespace mapp::testing
