// What being in quarantine means, and how it ends.

#include "mapp/codec/keyframe_codec.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/server/quarantine_fixture.h"

namespace mapp::testing {
namespace {

TEST_F(QuarantineTest, AbsurdDepthsFoundNoMap) {
  const SessionId session = Open(SensorKind::kRgbd, "empty");
  for (uint32_t number = 0; number < 3; ++number) {
    Keyframe keyframe = world_.View(SyntheticWorld::Stand(0, -2, 0.1 * number), session, number, rng_);
    ScaleWorld(1000)(keyframe, rng_);
    const StatusOr<UploadResult> result = Upload(keyframe);
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_FALSE(result->T_map_session);
  }
  EXPECT_TRUE(Session(session).IsQuarantined());
  EXPECT_FALSE(Map("empty").founder);
  const SessionId next = Open(SensorKind::kRgbd, "empty");
  EXPECT_TRUE(MustUpload(world_, SyntheticWorld::Stand(0, -2, 0), next, 0).T_map_session);
}

TEST_F(QuarantineTest, EveryCallThatUsesTheSessionIsRefused) {
  const SessionId session = OpenAligned();
  ASSERT_FALSE(WalkOn(session, Round(24, 0.4), 5, GarbagePose, world_).ok());
  const Keyframe keyframe = world_.View(SyntheticWorld::Stand(0, 0, 0), session, 90, rng_);
  ViewQuery view;
  EXPECT_TRUE(absl::IsFailedPrecondition(service_->AssessOverlap(context_, session, view, 100).status()));
  EXPECT_TRUE(
      absl::IsFailedPrecondition(service_->ReportUpdate(context_, session, {EncodeKeyframe(keyframe)}).status()));
  SharedMapInput input;
  input.session = session;
  const auto send = [](const std::string&) { return absl::OkStatus(); };
  EXPECT_TRUE(absl::IsFailedPrecondition(service_->RequestSharedMap(context_, input, send).status()));
  EXPECT_TRUE(service_->CloseSession(context_, session).ok());
}

TEST_F(QuarantineTest, AnUploadSentAgainIsStillAcknowledged) {
  const SessionId session = OpenAligned();
  ASSERT_FALSE(WalkOn(session, Round(24, 0.4), 5, GarbagePose, world_).ok());
  const StatusOr<UploadResult> again =
      Upload(world_.View(SyntheticWorld::Stand(0, 0, 0), session, 5, rng_, kFirstPoint));
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_TRUE(again->already_stored);
}

TEST_F(QuarantineTest, OneBadKeyframeIsLeftOutAndForgiven) {
  const SessionId session = OpenAligned();
  const MapContent before = Content();
  ASSERT_TRUE(WalkOn(session, {SyntheticWorld::Stand(0, 0, 0)}, 5, GarbagePose, world_).ok());
  ExpectSame(before, Content());
  EXPECT_TRUE(WalkOn(session, Round(24, 0.4), 6, {}, world_).ok());
  EXPECT_FALSE(Session(session).quarantine);
}

TEST_F(QuarantineTest, StandsAfterARestart) {
  const SessionId session = OpenAligned();
  ASSERT_FALSE(WalkOn(session, Round(24, 0.4), 5, GarbagePose, world_).ok());
  const std::string reason = Session(session).quarantine->reason;
  const MapContent before = Content();
  service_.reset();
  ASSERT_TRUE(store_->Close().ok());
  auto store = OpenSqliteMapStore((folder_ / "map.db").string(), {.sync_commits = false});
  ASSERT_TRUE(store.ok()) << store.status();
  store_ = *std::move(store);
  auto service = MapService::Create(*store_, {});
  ASSERT_TRUE(service.ok()) << service.status();
  service_ = *std::move(service);

  ASSERT_TRUE(Session(session).IsQuarantined());
  EXPECT_EQ(Session(session).quarantine->reason, reason);
  const Status refused = WalkOn(session, {SyntheticWorld::Stand(0, 0, 0)}, 90, {}, world_);
  EXPECT_TRUE(absl::IsFailedPrecondition(refused)) << refused;
  SessionLog log(*service_, session);
  ASSERT_TRUE(log.WaitFor<SessionQuarantined>());
  ExpectSame(before, Content());
}

TEST_F(QuarantineTest, AnOperatorsWordBringsBackWhatWasLeftOut) {
  const SessionId session = OpenAligned();
  ASSERT_FALSE(WalkOn(session, Round(24, 0.4), 5, LosesItsWay, world_).ok());
  const size_t num_frames = Content().frames.size();
  SessionLog log(*service_, session);
  const auto released = service_->ReleaseSession(context_, session);
  ASSERT_TRUE(released.ok()) << released.status();
  EXPECT_GE(released->num_frames_taken_in, 4U);
  EXPECT_EQ(Content().frames.size(), num_frames + released->num_frames_taken_in);
  EXPECT_TRUE(log.WaitFor<SessionReleased>());
  // For good: the same again is not judged.
  EXPECT_TRUE(WalkOn(session, Round(24, 0.4), 60, LosesItsWay, world_).ok());
  EXPECT_FALSE(Session(session).IsQuarantined());
  ASSERT_TRUE(Session(session).quarantine->released_ns);
  EXPECT_TRUE(absl::IsFailedPrecondition(service_->ReleaseSession(context_, session).status()));
  EXPECT_TRUE(absl::IsNotFound(service_->ReleaseSession(context_, SessionId(4711)).status()));
}

TEST_F(QuarantineTest, AFragmentWhoseOwnPointsMoveAboutNeverMerges) {
  const SessionId session = Open();
  // The looks of every single view are the room's.
  const Status refused = WalkOn(session, Round(24, 0.4), 0, GarbagePose, world_);
  ASSERT_TRUE(absl::IsFailedPrecondition(refused)) << refused;
  const size_t num_frames = Content().frames.size();
  for (uint32_t i = 0; i < 4; ++i) {
    MustUpload(world_, SyntheticWorld::Stand(0.1 * i, -0.2, 0.3 + 0.1 * i), founder_, kFounderViews + i);
  }
  Settle();
  EXPECT_FALSE(Session(session).T_map_session);
  EXPECT_EQ(Content().frames.size(), num_frames + 4);
}

TEST_F(QuarantineTest, AReleasedFragmentIsTriedAgain) {
  const SessionId session = Open();
  // One view proves nothing; the others come while the session is quarantined, and are refused.
  ASSERT_TRUE(WalkOn(session, {SyntheticWorld::Stand(0, -0.5, 0)}, 0, {}, world_).ok());
  const Status marked = store_->Write({}, [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(session));
    record.quarantine = Quarantine{.since_ns = 1, .reason = "for a test", .released_ns = std::nullopt};
    return writer.UpdateSession(record);
  });
  ASSERT_TRUE(marked.ok()) << marked;
  EXPECT_TRUE(absl::IsFailedPrecondition(WalkOn(session, {SyntheticWorld::Stand(0.2, -0.5, 0.15)}, 1, {}, world_)));

  SessionLog log(*service_, session);
  const auto released = service_->ReleaseSession(context_, session);
  ASSERT_TRUE(released.ok()) << released.status();
  EXPECT_EQ(released->num_frames_taken_in, 0U) << "it has no place in the map yet";
  for (uint32_t i = 1; i < 4; ++i) {
    MustUpload(world_, SyntheticWorld::Stand(0.2 * i, -0.5, 0.15 * i), session, i, kFirstPoint);
  }
  EXPECT_TRUE(log.WaitFor<SessionAligned>());
}

}  // namespace
}  // namespace mapp::testing
