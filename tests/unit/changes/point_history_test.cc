#include "server/changes/point_history.h"

#include <gtest/gtest.h>

#include <string>

namespace mapp {
namespace {

/// A letter a session: seen, missed, - not judged; capitals: by many views.
PointHistory History(const std::string& visits) {
  PointHistory history;
  for (size_t i = 0; i < visits.size(); ++i) {
    if (visits[i] == '-') continue;
    const uint16_t num_views = std::isupper(visits[i]) != 0 ? 5 : 1;
    const bool seen = std::tolower(visits[i]) == 's';
    history.visits.push_back({SessionId(i + 1), seen ? num_views : uint16_t{0}, seen ? uint16_t{0} : num_views});
  }
  return history;
}

/// As History; "" for a point that tells of nothing.
std::string Course(const std::string& visits) {
  const std::optional<PointCourse> course = CourseOf(History(visits));
  std::string text;
  if (!course) return text;
  for (const PointCourse::Visit& visit : course->visits) text += visit.is_there ? 's' : 'm';
  return text;
}

TEST(PointHistoryTest, ComingAndGoingStandsOut) {
  EXPECT_EQ(Course("sssmm"), "sssmm");
  EXPECT_EQ(Course("ssssm"), "ssssm");
  EXPECT_EQ(Course("mmss"), "mmss");
  EXPECT_EQ(Course("ss--mm"), "ssmm");
  EXPECT_EQ(Course("ssmmss"), "ssmmss");
}

TEST(PointHistoryTest, ChanceDoesNot) {
  EXPECT_EQ(Course("mmsmmm"), "");
  EXPECT_EQ(Course("ssssss"), "");
  EXPECT_EQ(Course(""), "");
}

TEST(PointHistoryTest, ManyViewsAreNoChance) { EXPECT_EQ(Course("ssmmSmss"), "ssmmsmss"); }

TEST(PointHistoryTest, OneVisitMayFindAPlaceFree) { EXPECT_EQ(Course("ssmsss"), "ssmsss"); }

TEST(PointHistoryTest, WhoPassesDoesNotStay) {
  EXPECT_EQ(Course("mmSmm"), "");
  EXPECT_EQ(Course("--Smm"), "smm");  // nobody had looked before
  EXPECT_EQ(Course("mmS"), "mms");    // it may stay
}

/// Sessions of the visits that are asked about the change after a visit, counted from 0.
std::string Around(const std::string& visits, size_t visit) {
  const std::optional<PointCourse> course = CourseOf(History(visits));
  std::string text;
  if (!course) return text;
  for (const PointCourse::Visit& one : course->Around(visit)) text += visits[one.session.value() - 1];
  return text;
}

TEST(PointHistoryTest, WhatHappensLongAfterChangesNothing) {
  const std::string before(12, 's'), after(12, 'm');
  EXPECT_EQ(Around(before + after, 11), before + after);
  EXPECT_EQ(Around("mmm" + before + after + "sss", 14), before + after);
  // By then it comes and goes so often that nothing can be told, but at this time it could.
  const std::string often = "ssmmssmmssmmssmmss";
  EXPECT_EQ(Around(before + after + often, 11), before + after);
  EXPECT_EQ(Around(before + after + often, 11 + 12 + 8), "");
}

TEST(PointHistoryTest, CoursesAreThoseOfTheHistories) {
  SessionFindings first{.session = SessionId(1), .frames = {}, .own = {}, .earlier = {}};
  SessionFindings second{.session = SessionId(2), .frames = {}, .own = {}, .earlier = {}};
  for (uint64_t id = 1; id <= 40'000; ++id) {
    first.own.push_back({MapPointId(id), 3, 0});
    const bool gone = id % 3 == 0;
    second.own.push_back({MapPointId(id), static_cast<uint16_t>(gone ? 0 : 2), static_cast<uint16_t>(gone ? 2 : 0)});
  }
  const SessionFindings findings[] = {first, second};
  for (const int num_threads : {1, 2}) {
    const ChangedCourses changed = CoursesOfMissed(findings, num_threads);
    ASSERT_EQ(changed.points.size(), 13'333U);
    ASSERT_EQ(changed.courses.size(), changed.points.size());
    for (size_t i = 0; i < changed.points.size(); ++i) {
      ASSERT_EQ(changed.points[i], MapPointId(3 * (i + 1)));
      ASSERT_TRUE(changed.courses[i].ChangesAfter(0));
    }
  }
}

TEST(PointHistoryTest, NeverSeenIsNothing) { EXPECT_EQ(Course("mmmmm"), ""); }

TEST(PointHistoryTest, OnlyMissedPointsHaveHistories) {
  SessionFindings first{
      .session = SessionId(1), .frames = {}, .own = {{MapPointId(1), 3, 0}, {MapPointId(2), 3, 0}}, .earlier = {}};
  SessionFindings second{
      .session = SessionId(2), .frames = {}, .own = {{MapPointId(1), 0, 4}, {MapPointId(2), 2, 0}}, .earlier = {}};
  second.earlier[SessionId(1)] = {{MapPointId(3), 0, 2}};
  const SessionFindings findings[] = {first, second};
  const std::vector<PointHistory> histories = HistoriesOfMissed(findings);
  ASSERT_EQ(histories.size(), 2U);
  EXPECT_EQ(histories[0].point, MapPointId(1));
  ASSERT_EQ(histories[0].visits.size(), 2U);
  EXPECT_TRUE(histories[0].visits[0].seen());
  EXPECT_TRUE(histories[0].visits[1].missed());
  EXPECT_EQ(histories[1].point, MapPointId(3));
}

TEST(FindingsCodecTest, GivesBackWhatWasPutIn) {
  SessionFindings findings{
      .session = SessionId(7),
      .frames = {{FrameId(3), Pose3::Exp((Eigen::Matrix<double, 6, 1>() << 1, 2, 3, .1, .2, .3).finished())}},
      .own = {{MapPointId(5), 1, 0}, {MapPointId(900), 65535, 2}},
      .earlier = {{SessionId(2), {{MapPointId(4), 0, 9}}}}};
  const std::string bytes = EncodeFindings(findings);
  const StatusOr<SessionFindings> back = DecodeFindings(bytes);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->session, findings.session);
  EXPECT_EQ(back->own, findings.own);
  EXPECT_EQ(back->earlier, findings.earlier);
  ASSERT_EQ(back->frames.size(), 1U);
  EXPECT_EQ(Distance(back->frames[0].T_map_camera, findings.frames[0].T_map_camera), 0);
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_TRUE(absl::IsDataLoss(DecodeFindings(bytes.substr(0, size)).status())) << size;
  }
}

}  // namespace
}  // namespace mapp
