#include "eval/harness/change_detection.h"

#include "api/convert/convert.h"
#include "api/status/grpc_status.h"
#include "eval/harness/fleet.h"
#include "mapp/base/rng.h"
#include "mapp/v1/admin_service.grpc.pb.h"
#include "storage/sqlite/sqlite_map_store.h"

#include <fmt/format.h>
#include <grpcpp/create_channel.h>

#include <chrono>
#include <filesystem>
#include <map>
#include <optional>

namespace mapp {
namespace {

constexpr std::chrono::minutes kDetectTimeout{30};
constexpr std::chrono::minutes kDisplaceTimeout{5};

StatusOr<sim::ChangeKind> KindOf(v1::ChangeKind kind) {
  switch (kind) {
    case v1::CHANGE_KIND_APPEARED:
      return sim::ChangeKind::kAppeared;
    case v1::CHANGE_KIND_VANISHED:
      return sim::ChangeKind::kVanished;
    case v1::CHANGE_KIND_MOVED:
      return sim::ChangeKind::kMoved;
    default:
      return absl::DataLossError(fmt::format("change of kind {}", static_cast<int>(kind)));
  }
}

StatusOr<OrientedBox> BoxOf(const v1::OrientedBox& proto, const std::string& field) {
  OrientedBox box_map;
  MAPP_ASSIGN_OR_RETURN(box_map.T_frame_box, FromProto(proto.pose(), field));
  box_map.size_m = {proto.size_x_m(), proto.size_y_m(), proto.size_z_m()};
  return box_map;
}

StatusOr<DetectedChange> DetectedFrom(const v1::Change& proto) {
  DetectedChange detected;
  MAPP_ASSIGN_OR_RETURN(detected.kind, KindOf(proto.kind()));
  if (proto.has_box_before()) {
    MAPP_ASSIGN_OR_RETURN(detected.before, BoxOf(proto.box_before(), "box_before"));
  }
  if (proto.has_box_after()) {
    MAPP_ASSIGN_OR_RETURN(detected.after, BoxOf(proto.box_after(), "box_after"));
  }
  return detected;
}

Eigen::Vector3d AnyDirection(Rng& rng) {
  return Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
}

}  // namespace

StatusOr<ChangeDetection> DetectChanges(const std::string& address, const std::stop_token& stop, double auto_accept) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);  // changes name their points
  const auto stub =
      v1::AdminService::NewStub(grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments));
  v1::DetectChangesRequest request;
  request.set_name(kEvalMapName);
  request.set_auto_accept(auto_accept);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kDetectTimeout);
  const std::stop_callback cancel(stop, [&context] { context.TryCancel(); });
  const auto reader = stub->DetectChanges(&context, request);
  std::optional<v1::DetectChangesResponse::Result> result;
  for (v1::DetectChangesResponse response; reader->Read(&response);) {
    if (response.has_result()) result = response.result();
  }
  MAPP_RETURN_IF_ERROR(Annotate(FromGrpcStatus(reader->Finish()), "DetectChanges"));
  if (!result) return absl::DataLossError("DetectChanges: no result");
  ChangeDetection detection;
  detection.num_accepted = result->num_accepted();
  detection.num_sessions_read = result->num_sessions_read();
  detection.seconds = result->seconds();
  for (const v1::Change& change : result->changes()) {
    MAPP_ASSIGN_OR_RETURN(DetectedChange detected, DetectedFrom(change));
    detection.changes.push_back(std::move(detected));
  }
  return detection;
}

StatusOr<std::string> CopyDatabase(const std::string& database, const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  const std::string copy = folder + "/map.db";
  if (!error) {
    std::filesystem::copy_file(database, copy, std::filesystem::copy_options::overwrite_existing, error);
  }
  if (error) return absl::ResourceExhaustedError(fmt::format("{}: {}", copy, error.message()));
  return copy;
}

Status DisplaceSessions(const std::string& database, double max_m, double max_rad, uint64_t seed) {
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapStore> store, OpenSqliteMapStore(database));
  const auto displace = [&](MapWriter& writer) -> Status {
    MAPP_ASSIGN_OR_RETURN(const MapRecord map, writer.FindMap(kEvalMapName));
    MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions, writer.ListSessions(map.id));
    MAPP_RETURN_IF_ERROR(writer.SetCause(map.id, RevisionCause::kAlignment, std::nullopt));
    Rng rng(seed);
    for (const SessionRecord& session : sessions) {
      const Eigen::Vector3d offset_map = rng.Uniform(0, max_m) * AnyDirection(rng);
      const Eigen::Quaterniond R_map_map = ExpSo3(rng.Uniform(0, max_rad) * AnyDirection(rng));
      MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, writer.ListFrames(map.id, session.id));
      for (const FrameRecord& frame : frames) {
        if (!frame.in_map) continue;
        const Pose3& T_map_camera = frame.T_frame_camera;
        // Turned where it stands: about the map's origin a degree would be metres at the end of the way.
        const Pose3 T_map_displaced(R_map_map * T_map_camera.rotation(), T_map_camera.translation() + offset_map);
        MAPP_RETURN_IF_ERROR(writer.SetFramePose(frame.id, frame.in_map, T_map_displaced));
      }
    }
    return absl::OkStatus();
  };
  MAPP_RETURN_IF_ERROR(store->Write(CallContext::WithTimeout(kDisplaceTimeout), displace));
  return store->Close();
}

}  // namespace mapp
