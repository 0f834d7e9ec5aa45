// What no well-meaning client sends: refused with the right code and the field's path, and nothing stored of it.

#include "api/convert/convert.h"
#include "api/status/grpc_status.h"
#include "mapp/codec/evidence_codec.h"
#include "mapp/codec/keyframe_codec.h"
#include "mapp/codec/query_codec.h"
#include "tests/integration/rpc/rpc_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace mapp {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

/// How a call ended.
struct Outcome {
  grpc::Status status;
  std::string field;
  std::string reason;
};

class BadRequestTest : public RpcTest {
 public:
  /// Makes `call` and reads the error detail out of its trailing metadata.
  static Outcome Try(const std::function<grpc::Status(grpc::ClientContext&)>& call) {
    grpc::ClientContext context;
    SetDeadline(context);
    Outcome outcome;
    outcome.status = call(context);
    if (const auto detail = ErrorDetailOf(context)) {
      outcome.field = detail->field();
      outcome.reason = detail->reason();
    }
    return outcome;
  }
  static void ExpectRefused(const Outcome& outcome, const std::string& field) {
    EXPECT_EQ(outcome.status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << outcome.status.error_message();
    EXPECT_EQ(outcome.field, field);
    EXPECT_EQ(outcome.reason, "INVALID_ARGUMENT");
    EXPECT_THAT(outcome.status.error_message(), StartsWith(field + ": "));
    EXPECT_EQ(outcome.status.error_message().find('\n'), std::string::npos) << "one line";
  }

  Outcome OpenSession(const v1::OpenSessionRequest& request) {
    v1::OpenSessionResponse response;
    return Try([&](grpc::ClientContext& c) { return map_service().OpenSession(&c, request, &response); });
  }
  Outcome Assess(const v1::AssessOverlapRequest& request) {
    v1::AssessOverlapResponse response;
    return Try([&](grpc::ClientContext& c) { return map_service().AssessOverlap(&c, request, &response); });
  }
  Outcome UploadBytes(const std::string& packet) {
    v1::UploadPartialKeyframeRequest request;
    request.set_keyframe(packet);
    v1::UploadPartialKeyframeResponse response;
    return Try([&](grpc::ClientContext& c) { return map_service().UploadPartialKeyframe(&c, request, &response); });
  }
  Outcome RequestSharedMap(const v1::RequestSharedMapRequest& request) {
    return Try([&](grpc::ClientContext& c) {
      const auto reader = map_service().RequestSharedMap(&c, request);
      v1::RequestSharedMapResponse response;
      while (reader->Read(&response)) {
      }
      return reader->Finish();
    });
  }
  Outcome Report(const v1::ReportUpdateRequest& request) {
    v1::ReportUpdateResponse response;
    return Try([&](grpc::ClientContext& c) { return map_service().ReportUpdate(&c, request, &response); });
  }
  Outcome ReportEvidence(const v1::ReportEvidenceRequest& request) {
    v1::ReportEvidenceResponse response;
    return Try([&](grpc::ClientContext& c) { return map_service().ReportEvidence(&c, request, &response); });
  }
  Outcome Watch(uint32_t session) {
    v1::WatchSessionRequest request;
    request.set_session_id(session);
    return Try([&](grpc::ClientContext& c) {
      const auto reader = map_service().WatchSession(&c, request);
      v1::WatchSessionResponse response;
      while (reader->Read(&response)) {
      }
      return reader->Finish();
    });
  }

  /// A session that founded the map with one keyframe.
  SessionId Founder() {
    const SessionId session = Open();
    v1::UploadPartialKeyframeResponse response;
    const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
    EXPECT_TRUE(Upload(View(stand, stand, session, 0), response).ok());
    return session;
  }
  static uint32_t Wire(SessionId session) { return static_cast<uint32_t>(session.value()); }
};

// OpenSession

struct BadOpen {
  std::string name;
  std::string field;
  std::function<void(v1::OpenSessionRequest&)> spoil;
};
class BadOpenTest : public BadRequestTest, public ::testing::WithParamInterface<BadOpen> {};

TEST_P(BadOpenTest, IsRefusedByPathAndMakesNoMap) {
  v1::OpenSessionRequest request = OpenRequest();
  GetParam().spoil(request);
  ExpectRefused(OpenSession(request), GetParam().field);
  EXPECT_TRUE(service_->ListMaps({}).value().empty());
}

INSTANTIATE_TEST_SUITE_P(
    All, BadOpenTest,
    ::testing::Values(
        BadOpen{"NoMapName", "map_name", [](auto& r) { r.clear_map_name(); }},
        BadOpen{"LongDeviceName", "device", [](auto& r) { r.set_device(std::string(129, 'x')); }},
        BadOpen{"NoSensor", "sensor", [](auto& r) { r.clear_sensor(); }},
        BadOpen{"NoCamera", "camera", [](auto& r) { r.clear_camera(); }},
        BadOpen{"ZeroFocalLength", "camera.fx", [](auto& r) { r.mutable_camera()->set_coefficients(0, 0); }},
        BadOpen{"UnknownModel", "camera.model", [](auto& r) { r.mutable_camera()->set_model("magic"); }},
        BadOpen{"NaNPrincipalPoint", "camera.cx",
                [](auto& r) { r.mutable_camera()->set_coefficients(2, std::nan("")); }},
        BadOpen{"EmptyFeatureSettings", "feature_settings.descriptor_kind",
                [](auto& r) { r.mutable_feature_settings(); }},
        BadOpen{"FeatureScaleOfNoMap", "feature_settings.scale_factor",
                [](auto& r) { *r.mutable_feature_settings() = ToProto(FeatureSettings{.scale_factor = 1.5F}); }}),
    [](const auto& tested) { return tested.param.name; });

TEST_F(BadRequestTest, AMapThatDoesNotExistIsNotFound) {
  v1::OpenSessionRequest request = OpenRequest("nowhere");
  request.set_create_map(false);
  const Outcome outcome = OpenSession(request);
  EXPECT_EQ(outcome.status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(outcome.reason, "NOT_FOUND");
  EXPECT_THAT(outcome.status.error_message(), HasSubstr("nowhere"));
}

TEST_F(BadRequestTest, FeaturesOfAnotherSettingThanTheMapsAreRefusedByPath) {
  // Of an older client, that tells no settings: the map has the defaults.
  Open();
  const v1::FeatureSettings kept = GetMap().feature_settings();
  EXPECT_EQ(kept.SerializeAsString(), ToProto(FeatureSettings()).SerializeAsString());
  v1::OpenSessionRequest request = OpenRequest();
  *request.mutable_feature_settings() = kept;
  EXPECT_TRUE(OpenSession(request).status.ok());

  request.mutable_feature_settings()->set_scale_factor(1.5F);
  const Outcome outcome = OpenSession(request);
  EXPECT_EQ(outcome.status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(outcome.field, "feature_settings.scale_factor");
  EXPECT_EQ(outcome.reason, "FAILED_PRECONDITION");
  EXPECT_THAT(outcome.status.error_message(), StartsWith(outcome.field + ": "));
  EXPECT_EQ(GetMap().num_sessions(), 2U);
}

// AssessOverlap

TEST_F(BadRequestTest, BadQueries) {
  v1::AssessOverlapRequest good;
  good.set_session_id(Wire(Founder()));
  good.set_view(EncodeViewQuery({}));
  EXPECT_TRUE(Assess(good).status.ok());

  v1::AssessOverlapRequest bad = good;
  bad.clear_session_id();
  ExpectRefused(Assess(bad), "session_id");
  bad = good;
  bad.clear_view();
  ExpectRefused(Assess(bad), "view");
  bad = good;
  bad.mutable_view()->pop_back();
  ExpectRefused(Assess(bad), "view");
  bad = good;
  bad.set_view(EncodeViewQuery({.pose_frame = PoseFrame::kSession,
                                .T_frame_camera = Pose3(Eigen::Quaterniond::Identity(), {2e6, 0, 0}),
                                .sampler = SamplerKind::kDepthSketch,
                                .sketch = {}}));
  ExpectRefused(Assess(bad), "view.pose");
  bad = good;
  bad.mutable_view()->front() = static_cast<char>(bad.view().front() & ~6);  // no sampler
  ExpectRefused(Assess(bad), "view");
  bad = good;
  bad.mutable_view()->front() = static_cast<char>(bad.view().front() | 6);  // occupancy, with a sketch upside down
  bad.mutable_view()->replace(bad.view().size() - 2, 2, "\x09\x03");
  ExpectRefused(Assess(bad), "view.sketch[11]");
  bad = good;
  bad.set_num_samples(1001);
  ExpectRefused(Assess(bad), "num_samples");
  bad = good;
  bad.set_session_id(4'000'000'000U);
  EXPECT_EQ(Assess(bad).status.error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(BadRequestTest, AQueryBeforeAlignmentIsAFailedPrecondition) {
  Founder();
  v1::AssessOverlapRequest request;
  request.set_session_id(Wire(Open()));
  request.set_view(EncodeViewQuery({}));
  EXPECT_EQ(Assess(request).status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
}

// UploadPartialKeyframe

TEST_F(BadRequestTest, BrokenPacketsAreRefusedAndNothingIsStored) {
  const SessionId session = Founder();
  const Pose3 stand = testing::SyntheticWorld::Stand(0.5, -2, 0);
  const std::string good = EncodeKeyframe(View(stand, stand, session, 1));
  const v1::MapInfo before = GetMap();
  ExpectRefused(UploadBytes(""), "keyframe");
  ExpectRefused(UploadBytes("not a keyframe at all, but long enough for one"), "keyframe");
  ExpectRefused(UploadBytes(good.substr(0, good.size() / 2)), "keyframe.checksum");
  Rng rng(1);
  for (int i = 0; i < 50; ++i) {
    std::string flipped = good;
    flipped[rng.Below(flipped.size())] ^= static_cast<char>(1 << rng.Below(8));
    const Outcome outcome = UploadBytes(flipped);
    EXPECT_EQ(outcome.status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_THAT(outcome.field, StartsWith("keyframe"));
  }
  const v1::MapInfo after = GetMap();
  EXPECT_EQ(after.revision(), before.revision());
  EXPECT_EQ(after.num_frames(), before.num_frames());
  EXPECT_TRUE(UploadBytes(good).status.ok()) << "the server goes on";
}

TEST_F(BadRequestTest, MessagesBeyondTheLimitAreRefused) {
  Open();
  EXPECT_EQ(UploadBytes(std::string(3 << 20, 'x')).status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
}

// RequestSharedMap, ReportUpdate, WatchSession

TEST_F(BadRequestTest, BadSharedMapRequests) {
  v1::RequestSharedMapRequest good;
  good.set_session_id(Wire(Founder()));
  good.set_view(EncodeViewQuery({}));
  EXPECT_TRUE(RequestSharedMap(good).status.ok());

  v1::RequestSharedMapRequest bad = good;
  bad.set_oversharing(9);
  ExpectRefused(RequestSharedMap(bad), "oversharing");
  bad = good;
  bad.set_oversharing(std::nanf(""));
  ExpectRefused(RequestSharedMap(bad), "oversharing");
  bad = good;
  bad.set_overlap(-0.5F);
  ExpectRefused(RequestSharedMap(bad), "overlap");
  bad = good;
  bad.set_min_seen_by_others(1.5F);
  ExpectRefused(RequestSharedMap(bad), "min_seen_by_others");
  for (const float distance_m : {-1.0F, 100.5F, std::nanf("")}) {
    bad = good;
    bad.mutable_look_ahead()->set_distance_m(distance_m);
    ExpectRefused(RequestSharedMap(bad), "look_ahead.distance_m");
  }
  for (const double y_m : {std::nan(""), HUGE_VAL, 2e6}) {
    bad = good;
    bad.mutable_look_ahead()->set_distance_m(5);
    bad.mutable_look_ahead()->mutable_motion()->set_y_m(y_m);
    ExpectRefused(RequestSharedMap(bad), "look_ahead.motion");
  }
  bad = good;
  bad.add_held_tiles()->set_key(TileKey{}.Packed());
  bad.add_held_tiles()->set_key(~uint64_t{0});
  ExpectRefused(RequestSharedMap(bad), "held_tiles[1].key");
  bad = good;
  bad.set_view("?");
  ExpectRefused(RequestSharedMap(bad), "view");
}

TEST_F(BadRequestTest, BadReports) {
  const SessionId session = Founder();
  v1::ReportUpdateRequest request;
  request.set_session_id(Wire(session));
  ExpectRefused(Report(request), "keyframes");
  const Pose3 stand = testing::SyntheticWorld::Stand(0, -2, 0);
  for (int i = 0; i < 9; ++i) request.add_keyframes(EncodeKeyframe(View(stand, stand, session, 1)));
  ExpectRefused(Report(request), "keyframes");
}

TEST_F(BadRequestTest, BadEvidence) {
  const SessionId session = Founder();
  std::vector<PointFinding> findings;
  const auto points = (*store_->Read())->PointsOfSession(session);
  for (const PointRecord& point : *points) {
    if (IsInEvidenceSample(point.id)) findings.push_back({point.id, 1, 0});
  }
  std::ranges::sort(findings, {}, &PointFinding::point);
  v1::ReportEvidenceRequest good;
  good.set_session_id(Wire(session));
  good.set_evidence(EncodeEvidence(findings));

  v1::ReportEvidenceRequest bad = good;
  bad.clear_session_id();
  ExpectRefused(ReportEvidence(bad), "session_id");
  bad = good;
  bad.clear_evidence();
  ExpectRefused(ReportEvidence(bad), "evidence");
  bad = good;
  bad.mutable_evidence()->pop_back();
  ExpectRefused(ReportEvidence(bad), "evidence");
  bad = good;
  uint64_t unknown = 1'000'000'000;
  while (!IsInEvidenceSample(MapPointId(unknown))) ++unknown;
  bad.set_evidence(EncodeEvidence(std::vector<PointFinding>{{MapPointId(unknown), 1, 0}}));
  ExpectRefused(ReportEvidence(bad), "evidence");
  bad = good;
  bad.set_session_id(Wire(Open()));
  EXPECT_EQ(ReportEvidence(bad).status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  bad.set_session_id(4'000'000'000U);
  EXPECT_EQ(ReportEvidence(bad).status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_TRUE((*store_->Read())->ListEvidence(session)->empty()) << "nothing half-done";

  EXPECT_TRUE(ReportEvidence(good).status.ok());
  EXPECT_TRUE(ReportEvidence(good).status.ok()) << "a repeat";
  EXPECT_EQ((*store_->Read())->ListEvidence(session)->size(), 1U);
  Outcome flooded;
  for (uint32_t number = 1; flooded.status.ok() && number < 100; ++number) {
    good.set_number(number);
    flooded = ReportEvidence(good);
  }
  EXPECT_EQ(flooded.status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_THAT(flooded.status.error_message(), HasSubstr("try again in"));
}

TEST_F(BadRequestTest, WatchingNobody) {
  ExpectRefused(Watch(0), "session_id");
  EXPECT_EQ(Watch(12345).status.error_code(), grpc::StatusCode::NOT_FOUND);
}

}  // namespace
}  // namespace mapp
