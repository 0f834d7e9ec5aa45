// Backups that the server writes: where it may, what it tells, and what it leaves when the caller goes.

#include "server/backup_folder.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/integration/rpc/rpc_fixture.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <optional>
#include <thread>

namespace mapp {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

class BackupRpcTest : public RpcTest {
 protected:
  void AllowBackups() {
    fs::create_directory(backups_);
    options_.back_up = [folder = BackupFolder(folder_.File("maps.db"), backups_)](const CallContext& context,
                                                                                  const BackupOptions& backup) {
      return folder.BackUp(context, backup);
    };
    RestartServer();
  }
  /// The last message; what came before it is counted in num_progress_.
  grpc::Status BackUp(const std::string& to, uint32_t num_kept = 0, bool dry_run = false) {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::BackUpRequest request;
    request.set_to(to);
    request.set_num_kept(num_kept);
    request.set_dry_run(dry_run);
    const auto reader = admin_service().BackUp(&context, request);
    while (reader->Read(&last_)) num_progress_ += last_.has_progress() ? 1 : 0;
    return reader->Finish();
  }
  /// The message of a refusal; nothing is written.
  std::string RefusalOf(const std::string& to, grpc::StatusCode code, uint32_t num_kept = 0) {
    const grpc::Status status = BackUp(to, num_kept);
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    EXPECT_THAT(status.error_message(), Not(HasSubstr("\n")));
    return status.error_message();
  }

  const std::string backups_ = folder_.File("backups");
  v1::BackUpResponse last_;
  int num_progress_ = 0;
};

TEST_F(BackupRpcTest, IsRefusedUntilTheOperatorSaysWhereTo) {
  EXPECT_THAT(RefusalOf(folder_.File("copy.db"), grpc::StatusCode::FAILED_PRECONDITION), HasSubstr("--backup-dir"));
  EXPECT_FALSE(fs::exists(folder_.File("copy.db")));
}

TEST_F(BackupRpcTest, TellsHowFarItIsThenWhatCameOfIt) {
  AllowBackups();
  const SessionId session = Open();
  const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
  v1::UploadPartialKeyframeResponse uploaded;
  for (uint32_t number = 0; number < 3; ++number) {
    ASSERT_TRUE(Upload(View(stand, stand, session, number), uploaded).ok());
  }
  ASSERT_TRUE(BackUp(backups_).ok());
  EXPECT_GE(num_progress_, 2);
  EXPECT_LE(num_progress_, 102) << "one for each percent";
  ASSERT_TRUE(last_.has_result()) << "it comes last";
  const std::string file = last_.result().file();
  EXPECT_EQ(fs::path(file).parent_path(), backups_);
  EXPECT_EQ(last_.result().num_bytes(), fs::file_size(file));
  const auto store = OpenSqliteMapStore(file, {.read_only = true}).value();
  EXPECT_EQ(store->Read().value()->FindMap("room").value().num_frames, 3);
}

TEST_F(BackupRpcTest, DeletesTheOldestWhenAsked) {
  AllowBackups();
  const std::string old = backups_ + "/maps-20200101T000000Z.db";
  WriteFile(old, "old");
  ASSERT_TRUE(BackUp(backups_, 1, /*dry_run=*/true).ok());
  EXPECT_EQ(last_.result().deleted(0), old);
  EXPECT_FALSE(fs::exists(last_.result().file()));
  EXPECT_TRUE(fs::exists(old));
  ASSERT_TRUE(BackUp(backups_, 1).ok());
  ASSERT_EQ(last_.result().deleted_size(), 1);
  EXPECT_EQ(last_.result().deleted(0), old);
  EXPECT_FALSE(fs::exists(old));
}

TEST_F(BackupRpcTest, WritesNowhereElse) {
  AllowBackups();
  fs::create_directory(backups_ + "-not");
  fs::create_directory_symlink(folder_.path(), backups_ + "/out");
  for (const std::string& to :
       {folder_.File("copy.db"), folder_.path().string(), backups_ + "/../copy.db", backups_ + "-not/copy.db",
        backups_ + "/out/copy.db", backups_ + "/out", std::string("copy.db"), std::string("")}) {
    EXPECT_THAT(RefusalOf(to, grpc::StatusCode::INVALID_ARGUMENT), HasSubstr("to: ")) << to;
  }
  EXPECT_FALSE(fs::exists(folder_.File("copy.db")));
  EXPECT_EQ(std::distance(fs::directory_iterator(backups_), {}), 1);
}

TEST_F(BackupRpcTest, RefusesWhatItCannotWrite) {
  AllowBackups();
  WriteFile(backups_ + "/copy.db", "precious");
  EXPECT_THAT(RefusalOf(backups_ + "/copy.db", grpc::StatusCode::ALREADY_EXISTS), HasSubstr("copy.db"));
  RefusalOf(backups_ + "/missing/copy.db", grpc::StatusCode::NOT_FOUND);
  RefusalOf(backups_ + "/new.db", grpc::StatusCode::INVALID_ARGUMENT, 3);
  RefusalOf(backups_ + "/maps.db-wal", grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(ReadFile(backups_ + "/copy.db"), "precious");
}

TEST_F(BackupRpcTest, LeavesNothingWhenTheCallerGoes) {
  fs::create_directory(backups_);
  std::optional<Status> outcome;
  options_.back_up = [&](const CallContext& context, BackupOptions options) {
    // Stays in the middle until the call is gone.
    options.on_progress = [&, tell = options.on_progress](const BackupProgress& progress) {
      tell(progress);
      while (context.Check().ok()) std::this_thread::yield();
    };
    const auto backup = BackupFolder(folder_.File("maps.db"), backups_).BackUp(context, options);
    outcome = backup.status();
    return backup;
  };
  RestartServer();
  {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::BackUpRequest request;
    request.set_to(backups_ + "/copy.db");
    const auto reader = admin_service().BackUp(&context, request);
    ASSERT_TRUE(reader->Read(&last_));
    EXPECT_TRUE(fs::exists(backups_ + "/copy.db.unfinished"));
    context.TryCancel();
    EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  StopServer();  // when its calls have ended
  ASSERT_TRUE(outcome.has_value());
  EXPECT_EQ(outcome->code(), absl::StatusCode::kCancelled);
  EXPECT_TRUE(fs::is_empty(backups_));
}

}  // namespace
}  // namespace mapp
