#include "cli/sessions.h"

#include "cli/admin_client.h"
#include "cli/confirm.h"
#include "cli/geometry_json.h"
#include "cli/text_table.h"
#include "text/json_writer.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

void AppendQuarantine(const std::optional<QuarantineSummary>& quarantine, JsonWriter& json) {
  json.Key("quarantine");
  if (!quarantine) {
    json.Null();
    return;
  }
  json.BeginObject().Field("since_unix_ns", quarantine->since_unix_ns).Field("reason", quarantine->reason);
  json.Field("released_unix_ns", quarantine->released_unix_ns).EndObject();
}

/// "open", "closed" or "quarantined".
std::string StateOf(const SessionSummary& session) {
  if (session.quarantine && session.quarantine->released_unix_ns == 0) return "quarantined";
  return session.closed_unix_ns == 0 ? "open" : "closed";
}

void AppendSession(const SessionSummary& session, JsonWriter& json) {
  json.BeginObject().Field("id", session.id).Field("map", session.map_name).Field("device", session.device);
  json.Field("sensor", SensorKindName(session.sensor)).Field("state", StateOf(session));
  json.Field("opened_unix_ns", session.opened_unix_ns).Field("closed_unix_ns", session.closed_unix_ns);
  AppendPose(session.T_map_session, "pose_map_session", json);
  json.Field("scale_map_session", session.scale_map_session);
  json.Field("aligned_at_keyframe", session.aligned_at_keyframe).Field("num_keyframes", session.num_keyframes);
  json.Field("num_upload_bytes", session.num_upload_bytes);
  AppendQuarantine(session.quarantine, json);
  json.EndObject();
}

std::string FormatJson(const std::vector<SessionSummary>& sessions) {
  JsonWriter json;
  json.BeginObject().Key("sessions").BeginArray();
  for (const SessionSummary& session : sessions) AppendSession(session, json);
  json.EndArray().EndObject();
  return std::move(json).Finish();
}

std::string FormatText(const std::vector<SessionSummary>& sessions) {
  TextTable table({{"id", Align::kRight},
                   {"map"},
                   {"device"},
                   {"sensor"},
                   {"state"},
                   {"keyframes", Align::kRight},
                   {"uploaded", Align::kRight},
                   {"aligned at", Align::kRight},
                   {"opened (UTC)"},
                   {"closed (UTC)"}});
  for (const SessionSummary& session : sessions) {
    table.AddRow({std::to_string(session.id), session.map_name, session.device, SensorKindName(session.sensor),
                  StateOf(session), std::to_string(session.num_keyframes),
                  FormatBytes(static_cast<double>(session.num_upload_bytes)),
                  session.aligned_at_keyframe ? std::to_string(*session.aligned_at_keyframe) : "-",
                  FormatUnixTime(session.opened_unix_ns), FormatUnixTime(session.closed_unix_ns)});
  }
  return table.Format();
}

std::string FormatText(const SessionSummary& session) {
  TextTable table({{"session"}, {std::to_string(session.id)}});
  table.AddRow({"map", session.map_name});
  table.AddRow({"device", session.device});
  table.AddRow({"sensor", SensorKindName(session.sensor)});
  table.AddRow({"state", StateOf(session)});
  table.AddRow({"opened (UTC)", FormatUnixTime(session.opened_unix_ns)});
  table.AddRow({"closed (UTC)", FormatUnixTime(session.closed_unix_ns)});
  table.AddRow({"aligned at", session.aligned_at_keyframe ? fmt::format("keyframe {}", *session.aligned_at_keyframe)
                                                          : std::string("not aligned")});
  if (session.scale_map_session != 1) {
    table.AddRow({"scale", fmt::format("{:.4g} m a unit", session.scale_map_session)});
  }
  table.AddRow({"keyframes", std::to_string(session.num_keyframes)});
  table.AddRow({"uploaded", FormatBytes(static_cast<double>(session.num_upload_bytes))});
  if (session.quarantine) {
    table.AddRow({"quarantined (UTC)", FormatUnixTime(session.quarantine->since_unix_ns)});
    table.AddRow({"released (UTC)", FormatUnixTime(session.quarantine->released_unix_ns)});
    table.AddRow({"reason", session.quarantine->reason});
  }
  return table.Format();
}

StatusOr<SessionSummary> FindSession(AdminClient& client, uint32_t id) {
  MAPP_ASSIGN_OR_RETURN(std::vector<SessionSummary> sessions, client.ListSessions(""));
  const auto found = std::ranges::find(sessions, uint64_t{id}, &SessionSummary::id);
  if (found == sessions.end()) return absl::NotFoundError(fmt::format("session {} does not exist", id));
  return std::move(*found);
}

}  // namespace

Status RunSessionsList(const SessionsListOptions& options, std::ostream& out) {
  MAPP_ASSIGN_OR_RETURN(const std::vector<SessionSummary> sessions,
                        AdminClient(options.server).ListSessions(options.map_name));
  out << (options.json ? FormatJson(sessions) : FormatText(sessions));
  return absl::OkStatus();
}

Status RunSessionsShow(const SessionsShowOptions& options, std::ostream& out) {
  AdminClient client(options.server);
  MAPP_ASSIGN_OR_RETURN(const SessionSummary session, FindSession(client, options.id));
  if (!options.json) {
    out << FormatText(session);
    return absl::OkStatus();
  }
  JsonWriter json;
  AppendSession(session, json);
  out << std::move(json).Finish();
  return absl::OkStatus();
}

Status RunSessionsRevert(const SessionsRevertOptions& options, std::istream& in, std::ostream& out) {
  AdminClient client(options.server);
  MAPP_ASSIGN_OR_RETURN(const SessionSummary session, FindSession(client, options.id));
  MAPP_ASSIGN_OR_RETURN(RevertedSummary reverted, client.RevertSession(options.id, options.reason, /*dry_run=*/true));
  if (!options.dry_run) {
    const Question question{
        .text = fmt::format("Take session {} of {} out of map {}: {} frames, {} points that nobody else observes?",
                            session.id, session.device, session.map_name, reverted.num_frames, reverted.num_points),
        .doing = "reverting a session",
        .not_done = "the session stays in the map",
        .yes = options.yes,
        .interactive = options.interactive};
    MAPP_RETURN_IF_ERROR(Confirm(question, in, out));
    MAPP_ASSIGN_OR_RETURN(reverted, client.RevertSession(options.id, options.reason, /*dry_run=*/false));
  }
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("id", session.id).Field("dry_run", options.dry_run);
    json.Field("map_revision", reverted.map_revision).Field("num_frames", reverted.num_frames);
    json.Field("num_points", reverted.num_points);
    json.Field("num_sessions_to_optimize", reverted.num_sessions_to_optimize).EndObject();
    out << std::move(json).Finish();
    return absl::OkStatus();
  }
  out << fmt::format("{} session {}: {} frames and {} points out of map {}, {} other sessions {} again\n",
                     options.dry_run ? "would revert" : "reverted", session.id, reverted.num_frames,
                     reverted.num_points, session.map_name, reverted.num_sessions_to_optimize,
                     options.dry_run ? "to optimize" : "are optimized");
  if (!options.dry_run) out << fmt::format("`mapp sessions release {}` brings it back\n", session.id);
  return absl::OkStatus();
}

Status RunSessionsErase(const SessionsEraseOptions& options, std::istream& in, std::ostream& out) {
  AdminClient client(options.server);
  MAPP_ASSIGN_OR_RETURN(const SessionSummary session, FindSession(client, options.id));
  MAPP_ASSIGN_OR_RETURN(ErasedSummary erased, client.EraseSession(options.id, options.force, /*dry_run=*/true));
  if (!options.dry_run) {
    const Question question{
        .text = fmt::format("Forget session {} of {} in map {} for good: {} keyframes and {} points? {} of its points "
                            "that others observe stay. The map's past before now cannot be read any more{}.",
                            session.id, session.device, session.map_name, erased.num_frames, erased.num_points,
                            erased.num_points_kept,
                            erased.dropped_tags.empty()
                                ? std::string()
                                : fmt::format("; tags that go with it: {}", fmt::join(erased.dropped_tags, ", "))),
        .doing = "erasing a session",
        .not_done = "nothing was erased",
        .yes = options.yes,
        .interactive = options.interactive};
    MAPP_RETURN_IF_ERROR(Confirm(question, in, out));
    MAPP_ASSIGN_OR_RETURN(erased, client.EraseSession(options.id, options.force, /*dry_run=*/false));
  }
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("id", session.id).Field("dry_run", options.dry_run);
    json.Field("map_revision", erased.map_revision).Field("num_frames", erased.num_frames);
    json.Field("num_points", erased.num_points).Field("num_points_kept", erased.num_points_kept);
    json.Key("dropped_tags").BeginArray();
    for (const std::string& tag : erased.dropped_tags) json.Value(tag);
    json.EndArray().EndObject();
    out << std::move(json).Finish();
    return absl::OkStatus();
  }
  out << fmt::format("{} session {}: {} keyframes and {} points; {} of its points that others observe {}\n",
                     options.dry_run ? "would erase" : "erased", session.id, erased.num_frames, erased.num_points,
                     erased.num_points_kept, options.dry_run ? "would stay" : "stay");
  if (!options.dry_run) out << "backups and bundles made before still hold it\n";
  return absl::OkStatus();
}

Status RunSessionsRelease(const SessionsReleaseOptions& options, std::istream& in, std::ostream& out) {
  AdminClient client(options.server);
  MAPP_ASSIGN_OR_RETURN(const SessionSummary session, FindSession(client, options.id));
  if (StateOf(session) != "quarantined") {
    return absl::FailedPreconditionError(fmt::format("session {} is not quarantined", options.id));
  }
  const Question question{
      .text =
          fmt::format("Session {} of {} in map {} is quarantined: {}.\nRelease it for good and take in what was left "
                      "out of the map?",
                      session.id, session.device, session.map_name, session.quarantine->reason),
      .doing = "releasing a session",
      .not_done = "the session stays quarantined",
      .yes = options.yes,
      .interactive = options.interactive};
  MAPP_RETURN_IF_ERROR(Confirm(question, in, out));
  MAPP_ASSIGN_OR_RETURN(const uint64_t num_frames, client.ReleaseSession(options.id));
  if (options.json) {
    JsonWriter json;
    json.BeginObject().Field("id", session.id).Field("num_frames", num_frames).EndObject();
    out << std::move(json).Finish();
  } else {
    out << fmt::format("released session {}: {} frames taken into the map\n", session.id, num_frames);
  }
  return absl::OkStatus();
}

}  // namespace mapp
