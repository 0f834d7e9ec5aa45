// Flips bits of a database that the service has written: what is read is what was written, or an error says so.
#include "mapp/base/bytes.h"
#include "mapp/base/rng.h"
#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/tile_codec.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/server/service_fixture.h"
#include "tests/unit/storage/map_dump.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cstdlib>
#include <fstream>
#include <map>

namespace mapp::testing {
namespace {

using ::testing::AnyOf;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr size_t kPageBytes = 16384;

int NumPlaces() {
  constexpr int kNumPlaces = 200;
  const char* wanted = std::getenv("MAPP_TEST_BIT_FLIPS");
  return wanted != nullptr ? std::atoi(wanted) : kNumPlaces;
}

void FlipBit(const std::string& file, size_t byte, int bit) {
  std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
  stream.seekg(static_cast<std::streamoff>(byte));
  const auto flipped = static_cast<char>(stream.get() ^ (1 << bit));
  stream.seekp(static_cast<std::streamoff>(byte));
  stream.put(flipped);
}

std::string ReadFile(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// Two maps that a service has made: one of three sessions, two of them fragments, and one of a single keyframe.
class DamagedDatabaseTest : public ServiceFixture {
 protected:
  DamagedDatabaseTest() {
    const SessionId founder = OpenAndUpload(world_, "room", {-1, 0, 1});
    const SessionId closed = OpenAndUpload(world_, "room", {0.5});
    OpenAndUpload(SyntheticWorld(99), "room", {0});
    founders_["room"] = founder;
    founders_["attic"] = OpenAndUpload(world_, "attic", {0});
    SharedMapInput input;
    input.session = founder;
    input.view.T_frame_camera = SyntheticWorld::Stand(0, -2, 0);
    Check(service_->RequestSharedMap(context_, input, [](const std::string&) { return absl::OkStatus(); }).status());
    Value(service_->PutTag(context_, "room", "monday", "2"));
    Check(service_->CloseSession(context_, closed).status());
    Check(store_->Write(context_, [&](MapWriter& writer) {
      return writer.AppendPlaceBlock(Value(writer.FindMap("room")).id, TestBytes(5, 30'000));
    }));
    // What is not in the main file has checksums of SQLite's own.
    service_.reset();
    Check(store_->Close());
    std::filesystem::copy_file(folder_ / "map.db", copy_);
  }
  ~DamagedDatabaseTest() override {
    // The base class closes what it has opened.
    service_.reset();
  }

  SessionId OpenAndUpload(const SyntheticWorld& world, const std::string& map, const std::vector<double>& stands_x_m) {
    const SessionId session = Open(SensorKind::kRgbd, map);
    uint32_t number = 0;
    for (const double x_m : stands_x_m) {
      MustUpload(world, SyntheticWorld::Stand(x_m, -2, 0), session, number, 1 + 10'000 * number);
      ++number;
    }
    return session;
  }

  struct Answers {
    int num_ok = 0;
    std::vector<Status> errors;
    void Take(const Status& status) {
      if (status.ok()) {
        ++num_ok;
      } else {
        errors.push_back(status);
      }
    }
  };
  /// What a device asks that enters a map, and uploads.
  /// As devices do: a change that shared its commit with one that met a damaged page, as that of an encoded tile stored
  /// behind an answer, is undone with it, and to be tried again.
  template <typename Call>
  static auto Insist(const Call& call) {
    constexpr int kMaxTries = 5;
    auto result = call();
    for (int i = 1; i < kMaxTries && absl::IsUnavailable(StatusOf(result)); ++i) result = call();
    return result;
  }

  Answers Visit(MapService& service, const std::string& map) {
    Answers answers;
    answers.Take(service.GetMap(context_, map, "").status());
    answers.Take(service.ListSessions(context_, map).status());
    answers.Take(service.ListRevisions(context_, map, 10).status());
    OpenSessionInput input;
    input.map_name = map;
    input.device = "visitor";
    input.camera = SyntheticWorld::DeviceCamera();
    const StatusOr<OpenedSession> opened = Insist([&] { return service.OpenSession(context_, input); });
    answers.Take(opened.status());
    if (!opened.ok()) return answers;
    const Pose3 stand = SyntheticWorld::Stand(0.2, -2, 0);
    const auto upload = [&](SessionId session, uint32_t number) {
      const std::string packet = EncodeKeyframe(world_.View(stand, session, number, rng_));
      answers.Take(Insist([&] { return service.UploadKeyframe(context_, packet); }).status());
    };
    upload(opened->session, 0);
    // A founder asks in the map's own frame, with what is in the map already.
    const SessionId founder = founders_.at(map);
    upload(founder, 9);
    ViewQuery view;
    view.T_frame_camera = stand;
    view.sketch =
        MakeQuerySketch(view.sampler, input.camera, OwnPoints(world_.View(stand, founder, 0, rng_), input.camera));
    constexpr int kNumSamples = 100;
    answers.Take(service.AssessOverlap(context_, founder, view, kNumSamples).status());
    SharedMapInput shared;
    shared.session = founder;
    shared.view.T_frame_camera = stand;
    const auto decode = [](const std::string& bytes) { return DecodeTile(bytes).status(); };
    answers.Take(service.RequestSharedMap(context_, shared, decode).status());
    answers.Take(Insist([&] { return service.CloseSession(context_, opened->session); }).status());
    return answers;
  }

  /// Everything that a server reads, as text; throws what an error says.
  std::string ReadAll() const {
    const auto store = Value(OpenSqliteMapStore(copy_, {.sync_commits = false}));
    const auto reader = Value(store->Read());
    std::string dump;
    for (const MapRecord& map : Value(reader->ListMaps())) {
      dump += DumpMap(*reader, map.id);
      for (const FrameRecord& frame : Value(reader->ListFrames(map.id, std::nullopt))) {
        dump += fmt::format("packet {:08x}\n", Crc32c(Value(reader->GetPacket(frame.id))));
      }
      for (const SessionRecord& session : Value(reader->ListSessions(map.id))) {
        dump += fmt::format("camera {}x{}\n", Value(reader->GetCamera(session.camera)).camera.width_px,
                            Value(reader->GetCamera(session.camera)).camera.height_px);
        for (const PointRecord& point : Value(reader->PointsOfSession(session.id))) {
          const Eigen::Vector3f& direction = point.view_direction;
          dump += fmt::format("point {} {} {} {} {} {} {} {:08x} {}\n", point.id.value(), direction.x(), direction.y(),
                              direction.z(), point.reference_distance_m, point.num_observations, point.confidence,
                              Crc32c({reinterpret_cast<const char*>(&point.descriptor), OrbDescriptor::kBytes}),
                              fmt::join(Values(point.observers), " "));
        }
      }
      for (const TileRecord& tile : Value(reader->ListTiles(map.id, std::nullopt))) {
        const std::optional<TileBlob> blob = Value(reader->GetTileBlob(map.id, tile.key));
        if (blob) dump += fmt::format("blob {} {:08x}\n", blob->revision.value(), Crc32c(blob->bytes));
      }
      for (const std::string& block : Value(reader->ListPlaceBlocks(map.id))) {
        dump += fmt::format("places {:08x}\n", Crc32c(block));
      }
      for (const TagRecord& tag : Value(reader->ListTags(map.id))) {
        dump += fmt::format("tag {} {}\n", tag.name, tag.revision.value());
      }
      const auto before = Value(store->ReadAsOf(map.id, Revision(1)));
      dump += DumpMap(*before, map.id);
    }
    return dump;
  }
  static std::vector<uint64_t> Values(const std::vector<FrameId>& ids) {
    std::vector<uint64_t> values;
    for (const FrameId id : ids) values.push_back(id.value());
    return values;
  }

  std::map<std::string, SessionId> founders_;
  const std::string copy_ = (folder_ / "copy.db").string();
};

TEST_F(DamagedDatabaseTest, IsReadAsItWasOrNamesTheDamage) {
  const std::string written = ReadFile(copy_);
  const std::string content = ReadAll();
  ASSERT_THAT(content, AllOf(HasSubstr("blob "), HasSubstr("places "), HasSubstr("tag monday"), HasSubstr("packet ")));
  Rng rng(20260115);
  int num_harmless = 0;
  int num_reported = 0;
  for (int i = 0; i < NumPlaces(); ++i) {
    const size_t byte = rng.Below(written.size());
    const int bit = static_cast<int>(rng.Below(8));
    SCOPED_TRACE(fmt::format("byte {} (page {}) bit {}", byte, byte / kPageBytes + 1, bit));
    FlipBit(copy_, byte, bit);
    try {
      EXPECT_TRUE(ReadAll() == content) << "other content than was written";
      ++num_harmless;
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(),
                  ContainsRegex(fmt::format("^DATA_LOSS: .*page {} .*is damaged", byte / kPageBytes + 1)));
      ++num_reported;
    }
    FlipBit(copy_, byte, bit);
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_TRUE(ReadFile(copy_) == written) << "reading has changed the file";
  EXPECT_GT(num_reported, num_harmless);
  RecordProperty("reported", num_reported);
  RecordProperty("harmless", num_harmless);
}

TEST_F(DamagedDatabaseTest, ACallThatMeetsADamagedPageFailsAloneAndByName) {
  const std::string original = copy_ + ".original";
  std::filesystem::rename(copy_, original);
  const size_t num_pages = std::filesystem::file_size(original) / kPageBytes;
  Rng rng(3);
  int num_all_served = 0;
  int num_others_served = 0;
  int num_refused = 0;
  for (size_t page = 1; page <= num_pages; page += 1 + rng.Below(6)) {
    SCOPED_TRACE(fmt::format("page {}", page));
    std::filesystem::copy_file(original, copy_, std::filesystem::copy_options::overwrite_existing);
    FlipBit(copy_, (page - 1) * kPageBytes + rng.Below(kPageBytes), static_cast<int>(rng.Below(8)));
    const auto is_named = ContainsRegex(fmt::format("page {} of copy.db is damaged", page));
    const auto store = OpenSqliteMapStore(copy_, {.sync_commits = false});
    auto service = store.ok() ? MapService::Create(**store, {}) : store.status();
    if (!service.ok()) {
      EXPECT_THAT(service, HasCode(absl::StatusCode::kDataLoss));
      EXPECT_THAT(std::string(service.status().message()), is_named);
      ++num_refused;
      continue;
    }
    const Answers room = Visit(**service, "room");
    const Answers attic = Visit(**service, "attic");
    for (const Status& error : room.errors) {
      EXPECT_THAT(error, HasCode(absl::StatusCode::kDataLoss));
      EXPECT_THAT(std::string(error.message()), is_named);
    }
    num_all_served += room.errors.empty() && attic.errors.empty();
    num_others_served += !room.errors.empty() && attic.errors.empty();
    service->reset();
    Check((*store)->Close());
  }
  RecordProperty("all_served", num_all_served);
  RecordProperty("others_served", num_others_served);
  RecordProperty("refused", num_refused);
  EXPECT_GT(num_others_served, 0);
  EXPECT_GT(num_refused, 0);
}

}  // namespace
}  // namespace mapp::testing
