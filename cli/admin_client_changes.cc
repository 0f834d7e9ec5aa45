// The calls about changes of the world.
#include "api/convert/convert.h"
#include "cli/admin_client_impl.h"

#include <algorithm>
#include <utility>

namespace mapp {
namespace {

StatusOr<ChangeKind> ToKind(v1::ChangeKind kind) {
  switch (kind) {
    case v1::CHANGE_KIND_APPEARED:
      return ChangeKind::kAppeared;
    case v1::CHANGE_KIND_VANISHED:
      return ChangeKind::kVanished;
    case v1::CHANGE_KIND_MOVED:
      return ChangeKind::kMoved;
    default:
      return absl::InvalidArgumentError(fmt::format("kind: {} is none that this program knows", int{kind}));
  }
}

StatusOr<ChangeStatus> ToStatus(v1::ChangeStatus status) {
  switch (status) {
    case v1::CHANGE_STATUS_PROPOSED:
      return ChangeStatus::kProposed;
    case v1::CHANGE_STATUS_ACCEPTED:
      return ChangeStatus::kAccepted;
    case v1::CHANGE_STATUS_REJECTED:
      return ChangeStatus::kRejected;
    default:
      return absl::InvalidArgumentError(fmt::format("status: {} is none that this program knows", int{status}));
  }
}

StatusOr<OrientedBox> ToBox(const v1::OrientedBox& proto, const std::string& field) {
  OrientedBox box_map;
  MAPP_ASSIGN_OR_RETURN(box_map.T_frame_box, FromProto(proto.pose(), field + ".pose"));
  box_map.size_m = {proto.size_x_m(), proto.size_y_m(), proto.size_z_m()};
  if (!box_map.size_m.allFinite() || box_map.size_m.minCoeff() < 0) {
    return absl::InvalidArgumentError(fmt::format("{}: its size is no size", field));
  }
  return box_map;
}

StatusOr<ChangeSummary> ToSummary(const v1::Change& proto) {
  ChangeSummary change;
  change.id = proto.id();
  MAPP_ASSIGN_OR_RETURN(change.kind, ToKind(proto.kind()));
  MAPP_ASSIGN_OR_RETURN(change.status, ToStatus(proto.status()));
  change.confidence = proto.confidence();
  change.after_unix_ns = proto.after_unix_ns();
  change.before_unix_ns = proto.before_unix_ns();
  change.first_seen_unix_ns = proto.first_seen_unix_ns();
  change.last_seen_unix_ns = proto.last_seen_unix_ns();
  change.session_ids.assign(proto.session_ids().begin(), proto.session_ids().end());
  if (proto.has_box_before()) {
    MAPP_ASSIGN_OR_RETURN(change.box_map_before, ToBox(proto.box_before(), "box_before"));
  }
  if (proto.has_box_after()) {
    MAPP_ASSIGN_OR_RETURN(change.box_map_after, ToBox(proto.box_after(), "box_after"));
  }
  if (change.box_map_before.has_value() != (change.kind != ChangeKind::kAppeared)) {
    return absl::InvalidArgumentError("box_before: does not go with the kind");
  }
  if (change.box_map_after.has_value() != (change.kind != ChangeKind::kVanished)) {
    return absl::InvalidArgumentError("box_after: does not go with the kind");
  }
  change.points_before.assign(proto.points_before().begin(), proto.points_before().end());
  change.points_after.assign(proto.points_after().begin(), proto.points_after().end());
  change.detected_revision = proto.detected_revision();
  change.applied_revision = proto.applied_revision();
  return change;
}

StatusOr<std::vector<ChangeSummary>> ToSummaries(const google::protobuf::RepeatedPtrField<v1::Change>& protos) {
  std::vector<ChangeSummary> changes;
  for (const v1::Change& proto : protos) {
    StatusOr<ChangeSummary> change = ToSummary(proto);
    if (!change.ok()) return BadAnswer(Annotate(change.status(), fmt::format("change {}", proto.id())));
    changes.push_back(*std::move(change));
  }
  return changes;
}

template <typename Request>
Request DecisionRequest(const std::string& name, const std::vector<uint64_t>& ids) {
  Request request;
  request.set_name(name);
  request.mutable_ids()->Add(ids.begin(), ids.end());
  return request;
}

StatusOr<ChangeDecisionSummary> ToDecision(const StatusOr<v1::DecideChangesResponse>& response) {
  MAPP_RETURN_IF_ERROR(response.status());
  ChangeDecisionSummary decision{{}, response->map_revision(), response->num_points()};
  MAPP_ASSIGN_OR_RETURN(decision.changes, ToSummaries(response->changes()));
  return decision;
}

}  // namespace

StatusOr<ChangeDetectionSummary> AdminClient::DetectChanges(
    const ChangeDetectionOrder& order, const std::function<void(const ChangeDetectionStep&)>& on_progress,
    const std::stop_token& stop) {
  v1::DetectChangesRequest request;
  request.set_name(order.map_name);
  request.set_from_unix_ns(order.from_unix_ns);
  request.set_to_unix_ns(order.to_unix_ns);
  request.set_auto_accept(order.auto_accept);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kWholeFileTimeout);
  const std::stop_callback cancel(stop, [&context] { context.TryCancel(); });
  const auto reader = impl_->stub->DetectChanges(&context, request);
  std::optional<v1::DetectChangesResponse::Result> result;
  v1::DetectChangesResponse response;
  while (reader->Read(&response)) {
    if (response.has_progress()) {
      on_progress({response.progress().num_sessions_done(), response.progress().num_sessions()});
    } else if (response.has_result()) {
      result = response.result();
    }
  }
  MAPP_RETURN_IF_ERROR(impl_->ToStatus(reader->Finish()));
  if (!result) return BadAnswer(absl::DataLossError("no result"));
  ChangeDetectionSummary summary{{},
                                 result->num_new(),
                                 result->num_dropped(),
                                 result->num_accepted(),
                                 result->num_sessions_read(),
                                 result->num_sessions(),
                                 result->seconds()};
  MAPP_ASSIGN_OR_RETURN(summary.changes, ToSummaries(result->changes()));
  return summary;
}

StatusOr<std::vector<ChangeSummary>> AdminClient::ListChanges(const std::string& name) {
  v1::ListChangesRequest request;
  request.set_name(name);
  MAPP_ASSIGN_OR_RETURN(const v1::ListChangesResponse response,
                        impl_->Call(&v1::AdminService::Stub::ListChanges, request, kBulkCallTimeout));
  return ToSummaries(response.changes());
}

StatusOr<ChangeDecisionSummary> AdminClient::AcceptChanges(const std::string& name, const std::vector<uint64_t>& ids) {
  return ToDecision(impl_->Call(&v1::AdminService::Stub::AcceptChanges,
                                DecisionRequest<v1::AcceptChangesRequest>(name, ids), kBulkCallTimeout));
}

StatusOr<ChangeDecisionSummary> AdminClient::RejectChanges(const std::string& name, const std::vector<uint64_t>& ids) {
  return ToDecision(impl_->Call(&v1::AdminService::Stub::RejectChanges,
                                DecisionRequest<v1::RejectChangesRequest>(name, ids), kBulkCallTimeout));
}

StatusOr<ChangeDecisionSummary> AdminClient::UndoChanges(const std::string& name, const std::vector<uint64_t>& ids) {
  return ToDecision(impl_->Call(&v1::AdminService::Stub::UndoChanges,
                                DecisionRequest<v1::UndoChangesRequest>(name, ids), kBulkCallTimeout));
}

}  // namespace mapp
