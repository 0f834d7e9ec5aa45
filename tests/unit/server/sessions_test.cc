#include "tests/unit/server/service_fixture.h"

#include <gmock/gmock.h>

#include <limits>

namespace mapp::testing {
namespace {

using ::testing::StartsWith;

class SessionsTest : public ServiceFixture {
 protected:
  static OpenSessionInput GoodInput() {
    OpenSessionInput input;
    input.map_name = "room";
    input.device = "device";
    input.camera = SyntheticWorld::DeviceCamera();
    input.create_map = true;
    return input;
  }
};

TEST_F(SessionsTest, UnknownMapIsOnlyMadeWhenAsked) {
  OpenSessionInput input = GoodInput();
  input.create_map = false;
  EXPECT_EQ(service_->OpenSession(context_, input).status().code(), absl::StatusCode::kNotFound);
  EXPECT_TRUE(service_->ListMaps(context_)->empty());
  input.create_map = true;
  const StatusOr<OpenedSession> first = service_->OpenSession(context_, input);
  const StatusOr<OpenedSession> second = service_->OpenSession(context_, input);
  ASSERT_TRUE(first.ok() && second.ok());
  EXPECT_EQ(first->map.id, second->map.id);
  EXPECT_NE(first->session, second->session);
}

struct BadOpen {
  std::string name;
  std::function<void(OpenSessionInput&)> spoil;
  std::string message_start;
};

class BadOpenTest : public SessionsTest, public ::testing::WithParamInterface<BadOpen> {};

TEST_P(BadOpenTest, IsRefusedAndMakesNoMap) {
  OpenSessionInput input = GoodInput();
  GetParam().spoil(input);
  const StatusOr<OpenedSession> opened = service_->OpenSession(context_, input);
  EXPECT_EQ(opened.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(opened.status().message()), StartsWith(GetParam().message_start));
  EXPECT_TRUE(service_->ListMaps(context_)->empty());
}

INSTANTIATE_TEST_SUITE_P(
    SessionsTest, BadOpenTest,
    ::testing::Values(
        BadOpen{"NoMapName", [](OpenSessionInput& input) { input.map_name.clear(); }, "map_name: "},
        BadOpen{"LongMapName", [](OpenSessionInput& input) { input.map_name.assign(129, 'x'); }, "map_name: "},
        BadOpen{"LineBreakInDevice", [](OpenSessionInput& input) { input.device = "a\nb"; }, "device: "},
        BadOpen{"ZeroFocalLength",
                [](OpenSessionInput& input) {
                  input.camera.projection = PinholeCamera{0, 525, 320, 240};
                },
                "camera."},
        BadOpen{"NoLevels", [](OpenSessionInput& input) { input.features.num_levels = 0; },
                "feature_settings.num_levels: "},
        BadOpen{"ScaleThatTheServerDoesNotComputeWith",
                [](OpenSessionInput& input) { input.features.scale_factor = 1.5F; },
                "feature_settings.scale_factor: this server makes maps of 1.2 only, got 1.5"},
        BadOpen{"StereoWithoutBaseline", [](OpenSessionInput& input) { input.sensor = SensorKind::kStereo; },
                "camera.stereo_baseline_m: "}),
    [](const auto& test) { return test.param.name; });

TEST_F(SessionsTest, MapKeepsTheFeatureSettingsOfTheSessionThatMadeIt) {
  OpenSessionInput input = GoodInput();
  input.features.num_levels = 5;
  input.features.patch_size_px = 41;
  ASSERT_TRUE(service_->OpenSession(context_, input).ok());
  EXPECT_FALSE(FirstDifference(Map().features, input.features).has_value());
  EXPECT_EQ(service_->OpenSession(context_, GoodInput()).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_TRUE(service_->OpenSession(context_, input).ok());
  EXPECT_EQ(Map().num_sessions, 2);
}

struct OtherFeatures {
  std::string name;
  std::function<void(FeatureSettings&)> change;
  std::string message;
};

class OtherFeaturesTest : public SessionsTest, public ::testing::WithParamInterface<OtherFeatures> {};

TEST_P(OtherFeaturesTest, AreRefusedByNameAndCreateNothing) {
  ASSERT_TRUE(service_->OpenSession(context_, GoodInput()).ok());
  OpenSessionInput input = GoodInput();
  GetParam().change(input.features);
  const Status status = service_->OpenSession(context_, input).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(status.message(), "feature_settings." + GetParam().message + "; use the map's settings or another map");
  EXPECT_EQ(Map().num_sessions, 1);
  EXPECT_EQ(service_->ListSessions(context_, "")->size(), 1U);
}

INSTANTIATE_TEST_SUITE_P(
    SessionsTest, OtherFeaturesTest,
    ::testing::Values(
        OtherFeatures{"Descriptor", [](FeatureSettings& features) { features.descriptor_kind = "BEBLID-256"; },
                      "descriptor_kind: the map \"room\" was made with ORB-256, this session has BEBLID-256"},
        OtherFeatures{"Scale", [](FeatureSettings& features) { features.scale_factor = 1.5F; },
                      "scale_factor: the map \"room\" was made with 1.2, this session has 1.5"},
        OtherFeatures{"Levels", [](FeatureSettings& features) { features.num_levels = 4; },
                      "num_levels: the map \"room\" was made with 8, this session has 4"},
        OtherFeatures{"Patch", [](FeatureSettings& features) { features.patch_size_px = 21; },
                      "patch_size_px: the map \"room\" was made with 31, this session has 21"}),
    [](const auto& test) { return test.param.name; });

TEST_F(SessionsTest, NamesCountCharactersNotBytes) {
  OpenSessionInput input = GoodInput();
  input.map_name.clear();
  for (int i = 0; i < 128; ++i) input.map_name += "ü";
  EXPECT_TRUE(service_->OpenSession(context_, input).ok());
}

TEST_F(SessionsTest, ClosingTwiceIsClosingOnce) {
  const SessionId session = Open();
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), session, 0);
  const StatusOr<ClosedSession> first = service_->CloseSession(context_, session);
  ASSERT_TRUE(first.ok());
  EXPECT_EQ(first->num_keyframes, 1);
  EXPECT_TRUE(first->optimization_pending);
  const std::optional<int64_t> closed_ns = Session(session).closed_ns;
  ASSERT_TRUE(closed_ns.has_value());
  ASSERT_TRUE(service_->CloseSession(context_, session).ok());
  EXPECT_EQ(Session(session).closed_ns, closed_ns);
  EXPECT_EQ(service_->CloseSession(context_, SessionId(4711)).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(SessionsTest, PosesAreThoseOfTheMapByNumber) {
  const SessionId session = Open();
  const Pose3 T_world_session = SyntheticWorld::Stand(0, -2, 0);
  MustUpload(world_, T_world_session, session, 0);
  const Pose3 second = SyntheticWorld::Stand(0, -2, 0.5);
  MustUpload(world_, second, session, 1);
  ASSERT_TRUE(service_->CloseSession(context_, session).ok());
  const StatusOr<SessionPoses> poses = service_->GetSessionPoses(context_, session);
  ASSERT_TRUE(poses.ok()) << poses.status();
  ASSERT_EQ(poses->frames.size(), 2U);
  EXPECT_EQ(poses->frames[0].number, 0U);
  EXPECT_EQ(poses->frames[1].number, 1U);
  EXPECT_LT(Distance(poses->frames[1].T_frame_camera, second), 0.1);
  EXPECT_GT(poses->map_revision.value(), 0U);
}

TEST_F(SessionsTest, PosesOfAFragmentOrOfNobodyAreRefused) {
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), Open(), 0);
  const StatusOr<SessionPoses> fragment = service_->GetSessionPoses(context_, Open());
  EXPECT_EQ(fragment.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_NE(fragment.status().message().find("not aligned"), std::string_view::npos) << fragment.status();
  EXPECT_EQ(service_->GetSessionPoses(context_, SessionId(4711)).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(SessionsTest, FragmentOwesNoOptimization) {
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), Open(), 0);
  const SessionId fragment = Open();
  MustUpload(SyntheticWorld(99), SyntheticWorld::Stand(0, -2, 0), fragment, 0);
  const StatusOr<ClosedSession> closed = service_->CloseSession(context_, fragment);
  ASSERT_TRUE(closed.ok());
  EXPECT_FALSE(closed->optimization_pending);
}

TEST_F(SessionsTest, WatcherHearsThePresentAlignmentFirst) {
  const SessionId session = Open();
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), session, 0);
  std::vector<SessionEvent> heard;
  const auto subscription =
      service_->WatchSession(context_, session, [&](const SessionEvent& event) { heard.push_back(event); });
  ASSERT_TRUE(subscription.ok());
  ASSERT_EQ(heard.size(), 1U);
  EXPECT_TRUE(std::holds_alternative<SessionAligned>(heard[0]));
  // Published while Write runs, so it is here once the upload returns.
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 0.5), session, 1);
  ASSERT_EQ(heard.size(), 2U);
  const auto* changed = std::get_if<TilesChanged>(&heard[1]);
  ASSERT_NE(changed, nullptr);
  EXPECT_FALSE(changed->keys.empty());
  EXPECT_EQ(changed->revision, Map().revision);
}

TEST_F(SessionsTest, WatcherOfAFragmentHearsNothingAtFirst) {
  const SessionId session = Open();
  bool heard = false;
  const auto subscription = service_->WatchSession(context_, session, [&](const SessionEvent&) { heard = true; });
  ASSERT_TRUE(subscription.ok());
  EXPECT_FALSE(heard);
  EXPECT_EQ(service_->WatchSession(context_, SessionId(4711), [](const SessionEvent&) {}).status().code(),
            absl::StatusCode::kNotFound);
}

TEST_F(SessionsTest, MapWithOpenSessionsIsDeletedOnlyByForce) {
  const SessionId session = Open();
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), session, 0);
  EXPECT_EQ(service_->DeleteMap(context_, "room", false).status().code(), absl::StatusCode::kFailedPrecondition);
  const StatusOr<MapRecord> deleted = service_->DeleteMap(context_, "room", true);
  ASSERT_TRUE(deleted.ok());
  EXPECT_EQ(deleted->num_frames, 1);
  EXPECT_EQ(service_->GetMap(context_, "room", "").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(Upload(world_.View(Pose3(), session, 1, rng_)).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(service_->DeleteMap(context_, "room", true).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(SessionsTest, ExportHoldsTheMapAndNoFragment) {
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), Open(), 0);
  MustUpload(SyntheticWorld(99), SyntheticWorld::Stand(0, -2, 0), Open(), 0);
  size_t num_frames = 0;
  size_t num_points = 0;
  const Status exported = service_->ExportMap(
      context_, "room", "",
      [&](const MapRecord&, const std::vector<FrameRecord>& frames) {
        num_frames = frames.size();
        return absl::OkStatus();
      },
      [&](const std::vector<PointRecord>& points) {
        num_points += points.size();
        return absl::OkStatus();
      });
  ASSERT_TRUE(exported.ok()) << exported;
  EXPECT_EQ(num_frames, 1U);
  EXPECT_EQ(static_cast<int64_t>(num_points), Map().num_points);
}

TEST_F(SessionsTest, StepsAreCountedOncePerKeyframe) {
  const SessionId session = Open();
  MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), session, 0);
  const Keyframe second = world_.View(SyntheticWorld::Stand(0, -2, 0.3), session, 1, rng_);
  ASSERT_TRUE(Upload(second).ok());
  ASSERT_TRUE(Upload(second)->already_stored);
  const std::vector<StepFigures> steps = service_->StepTimesSoFar();
  ASSERT_EQ(steps.size(), 3U);
  EXPECT_EQ(steps[0].step, "integration");
  EXPECT_EQ(steps[0].latency.count, 2U);
  EXPECT_GT(steps[0].latency.mean_ms, 0);
  EXPECT_EQ(steps[2].step, "optimization");
  EXPECT_EQ(steps[2].latency.count, 0U);
}

TEST_F(SessionsTest, PassedDeadlineStopsACall) {
  const CallContext late = CallContext::WithTimeout(std::chrono::milliseconds(-1));
  EXPECT_EQ(service_->ListMaps(late).status().code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(service_->OpenSession(late, GoodInput()).status().code(), absl::StatusCode::kDeadlineExceeded);
}

}  // namespace
}  // namespace mapp::testing
