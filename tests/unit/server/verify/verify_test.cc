#include "server/service/compaction.h"
#include "storage/map_store.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/server/service_fixture.h"
#include "tests/unit/server/verify/healthy_database.h"

#include <gmock/gmock.h>
#include <sqlite3.h>

#include <filesystem>
#include <fstream>

namespace mapp::testing {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

int64_t CountRows(const std::string& table) {
  sqlite3* db = nullptr;
  EXPECT_EQ(sqlite3_open_v2(HealthyDatabase().c_str(), &db, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
  sqlite3_stmt* count = nullptr;
  EXPECT_EQ(sqlite3_prepare_v2(db, ("SELECT count(*) FROM " + table).c_str(), -1, &count, nullptr), SQLITE_OK);
  EXPECT_EQ(sqlite3_step(count), SQLITE_ROW);
  const int64_t rows = sqlite3_column_int64(count, 0);
  sqlite3_finalize(count);
  sqlite3_close(db);
  return rows;
}

TEST(VerifyTest, WhatAServiceHasWrittenIsClean) {
  const auto report = Verify(HealthyDatabase());
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->num_violations(), 0) << Describe(*report);
  EXPECT_EQ(report->num_maps, 1);
  EXPECT_EQ(report->num_keyframes, CountRows("frames"));
  EXPECT_EQ(report->num_points, CountRows("points"));
  // Else nothing would have been looked at.
  for (const char* table : {"frame_pose_history", "frame_observation_history", "point_history", "session_history",
                            "map_history", "tile_blobs", "tags", "revisions", "frame_index", "tile_index"}) {
    EXPECT_GT(CountRows(table), 0) << table;
  }
  EXPECT_GT(CountRows("point_history WHERE fused_into IS NOT NULL"), 0);
  EXPECT_GT(CountRows("tile_blobs b JOIN tiles t USING (tile_id) WHERE b.revision = t.revision"), 0);
}

TEST(VerifyTest, StaysCleanWhenHistoryIsDropped) {
  const DatabaseCopy copy;
  {
    const auto store = OpenSqliteMapStore(copy.file());
    ASSERT_TRUE(store.ok()) << store.status();
    const auto reader = (*store)->Read();
    ASSERT_TRUE(reader.ok()) << reader.status();
    const StatusOr<std::vector<MapRecord>> maps = (*reader)->ListMaps();
    ASSERT_TRUE(maps.ok()) << maps.status();
    for (const MapRecord& map : *maps) {
      const CompactionRequest everything{.map_name = map.name, .keep_revisions = 0, .keep_days = {}};
      const Status untagged = (*store)->Write({}, [&](MapWriter& writer) -> Status {
        MAPP_ASSIGN_OR_RETURN(const std::vector<TagRecord> tags, writer.ListTags(map.id));
        for (const TagRecord& tag : tags) MAPP_RETURN_IF_ERROR(writer.DeleteTag(map.id, tag.name));
        return absl::OkStatus();
      });
      ASSERT_TRUE(untagged.ok()) << untagged;
      const auto compacted = CompactMap(**store, {}, everything, /*now_ns=*/0, {});
      ASSERT_TRUE(compacted.ok()) << compacted.status();
      EXPECT_GT(compacted->num_rows, 0);
      EXPECT_EQ(compacted->oldest, map.revision);
    }
  }
  const auto report = Verify(copy.file());
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->num_violations(), 0) << Describe(*report);
}

TEST(VerifyTest, EarlierSchemasAreCleanOnceMigrated) {
  for (const auto& entry : fs::directory_iterator(fs::path(MAPP_SOURCE_DIR) / "tests/golden/db")) {
    if (entry.path().extension() != ".db") continue;
    SCOPED_TRACE(entry.path());
    const fs::path folder = MakeTestFolder();
    const std::string file = (folder / "map.db").string();
    fs::copy_file(entry.path(), file);
    const auto store = OpenSqliteMapStore(file);
    ASSERT_TRUE(store.ok()) << store.status();
    ASSERT_TRUE((*store)->Close().ok());
    const auto report = Verify(file);
    ASSERT_TRUE(report.ok()) << report.status();
    for (const Violation& violation : report->violations) {
      // Packets, blobs and observers are made up in those, as no service would.
      EXPECT_THAT(violation.check, AnyOf("packets", "tile_blobs", "observers")) << Describe(*report);
    }
    fs::remove_all(folder);
  }
}

TEST(VerifyTest, ListsSoManyAndCountsTheRest) {
  const DatabaseCopy copy;
  copy.RunSql("UPDATE points SET confidence = 2");
  const auto report = Verify(copy.file(), 3);
  ASSERT_TRUE(report.ok()) << report.status();
  ASSERT_EQ(report->violations.size(), 3U) << Describe(*report);
  ASSERT_EQ(report->unlisted.size(), 1U);
  EXPECT_EQ(report->unlisted[0].check, "points");
  EXPECT_EQ(report->unlisted[0].count, report->num_points - 3);
  EXPECT_EQ(report->num_violations(), report->num_points);
}

TEST(VerifyTest, TellsHowFarItIs) {
  std::vector<VerifyProgress> told;
  VerifyOptions options;
  options.on_progress = [&told](const VerifyProgress& progress) { told.push_back(progress); };
  const auto report = VerifyDatabase({}, HealthyDatabase(), options);
  ASSERT_TRUE(report.ok()) << report.status();
  ASSERT_EQ(static_cast<int>(told.size()), report->num_checks);
  for (int i = 0; i < report->num_checks; ++i) {
    EXPECT_EQ(told[i].num_done, i);
    EXPECT_EQ(told[i].num_checks, report->num_checks);
    EXPECT_FALSE(told[i].check.empty());
  }
}

TEST(VerifyTest, StopsWhenAsked) {
  bool cancelled = false;
  CallContext context;
  context.is_cancelled = [&cancelled] { return cancelled; };
  VerifyOptions options;
  int num_told = 0;
  options.on_progress = [&](const VerifyProgress&) { cancelled = ++num_told == 3; };
  EXPECT_EQ(VerifyDatabase(context, HealthyDatabase(), options).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(num_told, 3);
}

TEST(VerifyTest, ChangesNothing) {
  const DatabaseCopy copy;
  const auto written = fs::last_write_time(copy.file());
  const auto report = Verify(copy.file());
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(fs::last_write_time(copy.file()), written);
  EXPECT_FALSE(fs::exists(copy.file() + ".lock"));
}

struct BadInput {
  std::string name;
  void (*make)(const DatabaseCopy& copy);
  absl::StatusCode code;
  std::string message;
};

TEST(VerifyTest, BadInputIsToldInOneLine) {
  const BadInput inputs[] = {
      {"Missing", [](const DatabaseCopy& copy) { fs::remove(copy.file()); }, absl::StatusCode::kNotFound,
       "no such file"},
      {"Text", [](const DatabaseCopy& copy) { std::ofstream(copy.file()) << "a shopping list\n"; },
       absl::StatusCode::kFailedPrecondition, "not a map database"},
      {"Empty", [](const DatabaseCopy& copy) { fs::resize_file(copy.file(), 0); },
       absl::StatusCode::kFailedPrecondition, "not a map database: it is empty"},
      {"Folder",
       [](const DatabaseCopy& copy) {
         fs::remove(copy.file());
         fs::create_directory(copy.file());
       },
       absl::StatusCode::kFailedPrecondition, "not a regular file"},
      {"AnotherProgram",
       [](const DatabaseCopy& copy) {
         fs::remove(copy.file());
         copy.RunSql("CREATE TABLE bookmarks (url TEXT); INSERT INTO bookmarks VALUES ('x');");
       },
       absl::StatusCode::kFailedPrecondition, "another program"},
      {"Newer", [](const DatabaseCopy& copy) { copy.RunSql("UPDATE tags SET name = name; PRAGMA user_version = 999"); },
       absl::StatusCode::kFailedPrecondition, "schema 999 is newer"},
      {"Older", [](const DatabaseCopy& copy) { copy.RunSql("UPDATE tags SET name = name; PRAGMA user_version = 1"); },
       absl::StatusCode::kFailedPrecondition, "start a server on it once"},
      {"CutShort", [](const DatabaseCopy& copy) { fs::resize_file(copy.file(), fs::file_size(copy.file()) / 2); },
       absl::StatusCode::kDataLoss, "corrupt"},
  };
  for (const BadInput& input : inputs) {
    SCOPED_TRACE(input.name);
    const DatabaseCopy copy;
    input.make(copy);
    const auto report = Verify(copy.file());
    EXPECT_EQ(report.status().code(), input.code) << report.status();
    EXPECT_THAT(std::string(report.status().message()),
                AllOf(StartsWith(copy.file() + ": "), HasSubstr(input.message)));
    EXPECT_EQ(report.status().message().find('\n'), std::string::npos);
  }
}

}  // namespace
}  // namespace mapp::testing
