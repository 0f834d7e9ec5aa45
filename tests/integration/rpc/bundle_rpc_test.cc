// Maps carried from server to server: mapp maps export and import, against a real server.

#include "bundle/bundle_file.h"
#include "cli/admin_client.h"
#include "cli/maps_bundle.h"
#include "tests/integration/rpc/rpc_fixture.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <sstream>
#include <thread>

namespace mapp {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr std::chrono::seconds kAlignmentTimeout(30);

class BundleRpcTest : public RpcTest {
 protected:
  void SetUp() override {
    const SessionId session = Open();
    for (uint32_t number = 0; number < 3; ++number) MustUpload(session, number);
    Close(session);
  }

  /// Walks on from where the map was founded.
  void MustUpload(SessionId session, uint32_t number) {
    const Pose3 start = testing::SyntheticWorld::Stand(0, -2, 0);
    v1::UploadPartialKeyframeResponse response;
    const grpc::Status status =
        Upload(View(testing::SyntheticWorld::Stand(0.2 * number, -2, 0), start, session, number), response);
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
  void Close(SessionId session) {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::CloseSessionRequest request;
    request.set_session_id(static_cast<uint32_t>(session.value()));
    v1::CloseSessionResponse response;
    EXPECT_TRUE(map_service().CloseSession(&context, request, &response).ok());
  }

  StatusOr<std::string> Export(MapsExportOptions options, const std::stop_token& stop = {}) {
    options.server = address();
    if (options.name.empty()) options.name = "room";
    options.bundle = bundle_;
    std::ostringstream out;
    MAPP_RETURN_IF_ERROR(RunMapsExport(options, stop, out));
    return out.str();
  }
  StatusOr<std::string> Import(MapsImportOptions options, const std::stop_token& stop = {}) {
    if (options.server.empty()) options.server = address();
    options.bundle = bundle_;
    std::ostringstream out;
    MAPP_RETURN_IF_ERROR(RunMapsImport(options, stop, out));
    return out.str();
  }
  size_t NumMaps() { return AdminClient(address()).ListMaps()->size(); }

  const std::string bundle_ = folder_.File("room.mappbundle");
};

TEST_F(BundleRpcTest, ImportedMapIsServedAtOnce) {
  EXPECT_THAT(*Export({}), AllOf(StartsWith(bundle_ + ": room at revision "), HasSubstr("1 sessions, 3 frames")));
  EXPECT_FALSE(fs::exists(bundle_ + ".unfinished"));
  const StatusOr<std::string> imported = Import({.server = {}, .bundle = {}, .as = "copy", .json = true});
  ASSERT_TRUE(imported.ok()) << imported.status();
  EXPECT_THAT(*imported, AllOf(HasSubstr("\"name\": \"copy\""), HasSubstr("\"imported\": true"),
                               HasSubstr("\"source_name\": \"room\""), HasSubstr("\"num_frames\": 3")));
  EXPECT_EQ(GetMap("copy").num_points(), GetMap("room").num_points());
  EXPECT_EQ(GetMap("copy").num_tiles(), GetMap("room").num_tiles());

  // Without a restart a device finds itself in it: place index, tiles and points are there.
  const SessionId session = Open("copy");
  const auto deadline = std::chrono::steady_clock::now() + kAlignmentTimeout;
  const auto is_aligned = [&] {
    const StatusOr<std::vector<SessionSummary>> sessions = AdminClient(address()).ListSessions("copy");
    return sessions.ok() && sessions->back().T_map_session.has_value();
  };
  for (uint32_t number = 0; number < 4; ++number) MustUpload(session, number);
  while (!is_aligned() && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_TRUE(is_aligned());
  RestartServer();
  EXPECT_EQ(NumMaps(), 2U);
}

TEST_F(BundleRpcTest, DryRunNeedsNoServer) {
  ASSERT_TRUE(Export({}).ok());
  const auto checked = Import({.server = "127.0.0.1:1", .bundle = {}, .as = "x", .dry_run = true});
  ASSERT_TRUE(checked.ok()) << checked.status();
  EXPECT_THAT(*checked, StartsWith("would import x from " + bundle_ + ": room at revision"));
  EXPECT_EQ(Import({.server = "127.0.0.1:1", .bundle = {}, .as = {}}).status().code(), absl::StatusCode::kUnavailable);
}

TEST_F(BundleRpcTest, EarlierStatesAreExported) {
  EXPECT_THAT(*Export({.server = {}, .name = {}, .at = "1", .bundle = {}, .json = true}),
              AllOf(HasSubstr("\"source_revision\": 1,"), HasSubstr("\"num_frames\": 1,")));
  EXPECT_THAT(Export({.server = {}, .name = {}, .at = "999", .bundle = {}, .force = true}).status().message(),
              HasSubstr("no revision 999"));
}

TEST_F(BundleRpcTest, FilesAreThereWholeOrNotAtAll) {
  EXPECT_THAT(Export({.server = {}, .name = "cellar", .at = {}, .bundle = {}}).status().message(),
              HasSubstr("\"cellar\" does not exist"));
  std::stop_source stopped;
  stopped.request_stop();
  EXPECT_THAT(Export({}, stopped.get_token()).status().message(), HasSubstr("interrupted: nothing was exported"));
  for (const fs::directory_entry& file : fs::directory_iterator(folder_.path())) {
    EXPECT_THAT(file.path().string(), Not(HasSubstr("mappbundle")));
  }

  WriteFile(bundle_, "mine");
  EXPECT_THAT(Export({}).status().message(), HasSubstr("is there already: choose another name, or --force"));
  EXPECT_EQ(ReadFile(bundle_), "mine");
  EXPECT_TRUE(Export({.server = {}, .name = {}, .at = {}, .bundle = {}, .force = true}).ok());
  EXPECT_THAT(ReadFile(bundle_), StartsWith("MAPPBNDL"));
}

TEST_F(BundleRpcTest, RefusedBundlesChangeNothing) {
  ASSERT_TRUE(Export({}).ok());
  const std::string whole = ReadFile(bundle_);
  EXPECT_THAT(Import({}).status().message(), HasSubstr("map \"room\" is there already: import the bundle under"));
  EXPECT_THAT(Import({.server = {}, .bundle = {}, .as = "a\nb"}).status().message(), HasSubstr("control characters"));
  WriteFile(bundle_, whole.substr(0, whole.size() / 2));
  EXPECT_THAT(Import({.server = {}, .bundle = {}, .as = "x"}).status().message(),
              AllOf(HasSubstr(bundle_ + ": the bundle is cut short"), HasSubstr("copy it anew, or export")));
  WriteFile(bundle_, "ply\n");
  EXPECT_THAT(Import({.server = {}, .bundle = {}, .as = "x"}).status().message(), HasSubstr("not a map bundle"));
  fs::remove(bundle_);
  EXPECT_EQ(Import({.server = {}, .bundle = {}, .as = "x"}).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(NumMaps(), 1U);
}

TEST_F(BundleRpcTest, ServerChecksWhatItIsSent) {
  ASSERT_TRUE(Export({}).ok());
  const std::string whole = ReadFile(bundle_);
  std::string flipped = whole;
  flipped[whole.size() / 2] = static_cast<char>(flipped[whole.size() / 2] ^ 1);
  const auto send = [this](const std::string& bytes, const std::stop_token& stop = {}) {
    WriteFile(bundle_, bytes);
    BundleFile file = *BundleFile::Open(bundle_);
    return AdminClient(address())
        .ImportBundle(
            "sent", *file.Read(), bytes.size(), [](const auto&) {}, stop)
        .status();
  };
  EXPECT_THAT(send(whole.substr(0, whole.size() - 1)).message(), HasSubstr("cut short"));
  EXPECT_THAT(send(flipped).message(), HasSubstr("damaged at byte"));
  EXPECT_THAT(send({}).message(), HasSubstr("not a map bundle"));
  std::stop_source stopped;
  stopped.request_stop();
  EXPECT_EQ(send(whole, stopped.get_token()).code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(NumMaps(), 1U);
  EXPECT_TRUE(send(whole).ok());
  EXPECT_EQ(NumMaps(), 2U);
}

}  // namespace
}  // namespace mapp
