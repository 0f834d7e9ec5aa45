#include "eval/overlap_study.h"

#include "eval/study_map.h"
#include "server/service/overlap_assessor.h"
#include "storage/map_store.h"
#include "tests/unit/server/service_fixture.h"

#include <gmock/gmock.h>

#include <numbers>

namespace mapp::testing {
namespace {

using ::testing::HasSubstr;

constexpr double kBack = std::numbers::pi;

/// The founder maps the half of the room towards +z; a second device looks there again, and then into the other half.
class OverlapStudyTest : public ServiceFixture {
 protected:
  OverlapStudyTest() : founder_(Open()) {
    for (uint32_t i = 0; i < 5; ++i) {
      const double x = -1 + 0.5 * i;
      MustUpload(world_, SyntheticWorld::Stand(x, -2, -0.2 * x), founder_, i);
    }
  }

  /// The second device's keyframes: `revisits` of the founder's half, then `others` of the other one.
  void Visit(uint32_t revisits, uint32_t others) {
    visitor_ = Open();
    Align(visitor_);
    for (uint32_t i = 0; i < revisits; ++i) {
      MustUpload(world_, SyntheticWorld::Stand(-0.2 + 0.1 * i, -1.9, 0.03), visitor_, i);
    }
    for (uint32_t i = 0; i < others; ++i) {
      MustUpload(world_, SyntheticWorld::Stand(0.1 * i, 1, kBack), visitor_, revisits + i);
    }
  }

  OverlapStudyOptions Options() const {
    OverlapStudyOptions options;
    options.database_file = (folder_ / "map.db").string();
    options.map_name = "room";
    options.query_sessions = {visitor_};
    options.samplers = {SamplerKind::kUniform, SamplerKind::kDepthSketch, SamplerKind::kOccupancy};
    return options;
  }

  static OverlapStudy MustRun(const OverlapStudyOptions& options) {
    const auto study = RunOverlapStudy(options);
    EXPECT_TRUE(study.ok()) << study.status();
    return *study;
  }

  static std::string Refusal(const OverlapStudyOptions& options) {
    const Status status = RunOverlapStudy(options).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(status.message());
  }

  /// What the map answers about a view by the depth sketch of what the world shows there.
  std::vector<bool> Answer(TileCache& tiles, const Pose3& T_map_camera) {
    Rng rng(4);
    const MapView view{Map().id, T_map_camera, SyntheticWorld::DeviceCamera(), Map().cone_range_m};
    ViewQuery query;
    query.sketch = MakeDepthSketch(view.camera, OwnPoints(world_.View(T_map_camera, founder_, 0, rng), view.camera));
    const auto answer = AssessView(tiles, view, query, 1000);
    EXPECT_TRUE(answer.ok()) << answer.status();
    return std::get<SampleStates>(*answer).redundant;
  }

  SessionId founder_;
  SessionId visitor_;
};

TEST_F(OverlapStudyTest, SketchAndBinsTellKnownViewsFromNew) {
  Visit(4, 3);
  const OverlapStudy study = MustRun(Options());
  EXPECT_EQ(study.num_views, 7);
  EXPECT_EQ(study.num_partial_skipped, 0);
  EXPECT_GT(study.num_map_points, 100);
  EXPECT_GT(study.mean_own_points, 50);
  EXPECT_GT(*study.oracle_matched_of_known, 0.9);
  ASSERT_EQ(study.rows.size(), 3);
  for (const OverlapStudyRow& row : std::span(study.rows).subspan(1)) {
    SCOPED_TRACE(static_cast<int>(row.sampler));
    EXPECT_EQ(row.by_geometry.num_views, 7);
    // What the visitor has brought of the other half is not in the map that is asked.
    EXPECT_NEAR(row.by_geometry.mean_true_overlap, 4.0 / 7, 0.05);
    EXPECT_DOUBLE_EQ(*row.by_geometry.seen.F1(), 1);
    EXPECT_LT(std::abs(row.by_geometry.bias), 0.05);
    EXPECT_LT(*row.by_geometry.Lost(), 0.1);
    EXPECT_LT(*row.by_geometry.Resent(), 0.1);
    EXPECT_GT(*row.matched_of_known, 0.9);
    EXPECT_DOUBLE_EQ(*row.localisable_of_seen, 1);
    EXPECT_LE(row.query_bytes.max, 43);
  }
  EXPECT_EQ(study.rows[2].sampler, SamplerKind::kOccupancy);
  EXPECT_LE(study.rows[1].answer_bytes.max, 1000 / 8 + 4);
}

TEST_F(OverlapStudyTest, TheUniformConeNeverSaysSeen) {
  Visit(4, 3);
  const OverlapStudyRow row = MustRun(Options()).rows[0];
  EXPECT_EQ(row.sampler, SamplerKind::kUniform);
  EXPECT_GT(row.by_geometry.rmse, MustRun(Options()).rows[1].by_geometry.rmse);
  EXPECT_LT(row.query_bytes.max, MustRun(Options()).rows[1].query_bytes.max);  // it tells of no depths
}

TEST_F(OverlapStudyTest, AWrongPoseShowsInWhatIsLostAndResent) {
  Visit(6, 0);
  OverlapStudyOptions options = Options();
  options.samplers = {SamplerKind::kDepthSketch};
  const OverlapScore exact = MustRun(options).rows[0].by_geometry;
  options.pose_noise_m = 0.5;
  options.pose_noise_rad = 0.2;
  const OverlapScore wrong = MustRun(options).rows[0].by_geometry;
  EXPECT_DOUBLE_EQ(wrong.mean_true_overlap, exact.mean_true_overlap);  // the truth knows the exact pose
  EXPECT_GT(*wrong.Resent(), *exact.Resent() + 0.05);
  EXPECT_LT(wrong.bias, exact.bias - 0.05);
  EXPECT_EQ(MustRun(options).rows[0].by_geometry.rmse, wrong.rmse);  // same seed, same figures
}

TEST_F(OverlapStudyTest, TheMapIsAsItWasWithoutTheAskingSession) {
  TileCache before_tiles(*store_, size_t{64} << 20);
  const Pose3 revisit = SyntheticWorld::Stand(0.1, -1.9, 0.03);
  const Pose3 other_half = SyntheticWorld::Stand(0, 1, kBack);
  const std::vector<bool> revisit_before = Answer(before_tiles, revisit);
  const std::vector<bool> other_before = Answer(before_tiles, other_half);
  const int64_t num_points_before = Map().num_points;

  Visit(3, 3);
  TileCache after_tiles(*store_, size_t{64} << 20);
  EXPECT_NE(Answer(after_tiles, other_half), other_before);
  const auto without = LoadMapWithout(*store_, Map(), {visitor_});
  ASSERT_TRUE(without.ok()) << without.status();
  EXPECT_EQ(static_cast<int64_t>(without->points.size()), num_points_before);
  EXPECT_EQ(Answer(*without->tiles, revisit), revisit_before);
  EXPECT_EQ(Answer(*without->tiles, other_half), other_before);

  const auto whole = LoadMapWithout(*store_, Map(), {});
  ASSERT_TRUE(whole.ok()) << whole.status();
  EXPECT_EQ(static_cast<int64_t>(whole->points.size()), Map().num_points);
  EXPECT_EQ(Answer(*whole->tiles, other_half), Answer(after_tiles, other_half));
}

TEST_F(OverlapStudyTest, SaysWhatItCannotAsk) {
  Visit(1, 0);
  OverlapStudyOptions options = Options();
  options.query_sessions = {};
  EXPECT_THAT(Refusal(options), HasSubstr("query_sessions"));
  options.query_sessions = {visitor_, visitor_};
  EXPECT_THAT(Refusal(options), HasSubstr("twice"));
  options.query_sessions = {visitor_, founder_};
  EXPECT_THAT(Refusal(options), HasSubstr("no other session"));
  options.query_sessions = {Open(SensorKind::kRgbd, "elsewhere")};
  EXPECT_THAT(Refusal(options), HasSubstr("not one of map \"room\""));
  options = Options();
  options.samplers.clear();
  EXPECT_THAT(Refusal(options), HasSubstr("samplers"));
  options = Options();
  options.num_samples = 0;
  EXPECT_THAT(Refusal(options), HasSubstr("num_samples"));
  options = Options();
  options.min_own_points = 100'000;
  EXPECT_THAT(Refusal(options), HasSubstr("1 with fewer points"));
  options = Options();
  options.map_name = "unknown";
  EXPECT_EQ(RunOverlapStudy(options).status().code(), absl::StatusCode::kNotFound);
  options.database_file = (folder_ / "absent.db").string();
  EXPECT_EQ(RunOverlapStudy(options).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace mapp::testing
