// A contributor is forgotten: nothing of what they sent is left, in the database's file nor in its log.

#include "mapp/codec/keyframe_codec.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/server/quarantine_fixture.h"
#include "tests/unit/server/verify/healthy_database.h"

#include <fstream>
#include <iterator>
#include <set>

namespace mapp::testing {
namespace {

/// Runs of this many bytes of a packet are looked for.
constexpr size_t kProbeBytes = 24;
constexpr size_t kProbeStep = 256;

std::string ReadBytes(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

class ErasureTest : public QuarantineTest {
 protected:
  SessionId Contribute() {
    const SessionId session = OpenAligned();
    const Status walked = WalkOn(session, Round(8, 0.4), 5, {}, world_);
    EXPECT_TRUE(walked.ok()) << walked;
    return session;
  }

  std::vector<std::string> Packets(SessionId session) {
    std::vector<std::string> packets;
    const auto reader = *store_->Read();
    for (const FrameRecord& frame : Frames(session)) packets.push_back(*reader->GetPacket(frame.id));
    return packets;
  }

  /// As parts of their packets, and as the descriptors that points and the place index keep.
  static std::set<std::string> ProbesOf(const std::vector<std::string>& packets) {
    std::set<std::string> probes;
    for (const std::string& packet : packets) {
      for (size_t i = 64; i + kProbeBytes <= packet.size(); i += kProbeStep)
        probes.insert(packet.substr(i, kProbeBytes));
      const auto keyframe = DecodeKeyframe(packet);
      EXPECT_TRUE(keyframe.ok()) << keyframe.status();
      for (const KeyframeFeature& feature : keyframe->features) {
        probes.emplace(feature.descriptor.Bytes());
      }
    }
    return probes;
  }

  /// How many of them are somewhere in the database's file or its log.
  size_t NumFound(const std::set<std::string>& probes) const {
    const std::string bytes = ReadBytes(folder_ / "map.db") + ReadBytes(folder_ / "map.db-wal");
    return static_cast<size_t>(std::ranges::count_if(
        probes, [&](const std::string& probe) { return bytes.find(probe) != std::string::npos; }));
  }

  ErasedSession Erase(SessionId session) {
    const auto erased = service_->EraseSession(context_, session, /*force=*/true, /*dry_run=*/false);
    EXPECT_TRUE(erased.ok()) << erased.status();
    return erased.ok() ? *erased : ErasedSession();
  }

  void ExpectHealthy() {
    const auto report = Verify((folder_ / "map.db").string());
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_EQ(report->num_violations(), 0) << Describe(*report);
  }

  /// Evidence of the session, findings of its map, and two changes that rest on it, one on it alone. Returns what may
  /// be looked for.
  std::set<std::string> AddChanges(SessionId session) {
    std::set<std::string> probes = {"seen from the door at noon", "gone since the last visit",
                                    "the founder found it gone"};
    const Status written = store_->Write(context_, [&](MapWriter& writer) -> Status {
      auto probe = probes.begin();
      MAPP_RETURN_IF_ERROR(
          writer.AppendEvidence({.session = session, .number = 0, .received_ns = 0, .packet = *probe++}));
      MAPP_RETURN_IF_ERROR(writer.PutFindings(session, *probe++));
      MAPP_RETURN_IF_ERROR(writer.PutFindings(founder_, *probe++));
      ChangeRecord change;
      change.map = Map().id;
      change.box_before = OrientedBox{.T_frame_box = {}, .size_m = {1, 1, 1}};
      change.sessions = {session};
      MAPP_RETURN_IF_ERROR(writer.PutChange(change).status());
      change.sessions = {founder_, session};
      return writer.PutChange(change).status();
    });
    EXPECT_TRUE(written.ok()) << written;
    return probes;
  }

  /// A device still finds its place.
  void ExpectServes() {
    OpenAligned();
    ExpectHealthy();
  }
};

TEST_F(ErasureTest, NothingOfItIsLeftInTheFiles) {
  const MapContent before = Content();
  const std::set<std::string> of_others = ProbesOf(Packets(founder_));
  const SessionId session = Contribute();
  std::set<std::string> probes = ProbesOf(Packets(session));
  std::erase_if(probes, [&](const std::string& probe) { return of_others.contains(probe); });
  ASSERT_GT(probes.size(), 1000U);
  const std::set<std::string> of_changes = AddChanges(session);
  EXPECT_EQ(NumFound(of_changes), of_changes.size());
  probes.insert(of_changes.begin(), of_changes.end());
  EXPECT_GT(NumFound(probes), probes.size() * 9 / 10) << "or nothing could be proven";
  ASSERT_TRUE(service_->PutTag(context_, "room", "spring", "").ok());

  const ErasedSession erased = Erase(session);
  EXPECT_EQ(erased.num_frames, 13U);
  EXPECT_EQ(erased.dropped_tags, std::vector<std::string>{"spring"});
  EXPECT_EQ(NumFound(probes), 0U);
  const auto changes = (*store_->Read())->ListChanges(Map().id);
  ASSERT_TRUE(changes.ok()) << changes.status();
  ASSERT_EQ(changes->size(), 1U);
  EXPECT_EQ(changes->front().sessions, std::vector<SessionId>{founder_});
  ExpectSame(before, Content(), /*some_observers=*/true);
  EXPECT_TRUE(absl::IsNotFound(service_->GetSessionPoses(context_, session).status()));
  EXPECT_EQ(Map().oldest_revision, Map().revision);
  ExpectServes();
}

TEST_F(ErasureTest, PointsThatOthersObserveBecomeTheirs) {
  const SessionId session = Contribute();
  std::set<std::string> probes = ProbesOf(Packets(founder_));
  const std::set<std::string> kept = ProbesOf(Packets(session));
  std::erase_if(probes, [&](const std::string& probe) { return kept.contains(probe); });
  const MapContent before = Content();
  const ErasedSession erased = Erase(founder_);
  EXPECT_GT(erased.num_points_kept, 100U);
  EXPECT_EQ(NumFound(probes), 0U);
  EXPECT_EQ(Map().founder, session);
  const MapContent after = Content();
  EXPECT_EQ(after.frames.size(), 13U);
  EXPECT_GE(after.points.size(), erased.num_points_kept);
  for (const auto& [id, point] : after.points) EXPECT_EQ(point.position, before.points.at(id).position);
  EXPECT_TRUE(WalkOn(session, {SyntheticWorld::Stand(0, 0, 0)}, 90, {}, world_).ok());
  ExpectServes();
}

TEST_F(ErasureTest, TheOnlySessionLeavesAnEmptyMap) {
  Erase(founder_);
  EXPECT_EQ(Map().num_frames, 0);
  EXPECT_EQ(Map().num_points, 0);
  EXPECT_FALSE(Map().founder);
  ExpectHealthy();
  EXPECT_TRUE(MustUpload(world_, SyntheticWorld::Stand(0, 0, 0), Open(), 0).T_map_session);
}

TEST_F(ErasureTest, AFragmentIsForgotten) {
  const SessionId fragment = Open();
  MustUpload(SyntheticWorld(99), SyntheticWorld::Stand(0, 0, 0), fragment, 0);
  const std::set<std::string> probes = ProbesOf(Packets(fragment));
  EXPECT_GT(NumFound(probes), probes.size() * 9 / 10);
  Erase(fragment);
  EXPECT_EQ(NumFound(probes), 0U);
  ExpectServes();
}

TEST_F(ErasureTest, OneThatWasRevertedIsForgotten) {
  const SessionId session = Contribute();
  ASSERT_TRUE(service_->RevertSession(context_, session, "", false).ok());
  Erase(session);
  ExpectServes();
}

TEST_F(ErasureTest, RefusesAndChangesNothing) {
  const SessionId session = Contribute();
  const MapContent before = Content();
  const Status open = service_->EraseSession(context_, session, /*force=*/false, /*dry_run=*/false).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(open)) << open;
  EXPECT_TRUE(absl::IsNotFound(service_->EraseSession(context_, SessionId(4711), true, false).status()));
  const auto dry = service_->EraseSession(context_, session, /*force=*/true, /*dry_run=*/true);
  ASSERT_TRUE(dry.ok()) << dry.status();
  EXPECT_EQ(dry->num_frames, 13U);
  EXPECT_FALSE(Session(session).quarantine);
  ExpectSame(before, Content());
}

}  // namespace
}  // namespace mapp::testing
