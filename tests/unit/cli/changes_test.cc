// `mapp changes` against a server whose answers the test sets.

#include "cli/changes.h"

#include "change_scene.h"
#include "cli/changed_map.h"
#include "cli/map_history.h"
#include "fake_admin_service.h"
#include "tests/unit/datasets/temp_folder.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

namespace mapp {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::StartsWith;
using Json = nlohmann::json;

class ChangesCommandTest : public testing::Test {
 protected:
  template <typename Options>
  Options On() const {
    Options options;
    options.server = service_->address();
    options.map_name = "garage";
    return options;
  }
  ChangesDetectOptions DetectOptions() const {
    ChangesDetectOptions options;
    options.server = service_->address();
    options.order.map_name = "garage";
    return options;
  }
  Json Printed() const { return Json::parse(out_.str()); }
  /// Its first bytes.
  static std::string Begin(const std::string& file, size_t num_bytes) {
    std::string bytes(num_bytes, '\0');
    std::ifstream(file, std::ios::binary).read(bytes.data(), static_cast<std::streamsize>(num_bytes));
    return bytes;
  }

  const ChangeScene scene_;
  const std::unique_ptr<FakeAdminService> service_ = scene_.Serve();
  const test::TempFolder folder_;
  std::ostringstream out_;
};

TEST_F(ChangesCommandTest, DetectAsksForTheTimeAndTellsFigures) {
  service_->detection.add_changes()->CopyFrom(service_->changes[0]);
  service_->detection.set_num_new(1);
  service_->detection.set_num_dropped(2);
  service_->detection.set_num_sessions_read(3);
  service_->detection.set_num_sessions(7);
  service_->detection.set_seconds(1.25);
  ChangesDetectOptions options = DetectOptions();
  options.order.from_unix_ns = 5;
  options.order.to_unix_ns = 9;
  options.order.auto_accept = 0.75;
  const Status status = RunChangesDetect(options, {}, out_);
  ASSERT_TRUE(status.ok()) << status;
  ASSERT_EQ(service_->detect_requests.size(), 1U);
  EXPECT_EQ(service_->detect_requests[0].from_unix_ns(), 5);
  EXPECT_EQ(service_->detect_requests[0].to_unix_ns(), 9);
  EXPECT_EQ(service_->detect_requests[0].auto_accept(), 0.75);
  EXPECT_THAT(out_.str(),
              AllOf(HasSubstr(" 1  vanished  proposed"),
                    HasSubstr("\ngarage: 1 changes: 1 new, 0 accepted; 2 dropped; 3 of 7 sessions read, 1.2 s\n")));
}

TEST_F(ChangesCommandTest, DetectInJson) {
  service_->detection.add_changes()->CopyFrom(service_->changes[2]);
  service_->detection.set_num_accepted(1);
  ChangesDetectOptions options = DetectOptions();
  options.json = true;
  ASSERT_TRUE(RunChangesDetect(options, {}, out_).ok());
  EXPECT_EQ(Printed()["changes"][0]["id"], 3);
  EXPECT_EQ(Printed()["num_accepted"], 1);
}

TEST_F(ChangesCommandTest, DetectWithoutFindingsPrintsFiguresOnly) {
  ASSERT_TRUE(RunChangesDetect(DetectOptions(), {}, out_).ok());
  EXPECT_THAT(out_.str(), StartsWith("garage: 0 changes: "));
}

TEST_F(ChangesCommandTest, StoppedByAPersonSaysHowToGoOn) {
  std::stop_source stopped;
  stopped.request_stop();
  const Status status = RunChangesDetect(DetectOptions(), stopped.get_token(), out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
  EXPECT_THAT(status.ToString(), HasSubstr("interrupted: the same command goes on"));
  EXPECT_THAT(out_.str(), IsEmpty());
}

TEST_F(ChangesCommandTest, AnswersThatMakeNoSenseAreDataLoss) {
  service_->changes[1].clear_box_after();
  const Status status = RunChangesList(On<ChangesListOptions>(), out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(status.ToString(), HasSubstr("change 2: box_after"));
  service_->changes.resize(1);
  service_->changes[0].set_kind(v1::CHANGE_KIND_UNSPECIFIED);
  EXPECT_THAT(RunChangesList(On<ChangesListOptions>(), out_).ToString(), HasSubstr("change 1: kind: 0"));
}

TEST_F(ChangesCommandTest, ListFilters) {
  auto options = On<ChangesListOptions>();
  options.json = true;
  const auto ids = [&]() -> std::vector<int> {
    out_.str("");
    EXPECT_TRUE(RunChangesList(options, out_).ok());
    std::vector<int> found;
    const Json printed = Printed();
    for (const Json& change : printed["changes"]) found.push_back(change["id"]);
    return found;
  };
  EXPECT_THAT(ids(), ElementsAre(1, 2, 3, 12, 13));
  options.status = ChangeStatus::kProposed;
  EXPECT_THAT(ids(), ElementsAre(1, 2, 3));
  options.kind = ChangeKind::kMoved;
  EXPECT_THAT(ids(), ElementsAre(3));
  options.status.reset();
  options.kind = ChangeKind::kVanished;
  EXPECT_THAT(ids(), ElementsAre(1, 12));
}

TEST_F(ChangesCommandTest, ShowFindsOne) {
  auto options = On<ChangesShowOptions>();
  options.id = 12;
  ASSERT_TRUE(RunChangesShow(options, out_).ok());
  EXPECT_THAT(out_.str(), AllOf(StartsWith("change "), HasSubstr("accepted\n"), HasSubstr("5440\n")));
  out_.str("");
  options.json = true;
  ASSERT_TRUE(RunChangesShow(options, out_).ok());
  EXPECT_EQ(Printed()["applied_revision"], 41);
  options.id = 99;
  const Status status = RunChangesShow(options, out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(status.ToString(), HasSubstr("map garage has no change 99"));
}

TEST_F(ChangesCommandTest, ErrorsAreTheServers) {
  auto options = On<ChangesListOptions>();
  options.map_name = "attic";
  const Status status = RunChangesList(options, out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(status.ToString(), HasSubstr("map \"attic\" does not exist"));
}

TEST_F(ChangesCommandTest, DecisionsNameTheIdsAndSayWhatWasDone) {
  auto options = On<ChangesDecideOptions>();
  options.ids = {1, 3};
  service_->decision.add_changes()->CopyFrom(service_->changes[0]);
  service_->decision.add_changes()->CopyFrom(service_->changes[2]);
  service_->decision.set_map_revision(43);
  service_->decision.set_num_points(100);
  ASSERT_TRUE(RunChangesDecide(options, out_).ok());
  EXPECT_EQ(out_.str(),
            "accepted: changes 1 3; 100 points retired at revision 43\n"
            "`mapp changes undo --map garage 1 3` takes it back\n");
  out_.str("");
  options.decision = ChangeDecision::kUndo;
  ASSERT_TRUE(RunChangesDecide(options, out_).ok());
  EXPECT_EQ(out_.str(), "proposed again: changes 1 3; 100 points live again at revision 43\n");
  out_.str("");
  options.decision = ChangeDecision::kReject;
  options.ids = {1};
  service_->decision.mutable_changes()->RemoveLast();
  service_->decision.clear_map_revision();
  ASSERT_TRUE(RunChangesDecide(options, out_).ok());
  EXPECT_THAT(out_.str(), StartsWith("rejected: change 1; the map stays as it was\n"));
  EXPECT_THAT(service_->decisions, ElementsAre("accept 1 3", "undo 1 3", "reject 1"));
}

TEST_F(ChangesCommandTest, DecisionsInJsonAndRefused) {
  auto options = On<ChangesDecideOptions>();
  options.ids = {1};
  options.json = true;
  service_->decision.add_changes()->CopyFrom(service_->changes[0]);
  service_->decision.set_map_revision(43);
  ASSERT_TRUE(RunChangesDecide(options, out_).ok());
  EXPECT_EQ(Printed()["map_revision"], 43);
  EXPECT_EQ(Printed()["changes"][0]["id"], 1);
  out_.str("");
  service_->decision_status = {grpc::StatusCode::FAILED_PRECONDITION, "change 1 is rejected; undo that first"};
  const Status status = RunChangesDecide(options, out_);
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(status.ToString(), HasSubstr("change 1 is rejected"));
  EXPECT_THAT(out_.str(), IsEmpty());
}

TEST_F(ChangesCommandTest, RenderWritesAPng) {
  auto options = On<ChangesRenderOptions>();
  options.out_file = folder_.File("changes.png");
  const Status status = RunChangesRender(options, out_);
  ASSERT_TRUE(status.ok()) << status;
  EXPECT_EQ(Begin(options.out_file, 4), "\x89PNG");
  EXPECT_EQ(out_.str(), options.out_file + ": 4 changes of map garage at revision 42\n") << "without the rejected one";
  EXPECT_THAT(service_->export_requests, ElementsAre("", "40")) << "where the retired points were";
}

TEST_F(ChangesCommandTest, RenderOfOneChangeAsksForThePastOnlyWhereItIsAccepted) {
  auto options = On<ChangesRenderOptions>();
  options.out_file = folder_.File("one.png");
  options.json = true;
  options.change_id = 3;
  ASSERT_TRUE(RunChangesRender(options, out_).ok());
  EXPECT_EQ(Printed()["num_changes"], 1);
  EXPECT_THAT(service_->export_requests, ElementsAre(""));
  options.change_id = 13;
  EXPECT_TRUE(RunChangesRender(options, out_).ok()) << "a rejected one that is asked for";
  options.change_id = 99;
  EXPECT_EQ(RunChangesRender(options, out_).code(), absl::StatusCode::kNotFound);
}

TEST_F(ChangesCommandTest, WhatIsCompactedAwayIsLeftOutAndSaid) {
  service_->at.clear();
  auto options = On<ChangesRenderOptions>();
  options.out_file = folder_.File("changes.png");
  options.before_after = true;
  ASSERT_TRUE(RunChangesRender(options, out_).ok());
  EXPECT_THAT(out_.str(), HasSubstr("\nwithout 40 points of them that are compacted away\n"));
}

TEST_F(ChangesCommandTest, WrongSuffixesAreRefusedBeforeAnythingIsAsked) {
  auto render = On<ChangesRenderOptions>();
  render.out_file = folder_.File("changes.jpg");
  EXPECT_THAT(RunChangesRender(render, out_).ToString(), AllOf(HasSubstr("--out: "), HasSubstr("must end in .png")));
  auto save = On<ChangesExportOptions>();
  save.out_file = folder_.File("changes.csv");
  EXPECT_THAT(RunChangesExport(save, out_).ToString(), AllOf(HasSubstr("--out: "), HasSubstr(".geojson or .ply")));
  EXPECT_THAT(service_->export_requests, IsEmpty());
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(ChangesCommandTest, ErrorsLeaveNoFile) {
  service_->now.mutable_frames(0)->mutable_pose_map_camera()->set_qw(7);
  auto options = On<ChangesRenderOptions>();
  options.out_file = folder_.File("changes.png");
  EXPECT_EQ(RunChangesRender(options, out_).code(), absl::StatusCode::kDataLoss);
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(ChangesCommandTest, ExportWritesFeaturesOfAllAndPointsOfWhatIsNotRejected) {
  auto options = On<ChangesExportOptions>();
  options.out_file = folder_.File("changes.geojson");
  ASSERT_TRUE(RunChangesExport(options, out_).ok());
  std::ifstream file(options.out_file);
  EXPECT_EQ(Json::parse(file)["features"].size(), 5U);
  EXPECT_EQ(out_.str(), options.out_file + ": 5 changes of map garage at revision 42\n");
  out_.str("");
  options.out_file = folder_.File("changes.ply");
  options.json = true;
  ASSERT_TRUE(RunChangesExport(options, out_).ok());
  EXPECT_THAT(Begin(options.out_file, 300), AllOf(StartsWith("ply\nformat binary"), HasSubstr("property uchar red\n")));
  EXPECT_EQ(Printed()["num_changes"], 4);
}

TEST_F(ChangesCommandTest, LogTellsOfAcceptedAndUndoneChanges) {
  uint64_t revision = 44;
  for (const v1::RevisionCause cause : {v1::REVISION_CAUSE_CHANGE_UNDONE, v1::REVISION_CAUSE_CHANGE}) {
    v1::ListRevisionsResponse::Run& run = *service_->revisions.add_runs();
    run.set_first_revision(revision);
    run.set_last_revision(revision--);
    run.set_num_revisions(1);
    run.set_cause(cause);
  }
  ASSERT_TRUE(RunMapsLog({.server = service_->address(), .name = "garage"}, out_).ok());
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("44         -            change undone      1"),
                                HasSubstr("43         -            change             1")));
}

TEST(PointRolesTest, WhatIsGoneCountsMoreThanThatItOnceCame) {
  ChangeSummary appeared;
  appeared.kind = ChangeKind::kAppeared;
  appeared.points_after = {7, 8};
  ChangeSummary moved;
  moved.kind = ChangeKind::kMoved;
  moved.points_before = {8};
  moved.points_after = {9};
  const PointRoles roles({appeared, moved});
  EXPECT_EQ(roles.Of(7), PointRole::kAppeared);
  EXPECT_EQ(roles.Of(8), PointRole::kMovedFrom);
  EXPECT_EQ(roles.Of(9), PointRole::kMovedTo);
  EXPECT_EQ(roles.Of(1), PointRole::kUnchanged);
}

TEST(ChangedMapTest, BeforeIsWithoutWhatCameAndAfterWithoutWhatWent) {
  const ChangedMap map = ChangeScene().ToChangedMap();
  const size_t num_walls = 4000, num_rejected = 20;
  EXPECT_EQ(PointsAt(map, MapMoment::kBoth).size(), num_walls + num_rejected + 60 + 60 + 80 + 40);
  EXPECT_EQ(PointsAt(map, MapMoment::kBefore).size(), num_walls + 60 + 40 + 40) << "at revision 40";
  EXPECT_EQ(PointsAt(map, MapMoment::kAfter).size(), num_walls + num_rejected + 60 + 40);
}

}  // namespace
}  // namespace mapp
