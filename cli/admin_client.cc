#include "api/convert/convert.h"
#include "cli/admin_client_impl.h"

#include <fmt/format.h>
#include <grpcpp/create_channel.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <string_view>
#include <tuple>

namespace mapp {
namespace {

Eigen::Vector3d ToVector(const v1::Point3& point) { return {point.x_m(), point.y_m(), point.z_m()}; }

StatusOr<MapFrameSummary> ToSummary(const v1::ExportedFrame& exported) {
  MapFrameSummary frame;
  frame.session_id = exported.session_id();
  frame.keyframe = exported.keyframe();
  frame.stamp_ns = exported.stamp_ns();
  MAPP_ASSIGN_OR_RETURN(frame.T_map_camera, FromProto(exported.pose_map_camera(), "pose_map_camera"));
  frame.partial = exported.partial();
  return frame;
}

MapPointSummary ToSummary(const v1::ExportedPoint& exported) {
  return {ToVector(exported.position_map()), exported.num_observations(), exported.confidence(), exported.session_id(),
          exported.id()};
}

/// REVISION_CAUSE_CHANGE_UNDONE is "change undone".
std::string NameOf(v1::RevisionCause cause) {
  if (!v1::RevisionCause_IsValid(cause) || cause == v1::REVISION_CAUSE_UNSPECIFIED) return "unknown";
  constexpr std::string_view kPrefix = "REVISION_CAUSE_";
  std::string name = v1::RevisionCause_Name(cause).substr(kPrefix.size());
  std::ranges::transform(name, name.begin(),
                         [](unsigned char c) { return c == '_' ? ' ' : static_cast<char>(std::tolower(c)); });
  return name;
}

std::vector<TagSummary> ToSummaries(const google::protobuf::RepeatedPtrField<v1::Tag>& tags) {
  std::vector<TagSummary> summaries;
  for (const v1::Tag& tag : tags) summaries.push_back({tag.name(), tag.revision(), tag.created_unix_ns()});
  return summaries;
}

}  // namespace

StatusOr<MapSummary> AdminClient::Impl::ToMapSummary(const v1::MapInfo& info) {
  MapSummary map;
  map.id = info.id();
  map.name = info.name();
  map.created_unix_ns = info.created_unix_ns();
  map.revision = info.revision();
  map.num_frames = info.num_frames();
  map.num_points = info.num_points();
  map.num_sessions = info.num_sessions();
  map.tile_edge_m = info.tile_edge_m();
  map.cone_range_m = info.cone_range_m();
  map.scale_unknown = info.scale_unknown();
  map.num_tiles = info.num_tiles();
  if (info.has_feature_settings()) {
    MAPP_ASSIGN_OR_RETURN(map.features, FromProto(info.feature_settings(), "feature_settings"));
  }
  if (info.has_bounds()) map.bounds = Aabb(ToVector(info.bounds().min()), ToVector(info.bounds().max()));
  return map;
}

AdminClient::AdminClient(const std::string& server) : impl_(std::make_unique<Impl>()) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);
  impl_->server = server;
  impl_->stub =
      v1::AdminService::NewStub(grpc::CreateCustomChannel(server, grpc::InsecureChannelCredentials(), arguments));
}

AdminClient::~AdminClient() = default;

StatusOr<ServerSummary> AdminClient::GetServerInfo() {
  MAPP_ASSIGN_OR_RETURN(const v1::GetServerInfoResponse response,
                        impl_->Call(&v1::AdminService::Stub::GetServerInfo, {}, kCallTimeout));
  ServerSummary server;
  server.version = response.version();
  server.schema_version = response.schema_version();
  server.started_unix_ns = response.started_unix_ns();
  for (const auto& figures : response.methods()) {
    server.methods.push_back({figures.method(),
                              figures.num_errors(),
                              {figures.num_calls(), figures.mean_ms(), figures.median_ms(), figures.p95_ms()}});
  }
  for (const auto& figures : response.steps()) {
    server.steps.push_back(
        {figures.step(), {figures.num_runs(), figures.mean_ms(), figures.median_ms(), figures.p95_ms()}});
  }
  server.usage = {response.cpu_s(), response.rss_bytes(), response.peak_rss_bytes()};
  return server;
}

StatusOr<std::vector<MapSummary>> AdminClient::ListMaps() {
  MAPP_ASSIGN_OR_RETURN(const v1::ListMapsResponse response,
                        impl_->Call(&v1::AdminService::Stub::ListMaps, {}, kCallTimeout));
  std::vector<MapSummary> maps;
  for (const v1::MapInfo& info : response.maps()) {
    StatusOr<MapSummary> map = Impl::ToMapSummary(info);
    if (!map.ok()) return BadAnswer(map.status());
    maps.push_back(*std::move(map));
  }
  return maps;
}

StatusOr<MapSummary> AdminClient::GetMap(const std::string& name, const std::string& at) {
  v1::GetMapRequest request;
  request.set_name(name);
  request.set_at(at);
  MAPP_ASSIGN_OR_RETURN(const v1::GetMapResponse response,
                        impl_->Call(&v1::AdminService::Stub::GetMap, request, kBulkCallTimeout));
  StatusOr<MapSummary> map = Impl::ToMapSummary(response.map());
  if (!map.ok()) return BadAnswer(map.status());
  return map;
}

StatusOr<std::pair<uint64_t, uint64_t>> AdminClient::DeleteMap(const std::string& name, bool force) {
  v1::DeleteMapRequest request;
  request.set_name(name);
  request.set_force(force);
  MAPP_ASSIGN_OR_RETURN(const v1::DeleteMapResponse response,
                        impl_->Call(&v1::AdminService::Stub::DeleteMap, request, kBulkCallTimeout));
  return std::pair(response.num_frames(), response.num_points());
}

StatusOr<MapContent> AdminClient::ExportMap(const std::string& name, const std::string& at) {
  v1::ExportMapRequest request;
  request.set_name(name);
  request.set_at(at);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kBulkCallTimeout);
  const auto reader = impl_->stub->ExportMap(&context, request);

  MapContent content;
  Status bad_answer;
  v1::ExportMapResponse response;
  while (bad_answer.ok() && reader->Read(&response)) {
    if (response.has_map()) {
      StatusOr<MapSummary> map = Impl::ToMapSummary(response.map());
      if (!map.ok()) return BadAnswer(map.status());
      content.map = *std::move(map);
    }
    for (const v1::ExportedPoint& point : response.points()) content.points.push_back(ToSummary(point));
    for (const v1::ExportedFrame& exported : response.frames()) {
      StatusOr<MapFrameSummary> frame = ToSummary(exported);
      if (!frame.ok()) {
        bad_answer = BadAnswer(frame.status());
        context.TryCancel();
        break;
      }
      content.frames.push_back(*std::move(frame));
    }
  }
  const grpc::Status finished = reader->Finish();
  MAPP_RETURN_IF_ERROR(bad_answer);
  MAPP_RETURN_IF_ERROR(impl_->ToStatus(finished));
  std::sort(content.frames.begin(), content.frames.end(), [](const MapFrameSummary& a, const MapFrameSummary& b) {
    return std::tie(a.session_id, a.keyframe) < std::tie(b.session_id, b.keyframe);
  });
  return content;
}

StatusOr<RevisionLogSummary> AdminClient::ListRevisions(const std::string& name, uint32_t max_runs) {
  v1::ListRevisionsRequest request;
  request.set_name(name);
  request.set_max_runs(max_runs);
  MAPP_ASSIGN_OR_RETURN(const v1::ListRevisionsResponse response,
                        impl_->Call(&v1::AdminService::Stub::ListRevisions, request, kBulkCallTimeout));
  RevisionLogSummary log;
  for (const v1::ListRevisionsResponse::Run& run : response.runs()) {
    log.runs.push_back({run.first_revision(), run.last_revision(), run.num_revisions(), run.first_unix_ns(),
                        run.last_unix_ns(), NameOf(run.cause()), run.session_id(), run.device()});
  }
  log.truncated = response.truncated();
  log.oldest_revision = response.oldest_revision();
  log.tags = ToSummaries(response.tags());
  return log;
}

StatusOr<MapDiffSummary> AdminClient::DiffRevisions(const std::string& name, const std::string& from,
                                                    const std::string& to) {
  v1::DiffRevisionsRequest request;
  request.set_name(name);
  request.set_from(from);
  request.set_to(to);
  MAPP_ASSIGN_OR_RETURN(const v1::DiffRevisionsResponse response,
                        impl_->Call(&v1::AdminService::Stub::DiffRevisions, request, kBulkCallTimeout));
  MapDiffSummary diff{response.from_revision(), response.to_revision(), {}};
  for (const v1::DiffRevisionsResponse::Session& session : response.sessions()) {
    diff.sessions.push_back({session.session_id(), session.device(), session.frames_added(), session.frames_moved(),
                             session.frames_removed(), session.points_added(), session.points_moved(),
                             session.points_removed()});
  }
  return diff;
}

StatusOr<std::vector<TagSummary>> AdminClient::ListTags(const std::string& name) {
  v1::ListTagsRequest request;
  request.set_name(name);
  MAPP_ASSIGN_OR_RETURN(const v1::ListTagsResponse response,
                        impl_->Call(&v1::AdminService::Stub::ListTags, request, kCallTimeout));
  return ToSummaries(response.tags());
}

StatusOr<uint64_t> AdminClient::PutTag(const std::string& name, const std::string& tag, const std::string& at) {
  v1::PutTagRequest request;
  request.set_name(name);
  request.set_tag(tag);
  request.set_at(at);
  MAPP_ASSIGN_OR_RETURN(const v1::PutTagResponse response,
                        impl_->Call(&v1::AdminService::Stub::PutTag, request, kCallTimeout));
  return response.revision();
}

Status AdminClient::DeleteTag(const std::string& name, const std::string& tag) {
  v1::DeleteTagRequest request;
  request.set_name(name);
  request.set_tag(tag);
  return impl_->Call(&v1::AdminService::Stub::DeleteTag, request, kCallTimeout).status();
}

StatusOr<CompactionSummary> AdminClient::CompactMap(const CompactionOrder& order,
                                                    const std::function<void(const CompactionStep&)>& on_progress,
                                                    const std::stop_token& stop) {
  v1::CompactMapRequest request;
  request.set_name(order.map_name);
  if (order.keep_revisions) request.set_keep_revisions(*order.keep_revisions);
  if (order.keep_days) request.set_keep_days(*order.keep_days);
  request.set_rewrite(order.rewrite);
  request.set_dry_run(order.dry_run);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kWholeFileTimeout);
  const std::stop_callback cancel(stop, [&context] { context.TryCancel(); });
  const auto reader = impl_->stub->CompactMap(&context, request);
  std::optional<CompactionSummary> summary;
  v1::CompactMapResponse response;
  while (reader->Read(&response)) {
    if (response.has_progress()) {
      const v1::CompactMapResponse::Progress& step = response.progress();
      on_progress({step.rows_done(), step.rows_total(), step.bytes_left()});
    } else if (response.has_result()) {
      const v1::CompactMapResponse::Result& result = response.result();
      summary = CompactionSummary{result.oldest_revision_before(), result.oldest_revision(), result.kept_for_tag(),
                                  result.num_rows(), result.num_bytes_given_back()};
    }
  }
  MAPP_RETURN_IF_ERROR(impl_->ToStatus(reader->Finish()));
  if (!summary) return BadAnswer(absl::DataLossError("no result"));
  return *summary;
}

StatusOr<MapOptimizationSummary> AdminClient::OptimizeMap(
    const std::string& name, const std::function<void(const MapOptimizationStep&)>& on_progress,
    const std::stop_token& stop) {
  v1::OptimizeMapRequest request;
  request.set_name(name);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kBulkCallTimeout);
  const std::stop_callback cancel(stop, [&context] { context.TryCancel(); });
  const auto reader = impl_->stub->OptimizeMap(&context, request);
  std::optional<MapOptimizationSummary> summary;
  v1::OptimizeMapResponse response;
  while (reader->Read(&response)) {
    if (response.has_progress()) {
      const v1::OptimizeMapResponse::Progress& step = response.progress();
      on_progress({step.round(), step.num_frames(), step.num_points(), step.pass(), step.num_iterations()});
    } else if (response.has_result()) {
      const v1::OptimizeMapResponse::Result& result = response.result();
      summary = MapOptimizationSummary{result.applied(),    result.initial_rmse_px(), result.final_rmse_px(),
                                       result.num_frames(), result.num_points(),      result.seconds(),
                                       result.num_rounds(), result.num_fused()};
    }
  }
  MAPP_RETURN_IF_ERROR(impl_->ToStatus(reader->Finish()));
  if (!summary) return BadAnswer(absl::DataLossError("no result"));
  return *summary;
}

StatusOr<Backup> AdminClient::BackUp(const BackupOptions& options, const std::stop_token& stop) {
  v1::BackUpRequest request;
  request.set_to(options.to);
  request.set_num_kept(static_cast<uint32_t>(options.num_kept));
  request.set_dry_run(options.dry_run);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kWholeFileTimeout);
  const std::stop_callback cancel(stop, [&context] { context.TryCancel(); });
  const auto reader = impl_->stub->BackUp(&context, request);
  std::optional<Backup> backup;
  v1::BackUpResponse response;
  while (reader->Read(&response)) {
    if (response.has_progress()) {
      const v1::BackUpResponse::Progress& progress = response.progress();
      if (!options.on_progress) continue;
      options.on_progress({.checking = progress.checking(),
                           .bytes_done = static_cast<int64_t>(progress.bytes_done()),
                           .bytes_total = static_cast<int64_t>(progress.bytes_total())});
    } else if (response.has_result()) {
      const v1::BackUpResponse::Result& result = response.result();
      backup = Backup{result.file(),
                      static_cast<int64_t>(result.num_bytes()),
                      static_cast<int>(result.schema_version()),
                      {result.deleted().begin(), result.deleted().end()}};
    }
  }
  MAPP_RETURN_IF_ERROR(impl_->ToStatus(reader->Finish()));
  if (!backup) return BadAnswer(absl::DataLossError("no result"));
  return *std::move(backup);
}

StatusOr<VerifyReport> AdminClient::Verify(const std::function<void(const VerifyProgress&)>& on_progress,
                                           const std::stop_token& stop) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kWholeFileTimeout);
  const std::stop_callback cancel(stop, [&context] { context.TryCancel(); });
  const auto reader = impl_->stub->VerifyDatabase(&context, v1::VerifyDatabaseRequest());
  VerifyReport report;
  bool has_result = false;
  v1::VerifyDatabaseResponse response;
  while (reader->Read(&response)) {
    if (response.has_progress()) {
      on_progress({response.progress().check(), static_cast<int>(response.progress().num_done()),
                   static_cast<int>(response.progress().num_checks())});
    } else if (response.has_violation()) {
      const v1::VerifyDatabaseResponse::Violation& found = response.violation();
      report.violations.push_back(
          {found.check(), found.what(), found.has_id() ? std::optional(found.id()) : std::nullopt, found.message()});
    } else if (response.has_result()) {
      const v1::VerifyDatabaseResponse::Result& result = response.result();
      for (const auto& more : result.unlisted()) {
        report.unlisted.push_back({more.check(), static_cast<int64_t>(more.count())});
      }
      report.num_checks = static_cast<int>(result.num_checks());
      report.num_maps = static_cast<int64_t>(result.num_maps());
      report.num_keyframes = static_cast<int64_t>(result.num_keyframes());
      report.num_points = static_cast<int64_t>(result.num_points());
      has_result = true;
    }
  }
  MAPP_RETURN_IF_ERROR(impl_->ToStatus(reader->Finish()));
  if (!has_result) return BadAnswer(absl::DataLossError("no result"));
  return report;
}

}  // namespace mapp
