// Sessions that are kept out of the map, and those that are not.

#include "tests/unit/server/quarantine_fixture.h"

#include <gmock/gmock.h>

namespace mapp::testing {
namespace {

using ::testing::HasSubstr;

struct BadSession {
  std::string name;
  Corrupt corrupt;
  std::string reason;  ///< when it goes bad on its way
};
class BadSessionTest : public QuarantineTest, public ::testing::WithParamInterface<BadSession> {};

TEST_P(BadSessionTest, IsQuarantinedAndTheMapIsAsBefore) {
  const SessionId session = OpenAligned();
  const MapContent before = Content();
  SessionLog log(*service_, session);
  const Status refused = WalkOn(session, Round(24, 0.4), 5, GetParam().corrupt, world_);
  EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr(GetParam().reason));
  EXPECT_THAT(std::string(refused.message()), HasSubstr("mapp sessions release"));

  const SessionRecord record = Session(session);
  ASSERT_TRUE(record.IsQuarantined());
  EXPECT_THAT(record.quarantine->reason, HasSubstr(GetParam().reason));
  const auto told = log.WaitFor<SessionQuarantined>();
  ASSERT_TRUE(told);
  EXPECT_EQ(told->reason, record.quarantine->reason);
  ExpectSame(before, Content());
  EXPECT_FALSE(Session(founder_).quarantine);
}

class BadFromTheStartTest : public BadSessionTest {};

TEST_P(BadFromTheStartTest, NeverEntersTheMap) {
  const MapContent before = Content();
  const SessionId session = Open();
  // Refused in the end or not: nothing of it enters the map.
  const Status status = WalkOn(session, Round(24, 0.4), 0, GetParam().corrupt, world_);
  EXPECT_TRUE(status.ok() || absl::IsFailedPrecondition(status)) << status;
  EXPECT_FALSE(Session(session).T_map_session);
  ExpectSame(before, Content());
}

const BadSession kBadSessions[] = {
    {"GarbagePoses", GarbagePose, "do not fit the session's own points"},
    {"WrongBaseline", ScaleWorld(1.3), "do not fit the session's own points"},
    {"DepthsTimesAThousand", ScaleWorld(1000), "depths that the sensor cannot"},
    {"WrongIntrinsics", WrongIntrinsics, "show something else"},
    {"ScrambledDescriptors", ScrambleDescriptors, "do not look like"},
};
const auto kNameOf = [](const auto& test) { return test.param.name; };

INSTANTIATE_TEST_SUITE_P(QuarantineTest, BadSessionTest, ::testing::ValuesIn(kBadSessions), kNameOf);
// From the start, its way would be one like any other.
INSTANTIATE_TEST_SUITE_P(LosesItsWay, BadSessionTest,
                         ::testing::Values(BadSession{"LosesItsWay", LosesItsWay, "fit the map elsewhere"}), kNameOf);
INSTANTIATE_TEST_SUITE_P(QuarantineTest, BadFromTheStartTest, ::testing::ValuesIn(kBadSessions), kNameOf);

/// A session that was brought to the map by mistake: its frame is told to be the map's.
class WrongAlignmentTest : public QuarantineTest {
 protected:
  Status WalkFrom(SessionId session, const Corrupt& corrupt) {
    Align(session);
    return WalkOn(session, Round(24, 0.4), 0, corrupt, world_);
  }
};

TEST_F(WrongAlignmentTest, AScaleOfItsOwnIsNamedInTheReason) {
  const MapContent before = Content();
  const SessionId session = Open();
  const Status refused = WalkFrom(session, ScaleDepths(1.3));
  EXPECT_THAT(std::string(refused.message()), HasSubstr("1.3 times the map's"));
  ExpectSame(before, Content());
}

TEST_F(WrongAlignmentTest, AllOfTheSessionIsTakenOutWhenNothingOfItEverAgreed) {
  const MapContent before = Content();
  const SessionId session = Open();
  const Status refused = WalkFrom(session, LosesItsWay);
  EXPECT_THAT(std::string(refused.message()), HasSubstr("fit the map elsewhere"));
  for (const FrameRecord& frame : Frames(session)) EXPECT_FALSE(frame.in_map);
  ExpectSame(before, Content());
}

TEST_F(WrongAlignmentTest, DescriptorsOfAnotherKindAreUnlikeTheMap) {
  const MapContent before = Content();
  const SessionId session = Open();
  const Status refused = WalkFrom(session, [](Keyframe& keyframe, Rng& rng) {
    ScrambleDescriptors(keyframe, rng);
    NewNumbers(keyframe, 1'000'000 + 1'000 * uint64_t{keyframe.number});
  });
  EXPECT_THAT(std::string(refused.message()), HasSubstr("show something else"));
  ExpectSame(before, Content());
}

struct HonestSession {
  std::string name;
  SensorNoise noise;
  Corrupt drift;
  double moved_share = 0;
};
class HonestSessionTest : public QuarantineTest, public ::testing::WithParamInterface<HonestSession> {};

TEST_P(HonestSessionTest, GoesOnAndIsKept) {
  const SessionId session = OpenAligned();
  const SyntheticWorld world = world_.Rearranged(GetParam().moved_share, 77);
  std::vector<Pose3> way;
  for (int round = 0; round < 2; ++round) {
    for (const Pose3& pose : Round(24, 0.4)) way.push_back(pose);
  }
  const Status status = WalkOn(session, way, 5, GetParam().drift, world, GetParam().noise);
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_FALSE(Session(session).quarantine);
  for (const FrameRecord& frame : Frames(session)) {
    EXPECT_TRUE(frame.in_map) << "keyframe " << frame.number;
  }
}

/// Two centimetres and a third of a degree a keyframe; what a tracker sees anew it numbers anew.
void Drift(Keyframe& keyframe, Rng&) {
  const double steps = keyframe.number - 4.0;
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.003 * steps, Eigen::Vector3d::UnitY()));
  keyframe.T_frame_camera = Pose3(turn, {0.01 * steps, 0, 0.01 * steps}) * keyframe.T_frame_camera;
  NewNumbers(keyframe, 1'000'000 + 1'000 * uint64_t{keyframe.number});
}

INSTANTIATE_TEST_SUITE_P(QuarantineTest, HonestSessionTest,
                         ::testing::Values(HonestSession{"Plain", {}, {}},
                                           HonestSession{"Noisy", {1.0, 0.03, 0.08}, {}},
                                           HonestSession{"Drifting", {}, Drift},
                                           HonestSession{"ChangedWorld", {}, {}, 0.3},
                                           HonestSession{"ChangedWorldSeenAnew", {}, Drift, 0.3},
                                           HonestSession{"MuchChangedWorld", {}, {}, 0.6}),
                         [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace mapp::testing
