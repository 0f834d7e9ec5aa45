#include "server/changes/change_match.h"

#include <gtest/gtest.h>

#include <limits>

namespace mapp {
namespace {

constexpr int64_t kEver = std::numeric_limits<int64_t>::min(), kNow = std::numeric_limits<int64_t>::max();

ChangeRecord Vanished(double x_m, int64_t after_ns, std::vector<MapPointId> points) {
  ChangeRecord change;
  change.kind = ChangeKind::kVanished;
  change.confidence = 0.9;
  change.after_ns = after_ns;
  change.before_ns = after_ns + 10;
  change.box_before = OrientedBox{Pose3(Eigen::Quaterniond::Identity(), {x_m, 0, 0}), {1, 1, 1}};
  change.points_before = std::move(points);
  return change;
}

ChangeRecord Stored(uint64_t id, ChangeStatus status, ChangeRecord change) {
  change.id = ChangeId(id);
  change.status = status;
  return change;
}

TEST(ChangeMatchTest, ProposalsTakeOverWhatIsKnownNow) {
  const ChangeRecord stored[] = {Stored(3, ChangeStatus::kProposed, Vanished(0, 100, {MapPointId(1), MapPointId(2)}))};
  ChangeRecord found = Vanished(0.1, 100, {MapPointId(1), MapPointId(2), MapPointId(5)});
  found.confidence = 0.99;
  const ChangeUpdate update = MatchChanges(stored, {found}, kEver, kNow);
  ASSERT_EQ(update.known.size(), 1U);
  EXPECT_EQ(update.known[0].id, ChangeId(3));
  EXPECT_EQ(update.known[0].confidence, 0.99);
  EXPECT_TRUE(update.fresh.empty());
  EXPECT_TRUE(update.dropped.empty());
}

TEST(ChangeMatchTest, WhatWasDecidedStays) {
  for (const ChangeStatus status : {ChangeStatus::kAccepted, ChangeStatus::kRejected}) {
    const ChangeRecord stored[] = {Stored(3, status, Vanished(0, 100, {MapPointId(1)}))};
    ChangeRecord found = Vanished(0, 100, {MapPointId(1)});
    found.confidence = 0.1;
    const ChangeUpdate update = MatchChanges(stored, {found}, kEver, kNow);
    ASSERT_EQ(update.known.size(), 1U);
    EXPECT_EQ(update.known[0].status, status);
    EXPECT_EQ(update.known[0].confidence, 0.9);
    EXPECT_TRUE(MatchChanges(stored, {}, kEver, kNow).dropped.empty());
  }
}

TEST(ChangeMatchTest, ProposalsThatNothingTellsOfGo) {
  const ChangeRecord stored[] = {Stored(3, ChangeStatus::kProposed, Vanished(0, 100, {})),
                                 Stored(4, ChangeStatus::kProposed, Vanished(0, 500, {}))};
  EXPECT_EQ(MatchChanges(stored, {}, kEver, kNow).dropped, (std::vector{ChangeId(3), ChangeId(4)}));
  EXPECT_EQ(MatchChanges(stored, {}, 400, kNow).dropped, std::vector{ChangeId(4)});
}

TEST(ChangeMatchTest, OtherPlacesTimesAndKindsAreOtherEvents) {
  const ChangeRecord change = Vanished(0, 100, {MapPointId(1), MapPointId(2)});
  EXPECT_TRUE(IsSameEvent(change, change));
  EXPECT_FALSE(IsSameEvent(change, Vanished(3, 100, {MapPointId(7)})));
  EXPECT_FALSE(IsSameEvent(change, Vanished(0, 110, {MapPointId(1), MapPointId(2)})));
  EXPECT_TRUE(IsSameEvent(change, Vanished(9, 105, {MapPointId(2)})));
  ChangeRecord appeared = change;
  appeared.kind = ChangeKind::kAppeared;
  EXPECT_FALSE(IsSameEvent(change, appeared));
}

/// Once its old place is cleared, what moved is only found to have come.
TEST(ChangeMatchTest, HalfOfAMoveIsTheMove) {
  ChangeRecord moved = Vanished(0, 100, {MapPointId(1)});
  moved.kind = ChangeKind::kMoved;
  moved.box_after = OrientedBox{Pose3(Eigen::Quaterniond::Identity(), {5, 0, 0}), {1, 1, 1}};
  moved.points_after = {MapPointId(8), MapPointId(9)};
  const ChangeRecord stored[] = {Stored(3, ChangeStatus::kAccepted, moved)};
  ChangeRecord appeared = moved;
  appeared.kind = ChangeKind::kAppeared;
  appeared.box_before.reset();
  appeared.points_before.clear();
  const ChangeUpdate update = MatchChanges(stored, {appeared}, kEver, kNow);
  ASSERT_EQ(update.known.size(), 1U);
  EXPECT_EQ(update.known[0].id, ChangeId(3));
  EXPECT_EQ(update.known[0].kind, ChangeKind::kMoved);
  EXPECT_TRUE(update.fresh.empty());
}

TEST(ChangeMatchTest, OneRecordStandsForOneEvent) {
  const ChangeRecord stored[] = {Stored(3, ChangeStatus::kProposed, Vanished(0, 100, {}))};
  const ChangeUpdate update = MatchChanges(stored, {Vanished(0, 100, {}), Vanished(0.2, 100, {})}, kEver, kNow);
  EXPECT_EQ(update.known.size(), 1U);
  EXPECT_EQ(update.fresh.size(), 1U);
}

}  // namespace
}  // namespace mapp
