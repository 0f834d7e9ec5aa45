#include "eval/metrics/change_metrics.h"

#include <gtest/gtest.h>

#include <numbers>

namespace mapp {
namespace {

using sim::ChangeKind;

/// A car's box standing at (x, y), turned by `yaw`.
OrientedBox Car(double x, double y, double yaw = 0) {
  return {Pose3(ExpSo3({0, 0, yaw}), {x, y, 0.75}), {4.2, 1.8, 1.5}};
}
TrueChange Vanished(const OrientedBox& box, int64_t stamp_ns = 0) {
  return {ChangeKind::kVanished, box, std::nullopt, stamp_ns};
}
TrueChange Appeared(const OrientedBox& box) { return {ChangeKind::kAppeared, std::nullopt, box, 0}; }
TrueChange Moved(const OrientedBox& before, const OrientedBox& after) { return {ChangeKind::kMoved, before, after, 0}; }
DetectedChange Detection(const TrueChange& change) { return {change.kind, change.before, change.after, std::nullopt}; }

std::vector<TrueChange> SomeChanges() {
  return {Vanished(Car(0, 0)), Vanished(Car(10, 0, 0.4)), Appeared(Car(0, 10, 1.2)),
          Moved(Car(20, 0), Car(20, 20, 0.7))};
}
std::vector<DetectedChange> Faithful(const std::vector<TrueChange>& changes) {
  std::vector<DetectedChange> detections;
  for (const TrueChange& change : changes) detections.push_back(Detection(change));
  return detections;
}
ChangeScore Score(const std::vector<TrueChange>& changes, const std::vector<DetectedChange>& detections,
                  const ChangeMatching& matching = {}) {
  const auto score = ScoreChanges(changes, detections, matching);
  EXPECT_TRUE(score.ok()) << score.status();
  EXPECT_EQ(
      score->all.num_right + score->num_false + score->num_duplicate + score->num_wrong_kind + score->num_wrong_time,
      score->all.num_detected);
  return *score;
}

TEST(OrientedBoxTest, IntersectionOverUnionOfKnownBoxes) {
  const OrientedBox cube{Pose3(), {1, 1, 1}};
  const auto shifted = [](double x) {
    return OrientedBox{Pose3(Eigen::Quaterniond::Identity(), {x, 0, 0}), {1, 1, 1}};
  };
  EXPECT_NEAR(IntersectionOverUnion(cube, cube), 1, 1e-12);
  EXPECT_NEAR(IntersectionOverUnion(cube, shifted(0.5)), 1.0 / 3, 0.03);
  EXPECT_EQ(IntersectionOverUnion(cube, shifted(1.01)), 0);
  EXPECT_NEAR(IntersectionOverUnion(cube, {Pose3(), {2, 2, 2}}), 1.0 / 8, 1e-12);
  // Turned by 45 degrees, two unit squares have an octagon of 2 (sqrt 2 - 1) in common.
  const OrientedBox turned{Pose3(ExpSo3({0, 0, std::numbers::pi / 4}), {0, 0, 0}), {1, 1, 1}};
  const double common = 2 * (std::numbers::sqrt2 - 1);
  EXPECT_NEAR(IntersectionOverUnion(cube, turned), common / (2 - common), 0.03);
  EXPECT_EQ(IntersectionOverUnion(cube, {Pose3(), {1, 1, 0}}), 0);
}

TEST(ScoreChangesTest, TellsHowWellTheBoxesOfRightDetectionsAgree) {
  const std::vector<TrueChange> changes = {Vanished(Car(0, 0)), Vanished(Car(10, 0))};
  // One is shifted by a third of its width, one lies elsewhere.
  const ChangeScore score = Score(changes, {Detection(Vanished(Car(0, 0.6))), Detection(Vanished(Car(30, 0)))});
  ASSERT_EQ(score.right_ious.size(), 1U);
  EXPECT_NEAR(score.right_ious.front(), 0.5, 0.03);
}

TEST(OrientedBoxTest, ABoxOfTheMapStandsInTheWorldAsTheMapDoes) {
  const Pose3 T_world_map(ExpSo3({std::numbers::pi / 2, 0, 0}), {5, 0, 1});
  const OrientedBox box = BoxIn(T_world_map, Aabb(Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(2, 4, 6)));
  EXPECT_NEAR(box.Volume(), 48, 1e-12);
  EXPECT_TRUE(box.Contains(T_world_map * Eigen::Vector3d(1.9, 3.9, 5.9)));
  EXPECT_FALSE(box.Contains(T_world_map * Eigen::Vector3d(2.1, 3.9, 5.9)));
  EXPECT_TRUE(box.Contains(T_world_map * Eigen::Vector3d(2.1, 3.9, 5.9), 0.2));
}

TEST(ChangeScoreTest, FaithfulDetectionsAreFlawless) {
  const ChangeScore score = Score(SomeChanges(), Faithful(SomeChanges()));
  EXPECT_DOUBLE_EQ(*score.all.Precision(), 1);
  EXPECT_DOUBLE_EQ(*score.all.Recall(), 1);
  EXPECT_EQ(score.Of(ChangeKind::kVanished).num_found, 2);
  EXPECT_EQ(score.Of(ChangeKind::kAppeared).num_found, 1);
  EXPECT_EQ(score.Of(ChangeKind::kMoved).num_found, 1);
}

TEST(ChangeScoreTest, AHiddenChangeCostsRecallOnly) {
  auto detections = Faithful(SomeChanges());
  detections.erase(detections.begin());
  const ChangeScore score = Score(SomeChanges(), detections);
  EXPECT_DOUBLE_EQ(*score.all.Recall(), 0.75);
  EXPECT_DOUBLE_EQ(*score.Of(ChangeKind::kVanished).Recall(), 0.5);
  EXPECT_DOUBLE_EQ(*score.Of(ChangeKind::kAppeared).Recall(), 1);
  EXPECT_DOUBLE_EQ(*score.all.Precision(), 1);
}

TEST(ChangeScoreTest, AFalseEventCostsPrecisionOnly) {
  auto detections = Faithful(SomeChanges());
  detections.push_back(Detection(Vanished(Car(50, 50))));
  const ChangeScore score = Score(SomeChanges(), detections);
  EXPECT_DOUBLE_EQ(*score.all.Precision(), 0.8);
  EXPECT_DOUBLE_EQ(*score.Of(ChangeKind::kVanished).Precision(), 2.0 / 3);
  EXPECT_DOUBLE_EQ(*score.all.Recall(), 1);
  EXPECT_EQ(score.num_false, 1);
}

TEST(ChangeScoreTest, ToldTwiceIsRightOnce) {
  auto detections = Faithful({Vanished(Car(0, 0))});
  detections.push_back(Detection(Vanished(Car(0.3, 0.2))));
  const ChangeScore score = Score({Vanished(Car(0, 0))}, detections);
  EXPECT_EQ(score.all.num_right, 1);
  EXPECT_EQ(score.num_duplicate, 1);
  EXPECT_DOUBLE_EQ(*score.all.Recall(), 1);
}

TEST(ChangeScoreTest, BoxesMustBeOfOnePlace) {
  // A sliver of the car with its centre inside counts; a box beside it does not.
  const OrientedBox sliver{Pose3(Eigen::Quaterniond::Identity(), {1.9, 0, 0.4}), {0.3, 0.3, 0.3}};
  EXPECT_EQ(Score({Vanished(Car(0, 0))}, {Detection(Vanished(sliver))}).all.num_right, 1);
  EXPECT_EQ(Score({Vanished(Car(0, 0))}, {Detection(Vanished(Car(0, 2.1)))}).num_false, 1);
  // Half a car's length off: they share enough volume, though the centre is outside the smaller margin.
  EXPECT_EQ(Score({Vanished(Car(0, 0))}, {Detection(Vanished(Car(2.3, 0)))}).all.num_right, 1);
  EXPECT_EQ(Score({Vanished(Car(0, 0))}, {Detection(Vanished(Car(2.3, 0)))}, {.min_iou = 0.5}).num_false, 1);
}

TEST(ChangeScoreTest, TheBestOfTwoNeighboursIsTaken) {
  // Two cars side by side, detections listed the other way round and each nearer to its own.
  const std::vector<TrueChange> changes = {Vanished(Car(0, 0)), Vanished(Car(0, 2.0))};
  const ChangeScore score = Score(changes, {Detection(Vanished(Car(0, 1.8))), Detection(Vanished(Car(0, 0.6)))});
  EXPECT_EQ(score.all.num_found, 2);
  EXPECT_EQ(score.all.num_right, 2);
}

TEST(ChangeScoreTest, TheWrongKindIsNotRight) {
  const ChangeScore score = Score({Vanished(Car(0, 0))}, {Detection(Appeared(Car(0, 0)))});
  EXPECT_EQ(score.num_wrong_kind, 1);
  EXPECT_DOUBLE_EQ(*score.all.Recall(), 0);
  EXPECT_DOUBLE_EQ(*score.Of(ChangeKind::kAppeared).Precision(), 0);
  EXPECT_EQ(score.Of(ChangeKind::kVanished).Precision(), std::nullopt);
  EXPECT_EQ(Score({Vanished(Car(0, 0))}, {Detection(Moved(Car(0, 0), Car(5, 5)))}).num_wrong_kind, 1);
}

TEST(ChangeScoreTest, AMoveMayBeToldAsLeavingAndComing) {
  const std::vector<TrueChange> moved = {Moved(Car(0, 0), Car(8, 0))};
  const ChangeScore both = Score(moved, {Detection(Vanished(Car(0, 0))), Detection(Appeared(Car(8, 0)))});
  EXPECT_EQ(both.all.num_right, 2);
  EXPECT_EQ(both.Of(ChangeKind::kMoved).num_found, 1);
  EXPECT_DOUBLE_EQ(*both.all.Recall(), 1);
  EXPECT_EQ(Score(moved, {Detection(Appeared(Car(8, 0)))}).all.num_found, 1);
  EXPECT_EQ(Score(moved, {Detection(Appeared(Car(0, 0)))}).num_wrong_kind, 1);
  // Told as a move, each part told again is a duplicate; one wrong place does not spoil the other.
  const ChangeScore again = Score(moved, {Detection(moved[0]), Detection(Vanished(Car(0, 0)))});
  EXPECT_EQ(again.all.num_right, 1);
  EXPECT_EQ(again.num_duplicate, 1);
  EXPECT_EQ(Score(moved, {Detection(Moved(Car(0, 0), Car(30, 0)))}).all.num_right, 1);
}

TEST(ChangeScoreTest, TheTimeMustFitWhereItIsTold) {
  const std::vector<TrueChange> changes = {Vanished(Car(0, 0), 1000)};
  DetectedChange detection = Detection(changes[0]);
  detection.window_ns = {900, 1000};
  EXPECT_EQ(Score(changes, {detection}).all.num_right, 1);
  detection.window_ns = {1001, 1100};
  const ChangeScore late = Score(changes, {detection});
  EXPECT_EQ(late.num_wrong_time, 1);
  EXPECT_DOUBLE_EQ(*late.all.Recall(), 0);
  EXPECT_EQ(Score(changes, {detection}, {.time_slack_ns = 1}).all.num_right, 1);
}

TEST(ChangeScoreTest, NothingToFindAndNothingSaid) {
  const ChangeScore score = Score({}, {});
  EXPECT_EQ(score.all.Precision(), std::nullopt);
  EXPECT_EQ(score.all.Recall(), std::nullopt);
  const DetectedChange no_box{ChangeKind::kVanished, std::nullopt, Car(0, 0), std::nullopt};
  EXPECT_EQ(ScoreChanges({}, std::vector{no_box}).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(TrueChangesTest, TakeTheBoxesOfTheWorldsObjects) {
  sim::World world;
  sim::WorldObject car;
  car.id = 7;
  car.size_m = {4, 2, 1.5};
  world.objects = {car};
  const Pose3 before(ExpSo3({0, 0, 0.3}), {1, 2, 0.75});
  const auto changes =
      TrueChangesOf(world, std::vector<sim::WorldChange>{{50, 7, ChangeKind::kVanished, before, std::nullopt}});
  ASSERT_TRUE(changes.ok()) << changes.status();
  EXPECT_EQ((*changes)[0].stamp_ns, 50);
  EXPECT_FALSE((*changes)[0].after);
  EXPECT_TRUE((*changes)[0].before->Contains(before * Eigen::Vector3d(1.9, -0.9, 0.7)));
  EXPECT_EQ(TrueChangesOf(world, std::vector<sim::WorldChange>{{50, 8, ChangeKind::kVanished, before, before}})
                .status()
                .code(),
            absl::StatusCode::kNotFound);
}

TEST(ChangedPointsTest, CountsThePointsOfTheBoxes) {
  const std::vector<OrientedBox> boxes = {Car(0, 0, 0.5)};
  const Pose3& T_frame_box = boxes[0].T_frame_box;
  const std::vector<Eigen::Vector3d> points = {
      T_frame_box * Eigen::Vector3d(2, 0, 0), T_frame_box * Eigen::Vector3d(-2, 0.8, 0.7),
      T_frame_box * Eigen::Vector3d(2.15, 0, 0),  // 5 cm before the bonnet
      T_frame_box * Eigen::Vector3d(4, 0, 0), T_frame_box * Eigen::Vector3d(0, 3, 0)};
  const auto score = ScoreChangedPoints(points, {true, false, true, true, false}, boxes, 0.1);
  ASSERT_TRUE(score.ok()) << score.status();
  EXPECT_DOUBLE_EQ(*score->Precision(), 2.0 / 3);
  EXPECT_DOUBLE_EQ(*score->Recall(), 2.0 / 3);
  EXPECT_DOUBLE_EQ(*ScoreChangedPoints(points, {true, false, true, true, false}, boxes, 0)->Recall(), 0.5);
  EXPECT_FALSE(ScoreChangedPoints(points, {true}, boxes, 0).ok());
}

}  // namespace
}  // namespace mapp
