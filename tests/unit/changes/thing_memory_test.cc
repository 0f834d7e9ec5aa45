#include "server/changes/thing_memory.h"

#include <gtest/gtest.h>

#include <vector>

namespace mapp {
namespace {

/// A thing of two points that three sessions tell of.
struct Asked {
  GroupEvent event{SessionId(3), false};
  std::vector<MapPointId> ids{MapPointId(7), MapPointId(9)};
  std::vector<Eigen::Vector3f> p_map{{0, 0, 1}, {0, 1, 1}};
  std::vector<TellingSession> telling{
      {SessionId(1), 10, {2, 0}}, {SessionId(2), 20, {2, 0}}, {SessionId(3), 30, {0, 2}}};

  ThingQuestion question() const { return {event, ids, p_map, telling}; }
};

std::vector<SessionFindings> Findings(double x_m = 0) {
  std::vector<SessionFindings> findings;
  for (uint64_t session = 1; session <= 3; ++session) {
    findings.push_back({.session = SessionId(session),
                        .frames = {{FrameId(session), Pose3(Eigen::Quaterniond::Identity(), {x_m, 0, 0})}},
                        .own = {},
                        .earlier = {}});
  }
  return findings;
}

ThingVerdict Left() {
  ThingVerdict verdict;
  verdict.happening.emplace();
  verdict.happening->confidence = 0.9;
  return verdict;
}

TEST(ThingMemoryTest, AnswersTheSameQuestion) {
  ThingMemory memory;
  memory.Begin(Findings());
  const Asked asked;
  EXPECT_FALSE(memory.Find(asked.question()).has_value());
  memory.Keep(asked.question(), Left());
  memory.End();
  memory.Begin(Findings());
  Asked again;
  again.p_map[0].x() += 0.01F;  // as refinement moves points
  const std::optional<ThingVerdict> found = memory.Find(again.question());
  ASSERT_TRUE(found.has_value());
  ASSERT_TRUE(found->happening.has_value());
  EXPECT_EQ(found->happening->confidence, 0.9);
}

TEST(ThingMemoryTest, EverythingThatAVerdictRestsOnCounts) {
  ThingMemory memory;
  memory.Begin(Findings());
  memory.Keep(Asked().question(), Left());
  const auto is_other = [&](const auto& change) {
    Asked asked;
    change(asked);
    return !memory.Find(asked.question()).has_value();
  };
  EXPECT_FALSE(is_other([](Asked&) {}));
  EXPECT_TRUE(is_other([](Asked& asked) { asked.event.came = true; }));
  EXPECT_TRUE(is_other([](Asked& asked) { asked.event.session = SessionId(2); }));
  EXPECT_TRUE(is_other([](Asked& asked) { asked.ids[1] = MapPointId(8); }));
  EXPECT_TRUE(is_other([](Asked& asked) { asked.p_map[1].y() += 0.1F; }));
  EXPECT_TRUE(is_other([](Asked& asked) { asked.telling[0].counts.num_missed = 1; }));
  EXPECT_TRUE(is_other([](Asked& asked) { asked.telling[0].has_views = false; }));
  EXPECT_TRUE(is_other([](Asked& asked) { asked.telling.pop_back(); }));
  // Frames that were made anew from other poses.
  memory.Begin(Findings(0.5));
  EXPECT_TRUE(is_other([](Asked&) {}));
}

TEST(ThingMemoryTest, ForgetsWhatNobodyAsksFor) {
  ThingMemory memory;
  memory.Begin(Findings());
  memory.Keep(Asked().question(), Left());
  memory.End();
  memory.Begin(Findings());
  memory.End();
  memory.Begin(Findings());
  EXPECT_FALSE(memory.Find(Asked().question()).has_value());
}

}  // namespace
}  // namespace mapp
