#include "server/rpc/admin_service_handler.h"

#include <algorithm>

namespace mapp {
namespace {

/// More backups than anybody keeps, and a number that fits.
constexpr uint32_t kMaxNumKept = 1'000'000;

/// A message for every percent, not for every step of a large database.
class ProgressFilter {
 public:
  bool IsNews(const BackupProgress& progress) {
    const int64_t percent = progress.bytes_total > 0 ? 100 * progress.bytes_done / progress.bytes_total : 0;
    if (percent == percent_ && progress.checking == checking_) return false;
    percent_ = percent;
    checking_ = progress.checking;
    return true;
  }

 private:
  int64_t percent_ = -1;
  bool checking_ = false;
};

}  // namespace

grpc::Status AdminServiceHandler::BackUp(grpc::ServerContext* context, const v1::BackUpRequest* request,
                                         grpc::ServerWriter<v1::BackUpResponse>* writer) {
  return runner_.Stream("BackUp", *context, *request, [&](Call& call) -> Status {
    if (!back_up_) {
      return absl::FailedPreconditionError(
          "the server writes no backups: start it with --backup-dir DIR, the folder they may go to");
    }
    const auto send = [&](const v1::BackUpResponse& message) {
      if (!writer->Write(message)) return false;
      call.streamed_bytes += message.ByteSizeLong();
      return true;
    };
    ProgressFilter filter;
    const auto tell = [&](const BackupProgress& progress) {
      if (!filter.IsNews(progress)) return;
      v1::BackUpResponse message;
      v1::BackUpResponse::Progress& out = *message.mutable_progress();
      out.set_checking(progress.checking);
      out.set_bytes_done(static_cast<uint64_t>(progress.bytes_done));
      out.set_bytes_total(static_cast<uint64_t>(progress.bytes_total));
      send(message);  // a caller that is gone cancels call.context
    };
    BackupOptions options;
    options.to = request->to();
    options.num_kept = static_cast<int>(std::min(request->num_kept(), kMaxNumKept));
    options.dry_run = request->dry_run();
    options.on_progress = tell;
    MAPP_ASSIGN_OR_RETURN(const Backup backup, back_up_(call.context, options));
    v1::BackUpResponse message;
    v1::BackUpResponse::Result& result = *message.mutable_result();
    result.set_file(backup.file);
    result.set_num_bytes(static_cast<uint64_t>(backup.num_bytes));
    result.set_schema_version(static_cast<uint32_t>(backup.schema_version));
    for (const std::string& file : backup.deleted) result.add_deleted(file);
    return send(message) ? absl::OkStatus() : absl::CancelledError("the caller is gone");
  });
}

}  // namespace mapp
