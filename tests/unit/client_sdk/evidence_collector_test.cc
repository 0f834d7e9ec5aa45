#include "client_sdk/src/evidence_collector.h"

#include "evidence_views.h"
#include "mapp/codec/evidence_codec.h"
#include "mapp/codec/tile_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

namespace mapp {
namespace {

using testing::IsEmpty;
using testing::SizeIs;

constexpr int64_t kSecondNs = 1'000'000'000;

class EvidenceCollectorTest : public ::testing::Test {
 protected:
  EvidenceCollectorTest() { Receive(tile_, 1); }

  void Receive(const Tile& tile, uint32_t number) {
    ClientSharedMap received;
    received.tiles.push_back({tile, EncodeTile(tile)});
    const SharedTiles::Taken taken = tiles_.Take(std::move(received), {});
    collector_.UseMap(number, taken.keys, tiles_, TestAlignment());
  }
  std::vector<PointFinding> TakeReport() {
    if (!collector_.has_reports()) return {};
    const StatusOr<std::vector<PointFinding>> findings = DecodeEvidence(collector_.NextReport().packet);
    EXPECT_TRUE(findings.ok()) << findings.status();
    collector_.DropNextReport();
    return *findings;
  }

  const Tile tile_ = JudgedTile(Revision(1));
  SharedTiles tiles_{kDefaultTileEdgeM, 100, TestCamera()};
  EvidenceCollector collector_{TestCamera(), /*range_m=*/20};
};

TEST_F(EvidenceCollectorTest, ASampleOfWhatIsThereIsSeen) {
  collector_.Add(ViewOf(tile_, 0), 1);
  collector_.Conclude();
  const std::vector<PointFinding> findings = TakeReport();
  EXPECT_GT(findings.size(), tile_.points.size() / kEvidenceOneIn / 2);
  EXPECT_LT(findings.size(), tile_.points.size() / kEvidenceOneIn * 2);
  for (const PointFinding& finding : findings) {
    EXPECT_TRUE(IsInEvidenceSample(finding.point));
    EXPECT_EQ(finding, (PointFinding{finding.point, 1, 0}));
  }
}

TEST_F(EvidenceCollectorTest, WhatTheRayGoesThroughIsMissed) {
  const auto is_gone = [](const Eigen::Vector3d& p_camera) { return p_camera.x() > 0; };
  collector_.Add(ViewOf(tile_, 0, is_gone), 1);
  collector_.Add(ViewOf(tile_, kSecondNs, is_gone), 1);
  collector_.Conclude();
  std::map<MapPointId, Eigen::Vector3d> p_camera;
  for (const TilePoint& point : tile_.points) {
    p_camera[point.id] = TestAlignment().Inverse() * point.p_map.cast<double>();
  }
  size_t num_missed = 0, num_seen = 0;
  for (const PointFinding& finding : TakeReport()) {
    const Eigen::Vector3d& p = p_camera.at(finding.point);
    if (p.x() / p.z() > 0.1) {
      EXPECT_EQ(finding, (PointFinding{finding.point, 0, 2}));
      ++num_missed;
    } else if (p.x() / p.z() < -0.1) {
      EXPECT_EQ(finding, (PointFinding{finding.point, 2, 0}));
      ++num_seen;
    }
  }
  EXPECT_GT(num_missed, 10U);
  EXPECT_GT(num_seen, 10U);
}

TEST_F(EvidenceCollectorTest, HiddenPointsAreNotToldOf) {
  Keyframe view = ViewOf(tile_, 0);
  for (KeyframeFeature& feature : view.features) feature.point->depth_m = 1;
  collector_.Add(view, 1);
  collector_.Conclude();
  EXPECT_THAT(TakeReport(), IsEmpty());
}

TEST_F(EvidenceCollectorTest, FramesOfAnotherMapAndNoFramesMakeNoReport) {
  collector_.Add(ViewOf(tile_, 0), 2);
  collector_.Conclude();
  collector_.Conclude();
  EXPECT_FALSE(collector_.has_reports());
}

TEST_F(EvidenceCollectorTest, EveryMinuteMakesAReport) {
  EXPECT_FALSE(collector_.Add(ViewOf(tile_, 0), 1));
  EXPECT_FALSE(collector_.Add(ViewOf(tile_, 59 * kSecondNs), 1));
  EXPECT_TRUE(collector_.Add(ViewOf(tile_, 61 * kSecondNs), 1));
  EXPECT_EQ(collector_.NextReport().number, 0U);
  EXPECT_EQ(TakeReport().front().num_seen, 2U);
  collector_.Conclude();
  EXPECT_EQ(collector_.NextReport().number, 1U);
  EXPECT_EQ(TakeReport().front().num_seen, 1U);
}

TEST_F(EvidenceCollectorTest, ATileOfTwoRevisionsCountsAsOne) {
  collector_.Add(ViewOf(tile_, 0), 1);
  Tile later = tile_;
  later.revision = Revision(2);
  Receive(later, 2);
  collector_.Add(ViewOf(tile_, kSecondNs), 2);
  collector_.Conclude();
  const std::vector<PointFinding> findings = TakeReport();
  ASSERT_FALSE(findings.empty());
  for (const PointFinding& finding : findings) EXPECT_EQ(finding.num_seen, 2U);
}

TEST_F(EvidenceCollectorTest, OldReportsGoBeforeTheMemoryFills) {
  for (int i = 0; i < 50; ++i) {
    collector_.Add(ViewOf(tile_, i * kSecondNs), 1);
    collector_.Conclude();
  }
  EXPECT_EQ(collector_.NextReport().number, 18U);
}

}  // namespace
}  // namespace mapp
