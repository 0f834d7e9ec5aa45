#include "sim/world/world_files.h"

#include "text/file_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <regex>

namespace mapp::sim {
namespace {

using testing::HasSubstr;

template <typename T>
T At(const std::string& bytes, size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

Scene TwoQuads() {
  const auto texture = std::make_shared<const Texture>(GrayImage(4, 4, 100));
  Scene scene;
  scene.quads.push_back({{1, 2, 3}, {4, 0, 0}, {0, 0, -2}, texture});
  scene.quads.push_back({{0, 0, 0}, {1, 0, 0}, {0, -1, 0}, texture});
  return scene;
}

TEST(WriteMeshTest, ReadsBackAsTwoTrianglesAQuadThatFaceItsFront) {
  const std::string file = testing::TempDir() + "/mapp_mesh_test.ply";
  const Scene scene = TwoQuads();
  ASSERT_TRUE(WriteMesh(scene, file).ok());
  const std::string ply = ReadInput(file).value();
  EXPECT_THAT(ply, HasSubstr("element vertex 8\n"));
  EXPECT_THAT(ply, HasSubstr("element face 4\n"));
  const std::string end = "end_header\n";
  const size_t body = ply.find(end) + end.size();
  constexpr size_t kVertexBytes = 12;
  constexpr size_t kFaceBytes = 13;
  ASSERT_EQ(ply.size(), body + 8 * kVertexBytes + 4 * kFaceBytes);
  const auto vertex = [&](size_t i) {
    const size_t at = body + i * kVertexBytes;
    return Eigen::Vector3d(At<float>(ply, at), At<float>(ply, at + 4), At<float>(ply, at + 8));
  };
  double area_m2 = 0;
  for (size_t i = 0; i < 4; ++i) {
    const size_t at = body + 8 * kVertexBytes + i * kFaceBytes;
    ASSERT_EQ(ply[at], 3);
    const Eigen::Vector3d a = vertex(At<uint32_t>(ply, at + 1));
    const Eigen::Vector3d b = vertex(At<uint32_t>(ply, at + 5));
    const Eigen::Vector3d c = vertex(At<uint32_t>(ply, at + 9));
    const Eigen::Vector3d normal = (b - a).cross(c - a);
    EXPECT_NEAR((normal.normalized() - scene.quads[i / 2].NormalWorld()).norm(), 0, 1e-6);
    area_m2 += 0.5 * normal.norm();
  }
  EXPECT_NEAR(area_m2, 8 + 1, 1e-5);
  std::filesystem::remove(file);
}

TEST(WriteMeshTest, NamesTheFileThatCannotBeWritten) {
  const Status status = WriteMesh(TwoQuads(), "/no/such/folder/mesh.ply");
  EXPECT_FALSE(status.ok());
  EXPECT_THAT(std::string(status.message()), HasSubstr("/no/such/folder/mesh.ply"));
}

World MovedCarAndVanishedBox() {
  World world;
  world.setting = "garage";
  WorldObject car;
  car.id = 1;
  car.kind = "car";
  car.model = 3;
  car.size_m = {4, 2, 1.5};
  const double angle = 0.25;
  car.placements = {{.T_world_object = Pose3({1, 0, 0, 0}, {1, 2, 0.75})},
                    {2'500'000'000, Pose3({std::cos(angle), 0, 0, std::sin(angle)}, {5, 6, 0.75})}};
  WorldObject box = car;
  box.id = 2;
  box.kind = "box";
  box.placements = {{.T_world_object = Pose3()}, {1'000'000'000, std::nullopt}};
  world.objects = {car, box};
  return world;
}

TEST(WriteChangesTest, ReadsBackWithTimesAndBoxes) {
  const std::string file = testing::TempDir() + "/mapp_changes_test.json";
  ASSERT_TRUE(WriteChanges(MovedCarAndVanishedBox(), file).ok());
  const std::string text = ReadInput(file).value();
  EXPECT_THAT(text, HasSubstr("\"stamp_ns\": 1000000000,"));
  EXPECT_THAT(text, HasSubstr("\"after\": null"));
  // OpenCV's parser knows no null.
  const cv::FileStorage json(std::regex_replace(text, std::regex("null"), "0"),
                             cv::FileStorage::READ | cv::FileStorage::MEMORY | cv::FileStorage::FORMAT_JSON);
  ASSERT_TRUE(json.isOpened());
  EXPECT_EQ(json["setting"].string(), "garage");
  const cv::FileNode changes = json["changes"];
  ASSERT_EQ(changes.size(), 2);
  EXPECT_EQ(changes[0]["change"].string(), "vanished");
  EXPECT_EQ(changes[0]["kind"].string(), "box");
  EXPECT_EQ(static_cast<int>(changes[0]["object"]), 2);
  EXPECT_EQ(changes[1]["change"].string(), "moved");
  EXPECT_EQ(changes[1]["kind"].string(), "car");
  EXPECT_DOUBLE_EQ(static_cast<double>(changes[1]["time_s"]), 2.5);
  EXPECT_DOUBLE_EQ(static_cast<double>(changes[1]["before"]["center"][1]), 2);
  EXPECT_DOUBLE_EQ(static_cast<double>(changes[1]["after"]["center"][0]), 5);
  EXPECT_DOUBLE_EQ(static_cast<double>(changes[1]["after"]["size"][2]), 1.5);
  EXPECT_NEAR(static_cast<double>(changes[1]["after"]["yaw"]), 0.5, 1e-9);
  std::filesystem::remove(file);
}

TEST(WriteChangesTest, NamesTheFileThatCannotBeWritten) {
  EXPECT_THAT(std::string(WriteChanges(MovedCarAndVanishedBox(), "/no/such/folder/c.json").message()),
              HasSubstr("/no/such/folder/c.json"));
}

}  // namespace
}  // namespace mapp::sim
