// A session in quarantine as its device and an operator see it.

#include "cli/sessions.h"
#include "mapp/client/participant.h"
#include "tests/integration/rpc/rpc_fixture.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <sstream>

namespace mapp {
namespace {

using ::testing::HasSubstr;

constexpr std::chrono::seconds kLongEnough{20};

class QuarantineRpcTest : public RpcTest {
 protected:
  /// A device whose depths are a thousand times too large, until the server takes no more.
  std::unique_ptr<Participant> RunBadDevice() {
    MapClientOptions client;
    client.server_address = address();
    ParticipantOptions options;
    options.map_name = "room";
    options.device = "drone-3";
    options.policy = UploadPolicy::kUploadAll;
    auto device = Participant::Open(client, options, testing::SyntheticWorld::DeviceCamera(), SensorKind::kRgbd,
                                    /*adapter=*/nullptr);
    EXPECT_TRUE(device.ok()) << device.status();
    const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
    for (uint32_t number = 0; number < 4; ++number) {
      Keyframe keyframe = View(stand, stand, (*device)->session().value(), number);
      for (KeyframeFeature& feature : keyframe.features) feature.point->depth_m *= 1000;
      (*device)->OnKeyframe(std::move(keyframe));
      EXPECT_TRUE((*device)->WaitIdle(kLongEnough).ok());
    }
    return *std::move(device);
  }

  std::string Show(SessionId session, bool json) {
    std::ostringstream out;
    const Status shown =
        RunSessionsShow({.server = address(), .id = static_cast<uint32_t>(session.value()), .json = json}, out);
    EXPECT_TRUE(shown.ok()) << shown;
    return out.str();
  }

  SessionsReleaseOptions ReleaseOptions(SessionId session) {
    return {.server = address(), .id = static_cast<uint32_t>(session.value())};
  }
};

TEST_F(QuarantineRpcTest, TheDeviceIsToldAndItsUploadsAreRefusedWithTheReason) {
  const std::unique_ptr<Participant> device = RunBadDevice();
  const ParticipantStats stats = device->stats();
  EXPECT_EQ(stats.num_uploaded, 3U);
  EXPECT_EQ(stats.num_rejected, 1U);
  EXPECT_THAT(stats.last_error, HasSubstr("FAILED_PRECONDITION"));
  EXPECT_THAT(stats.last_error, HasSubstr("is quarantined since"));
  EXPECT_THAT(stats.last_error, HasSubstr("depths that the sensor cannot have measured"));
  ASSERT_TRUE(stats.quarantine_reason);
  EXPECT_THAT(*stats.quarantine_reason, HasSubstr("wrong depth scale"));
  EXPECT_EQ(GetMap().num_frames(), 0U);
}

TEST_F(QuarantineRpcTest, AnOperatorSeesItAndLiftsIt) {
  const std::unique_ptr<Participant> device = RunBadDevice();
  const SessionId session = device->session().value();
  EXPECT_THAT(Show(session, false), HasSubstr("quarantined"));
  EXPECT_THAT(Show(session, false), HasSubstr("the median depth of its points is"));
  EXPECT_THAT(Show(session, true), HasSubstr("\"state\": \"quarantined\""));
  std::ostringstream list;
  ASSERT_TRUE(RunSessionsList({.server = address(), .map_name = "room"}, list).ok());
  EXPECT_THAT(list.str(), HasSubstr("quarantined"));

  std::istringstream nobody;
  std::ostringstream out;
  SessionsReleaseOptions options = ReleaseOptions(session);
  EXPECT_TRUE(absl::IsFailedPrecondition(RunSessionsRelease(options, nobody, out))) << "nobody can be asked";
  options.interactive = true;
  std::istringstream no("n\n");
  EXPECT_TRUE(absl::IsCancelled(RunSessionsRelease(options, no, out)));
  EXPECT_THAT(out.str(), HasSubstr("drone-3"));
  EXPECT_THAT(Show(session, false), HasSubstr("quarantined"));
  std::istringstream yes("y\n");
  const Status released = RunSessionsRelease(options, yes, out);
  ASSERT_TRUE(released.ok()) << released;
  EXPECT_THAT(Show(session, true), HasSubstr("\"state\": \"open\""));
  EXPECT_TRUE(absl::IsFailedPrecondition(RunSessionsRelease(options, yes, out))) << "it is not quarantined any more";
  options.id = 4711;
  EXPECT_TRUE(absl::IsNotFound(RunSessionsRelease(options, yes, out)));
}

TEST_F(QuarantineRpcTest, AnOperatorRevertsASession) {
  const std::unique_ptr<Participant> device = RunBadDevice();
  const auto id = static_cast<uint32_t>(device->session()->value());
  std::istringstream none;
  std::ostringstream out;
  // Of the guard's quarantine nothing is left in the map to be taken out.
  SessionsRevertOptions options{.server = address(), .id = id, .reason = "test", .yes = true};
  EXPECT_TRUE(absl::IsFailedPrecondition(RunSessionsRevert(options, none, out)));
  ASSERT_TRUE(RunSessionsRelease({.server = address(), .id = id, .yes = true}, none, out).ok());
  options.dry_run = true;
  ASSERT_TRUE(RunSessionsRevert(options, none, out).ok());
  EXPECT_THAT(out.str(), HasSubstr("would revert session"));
  EXPECT_THAT(Show(*device->session(), true), HasSubstr("\"state\": \"open\""));
  options.dry_run = options.yes = false;
  EXPECT_TRUE(absl::IsFailedPrecondition(RunSessionsRevert(options, none, out))) << "nobody can be asked";
  options.yes = options.json = true;
  out.str("");
  ASSERT_TRUE(RunSessionsRevert(options, none, out).ok());
  EXPECT_THAT(out.str(), HasSubstr("\"map_revision\": 0")) << "it had founded no map";
  EXPECT_THAT(Show(*device->session(), false), HasSubstr("reverted by an operator: test"));
  options.id = 4711;
  EXPECT_TRUE(absl::IsNotFound(RunSessionsRevert(options, none, out)));
}

TEST_F(QuarantineRpcTest, AnOperatorErasesASession) {
  const std::unique_ptr<Participant> device = RunBadDevice();
  const auto id = static_cast<uint32_t>(device->session()->value());
  std::istringstream none;
  std::ostringstream out;
  SessionsEraseOptions options{.server = address(), .id = id, .yes = true};
  EXPECT_TRUE(absl::IsFailedPrecondition(RunSessionsErase(options, none, out))) << "it is open";
  options.force = options.dry_run = true;
  ASSERT_TRUE(RunSessionsErase(options, none, out).ok());
  EXPECT_THAT(out.str(), HasSubstr("would erase session"));
  options.dry_run = options.yes = false;
  options.interactive = true;
  std::istringstream no("n\n");
  EXPECT_TRUE(absl::IsCancelled(RunSessionsErase(options, no, out)));
  EXPECT_THAT(out.str(), HasSubstr("The map's past before now cannot be read any more."));
  std::istringstream yes("y\n");
  out.str("");
  const Status erased = RunSessionsErase(options, yes, out);
  ASSERT_TRUE(erased.ok()) << erased;
  EXPECT_THAT(out.str(), HasSubstr("backups and bundles made before still hold it"));
  EXPECT_TRUE(absl::IsNotFound(RunSessionsErase(options, yes, out)));
  EXPECT_TRUE(absl::IsNotFound(RunSessionsShow({.server = address(), .id = id}, out)));
}

}  // namespace
}  // namespace mapp
