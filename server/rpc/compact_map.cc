#include "server/rpc/admin_service_handler.h"

namespace mapp {

grpc::Status AdminServiceHandler::CompactMap(grpc::ServerContext* context, const v1::CompactMapRequest* request,
                                             grpc::ServerWriter<v1::CompactMapResponse>* writer) {
  return runner_.Stream("CompactMap", *context, *request, [&](Call& call) -> Status {
    const auto send = [&](const v1::CompactMapResponse& message) {
      if (!writer->Write(message)) return false;
      call.streamed_bytes += message.ByteSizeLong();
      return true;
    };
    const auto tell = [&](const CompactionProgress& progress) {
      v1::CompactMapResponse message;
      v1::CompactMapResponse::Progress& out = *message.mutable_progress();
      out.set_rows_done(static_cast<uint64_t>(progress.rows_done));
      out.set_rows_total(static_cast<uint64_t>(progress.rows_total));
      out.set_bytes_left(static_cast<uint64_t>(progress.bytes_left));
      send(message);  // a caller that is gone cancels call.context
    };
    CompactionRequest wanted{.map_name = request->name(),
                             .keep_revisions = {},
                             .keep_days = {},
                             .dry_run = request->dry_run(),
                             .rewrite = request->rewrite()};
    if (request->has_keep_revisions()) wanted.keep_revisions = request->keep_revisions();
    if (request->has_keep_days()) wanted.keep_days = request->keep_days();
    MAPP_ASSIGN_OR_RETURN(const Compaction compaction, service_.CompactMap(call.context, wanted, tell));
    v1::CompactMapResponse message;
    v1::CompactMapResponse::Result& result = *message.mutable_result();
    result.set_oldest_revision_before(compaction.oldest_before.value());
    result.set_oldest_revision(compaction.oldest.value());
    if (compaction.kept_for) result.set_kept_for_tag(compaction.kept_for->name);
    result.set_num_rows(static_cast<uint64_t>(compaction.num_rows));
    result.set_num_bytes_given_back(static_cast<uint64_t>(compaction.num_bytes_given_back));
    return send(message) ? absl::OkStatus() : absl::CancelledError("the caller is gone");
  });
}

}  // namespace mapp
