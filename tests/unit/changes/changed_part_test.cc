#include "server/changes/changed_part.h"

#include <gtest/gtest.h>

namespace mapp {
namespace {

/// Two points a decimetre apart, the first with this id, gone between `after_ns` and `before_ns`.
ChangedPart PartAt(float x_m, uint64_t id, int64_t after_ns, int64_t before_ns, size_t group) {
  ChangedPart part;
  part.happening.time = {0, after_ns, before_ns, 100};
  part.happening.sessions = {SessionId(id)};
  part.happening.confidence = 0.1 * static_cast<double>(id);
  part.group = group;
  part.points = {{MapPointId(id), {x_m, 0, 0}, {0, 0, 1}}, {MapPointId(id + 1), {x_m + 0.1F, 0, 0}, {0, 0, 1}}};
  return part;
}

TEST(JoinPartsTest, PartsSideBySideThatWentTogetherAreOne) {
  const auto joined = JoinParts({PartAt(0, 1, 10, 30, 0), PartAt(0.3F, 2, 20, 40, 1)}, 0.3);
  ASSERT_EQ(joined.size(), 1U);
  EXPECT_EQ(joined[0].points.size(), 3U);  // they share one
  EXPECT_EQ(joined[0].happening.time.after_ns, 20);
  EXPECT_EQ(joined[0].happening.time.before_ns, 30);
  EXPECT_EQ(joined[0].happening.sessions, (std::vector<SessionId>{SessionId(1), SessionId(2)}));
  EXPECT_EQ(joined[0].happening.confidence, 0.2);
}

TEST(JoinPartsTest, OthersStayApart) {
  EXPECT_EQ(JoinParts({PartAt(0, 1, 10, 30, 0), PartAt(0.5F, 2, 10, 30, 1)}, 0.3).size(), 2U);  // too far
  EXPECT_EQ(JoinParts({PartAt(0, 1, 10, 20, 0), PartAt(0.1F, 2, 20, 30, 1)}, 0.3).size(), 2U);  // at another time
  EXPECT_EQ(JoinParts({PartAt(0, 1, 10, 30, 0), PartAt(0.1F, 3, 10, 30, 0)}, 0.3).size(), 2U);  // told apart before
  std::vector<ChangedPart> parts = {PartAt(0, 1, 10, 30, 0), PartAt(0.1F, 3, 10, 30, 1)};
  parts[0].happening.kind = ChangeKind::kAppeared;
  EXPECT_EQ(JoinParts(parts, 0.3).size(), 2U);
  EXPECT_TRUE(JoinParts({}, 0.3).empty());
}

TEST(JoinPartsTest, WhatHasGrownReachesFurther) {
  const auto joined =
      JoinParts({PartAt(0, 1, 10, 30, 0), PartAt(0.6F, 3, 10, 30, 1), PartAt(0.3F, 5, 10, 30, 2)}, 0.25);
  EXPECT_EQ(joined.size(), 1U);
}

}  // namespace
}  // namespace mapp
