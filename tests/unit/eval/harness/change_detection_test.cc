#include "eval/harness/change_detection.h"

#include "eval/harness/fleet.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/datasets/temp_folder.h"

#include <gtest/gtest.h>

#include <map>

namespace mapp {
namespace {

constexpr int kNumFrames = 3;

/// Two sessions of the map that a fleet makes, whose first frame is not in the map.
Status FillTwoSessions(const std::string& database) {
  MAPP_ASSIGN_OR_RETURN(const auto store, OpenSqliteMapStore(database));
  const auto fill = [](MapWriter& writer) -> Status {
    MapRecord map;
    map.name = kEvalMapName;
    MAPP_ASSIGN_OR_RETURN(const MapId map_id, writer.CreateMap(map));
    Camera pinhole;
    pinhole.projection = PinholeCamera{500, 500, 320, 240};
    pinhole.width_px = 640;
    pinhole.height_px = 480;
    MAPP_ASSIGN_OR_RETURN(const CameraId camera, writer.InsertCamera(pinhole));
    for (const char* device : {"a", "b"}) {
      SessionRecord session;
      session.map = map_id;
      session.camera = camera;
      session.device = device;
      MAPP_ASSIGN_OR_RETURN(const SessionId session_id, writer.InsertSession(session));
      for (int i = 0; i < kNumFrames; ++i) {
        FrameRecord frame;
        frame.map = map_id;
        frame.session = session_id;
        frame.camera = camera;
        frame.number = static_cast<uint32_t>(i);
        frame.in_map = i > 0;
        frame.T_frame_camera = Pose3(ExpSo3({0, 0, 0.1 * i}), {10.0 * i, 0, 0});
        MAPP_RETURN_IF_ERROR(writer.InsertFrame(frame, "packet", {}).status());
      }
    }
    return absl::OkStatus();
  };
  MAPP_RETURN_IF_ERROR(store->Write(CallContext::WithTimeout(std::chrono::seconds(30)), fill));
  return store->Close();
}

TEST(DisplaceSessionsTest, CamerasOfASessionMoveAlikeAndNoFurtherThanTold) {
  const test::TempFolder folder;
  const std::string database = folder.File("map.db");
  const Status filled = FillTwoSessions(database);
  ASSERT_TRUE(filled.ok()) << filled;
  const Status displaced = DisplaceSessions(database, /*max_m=*/0.1, /*max_rad=*/0.02, /*seed=*/1);
  ASSERT_TRUE(displaced.ok()) << displaced;

  const auto store = OpenSqliteMapStore(database, {.read_only = true}).value();
  const auto reader = store->Read().value();
  const MapRecord map = reader->FindMap(kEvalMapName).value();
  std::map<SessionId, Eigen::Vector3d> offsets_map;
  const std::vector<FrameRecord> frames = reader->ListFrames(map.id, std::nullopt).value();
  ASSERT_EQ(frames.size(), 2U * kNumFrames);
  for (const FrameRecord& frame : frames) {
    const double i = frame.number;
    const Pose3 T_map_camera(ExpSo3({0, 0, 0.1 * i}), {10 * i, 0, 0});
    const Eigen::Vector3d offset_map = frame.T_frame_camera.translation() - T_map_camera.translation();
    const double turn = frame.T_frame_camera.rotation().angularDistance(T_map_camera.rotation());
    if (!frame.in_map) {
      EXPECT_LT(offset_map.norm() + turn, 1e-6) << "a fragment has no place in the map that could be wrong";
      continue;
    }
    EXPECT_GT(offset_map.norm(), 0);
    EXPECT_LE(offset_map.norm(), 0.1 + 1e-9);
    EXPECT_GT(turn, 0);
    EXPECT_LE(turn, 0.02 + 1e-9);
    const auto [known, is_first] = offsets_map.emplace(frame.session, offset_map);
    EXPECT_LT((known->second - offset_map).norm(), 1e-6);
  }
  ASSERT_EQ(offsets_map.size(), 2U);
  EXPECT_GT((offsets_map.begin()->second - offsets_map.rbegin()->second).norm(), 1e-4);
}

TEST(DisplaceSessionsTest, ADatabaseWithoutTheMapIsRefused) {
  const test::TempFolder folder;
  EXPECT_EQ(DisplaceSessions(folder.File("map.db"), 0.1, 0.02, 1).code(), absl::StatusCode::kNotFound);
}

TEST(DetectChangesTest, AServerThatIsNotThereIsNamed) {
  const auto detection = DetectChanges("127.0.0.1:1", std::stop_token());
  EXPECT_EQ(detection.status().code(), absl::StatusCode::kUnavailable) << detection.status();
}

}  // namespace
}  // namespace mapp
