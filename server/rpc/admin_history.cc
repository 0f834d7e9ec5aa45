// ListRevisions, DiffRevisions and the tags.

#include "server/rpc/admin_service_handler.h"

namespace mapp {
namespace {

constexpr uint32_t kDefaultRuns = 50;

v1::Tag ToProto(const TagRecord& record) {
  v1::Tag tag;
  tag.set_name(record.name);
  tag.set_revision(record.revision.value());
  tag.set_created_unix_ns(record.created_ns);
  return tag;
}

v1::ListRevisionsResponse::Run ToProto(const RevisionRun& run) {
  v1::ListRevisionsResponse::Run out;
  out.set_first_revision(run.first.value());
  out.set_last_revision(run.last.value());
  out.set_num_revisions(run.num_revisions);
  out.set_first_unix_ns(run.first_ns);
  out.set_last_unix_ns(run.last_ns);
  out.set_cause(static_cast<v1::RevisionCause>(run.cause));  // the same numbers
  if (run.session) out.set_session_id(static_cast<uint32_t>(run.session->value()));
  out.set_device(run.device);
  return out;
}

v1::DiffRevisionsResponse::Session ToProto(const MapDiff::Session& session) {
  const SessionDiff& counts = session.counts;
  v1::DiffRevisionsResponse::Session out;
  out.set_session_id(static_cast<uint32_t>(counts.session.value()));
  out.set_device(session.device);
  out.set_frames_added(static_cast<uint64_t>(counts.frames_added));
  out.set_frames_moved(static_cast<uint64_t>(counts.frames_moved));
  out.set_frames_removed(static_cast<uint64_t>(counts.frames_removed));
  out.set_points_added(static_cast<uint64_t>(counts.points_added));
  out.set_points_moved(static_cast<uint64_t>(counts.points_moved));
  out.set_points_removed(static_cast<uint64_t>(counts.points_removed));
  return out;
}

}  // namespace

grpc::Status AdminServiceHandler::ListRevisions(grpc::ServerContext* context, const v1::ListRevisionsRequest* request,
                                                v1::ListRevisionsResponse* response) {
  return runner_.Unary("ListRevisions", *context, *request, *response, [&](const Call& call) -> Status {
    const uint32_t max_runs = request->max_runs() == 0 ? kDefaultRuns : request->max_runs();
    MAPP_ASSIGN_OR_RETURN(const RevisionLog log, service_.ListRevisions(call.context, request->name(), max_runs));
    for (const RevisionRun& run : log.runs) *response->add_runs() = ToProto(run);
    for (const TagRecord& tag : log.tags) *response->add_tags() = ToProto(tag);
    response->set_truncated(log.truncated);
    response->set_oldest_revision(log.oldest.value());
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::DiffRevisions(grpc::ServerContext* context, const v1::DiffRevisionsRequest* request,
                                                v1::DiffRevisionsResponse* response) {
  return runner_.Unary("DiffRevisions", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const MapDiff diff,
                          service_.DiffRevisions(call.context, request->name(), request->from(), request->to()));
    response->set_from_revision(diff.from.value());
    response->set_to_revision(diff.to.value());
    for (const MapDiff::Session& session : diff.sessions) *response->add_sessions() = ToProto(session);
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::ListTags(grpc::ServerContext* context, const v1::ListTagsRequest* request,
                                           v1::ListTagsResponse* response) {
  return runner_.Unary("ListTags", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const std::vector<TagRecord> tags, service_.ListTags(call.context, request->name()));
    for (const TagRecord& tag : tags) *response->add_tags() = ToProto(tag);
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::PutTag(grpc::ServerContext* context, const v1::PutTagRequest* request,
                                         v1::PutTagResponse* response) {
  return runner_.Unary("PutTag", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const Revision revision,
                          service_.PutTag(call.context, request->name(), request->tag(), request->at()));
    response->set_revision(revision.value());
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::DeleteTag(grpc::ServerContext* context, const v1::DeleteTagRequest* request,
                                            v1::DeleteTagResponse* response) {
  return runner_.Unary("DeleteTag", *context, *request, *response, [&](const Call& call) -> Status {
    return service_.DeleteTag(call.context, request->name(), request->tag());
  });
}

}  // namespace mapp
