#include "mapp/base/claim.h"
#include "server/rpc/admin_service_handler.h"

namespace mapp {
namespace {

v1::VerifyDatabaseResponse ProgressMessage(const VerifyProgress& progress) {
  v1::VerifyDatabaseResponse message;
  message.mutable_progress()->set_check(progress.check);
  message.mutable_progress()->set_num_done(static_cast<uint32_t>(progress.num_done));
  message.mutable_progress()->set_num_checks(static_cast<uint32_t>(progress.num_checks));
  return message;
}

v1::VerifyDatabaseResponse ViolationMessage(const Violation& violation) {
  v1::VerifyDatabaseResponse message;
  message.mutable_violation()->set_check(violation.check);
  message.mutable_violation()->set_what(violation.what);
  if (violation.id) message.mutable_violation()->set_id(*violation.id);
  message.mutable_violation()->set_message(violation.message);
  return message;
}

v1::VerifyDatabaseResponse ResultMessage(const VerifyReport& report) {
  v1::VerifyDatabaseResponse message;
  v1::VerifyDatabaseResponse::Result& result = *message.mutable_result();
  for (const UnlistedViolations& more : report.unlisted) {
    v1::VerifyDatabaseResponse::Unlisted& unlisted = *result.add_unlisted();
    unlisted.set_check(more.check);
    unlisted.set_count(static_cast<uint64_t>(more.count));
  }
  result.set_num_checks(static_cast<uint32_t>(report.num_checks));
  result.set_num_maps(static_cast<uint64_t>(report.num_maps));
  result.set_num_keyframes(static_cast<uint64_t>(report.num_keyframes));
  result.set_num_points(static_cast<uint64_t>(report.num_points));
  return message;
}

}  // namespace

grpc::Status AdminServiceHandler::VerifyDatabase(grpc::ServerContext* context, const v1::VerifyDatabaseRequest* request,
                                                 grpc::ServerWriter<v1::VerifyDatabaseResponse>* writer) {
  return runner_.Stream("VerifyDatabase", *context, *request, [&](Call& call) -> Status {
    if (!verify_) return absl::FailedPreconditionError("this server does not verify its database");
    // It reads the whole file and keeps the write-ahead log from being cut back: once is enough.
    const Claim claim(verifying_);
    if (!claim.is_mine()) {
      return absl::FailedPreconditionError("the server is verifying its database for another caller: ask again later");
    }
    const auto send = [&](const v1::VerifyDatabaseResponse& message) {
      if (!writer->Write(message)) return false;
      call.streamed_bytes += message.ByteSizeLong();
      return true;
    };
    // A caller that is gone cancels call.context.
    const auto tell = [&](const VerifyProgress& progress) { send(ProgressMessage(progress)); };
    MAPP_ASSIGN_OR_RETURN(const VerifyReport report, verify_(call.context, tell));
    for (const Violation& violation : report.violations) {
      if (!send(ViolationMessage(violation))) return absl::CancelledError("the caller is gone");
    }
    return send(ResultMessage(report)) ? absl::OkStatus() : absl::CancelledError("the caller is gone");
  });
}

}  // namespace mapp
