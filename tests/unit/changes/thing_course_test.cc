#include "server/changes/thing_course.h"

#include <gtest/gtest.h>

#include <string>

namespace mapp {
namespace {

constexpr int64_t kDayNs = 86400'000'000'000;

/// A visit a day, from day 1: s saw the thing, m missed it, M missed it with rays that went on beyond, d doubts.
std::vector<ThingVisit> VisitsFrom(const std::string& text) {
  std::vector<ThingVisit> visits;
  for (size_t i = 0; i < text.size(); ++i) {
    const bool seen = text[i] == 's';
    const PresenceEvidence evidence{static_cast<int64_t>(i + 1) * kDayNs,
                                    seen             ? 30.0
                                    : text[i] == 'd' ? 10.0
                                                     : 0.0,
                                    seen             ? 0.0
                                    : text[i] == 'd' ? 10.0
                                                     : 30.0};
    visits.push_back({SessionId(i + 1), evidence, text[i] == 'M'});
  }
  return visits;
}

std::optional<Happening> At(const std::string& text, ChangeKind kind, int64_t day) {
  return HappeningAt(VisitsFrom(text), kind, day * kDayNs, {});
}

TEST(ThingCourseTest, TellsWhenAThingLeftAndWhoSaidSo) {
  const std::optional<Happening> left = At("sssmm", ChangeKind::kVanished, 4);
  ASSERT_TRUE(left.has_value());
  EXPECT_GT(left->confidence, 0.95);
  EXPECT_EQ(left->time.since_ns, 1 * kDayNs);
  EXPECT_EQ(left->time.after_ns, 3 * kDayNs);
  EXPECT_EQ(left->time.before_ns, 4 * kDayNs);
  EXPECT_EQ(left->time.until_ns, 5 * kDayNs);
  EXPECT_EQ(left->first_seen_ns, 1 * kDayNs);
  EXPECT_EQ(left->last_seen_ns, 3 * kDayNs);
  EXPECT_EQ(left->sessions.size(), 5U);
  EXPECT_EQ(left->seen_by, (std::vector<SessionId>{SessionId(3), SessionId(2), SessionId(1)}));
  EXPECT_EQ(left->missed_by, (std::vector<SessionId>{SessionId(4), SessionId(5)}));
}

TEST(ThingCourseTest, AnotherTimeOrKindIsAnotherEvent) {
  EXPECT_FALSE(At("sssmm", ChangeKind::kVanished, 3).has_value());
  EXPECT_FALSE(At("sssmm", ChangeKind::kVanished, 5).has_value());
  EXPECT_FALSE(At("sssmm", ChangeKind::kAppeared, 4).has_value());
  EXPECT_TRUE(At("smmss", ChangeKind::kVanished, 2).has_value());
  EXPECT_TRUE(At("smmss", ChangeKind::kAppeared, 4).has_value());
}

TEST(ThingCourseTest, AVisitInDoubtDoesNotBoundTheTime) {
  const std::optional<Happening> left = At("ssdmm", ChangeKind::kVanished, 3);
  ASSERT_TRUE(left.has_value());
  EXPECT_GT(left->confidence, 0.9);
  EXPECT_EQ(left->time.after_ns, 2 * kDayNs);
  EXPECT_EQ(left->time.before_ns, 4 * kDayNs);
}

TEST(ThingCourseTest, WhoPassesIsNoEvent) {
  EXPECT_FALSE(At("mmsmm", ChangeKind::kAppeared, 3).has_value());
  EXPECT_FALSE(At("mmsmm", ChangeKind::kVanished, 4).has_value());
  EXPECT_TRUE(At("mmssm", ChangeKind::kAppeared, 3).has_value());
  // What had stood there for two visits has come back.
  EXPECT_TRUE(At("ssmsm", ChangeKind::kVanished, 5).has_value());
  // Nobody knows whether it will stay, or had stayed before.
  EXPECT_TRUE(At("mmmms", ChangeKind::kAppeared, 5).has_value());
  EXPECT_TRUE(At("smmmm", ChangeKind::kVanished, 2).has_value());
}

TEST(ThingCourseTest, OneVisitMissesAThingForNothingUnlessItLooksThrough) {
  EXPECT_FALSE(At("ssmss", ChangeKind::kVanished, 3).has_value());
  EXPECT_FALSE(At("ssmss", ChangeKind::kAppeared, 4).has_value());
  EXPECT_TRUE(At("ssMss", ChangeKind::kVanished, 3).has_value());
  EXPECT_TRUE(At("ssMss", ChangeKind::kAppeared, 4).has_value());
}

TEST(ThingCourseTest, AStayIsAsLongAsAllVisitsTell) {
  const std::vector<ThingVisit> all = VisitsFrom("mssssssmm");
  std::optional<Happening> left = HappeningAt(std::span(all).subspan(4), ChangeKind::kVanished, 8 * kDayNs, {});
  ASSERT_TRUE(left.has_value());
  EXPECT_EQ(left->first_seen_ns, 5 * kDayNs);
  ExtendStay(all, *left);
  EXPECT_EQ(left->first_seen_ns, 2 * kDayNs);
  EXPECT_EQ(left->last_seen_ns, 7 * kDayNs);

  const std::vector<ThingVisit> later = VisitsFrom("mmsssss");
  std::optional<Happening> came = HappeningAt(std::span(later).first(4), ChangeKind::kAppeared, 3 * kDayNs, {});
  ASSERT_TRUE(came.has_value());
  EXPECT_EQ(came->last_seen_ns, 4 * kDayNs);
  ExtendStay(later, *came);
  EXPECT_EQ(came->first_seen_ns, 3 * kDayNs);
  EXPECT_EQ(came->last_seen_ns, 7 * kDayNs);
}

TEST(ThingCourseTest, NoVisitsTellNothing) { EXPECT_FALSE(At("", ChangeKind::kVanished, 1).has_value()); }

}  // namespace
}  // namespace mapp
