#include "server/rpc/admin_service_handler.h"

namespace mapp {

grpc::Status AdminServiceHandler::ExportBundle(grpc::ServerContext* context, const v1::ExportBundleRequest* request,
                                               grpc::ServerWriter<v1::ExportBundleResponse>* writer) {
  return runner_.Stream("ExportBundle", *context, *request, [&](Call& call) -> Status {
    v1::ExportBundleResponse message;
    const auto note = [&message](uint64_t frames_done, uint64_t frames_total) {
      message.set_frames_done(frames_done);
      message.set_frames_total(frames_total);
    };
    const auto send = [&](std::string_view bytes) -> Status {
      message.set_data(bytes.data(), bytes.size());
      call.streamed_bytes += message.ByteSizeLong();
      return writer->Write(message) ? absl::OkStatus() : absl::CancelledError("the caller is gone");
    };
    return service_.ExportBundle(call.context, request->name(), request->at(), send, note);
  });
}

}  // namespace mapp
