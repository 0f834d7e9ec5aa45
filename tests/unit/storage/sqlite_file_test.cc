// What is particular to the SQLite engine: the file, its owner, and what can be wrong with it.
#include "storage/sqlite/connection.h"
#include "storage/sqlite/migrator.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <fstream>
#include <sched.h>
#include <sys/mount.h>
#include <unistd.h>

namespace mapp {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

/// Runs SQL on a file behind the store's back.
void RunSql(const std::string& file, const std::string& sql) {
  Check(Value(sqlite::Connection::Open(file, sqlite::Connection::Mode::kCreate, {}))->Execute(sql));
}

void WriteFile(const std::string& file, const std::string& bytes) { std::ofstream(file, std::ios::binary) << bytes; }

std::string ReadFile(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::unique_ptr<MapStore> Open(const std::string& file, const SqliteOptions& options = {}) {
  return Value(OpenSqliteMapStore(file, options));
}

Scene AddSceneTo(MapStore& store, const std::string& map_name = "kitchen") {
  Scene scene;
  Check(store.Write({}, [&](MapWriter& writer) {
    scene = AddScene(writer, map_name);
    return absl::OkStatus();
  }));
  return scene;
}

Status Upload(MapStore& store, const Scene& scene, uint32_t number, size_t packet_bytes) {
  return store.Write({}, [&](MapWriter& writer) {
    return writer
        .InsertFrame(TestFrame(scene.map, scene.session, scene.camera, number, PoseAt(0, 0, 0)),
                     TestBytes(number, packet_bytes), {})
        .status();
  });
}

class SqliteFileTest : public testing::Test {
 protected:
  /// The message of a refusal: one line that names the file.
  std::string RefusalOf(const std::string& file, StatusCode code, const SqliteOptions& options = {}) {
    const auto store = OpenSqliteMapStore(file, options);
    EXPECT_THAT(store, HasCode(code));
    const std::string message(store.status().message());
    EXPECT_THAT(message, AllOf(HasSubstr(file), Not(HasSubstr("\n"))));
    return message;
  }

  TempFolder folder_;
  const std::string file_ = folder_.File("maps.db");
};

TEST_F(SqliteFileTest, CreatesAFileThatSqliteFindsSound) {
  AddSceneTo(*Open(file_));
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &db), SQLITE_OK);
  int (*append)(void*, int, char**, char**) = [](void* text, int, char** values, char**) {
    *static_cast<std::string*>(text) += std::string(values[0]) + " ";
    return 0;
  };
  std::string answers;
  for (const char* pragma : {"integrity_check", "journal_mode", "page_size", "user_version", "application_id"}) {
    ASSERT_EQ(sqlite3_exec(db, (std::string("PRAGMA ") + pragma).c_str(), append, &answers, nullptr), SQLITE_OK);
  }
  EXPECT_EQ(answers, fmt::format("ok wal 16384 {} 1298231408 ", sqlite::EmbeddedMigrations().size()));
  sqlite3_close(db);
}

TEST_F(SqliteFileTest, CloseLeavesOneFileAndALock) {
  const auto store = Open(file_);
  AddSceneTo(*store);
  Value(store->Read());
  Check(store->Close());
  EXPECT_FALSE(std::filesystem::exists(file_ + "-wal"));
  Open(file_);
}

TEST_F(SqliteFileTest, RefusesAFileThatIsNoDatabase) {
  const std::string text(5000, 'x');
  WriteFile(file_, text);
  EXPECT_THAT(RefusalOf(file_, StatusCode::kFailedPrecondition), HasSubstr("not a map database"));
  EXPECT_EQ(ReadFile(file_), text);
}

TEST_F(SqliteFileTest, RefusesAnotherProgramsDatabase) {
  RunSql(file_, "CREATE TABLE recipes (name TEXT); PRAGMA user_version = 1;");
  const std::string before = ReadFile(file_);
  EXPECT_THAT(RefusalOf(file_, StatusCode::kFailedPrecondition), HasSubstr("another program"));
  EXPECT_EQ(ReadFile(file_), before);
}

TEST_F(SqliteFileTest, RefusesANewerSchema) {
  Open(file_);
  const size_t newest = sqlite::EmbeddedMigrations().size();
  RunSql(file_, fmt::format("PRAGMA user_version = {};", newest + 1));
  EXPECT_THAT(RefusalOf(file_, StatusCode::kFailedPrecondition),
              HasSubstr(fmt::format("database schema {} is newer than this program's {}", newest + 1, newest)));
  EXPECT_THAT(RefusalOf(file_, StatusCode::kFailedPrecondition, {.read_only = true}), HasSubstr("newer"));
}

TEST_F(SqliteFileTest, RefusesASchemaThatAnotherMigrationMade) {
  Open(file_);
  RunSql(file_, "UPDATE schema_migrations SET sha256 = 'f00';");
  EXPECT_THAT(RefusalOf(file_, StatusCode::kFailedPrecondition), HasSubstr("0001_initial.sql"));
}

TEST_F(SqliteFileTest, RefusesAMissingFolderAndAFolder) {
  RefusalOf(folder_.File("missing/maps.db"), StatusCode::kNotFound);
  RefusalOf(folder_.path().string(), StatusCode::kFailedPrecondition);
}

TEST_F(SqliteFileTest, RefusesAFolderItMayNotWrite) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root, to become a user without rights";
  std::filesystem::permissions(folder_.path(), std::filesystem::perms(0555));
  constexpr uid_t kNobody = 65534;
  ASSERT_EQ(seteuid(kNobody), 0);
  const std::string message = RefusalOf(file_, StatusCode::kFailedPrecondition);
  ASSERT_EQ(seteuid(0), 0);
  EXPECT_THAT(message, HasSubstr("Permission denied"));
}

TEST_F(SqliteFileTest, RefusesAFileItMayNotRead) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root, to become a user without rights";
  Open(file_);
  std::filesystem::permissions(folder_.path(), std::filesystem::perms(0777));
  std::filesystem::permissions(file_, std::filesystem::perms(0600));
  std::filesystem::permissions(file_ + ".lock", std::filesystem::perms(0666));
  constexpr uid_t kNobody = 65534;
  ASSERT_EQ(seteuid(kNobody), 0);
  const std::string message = RefusalOf(file_, StatusCode::kFailedPrecondition);
  ASSERT_EQ(seteuid(0), 0);
  EXPECT_THAT(message, HasSubstr("Permission denied"));
}

TEST_F(SqliteFileTest, SecondOwnerIsRefusedByName) {
  auto owner = Open(file_);
  EXPECT_THAT(RefusalOf(file_, StatusCode::kFailedPrecondition),
              HasSubstr("in use by process " + std::to_string(getpid())));
  const std::string link = folder_.File("link.db");
  std::filesystem::create_symlink(file_, link);
  RefusalOf(link, StatusCode::kFailedPrecondition);
  Check(owner->Close());
  Open(file_);
}

TEST_F(SqliteFileTest, ToolsReadBesideTheOwner) {
  const auto owner = Open(file_);
  const auto tool = Open(file_, {.read_only = true});
  AddSceneTo(*owner);
  EXPECT_EQ(Value(Value(tool->Read())->ListMaps()).size(), 1U);
  EXPECT_THAT(tool->Write({}, [](MapWriter&) { return absl::OkStatus(); }), HasCode(StatusCode::kFailedPrecondition));
}

TEST_F(SqliteFileTest, ToolsCreateNothing) {
  RefusalOf(file_, StatusCode::kNotFound, {.read_only = true});
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
  WriteFile(file_, "");
  EXPECT_THAT(RefusalOf(file_, StatusCode::kFailedPrecondition, {.read_only = true}), HasSubstr("empty"));
}

TEST_F(SqliteFileTest, DamagedRowsAreReportedByName) {
  Scene scene;
  FrameId frame;
  MapPointId point;
  {
    const auto store = Open(file_);
    scene = AddSceneTo(*store);
    Check(Upload(*store, scene, 0, 100));
    Check(store->Write({}, [&](MapWriter& writer) {
      point = Value(writer.InsertPoint(scene.map, TestPoint(scene.session, 1, {1, 1, 1})));
      return writer.PutTileBlob(scene.map, {0, 0, 0}, {.revision = Revision(2), .bytes = "tile"});
    }));
    frame = *Value(Value(store->Read())->FindFrame(scene.session, 0));
  }
  RunSql(
      file_,
      "UPDATE keyframe_log SET packet = CAST('x' || packet AS BLOB); UPDATE tile_blobs SET blob = CAST('bad' AS BLOB);"
      "UPDATE frame_observations SET observations = x'00'; UPDATE points SET descriptor = x'00';");
  const auto store = Open(file_);
  const auto reader = Value(store->Read());
  EXPECT_THAT(reader->GetPacket(frame), HasCode(StatusCode::kDataLoss));
  EXPECT_THAT(std::string(reader->GetTileBlob(scene.map, {0, 0, 0}).status().message()), HasSubstr("tile 0/0/0"));
  EXPECT_THAT(reader->GetObservations(frame), HasCode(StatusCode::kDataLoss));
  EXPECT_THAT(reader->GetPoints(std::span(&point, 1)), HasCode(StatusCode::kDataLoss));
  EXPECT_EQ(Value(reader->GetFrame(frame)).number, 0U) << "the rest stays readable";
}

TEST_F(SqliteFileTest, DamagedEvidenceAndChangesAreReportedByName) {
  Scene scene;
  ChangeId change;
  {
    const auto store = Open(file_);
    scene = AddSceneTo(*store);
    Check(store->Write({}, [&](MapWriter& writer) {
      ChangeRecord record;
      record.map = scene.map;
      record.box_before = OrientedBox{.T_frame_box = {}, .size_m = {1, 1, 1}};
      change = Value(writer.PutChange(record));
      Check(writer.PutFindings(scene.session, "findings"));
      return writer.AppendEvidence({.session = scene.session, .number = 17, .received_ns = 0, .packet = "packet"});
    }));
  }
  RunSql(file_,
         "UPDATE evidence SET packet = x'00'; UPDATE findings SET blob = x'00'; UPDATE changes SET points_before "
         "= x'80';");
  const auto store = Open(file_);
  const auto reader = Value(store->Read());
  const Status evidence = reader->ListEvidence(scene.session).status();
  EXPECT_THAT(evidence, HasCode(StatusCode::kDataLoss));
  EXPECT_THAT(std::string(evidence.message()), HasSubstr("evidence 17 of session 1"));
  EXPECT_THAT(reader->FindFindings(scene.session), HasCode(StatusCode::kDataLoss));
  EXPECT_THAT(std::string(reader->GetChange(change).status().message()), HasSubstr("change 1"));
  EXPECT_THAT(reader->ListChanges(scene.map), HasCode(StatusCode::kDataLoss));
  Check(store->Write({}, [&](MapWriter& writer) { return writer.PutFindings(scene.session, "made again"); }));
  EXPECT_EQ(Value(Value(store->Read())->FindFindings(scene.session)), "made again");
}

TEST_F(SqliteFileTest, ImpossibleFeatureSettingsOfAMapAreReportedByName) {
  AddSceneTo(*Open(file_), "garage");
  RunSql(file_, "UPDATE maps SET feature_num_levels = 99;");
  const StatusOr<MapRecord> map = Value(Open(file_)->Read())->FindMap("garage");
  EXPECT_THAT(map, HasCode(StatusCode::kDataLoss));
  EXPECT_THAT(std::string(map.status().message()), HasSubstr("map 1: feature_settings.num_levels"));
}

/// Mounts a small disk on `folder`, in a mount namespace of the test's own: it goes with the process, however that
/// ends.
bool MountSmallDisk(const std::string& folder) {
  return unshare(CLONE_NEWNS) == 0 && mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
         mount("tmpfs", folder.c_str(), "tmpfs", 0, "size=4m") == 0;
}

/// Uploads until the disk is full, then expects that nothing of the failed one stays and that reads go on.
uint32_t FillUp(MapStore& store, const Scene& scene) {
  uint32_t number = 0;
  Status status;
  while ((status = Upload(store, scene, number, 100'000)).ok()) ++number;
  EXPECT_THAT(status, HasCode(StatusCode::kResourceExhausted));
  EXPECT_THAT(std::string(status.message()), HasSubstr("disk full"));
  const auto reader = Value(store.Read());
  EXPECT_EQ(Value(reader->GetSession(scene.session)).num_keyframes, number);
  EXPECT_EQ(Value(reader->ListFrames(scene.map, scene.session)).size(), number);
  EXPECT_EQ(Value(reader->FindFrame(scene.session, number)), std::nullopt);
  EXPECT_EQ(Value(reader->GetMap(scene.map)).revision, Revision(number));
  return number;
}

TEST_F(SqliteFileTest, FullFileTakesNothingMoreUntilThereIsRoom) {
  const auto store = Open(file_, {.max_pages = 128});
  const Scene kitchen = AddSceneTo(*store, "kitchen");
  const Scene garage = AddSceneTo(*store, "garage");
  EXPECT_GT(FillUp(*store, kitchen), 3U);
  EXPECT_THAT(Upload(*store, garage, 0, 100'000), HasCode(StatusCode::kResourceExhausted));
  Check(store->Write({}, [&](MapWriter& writer) { return writer.DeleteMap(kitchen.map); }));
  EXPECT_TRUE(Upload(*store, garage, 0, 100'000).ok());
}

TEST_F(SqliteFileTest, FullDiskTakesNothingMoreUntilThereIsRoom) {
  const std::string disk = folder_.File("disk");
  std::filesystem::create_directory(disk);
  if (!MountSmallDisk(disk)) GTEST_SKIP() << "needs the right to mount";
  {
    const std::string ballast = disk + "/ballast";
    WriteFile(ballast, std::string(2 << 20, 'x'));
    const auto store = Open(disk + "/maps.db");
    const Scene scene = AddSceneTo(*store);
    const uint32_t number = FillUp(*store, scene);
    std::filesystem::remove(ballast);
    EXPECT_TRUE(Upload(*store, scene, number, 100'000).ok());
    EXPECT_EQ(Value(Value(store->Read())->GetSession(scene.session)).num_keyframes, number + 1);
  }
  umount(disk.c_str());
}

TEST(SqliteRewriteTest, GivesPageChecksumsToADatabaseOfBefore) {
  const TempFolder folder;
  const std::string file = folder.File("maps.db");
  const auto store = Open(file, {.page_checksums = false});
  AddSceneTo(*store);
  constexpr size_t kReservedBytesAt = 20;  // of the header: bytes at the end of every page
  EXPECT_EQ(ReadFile(file)[kReservedBytesAt], 0);
  Check(store->Rewrite({}));
  EXPECT_EQ(ReadFile(file)[kReservedBytesAt], 8);
  EXPECT_EQ(Value(Value(store->Read())->ListMaps()).size(), 1U);
  AddSceneTo(*store, "garage");
  Check(store->Close());
  EXPECT_EQ(Value(Value(Open(file)->Read())->ListMaps()).size(), 2U);
}

}  // namespace
}  // namespace mapp
