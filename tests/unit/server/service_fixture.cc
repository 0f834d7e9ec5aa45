#include "tests/unit/server/service_fixture.h"

#include "mapp/codec/keyframe_codec.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <fmt/format.h>

#include <atomic>
#include <unistd.h>

namespace mapp::testing {

std::filesystem::path MakeTestFolder() {
  std::string pattern = (std::filesystem::temp_directory_path() / "mapp-service-XXXXXX").string();
  if (mkdtemp(pattern.data()) == nullptr) ADD_FAILURE() << "cannot make " << pattern;
  return pattern;
}

ServiceFixture::ServiceFixture() : folder_(MakeTestFolder()) {
  StatusOr<std::unique_ptr<MapStore>> store =
      OpenSqliteMapStore((folder_ / "map.db").string(), {.sync_commits = false});
  EXPECT_TRUE(store.ok()) << store.status();
  store_ = *std::move(store);
  StatusOr<std::unique_ptr<MapService>> service = MapService::Create(*store_, {});
  EXPECT_TRUE(service.ok()) << service.status();
  service_ = *std::move(service);
}

ServiceFixture::~ServiceFixture() {
  service_.reset();
  EXPECT_TRUE(store_->Close().ok());
  store_.reset();
  std::filesystem::remove_all(folder_);
}

SessionId ServiceFixture::Open(SensorKind sensor, const std::string& map_name, const FeatureSettings& features) {
  OpenSessionInput input;
  input.map_name = map_name;
  input.device = "device";
  input.sensor = sensor;
  input.camera = SyntheticWorld::DeviceCamera();
  input.features = features;
  input.create_map = true;
  const StatusOr<OpenedSession> opened = service_->OpenSession(context_, input);
  EXPECT_TRUE(opened.ok()) << opened.status();
  return opened->session;
}

StatusOr<UploadResult> ServiceFixture::Upload(const Keyframe& keyframe) {
  return service_->UploadKeyframe(context_, EncodeKeyframe(keyframe));
}

UploadResult ServiceFixture::MustUpload(const SyntheticWorld& world, const Pose3& T_world_camera, SessionId session,
                                        uint32_t number, uint64_t first_session_point) {
  const StatusOr<UploadResult> result = Upload(world.View(T_world_camera, session, number, rng_, first_session_point));
  EXPECT_TRUE(result.ok()) << result.status();
  return *result;
}

double ServiceFixture::Overlap(const SyntheticWorld& world, const Pose3& T_world_camera, SessionId session,
                               SamplerKind sampler) {
  constexpr int kNumSamples = 1000;
  const Camera camera = SyntheticWorld::DeviceCamera();
  const std::vector<Eigen::Vector3d> own = OwnPoints(world.View(T_world_camera, session, 0, rng_), camera);
  ViewQuery query;
  query.T_frame_camera = T_world_camera;
  query.sampler = sampler;
  query.sketch = MakeQuerySketch(sampler, camera, own);
  const StatusOr<AssessedOverlap> assessed = service_->AssessOverlap(context_, session, query, kNumSamples);
  EXPECT_TRUE(assessed.ok()) << assessed.status();
  const OverlapQuestion question{camera, Map().cone_range_m, sampler, query.sketch, kNumSamples};
  if (const auto* states = std::get_if<SampleStates>(&assessed->answer)) {
    EXPECT_EQ(states->redundant.size(), DrawSamples(question).p_camera.size());
  }
  return CountOverlap(question, assessed->answer, own).overlap;
}

void ServiceFixture::Align(SessionId session) {
  const Status aligned = store_->Write(context_, [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(SessionRecord record, writer.GetSession(session));
    record.T_map_session = Pose3();
    record.aligned_at_keyframe = 0;
    return writer.UpdateSession(record);
  });
  EXPECT_TRUE(aligned.ok()) << aligned;
}

MapRecord ServiceFixture::Map(const std::string& name) {
  const StatusOr<MapState> map = service_->GetMap(context_, name, "");
  EXPECT_TRUE(map.ok()) << map.status();
  return map->record;
}

SessionRecord ServiceFixture::Session(SessionId session) {
  StatusOr<std::unique_ptr<MapReader>> reader = store_->Read();
  EXPECT_TRUE(reader.ok()) << reader.status();
  StatusOr<SessionRecord> record = (*reader)->GetSession(session);
  EXPECT_TRUE(record.ok()) << record.status();
  return *std::move(record);
}

}  // namespace mapp::testing
