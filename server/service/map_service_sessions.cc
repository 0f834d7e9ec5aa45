// What operators do with sessions.
#include "mapp/base/unix_time.h"
#include "server/service/map_service_impl.h"
#include "server/service/session_erasure.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

/// What is to be erased, as it stands.
struct ErasurePlan {
  SessionRecord session;
  MapRecord map;
  bool is_in_map = false;
  size_t num_points = 0;
  std::vector<std::string> tags;
};

StatusOr<ErasurePlan> PlanErasure(MapReader& reader, SessionId session) {
  ErasurePlan plan;
  MAPP_ASSIGN_OR_RETURN(plan.session, reader.GetSession(session));
  MAPP_ASSIGN_OR_RETURN(plan.map, reader.GetMap(plan.session.map));
  MAPP_ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames, reader.ListFrames(plan.map.id, session));
  plan.is_in_map = std::ranges::any_of(frames, &FrameRecord::in_map);
  MAPP_ASSIGN_OR_RETURN(const std::vector<PointRecord> points, reader.PointsOfSession(session));
  plan.num_points = static_cast<size_t>(std::ranges::count(points, session, &PointRecord::session));
  MAPP_ASSIGN_OR_RETURN(const std::vector<TagRecord> tags, reader.ListTags(plan.map.id));
  for (const TagRecord& tag : tags) plan.tags.push_back(tag.name);
  return plan;
}

}  // namespace

StatusOr<std::vector<SessionRecord>> MapService::ListSessions(const CallContext& context, const std::string& map_name) {
  MAPP_RETURN_IF_ERROR(context.Check());
  MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
  if (map_name.empty()) return reader->ListSessions(std::nullopt);
  MAPP_ASSIGN_OR_RETURN(const MapRecord map, reader->FindMap(map_name));
  return reader->ListSessions(map.id);
}

StatusOr<ReleasedSession> MapService::ReleaseSession(const CallContext& context, SessionId session) {
  ReleasedSession released;
  MAPP_ASSIGN_OR_RETURN(released.session, impl_->guard.Release(context, session));
  MAPP_ASSIGN_OR_RETURN(released.num_frames_taken_in, impl_->integrator.IntegrateLeftOut(context, session));
  if (!released.session.T_map_session) {
    impl_->registrar.OnSessionReleased(released.session.map, session);
  } else if (released.session.closed_ns) {
    impl_->optimizer.OnSessionClosed(session);
  }
  return released;
}

StatusOr<RevertedSession> MapService::RevertSession(const CallContext& context, SessionId session,
                                                    const std::string& reason, bool dry_run) {
  const std::string why = reason.empty() ? "reverted by an operator" : "reverted by an operator: " + reason;
  MAPP_ASSIGN_OR_RETURN(const QuarantinedSession reverted, impl_->guard.Revert(context, session, why, dry_run));
  if (!dry_run) {
    for (const SessionId neighbor : reverted.neighbors) impl_->optimizer.OnSessionClosed(neighbor);
  }
  return RevertedSession{.session = session,
                         .map_revision = reverted.revision,
                         .num_frames = reverted.retired_frames.size(),
                         .num_points = reverted.num_retired_points,
                         .num_sessions_to_optimize = reverted.neighbors.size()};
}

StatusOr<ErasedSession> MapService::EraseSession(const CallContext& context, SessionId session, bool force,
                                                 bool dry_run) {
  ErasurePlan plan;
  {
    MAPP_ASSIGN_OR_RETURN(const std::unique_ptr<MapReader> reader, impl_->store.Read());
    MAPP_ASSIGN_OR_RETURN(plan, PlanErasure(*reader, session));
  }
  if (!plan.session.closed_ns && !force) {
    return absl::FailedPreconditionError(
        fmt::format("session {} of {} is open: wait until its device has closed it, or force it", session.value(),
                    plan.session.device));
  }
  ErasedSession erased{.map_revision = plan.map.revision,
                       .num_frames = static_cast<size_t>(plan.session.num_keyframes),
                       .num_points = plan.num_points,
                       .num_points_kept = 0,
                       .dropped_tags = plan.tags};
  // Nothing of it comes to the map from here on, whatever its device still sends.
  if (plan.is_in_map || !plan.session.IsQuarantined()) {
    MAPP_ASSIGN_OR_RETURN(const RevertedSession reverted, RevertSession(context, session, "to be erased", dry_run));
    if (plan.is_in_map) erased.num_points = reverted.num_points;
    erased.num_points_kept = plan.num_points - std::min(plan.num_points, erased.num_points);
  }
  if (dry_run) return erased;
  for (const std::string& tag : plan.tags) MAPP_RETURN_IF_ERROR(DeleteTag(context, plan.map.name, tag));
  // In small steps, so that little is left for the one that stops all others.
  const CompactionRequest all_history{
      .map_name = plan.map.name, .keep_revisions = 0, .keep_days = {}, .dry_run = false};
  MAPP_RETURN_IF_ERROR(CompactMap(context, all_history, {}).status());
  const auto forget = [&]() -> Status {
    SessionErasure erasure;
    const auto erase = [&](MapWriter& writer) -> Status {
      MAPP_ASSIGN_OR_RETURN(erasure, mapp::EraseSession(writer, session));
      return absl::OkStatus();
    };
    MAPP_RETURN_IF_ERROR(impl_->store.Write(context, erase, [&] { impl_->tiles.OnMapDeleted(plan.map.id); }));
    erased.map_revision = erasure.revision;
    erased.num_points_kept = erasure.num_points_kept;
    return absl::OkStatus();
  };
  MAPP_RETURN_IF_ERROR(impl_->registrar.RunAlone(plan.map.id, forget));
  MAPP_RETURN_IF_ERROR(
      Annotate(impl_->store.Rewrite(context), fmt::format("session {} is erased from the map", session.value())));
  return erased;
}

}  // namespace mapp
