// The calls about sessions.
#include "api/convert/convert.h"
#include "cli/admin_client_impl.h"

#include <utility>

namespace mapp {
namespace {

StatusOr<SessionSummary> ToSummary(const v1::SessionInfo& info) {
  SessionSummary session;
  session.id = info.id();
  session.map_name = info.map_name();
  session.device = info.device();
  MAPP_ASSIGN_OR_RETURN(session.sensor, FromProto(info.sensor(), "sensor"));
  session.opened_unix_ns = info.opened_unix_ns();
  session.closed_unix_ns = info.closed_unix_ns();
  if (info.has_pose_map_session()) {
    MAPP_ASSIGN_OR_RETURN(session.T_map_session, FromProto(info.pose_map_session(), "pose_map_session"));
    MAPP_ASSIGN_OR_RETURN(session.scale_map_session, ScaleFromProto(info.scale_map_session(), "scale_map_session"));
    session.aligned_at_keyframe = info.aligned_at_keyframe();
  }
  session.num_keyframes = info.num_keyframes();
  session.num_upload_bytes = info.num_upload_bytes();
  if (info.has_quarantine()) {
    session.quarantine = QuarantineSummary{info.quarantine().since_unix_ns(), info.quarantine().reason(),
                                           info.quarantine().released_unix_ns()};
  }
  return session;
}

}  // namespace

StatusOr<std::vector<SessionSummary>> AdminClient::ListSessions(const std::string& map_name) {
  v1::ListSessionsRequest request;
  request.set_map_name(map_name);
  MAPP_ASSIGN_OR_RETURN(const v1::ListSessionsResponse response,
                        impl_->Call(&v1::AdminService::Stub::ListSessions, request, kCallTimeout));
  std::vector<SessionSummary> sessions;
  for (const v1::SessionInfo& info : response.sessions()) {
    StatusOr<SessionSummary> session = ToSummary(info);
    if (!session.ok()) return BadAnswer(session.status());
    sessions.push_back(*std::move(session));
  }
  return sessions;
}

StatusOr<uint64_t> AdminClient::ReleaseSession(uint64_t session_id) {
  v1::ReleaseSessionRequest request;
  request.set_session_id(static_cast<uint32_t>(session_id));
  MAPP_ASSIGN_OR_RETURN(const v1::ReleaseSessionResponse response,
                        impl_->Call(&v1::AdminService::Stub::ReleaseSession, request, kBulkCallTimeout));
  return response.num_frames();
}

StatusOr<RevertedSummary> AdminClient::RevertSession(uint64_t session_id, const std::string& reason, bool dry_run) {
  v1::RevertSessionRequest request;
  request.set_session_id(static_cast<uint32_t>(session_id));
  request.set_reason(reason);
  request.set_dry_run(dry_run);
  MAPP_ASSIGN_OR_RETURN(const v1::RevertSessionResponse response,
                        impl_->Call(&v1::AdminService::Stub::RevertSession, request, kBulkCallTimeout));
  return RevertedSummary{response.map_revision(), response.num_frames(), response.num_points(),
                         response.num_sessions_to_optimize()};
}

StatusOr<ErasedSummary> AdminClient::EraseSession(uint64_t session_id, bool force, bool dry_run) {
  v1::EraseSessionRequest request;
  request.set_session_id(static_cast<uint32_t>(session_id));
  request.set_force(force);
  request.set_dry_run(dry_run);
  MAPP_ASSIGN_OR_RETURN(const v1::EraseSessionResponse response,
                        impl_->Call(&v1::AdminService::Stub::EraseSession, request, kBulkCallTimeout));
  return ErasedSummary{response.map_revision(),
                       response.num_frames(),
                       response.num_points(),
                       response.num_points_kept(),
                       {response.dropped_tags().begin(), response.dropped_tags().end()}};
}

}  // namespace mapp
