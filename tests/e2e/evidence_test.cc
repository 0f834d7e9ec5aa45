// Devices that localise on a shared map without uploading: what they tell of it, with the real programs.

#include "cli/visit_spec.h"
#include "datasets/sequence.h"
#include "eval/metrics/change_metrics.h"
#include "eval/metrics/trajectory_metrics.h"
#include "mapp/codec/evidence_codec.h"
#include "server/changes/device_evidence.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/e2e/service_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <map>

namespace mapp {
namespace {

/// Two visits before six of the cars on the way have left, one after.
constexpr const char* kParking =
    "sim:garage:users=3,path=60,rate=10,seed=1,sensor=rgbd,routes=1,changes=6,changes-near=8,change-kinds=vanished,"
    "stable=2";

/// What one session's device has told.
struct Told {
  size_t num_bytes = 0;
  size_t num_reports = 0;
  int num_seen = 0, num_missed = 0;            ///< points where nothing changed
  int num_seen_gone = 0, num_missed_gone = 0;  ///< points of the cars that left
};

class EvidenceOfDevicesTest : public ServiceTest {
 protected:
  Replayed VisitGarage(int visit) {
    return Replay(kParking + ("/" + std::to_string(visit)), "visit" + std::to_string(visit), {"--level", "features"});
  }

  /// The cars that leave, where the map of `founder` has them.
  static std::vector<OrientedBox> FindGone(const Replayed& founder) {
    const StatusOr<VisitSpec> spec = ParseVisitSpec(std::string(kParking) + "/0");
    const auto simulation = sim::Simulate(spec->simulation);
    const auto changes = TrueChangesOf(*(*simulation)->world, sim::ChangesOf(*(*simulation)->world));
    const auto error = AbsoluteTrajectoryError(*ReadTumTrajectory(founder.truth_file),
                                               *ReadTumTrajectory(founder.trajectory_file), /*with_scale=*/false);
    EXPECT_TRUE(changes.ok() && error.ok()) << changes.status() << error.status();
    const Pose3 T_map_world = error->T_truth_estimate.pose.Inverse();
    std::vector<OrientedBox> boxes;
    for (const TrueChange& change : *changes) {
      boxes.push_back({T_map_world * change.before->T_frame_box, change.before->size_m});
    }
    return boxes;
  }

  static Told Collect(MapReader& reader, SessionId session, const std::vector<OrientedBox>& gone) {
    Told told;
    const StatusOr<std::vector<EvidenceRecord>> reports = reader.ListEvidence(session);
    EXPECT_TRUE(reports.ok()) << reports.status();
    told.num_reports = reports->size();
    for (const EvidenceRecord& report : *reports) told.num_bytes += report.packet.size();
    const StatusOr<std::vector<PointFinding>> findings = FindingsOfEvidence(reader, session);
    EXPECT_TRUE(findings.ok()) << findings.status();
    for (const PointFinding& finding : *findings) {
      EXPECT_TRUE(IsInEvidenceSample(finding.point));
      const StatusOr<std::vector<PointRecord>> point = reader.FindPoints({&finding.point, 1});
      EXPECT_TRUE(point.ok()) << point.status();
      if (point->empty()) continue;  // fused since
      const Eigen::Vector3d& p_map = point->front().position;
      // What stands on the floor, or next to a wall, has surfaces within the judge's radius when it has left.
      const bool is_gone = std::ranges::any_of(gone, [&](const OrientedBox& box) {
        return box.Contains(p_map, 0.05) && (box.T_frame_box.Inverse() * p_map).z() > -0.5 * box.size_m.z() + 0.5;
      });
      const bool is_missed = finding.num_missed > finding.num_seen;
      ++(is_gone ? is_missed ? told.num_missed_gone : told.num_seen_gone : is_missed ? told.num_missed : told.num_seen);
    }
    return told;
  }
};

TEST_F(EvidenceOfDevicesTest, PointsOfWhatLeftAreMissedAtSomeHundredBytesAMinute) {
  StartServer();
  const Replayed founder = VisitGarage(0);
  ASSERT_EQ(founder.exit_code, 0) << founder.err;
  const Replayed before = VisitGarage(1);
  ASSERT_EQ(before.exit_code, 0) << before.err;
  // What was acknowledged outlives the server.
  KillAndRestartServer();
  const Replayed after = VisitGarage(2);
  ASSERT_EQ(after.exit_code, 0) << after.err;
  EXPECT_EQ(server().Stop(), 0);

  const std::vector<OrientedBox> gone = FindGone(founder);
  ASSERT_EQ(gone.size(), 6U);
  const auto store = OpenSqliteMapStore(database(), {.read_only = true});
  ASSERT_TRUE(store.ok()) << store.status();
  const std::unique_ptr<MapReader> reader = *(*store)->Read();
  const std::vector<SessionRecord> sessions = *reader->ListSessions(std::nullopt);
  ASSERT_EQ(sessions.size(), 3U);
  EXPECT_EQ(Collect(*reader, sessions[0].id, gone).num_reports, 0U) << "it was on no shared map";
  std::map<int, Told> told;
  for (const int visit : {1, 2}) {
    told[visit] = Collect(*reader, sessions[visit].id, gone);
    const Replayed& replayed = visit == 1 ? before : after;
    const double minutes = replayed.Number("frames_on_shared_map") / 10 / 60;
    ASSERT_GT(minutes, 0.1);
    const double bytes_per_minute = static_cast<double>(told[visit].num_bytes) / minutes;
    std::printf("visit %d: %zu reports, %.0f bytes a minute; %d seen, %d missed; of what left %d seen, %d missed\n",
                visit, told[visit].num_reports, bytes_per_minute, told[visit].num_seen, told[visit].num_missed,
                told[visit].num_seen_gone, told[visit].num_missed_gone);
    EXPECT_GE(told[visit].num_reports, 1U);
    EXPECT_LT(bytes_per_minute, 1000);
    EXPECT_LT(told[visit].num_missed, 0.05 * told[visit].num_seen) << "what stayed";
  }
  EXPECT_GT(told[1].num_seen_gone, 5);
  EXPECT_LE(told[1].num_missed_gone, told[1].num_seen_gone / 5);
  EXPECT_GT(told[2].num_missed_gone, 5);
  EXPECT_LE(told[2].num_seen_gone, told[2].num_missed_gone / 2);
  const Finished verified = RunMapp({"verify", "--db", database()});
  EXPECT_EQ(verified.exit_code, 0) << verified.out;
}

}  // namespace
}  // namespace mapp
