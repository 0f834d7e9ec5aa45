#include "cli/verify.h"

#include "storage/sqlite/checksum_vfs.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>
#include <sqlite3.h>

#include <sstream>

namespace mapp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

/// Runs `mapp verify` on a database of one empty map.
class VerifyCommandTest : public ::testing::Test {
 protected:
  VerifyCommandTest() {
    const auto store = OpenSqliteMapStore(options_.database);
    EXPECT_TRUE(store.ok()) << store.status();
    const Status added = (*store)->Write({}, [](MapWriter& writer) {
      MapRecord map;
      map.name = "hall";
      return writer.CreateMap(map).status();
    });
    EXPECT_TRUE(added.ok()) << added;
    EXPECT_TRUE((*store)->Close().ok());
  }

  void RunSql(const std::string& sql) const {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open_v2(options_.database.c_str(), &db, SQLITE_OPEN_READWRITE, sqlite::ChecksumVfsName()),
              SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    sqlite3_close(db);
  }

  const test::TempFolder folder_;
  VerifyCommandOptions options_{.server = {}, .database = folder_.File("maps.db")};
  std::ostringstream out_;
};

TEST_F(VerifyCommandTest, SaysThatNothingIsWrong) {
  const Status status = RunVerify(options_, {}, out_);
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(out_.str(), options_.database + ": nothing is wrong; 1 maps, 0 keyframes, 0 points\n");
}

TEST_F(VerifyCommandTest, PrintsALineAViolationAndFails) {
  RunSql("UPDATE maps SET num_frames = 3; DELETE FROM id_sequences");
  const Status status = RunVerify(options_, {}, out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(status.ToString(), HasSubstr("maps.db: 2 violations; "));
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("map_counters: map 1: num_frames is 3, and 0 frames are in the map\n"),
                                HasSubstr("id_sequence: point 0: ")));
}

TEST_F(VerifyCommandTest, ChecksPlaceBlocks) {
  RunSql("INSERT INTO place_blocks VALUES (1, 0, x'00')");
  EXPECT_EQ(RunVerify(options_, {}, out_).code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(out_.str(), StartsWith("place_blocks: map 1: place block 0: "));
}

TEST_F(VerifyCommandTest, JsonListsAll) {
  options_.json = true;
  ASSERT_TRUE(RunVerify(options_, {}, out_).ok());
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("\"num_violations\": 0"), HasSubstr("\"num_maps\": 1"),
                                HasSubstr("\"violations\": []"), HasSubstr("\"unlisted\": []")));
  RunSql("UPDATE maps SET num_frames = 3");
  out_.str("");
  EXPECT_EQ(RunVerify(options_, {}, out_).code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("\"check\": \"map_counters\""), HasSubstr("\"what\": \"map\""),
                                HasSubstr("\"id\": 1"), HasSubstr("\"message\": \"num_frames is 3")));
}

TEST_F(VerifyCommandTest, StoppedByAPersonSaysSo) {
  std::stop_source stopped;
  stopped.request_stop();
  const Status status = RunVerify(options_, stopped.get_token(), out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
  EXPECT_THAT(status.ToString(), HasSubstr("interrupted: not all was checked"));
  EXPECT_THAT(out_.str(), IsEmpty());
}

TEST_F(VerifyCommandTest, ErrorsNameTheFile) {
  options_.database = folder_.File("missing.db");
  const Status status = RunVerify(options_, {}, out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(status.ToString(), HasSubstr("missing.db: no such file"));
}

}  // namespace
}  // namespace mapp
