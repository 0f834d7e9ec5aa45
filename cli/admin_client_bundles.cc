// AdminClient's calls about bundles.

#include "cli/admin_client_impl.h"

#include <optional>
#include <string>

namespace mapp {
namespace {

/// Bytes sent in one message: far below what a server takes.
constexpr size_t kBundleChunkBytes = size_t{256} << 10;

using Phase = BundleImportStep::Phase;

}  // namespace

Status AdminClient::ExportBundle(const std::string& name, const std::string& at, const ByteSink& sink,
                                 const std::function<void(const BundleExportStep&)>& on_progress,
                                 const std::stop_token& stop) {
  v1::ExportBundleRequest request;
  request.set_name(name);
  request.set_at(at);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kWholeFileTimeout);
  const std::stop_callback cancel(stop, [&context] { context.TryCancel(); });
  const auto reader = impl_->stub->ExportBundle(&context, request);
  BundleExportStep step;
  v1::ExportBundleResponse response;
  Status taken;
  while (taken.ok() && reader->Read(&response)) {
    taken = sink(response.data());
    step.num_bytes += response.data().size();
    step.frames_done = response.frames_done();
    step.frames_total = response.frames_total();
    on_progress(step);
  }
  if (!taken.ok()) context.TryCancel();
  const Status ended = impl_->ToStatus(reader->Finish());
  return taken.ok() ? ended : taken;
}

StatusOr<ImportSummary> AdminClient::ImportBundle(const std::string& name, const ByteSource& bundle, uint64_t num_bytes,
                                                  const std::function<void(const BundleImportStep&)>& on_progress,
                                                  const std::stop_token& stop) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kWholeFileTimeout);
  const std::stop_callback cancel(stop, [&context] { context.TryCancel(); });
  const auto stream = impl_->stub->ImportBundle(&context);
  v1::ImportBundleRequest request;
  request.set_name(name);
  std::string chunk(kBundleChunkBytes, '\0');
  for (uint64_t num_sent = 0;;) {
    const StatusOr<size_t> num_read = bundle(chunk.data(), chunk.size());
    if (!num_read.ok()) {
      context.TryCancel();
      stream->Finish();
      return num_read.status();
    }
    if (*num_read == 0 && num_sent > 0) break;
    request.set_data(chunk.data(), *num_read);
    // A server that takes no more says why in the end.
    if (!stream->Write(request) || *num_read == 0) break;
    num_sent += *num_read;
    on_progress({Phase::kSending, num_sent, num_bytes});
    request.clear_name();
  }
  stream->WritesDone();
  std::optional<ImportSummary> summary;
  v1::ImportBundleResponse response;
  while (stream->Read(&response)) {
    if (response.has_progress()) {
      const v1::ImportBundleResponse::Progress& progress = response.progress();
      on_progress(
          {progress.writing() ? Phase::kWriting : Phase::kChecking, progress.bytes_done(), progress.bytes_total()});
    } else if (response.has_result()) {
      MAPP_ASSIGN_OR_RETURN(MapSummary map, Impl::ToMapSummary(response.result().map()));
      summary = ImportSummary{std::move(map), response.result().num_frames(), response.result().num_points()};
    }
  }
  MAPP_RETURN_IF_ERROR(impl_->ToStatus(stream->Finish()));
  if (!summary) return BadAnswer(absl::DataLossError("no result"));
  return *std::move(summary);
}

}  // namespace mapp
