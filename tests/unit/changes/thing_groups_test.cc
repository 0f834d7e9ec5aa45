#include "server/changes/thing_groups.h"

#include "mapp/base/rng.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

namespace mapp {
namespace {

const Eigen::Vector3f kUpOfMap(0, -1, 0);

/// A letter a session: seen, missed, - not judged.
PointCourse CourseFrom(const std::string& visits) {
  PointCourse course;
  for (size_t i = 0; i < visits.size(); ++i) {
    if (visits[i] != '-') course.visits.push_back({SessionId(i + 1), visits[i] == 's', visits[i] == 's'});
  }
  return course;
}

/// Points of a block of 1.8 x 1.5 x 1 m that begins at x.
void AddBlock(float x_m, size_t num, const std::string& visits, Rng& rng, std::vector<PointCourse>& courses,
              std::vector<Eigen::Vector3f>& p_map) {
  for (size_t i = 0; i < num; ++i) {
    p_map.emplace_back(x_m + static_cast<float>(rng.Uniform(0, 1.8)), static_cast<float>(rng.Uniform(-1.5, 0)),
                       static_cast<float>(rng.Uniform(5, 6)));
    courses.push_back(CourseFrom(visits));
  }
}

TEST(ThingGroupsTest, HistoriesTell) {
  EXPECT_TRUE(TellTheSame(CourseFrom("sssmm").visits, CourseFrom("s-smm").visits));
  EXPECT_FALSE(TellTheSame(CourseFrom("sssmm").visits, CourseFrom("smmmm").visits));
  EXPECT_FALSE(TellTheSame(CourseFrom("sss--").visits, CourseFrom("sssmm").visits));  // gone for none of them together
  EXPECT_FALSE(TellTheSame(CourseFrom("mmsss").visits, CourseFrom("sssmm").visits));
}

TEST(ThingGroupsTest, ThingsApartAreThings) {
  Rng rng(1);
  std::vector<PointCourse> courses;
  std::vector<Eigen::Vector3f> p_map;
  AddBlock(0, 200, "ssmm", rng, courses, p_map);
  AddBlock(4, 100, "ssmm", rng, courses, p_map);
  AddBlock(0, 60, "smmm", rng, courses, p_map);  // another that stood in the first one's place
  const std::vector<ChangedThing> things = GroupThings(courses, p_map, kUpOfMap, {});
  std::multiset<size_t> sizes;
  for (const ChangedThing& thing : things) sizes.insert(thing.points.size());
  EXPECT_EQ(sizes, (std::multiset<size_t>{60, 97, 200}));
}

TEST(ThingGroupsTest, NeighboursWithStrayPointsBetweenThemAreTwo) {
  Rng rng(1);
  std::vector<PointCourse> courses;
  std::vector<Eigen::Vector3f> p_map;
  AddBlock(0, 400, "ssmm", rng, courses, p_map);
  AddBlock(2.4F, 400, "ssmm", rng, courses, p_map);
  p_map.emplace_back(2.1F, -0.5F, 5.2F);
  courses.push_back(CourseFrom("ssmm"));
  const std::vector<ChangedThing> things = GroupThings(courses, p_map, kUpOfMap, {});
  ASSERT_EQ(things.size(), 2U);
  EXPECT_EQ(things[0].points.size() + things[1].points.size(), 801U);
  EXPECT_EQ(things[0].group, things[1].group);
}

TEST(ThingGroupsTest, FewPointsAreNoThing) {
  Rng rng(1);
  std::vector<PointCourse> courses;
  std::vector<Eigen::Vector3f> p_map;
  AddBlock(0, 5, "ssmm", rng, courses, p_map);
  EXPECT_TRUE(GroupThings(courses, p_map, kUpOfMap, {}).empty());
  EXPECT_TRUE(GroupThings({}, {}, kUpOfMap, {}).empty());
}

}  // namespace
}  // namespace mapp
