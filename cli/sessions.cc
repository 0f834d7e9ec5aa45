#include "cli/sessions.h"

#include "cli/admin_client.h"
#include "cli/text_table.h"
#include "text/json_writer.h"

namespace mapp {
namespace {

void AppendPose(const std::optional<Pose3>& pose, const char* key, JsonWriter& json) {
  json.Key(key);
  if (!pose) {
    json.Null();
    return;
  }
  const Eigen::Vector3d& t = pose->translation();
  const Eigen::Quaterniond& q = pose->rotation();
  json.BeginObject().Field("tx_m", t.x()).Field("ty_m", t.y()).Field("tz_m", t.z());
  json.Field("qw", q.w()).Field("qx", q.x()).Field("qy", q.y()).Field("qz", q.z()).EndObject();
}

std::string FormatJson(const std::vector<SessionSummary>& sessions) {
  JsonWriter json;
  json.BeginObject().Key("sessions").BeginArray();
  for (const SessionSummary& session : sessions) {
    json.BeginObject().Field("id", session.id).Field("map", session.map_name).Field("device", session.device);
    json.Field("sensor", SensorKindName(session.sensor));
    json.Field("opened_unix_ns", session.opened_unix_ns).Field("closed_unix_ns", session.closed_unix_ns);
    AppendPose(session.T_map_session, "pose_map_session", json);
    json.Field("aligned_at_keyframe", session.aligned_at_keyframe).Field("num_keyframes", session.num_keyframes);
    json.Field("num_upload_bytes", session.num_upload_bytes).EndObject();
  }
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const std::vector<SessionSummary>& sessions) {
  TextTable table({{"id", Align::kRight},
                   {"map"},
                   {"device"},
                   {"sensor"},
                   {"keyframes", Align::kRight},
                   {"uploaded", Align::kRight},
                   {"aligned at", Align::kRight},
                   {"opened (UTC)"},
                   {"closed (UTC)"}});
  for (const SessionSummary& session : sessions) {
    table.AddRow({std::to_string(session.id), session.map_name, session.device, SensorKindName(session.sensor),
                  std::to_string(session.num_keyframes), FormatBytes(static_cast<double>(session.num_upload_bytes)),
                  session.aligned_at_keyframe ? std::to_string(*session.aligned_at_keyframe) : "-",
                  FormatUnixTime(session.opened_unix_ns), FormatUnixTime(session.closed_unix_ns)});
  }
  return table.Format();
}

}  // namespace

Status RunSessionsList(const SessionsListOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionSummary> sessions,
                        AdminClient(options.server).ListSessions(options.map_name));
  out << (options.json ? FormatJson(sessions) : FormatText(sessions));
  return absl::OkStatus();
}

}  // namespace mapp
