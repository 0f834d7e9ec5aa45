// `mapp verify --server`: the server looks through its own database and tells what it has found.

#include "cli/verify.h"
#include "storage/sqlite/checksum_vfs.h"
#include "storage/verify.h"
#include "tests/integration/rpc/rpc_fixture.h"

#include <gmock/gmock.h>
#include <sqlite3.h>

#include <future>
#include <sstream>

namespace mapp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class VerifyRpcTest : public RpcTest {
 protected:
  VerifyRpcTest() {
    options_.verify = [file = database_](const CallContext& context,
                                         const std::function<void(const VerifyProgress&)>& on_progress) {
      return VerifyDatabase(context, file, {.on_progress = on_progress, .max_listed = 2});
    };
    RestartServer();
    const SessionId session = Open();
    const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
    v1::UploadPartialKeyframeResponse uploaded;
    for (uint32_t number = 0; number < 3; ++number) {
      EXPECT_TRUE(Upload(View(stand, stand, session, number), uploaded).ok());
    }
  }

  Status Run(bool json = false) {
    out_.str("");
    return RunVerify({.server = address(), .database = {}, .json = json}, {}, out_);
  }
  /// Beside the server, as no operator should.
  void RunSql(const std::string& sql) const {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open_v2(database_.c_str(), &db, SQLITE_OPEN_READWRITE, sqlite::ChecksumVfsName()), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    sqlite3_close(db);
  }

  const std::string database_ = folder_.File("maps.db");
  std::ostringstream out_;
};

TEST_F(VerifyRpcTest, SaysThatNothingIsWrong) {
  const Status status = Run();
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_THAT(out_.str(), HasSubstr(address() + ": nothing is wrong; 1 maps, 3 keyframes, "));
}

TEST_F(VerifyRpcTest, TellsHowFarItIsThenWhatItFound) {
  RunSql("UPDATE points SET confidence = 2; UPDATE maps SET num_frames = 7");
  grpc::ClientContext context;
  SetDeadline(context);
  const auto reader = admin_service().VerifyDatabase(&context, v1::VerifyDatabaseRequest());
  v1::VerifyDatabaseResponse message;
  uint32_t num_progress = 0;
  std::vector<std::string> checks;
  while (reader->Read(&message)) {
    num_progress += message.has_progress() ? 1 : 0;
    if (message.has_violation()) checks.push_back(message.violation().check());
  }
  ASSERT_TRUE(reader->Finish().ok());
  ASSERT_TRUE(message.has_result()) << "it comes last";
  EXPECT_EQ(num_progress, message.result().num_checks());
  EXPECT_THAT(checks, ::testing::ElementsAre("map_counters", "points", "points"));
  ASSERT_EQ(message.result().unlisted_size(), 1);
  EXPECT_EQ(message.result().unlisted(0).count(), message.result().num_points() - 2);
}

TEST_F(VerifyRpcTest, TheCommandPrintsWhatTheServerFound) {
  RunSql("UPDATE points SET confidence = 2; DELETE FROM id_sequences");
  EXPECT_EQ(Run().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("points: point 1: confidence 2 is not in [0, 1]\n"), HasSubstr(" more\n"),
                                HasSubstr("id_sequence: point ")));
  EXPECT_EQ(Run(/*json=*/true).code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("\"database\": \"" + address()), HasSubstr("\"check\": \"id_sequence\"")));
}

TEST_F(VerifyRpcTest, OneCallerAtATime) {
  std::promise<void> begun, release;
  std::shared_future<void> released = release.get_future();
  options_.verify = [&](const CallContext&, const auto&) -> StatusOr<VerifyReport> {
    begun.set_value();
    released.wait();
    return VerifyReport{};
  };
  RestartServer();
  auto first = std::async(std::launch::async, [this] {
    std::ostringstream out;
    return RunVerify({.server = address(), .database = {}}, {}, out);
  });
  begun.get_future().wait();
  const Status second = Run();
  release.set_value();
  EXPECT_EQ(second.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(second.ToString(), HasSubstr("for another caller"));
  const Status status = first.get();
  EXPECT_TRUE(status.ok()) << status;
}

TEST_F(VerifyRpcTest, AServerMayNotOfferIt) {
  options_.verify = {};
  RestartServer();
  EXPECT_EQ(Run().code(), absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace mapp
