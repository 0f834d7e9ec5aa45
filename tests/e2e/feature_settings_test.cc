// A map keeps the settings that its features were extracted with, and refuses those of others by name.

#include "mapp/client/participant.h"
#include "tests/e2e/service_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mapp {
namespace {

using testing::HasSubstr;

class FeatureSettingsTest : public ServiceTest {
 protected:
  /// A device with a SLAM system of its own, whose extractor has these settings.
  StatusOr<std::unique_ptr<Participant>> Join(const std::string& map, const FeatureSettings& features) {
    MapClientOptions client;
    client.server_address = server().address();
    ParticipantOptions options;
    options.map_name = map;
    options.policy = UploadPolicy::kUploadAll;
    options.features = features;
    const Camera camera{.projection = PinholeCamera{525, 525, 319.5, 239.5}, .width_px = 640, .height_px = 480};
    return Participant::Open(client, options, camera, SensorKind::kRgbd, /*adapter=*/nullptr);
  }
  std::string ShowMap(const std::string& map) {
    const Finished shown = RunMapp({"maps", "show", map, "--json", "--server", server().address()});
    EXPECT_EQ(shown.exit_code, 0) << shown.err;
    return shown.out;
  }
};

TEST_F(FeatureSettingsTest, BuiltInTrackerIsRefusedByAMapOfAnotherSetting) {
  StartServer();
  const FeatureSettings wide{.patch_size_px = 41};
  ASSERT_TRUE(Join("place", wide).ok());
  KillAndRestartServer();
  EXPECT_THAT(ExpectFailure(ReplayArguments("sim:room/0", "device")),
              HasSubstr("feature_settings.patch_size_px: the map \"place\" was made with 41, this session has 31"));
  EXPECT_EQ(JsonNumber(ShowMap("place"), "patch_size_px"), 41.0);
  EXPECT_EQ(JsonNumber(ShowMap("place"), "num_sessions"), 1.0);
  const auto again = Join("place", wide);
  EXPECT_TRUE(again.ok()) << again.status();
}

TEST_F(FeatureSettingsTest, MapOfAnOlderDatabaseHasTheDefaults) {
  std::filesystem::copy_file(std::string(MAPP_SOURCE_DIR) + "/tests/golden/db/schema_0002.db", folder().File("map.db"));
  StartServer();
  const std::string shown = ShowMap("golden");
  EXPECT_THAT(shown, HasSubstr("\"descriptor_kind\": \"ORB-256\""));
  EXPECT_THAT(shown, HasSubstr("\"scale_factor\": 1.2,"));
  EXPECT_EQ(JsonNumber(shown, "num_levels"), 8.0);
  EXPECT_EQ(JsonNumber(shown, "patch_size_px"), 31.0);

  const Status other = Join("golden", {.scale_factor = 1.5F}).status();
  EXPECT_EQ(other.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(other.ToString(),
              HasSubstr("feature_settings.scale_factor: the map \"golden\" was made with 1.2, this session has 1.5"));
  EXPECT_EQ(JsonNumber(ShowMap("golden"), "num_sessions"), JsonNumber(shown, "num_sessions"));
  const auto same = Join("golden", {});
  EXPECT_TRUE(same.ok()) << same.status();
}

}  // namespace
}  // namespace mapp
