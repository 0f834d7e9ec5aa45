#include "mapp/base/mutex.h"
#include "server/rpc/admin_service_handler.h"
#include "server/rpc/record_protos.h"

#include <chrono>
#include <thread>

namespace mapp {
namespace {

using ImportStream = grpc::ServerReaderWriter<v1::ImportBundleResponse, v1::ImportBundleRequest>;

constexpr std::chrono::milliseconds kProgressInterval(200);

/// Sends the latest progress now and then, from a thread of its own: a caller that does not read must not hold up the
/// thread that writes the database.
class ProgressSender {
 public:
  explicit ProgressSender(ImportStream& stream) : stream_(stream), thread_([this] { Run(); }) {}
  ~ProgressSender() { Stop(); }
  ProgressSender(const ProgressSender&) = delete;
  ProgressSender& operator=(const ProgressSender&) = delete;

  void Note(const BundleImportProgress& progress) {
    const MutexLock lock(mutex_);
    latest_ = progress;
  }
  /// Nothing is sent any more when it returns.
  void Stop() {
    {
      const MutexLock lock(mutex_);
      stopped_ = true;
    }
    changed_.NotifyAll();
    if (thread_.joinable()) thread_.join();
  }
  uint64_t sent_bytes() const { return sent_bytes_; }

 private:
  /// nullopt when stopped.
  std::optional<BundleImportProgress> Next() {
    const MutexLock lock(mutex_);
    const auto until = std::chrono::steady_clock::now() + kProgressInterval;
    while (!stopped_ && changed_.WaitUntil(mutex_, until)) {
    }
    if (stopped_) return std::nullopt;
    return latest_;
  }

  void Run() {
    for (;;) {
      const std::optional<BundleImportProgress> progress = Next();
      if (!progress) return;
      v1::ImportBundleResponse message;
      message.mutable_progress()->set_writing(progress->writing);
      message.mutable_progress()->set_bytes_done(progress->bytes_done);
      message.mutable_progress()->set_bytes_total(progress->bytes_total);
      if (!stream_.Write(message)) return;
      sent_bytes_ += message.ByteSizeLong();
    }
  }

  ImportStream& stream_;
  Mutex mutex_;
  CondVar changed_;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  BundleImportProgress latest_ ABSL_GUARDED_BY(mutex_);
  uint64_t sent_bytes_ = 0;
  std::thread thread_;  ///< last: it uses all of the above
};

}  // namespace

grpc::Status AdminServiceHandler::ImportBundle(grpc::ServerContext* context, ImportStream* stream) {
  return runner_.StreamBoth("ImportBundle", *context, [&](Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(BundleFile bundle, BundleFile::CreateUnnamed(spool_folder_));
    std::optional<std::string> name;
    v1::ImportBundleRequest request;
    while (stream->Read(&request)) {
      call.received_bytes += request.ByteSizeLong();
      if (!name) {
        name = request.name();
        MAPP_RETURN_IF_ERROR(service_.CheckNameIsFree(*name));
      }
      MAPP_RETURN_IF_ERROR(bundle.Append(request.data()));
    }
    MAPP_RETURN_IF_ERROR(call.context.Check());
    ProgressSender sender(*stream);
    const StatusOr<ImportedMap> imported =
        service_.ImportBundle(call.context, bundle, name.value_or(""),
                              [&sender](const BundleImportProgress& progress) { sender.Note(progress); });
    sender.Stop();
    call.streamed_bytes += sender.sent_bytes();
    MAPP_RETURN_IF_ERROR(imported.status());
    v1::ImportBundleResponse message;
    *message.mutable_result()->mutable_map() = ToProto(imported->map);
    message.mutable_result()->set_num_frames(imported->counts.frames);
    message.mutable_result()->set_num_points(imported->counts.points);
    call.streamed_bytes += message.ByteSizeLong();
    stream->Write(message);  // who is gone by now finds the map there
    return absl::OkStatus();
  });
}

}  // namespace mapp
