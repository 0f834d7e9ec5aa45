#include "tests/unit/server/verify/healthy_database.h"

#include "storage/sqlite/checksum_vfs.h"
#include "tests/unit/server/quarantine_fixture.h"
#include "vision/place_block.h"

#include <sqlite3.h>

#include <filesystem>

namespace mapp::testing {
namespace {

namespace fs = std::filesystem;

class HealthyMap : public QuarantineTest {
 public:
  explicit HealthyMap(const fs::path& file) {
    const SessionId aligned = OpenAligned();
    UploadOneThatIsTakenOut();
    MustUpload(SyntheticWorld(99), SyntheticWorld::Stand(0, 0, 0), Open(), 0);
    const auto closed = service_->CloseSession(context_, aligned);
    EXPECT_TRUE(closed.ok()) << closed.status();
    const auto optimized = service_->OptimizeMap(context_, "room", {});
    EXPECT_TRUE(optimized.ok()) << optimized.status();
    const auto tagged = service_->PutTag(context_, "room", "spring", "");
    EXPECT_TRUE(tagged.ok()) << tagged.status();
    SendTiles();
    ReportChange(aligned);
    // As beside a running server.
    const auto report = Verify((folder_ / "map.db").string());
    EXPECT_TRUE(report.ok()) << report.status();
    EXPECT_EQ(report->num_violations(), 0) << Describe(*report);
    service_.reset();
    EXPECT_TRUE(store_->Close().ok());
    fs::copy_file(folder_ / "map.db", file);
  }

 private:
  void TestBody() override {}

  void UploadOneThatIsTakenOut() {
    const SessionId session = OpenAligned();
    const Status refused = WalkOn(session, Round(12, 0.5), 5, ScaleWorld(1.4), world_);
    EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition) << refused;
    EXPECT_TRUE(Session(session).IsQuarantined());
  }

  /// Something has moved, as two sessions tell.
  void ReportChange(SessionId session) {
    const Status written = store_->Write(context_, [&](MapWriter& writer) -> Status {
      ChangeRecord change;
      change.map = Map().id;
      change.kind = ChangeKind::kMoved;
      change.confidence = 0.9;
      change.sessions = {founder_, session};
      change.box_before = OrientedBox{.T_frame_box = SyntheticWorld::Stand(1, 0, 0), .size_m = {1, 1, 1}};
      change.box_after = OrientedBox{.T_frame_box = SyntheticWorld::Stand(2, 0, 0), .size_m = {1, 1, 1}};
      change.points_before = {MapPointId(3), MapPointId(300)};
      MAPP_RETURN_IF_ERROR(writer.PutChange(change).status());
      MAPP_RETURN_IF_ERROR(writer.PutFindings(founder_, "what it found"));
      return writer.AppendEvidence({.session = founder_, .number = 0, .received_ns = 0, .packet = "what it saw"});
    });
    EXPECT_TRUE(written.ok()) << written;
  }

  /// Makes the service keep the encoded tiles.
  void SendTiles() {
    for (const Pose3& pose : Round(4)) {
      SharedMapInput input;
      input.session = founder_;
      input.view.T_frame_camera = pose;
      const auto sent =
          service_->RequestSharedMap(context_, input, [](const std::string&) { return absl::OkStatus(); });
      EXPECT_TRUE(sent.ok()) << sent.status();
      EXPECT_GT(sent->num_tiles_sent, 0U);
    }
  }
};

/// Removed with the process.
struct SharedFolder {
  const fs::path path = MakeTestFolder();
  ~SharedFolder() { fs::remove_all(path); }
};

}  // namespace

const std::string& HealthyDatabase() {
  static const SharedFolder folder;
  static const std::string file = [] {
    const fs::path made = folder.path / "healthy.db";
    HealthyMap map(made);
    return made.string();
  }();
  return file;
}

StatusOr<VerifyReport> Verify(const std::string& file, int max_listed) {
  VerifyOptions options;
  options.check_place_block = [](std::string_view block) { return DecodePlaceBlock(block).status(); };
  options.max_listed = max_listed;
  return VerifyDatabase({}, file, options);
}

std::string Describe(const VerifyReport& report) {
  std::string text;
  for (const Violation& violation : report.violations) {
    text += violation.check + ": " + violation.what + " " + std::to_string(violation.id.value_or(-1)) + ": " +
            violation.message + "\n";
  }
  return text;
}

DatabaseCopy::DatabaseCopy() : folder_(MakeTestFolder()), file_(folder_ + "/copy.db") {
  fs::copy_file(HealthyDatabase(), file_);
}

DatabaseCopy::~DatabaseCopy() { fs::remove_all(folder_); }

void DatabaseCopy::RunSql(const std::string& sql) const {
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open_v2(file_.c_str(), &db, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, sqlite::ChecksumVfsName()),
            SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
  EXPECT_TRUE(sqlite3_total_changes(db) > 0 || sql.starts_with("DROP")) << "it changed nothing: " << sql;
  sqlite3_close(db);
}

}  // namespace mapp::testing
