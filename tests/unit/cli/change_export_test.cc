#include "cli/change_export.h"

#include "change_scene.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

namespace mapp {
namespace {

using testing::HasSubstr;
using Json = nlohmann::json;

Json FeaturesOf(const ChangeScene& scene) { return Json::parse(FormatChangeFeatures(scene.now, scene.changes)); }

TEST(ChangeFeaturesTest, AreAFeatureCollectionInTheMapsMetres) {
  const Json json = FeaturesOf({});
  EXPECT_EQ(json["type"], "FeatureCollection");
  EXPECT_EQ(json["format_version"], 1);
  EXPECT_EQ(json["map"], "garage");
  EXPECT_EQ(json["revision"], 42);
  ASSERT_EQ(json["features"].size(), 5U);
  const Json& moved = json["features"][2];
  EXPECT_EQ(moved["type"], "Feature");
  EXPECT_EQ(moved["id"], 3);
  EXPECT_EQ(moved["properties"]["kind"], "moved");
  EXPECT_EQ(moved["properties"]["points_before"].size(), 40U);
  EXPECT_EQ(moved["properties"]["box_before"]["size_m"], Json({0.7, 1.0, 0.5}));
  EXPECT_EQ(moved["properties"]["box_after"]["outline_m"], moved["geometry"]["coordinates"][0]);
  EXPECT_TRUE(json["features"][0]["properties"]["box_after"].is_null());
}

TEST(ChangeFeaturesTest, OutlinesLieOnTheGroundOfALevelCamera) {
  const Json json = FeaturesOf({});
  const auto at = [&](const char* axis, size_t i) { return json["ground"][axis][i].get<double>(); };
  EXPECT_NEAR(at("up_map", 1), -1, 1e-6);
  EXPECT_NEAR(at("u_map", 0), 1, 1e-6);
  EXPECT_NEAR(at("v_map", 2), 1, 1e-6);
  // A crate of 0.9 x 0.6 m at x 2, z 2, turned by 30 degrees about y.
  const Json& ring = json["features"][0]["geometry"]["coordinates"][0];
  ASSERT_EQ(ring.size(), 5U);
  EXPECT_EQ(ring.front(), ring.back());
  double twice_area = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (size_t i = 0; i + 1 < ring.size(); ++i) {
    const Eigen::Vector2d a(ring[i][0].get<double>(), ring[i][1].get<double>());
    const Eigen::Vector2d b(ring[i + 1][0].get<double>(), ring[i + 1][1].get<double>());
    twice_area += a.x() * b.y() - a.y() * b.x();
    sum += a;
  }
  EXPECT_NEAR(twice_area / 2, 0.9 * 0.6, 1e-6) << "counterclockwise";
  EXPECT_NEAR(sum.x() / 4, 2, 1e-6);
  EXPECT_NEAR(sum.y() / 4, 2, 1e-6);
  const Json& box = json["features"][0]["properties"]["box_before"];
  EXPECT_NEAR(box["min_height_m"].get<double>(), 0, 1e-6);
  EXPECT_NEAR(box["max_height_m"].get<double>(), 0.8, 1e-6);
}

TEST(ChangeFeaturesTest, GroundIsLevelWhereverUpIs) {
  ChangeScene scene;
  // The same room in a map whose z is up.
  const Pose3 T_up_room(Eigen::Quaterniond(Eigen::AngleAxisd(-1.5707963267948966, Eigen::Vector3d::UnitX())),
                        Eigen::Vector3d::Zero());
  for (MapFrameSummary& frame : scene.now.frames) frame.T_map_camera = T_up_room * frame.T_map_camera;
  for (ChangeSummary& change : scene.changes) {
    for (std::optional<OrientedBox>* box : {&change.box_map_before, &change.box_map_after}) {
      if (*box) (*box)->T_frame_box = T_up_room * (*box)->T_frame_box;
    }
  }
  const Json json = FeaturesOf(scene);
  EXPECT_NEAR(json["ground"]["up_map"][2].get<double>(), 1, 1e-6);
  EXPECT_NEAR(json["ground"]["v_map"][1].get<double>(), 1, 1e-6);
  EXPECT_NEAR(json["features"][0]["properties"]["box_before"]["max_height_m"].get<double>(), 0.8, 1e-6);
}

TEST(ChangedPlyTest, HasEveryPointInItsColor) {
  const ChangedMap map = ChangeScene().ToChangedMap();
  const std::string ply = FormatChangedPly(map);
  const size_t num_points = map.now.points.size() + 40;
  EXPECT_THAT(ply, HasSubstr("element vertex " + std::to_string(num_points) + "\n"));
  const std::string end = "property uchar blue\nend_header\n";
  const std::string body = ply.substr(ply.find(end) + end.size());
  constexpr size_t kRecordBytes = 27;
  ASSERT_EQ(body.size(), num_points * kRecordBytes);
  const auto color_of = [&](size_t i) { return body.substr(i * kRecordBytes + 24, 3); };
  EXPECT_EQ(color_of(0), "\xA0\xA0\xA0");
  EXPECT_EQ(color_of(4000), "\xC8\x1E\x1E") << "the first of #1";
  EXPECT_EQ(color_of(num_points - 1), "\xC8\x1E\x1E") << "retired";
}

TEST(ChangeExportTest, FormatGoesByTheSuffix) {
  EXPECT_EQ(ChangeExportFormatOf("a/b.geojson").value(), ChangeExportFormat::kJson);
  EXPECT_EQ(ChangeExportFormatOf("b.json").value(), ChangeExportFormat::kJson);
  EXPECT_EQ(ChangeExportFormatOf("b.x.ply").value(), ChangeExportFormat::kPly);
  for (const std::string file : {"b", "b.png", "b.PLY", "b.ply/c", "json", "-", ""}) {
    const Status status = ChangeExportFormatOf(file).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << file;
    EXPECT_THAT(status.ToString(), HasSubstr(".json, .geojson or .ply"));
  }
  EXPECT_TRUE(CheckPngName("a.png").ok());
  EXPECT_TRUE(CheckPngName("-").ok());
  EXPECT_THAT(CheckPngName("a.jpg").ToString(), HasSubstr("a.jpg: the name must end in .png"));
}

}  // namespace
}  // namespace mapp
