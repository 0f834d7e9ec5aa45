#include "server/rpc/admin_service_handler.h"
#include "server/rpc/record_protos.h"

namespace mapp {
namespace {

/// Frames or points a message: about 100 KB, far below what a client must accept.
constexpr int kRecordsPerMessage = 1000;

/// Packs records into messages and sends each when it is full.
class ExportWriter {
 public:
  ExportWriter(grpc::ServerWriter<v1::ExportMapResponse>& writer, Call& call) : writer_(writer), call_(call) {}

  Status AddFrames(const MapRecord& map, const std::vector<FrameRecord>& frames) {
    *message_.mutable_map() = ToProto(map);
    for (const FrameRecord& frame : frames) {
      *message_.add_frames() = ToProto(frame);
      if (message_.frames_size() >= kRecordsPerMessage) MAPP_RETURN_IF_ERROR(Flush());
    }
    return Flush();
  }
  Status AddPoints(const std::vector<PointRecord>& points) {
    for (const PointRecord& point : points) {
      *message_.add_points() = ToProto(point);
      if (message_.points_size() >= kRecordsPerMessage) MAPP_RETURN_IF_ERROR(Flush());
    }
    return absl::OkStatus();
  }
  Status Flush() {
    const size_t bytes = message_.ByteSizeLong();
    if (bytes == 0) return absl::OkStatus();
    if (!writer_.Write(message_)) return absl::CancelledError("the caller is gone");
    call_.streamed_bytes += bytes;
    message_.Clear();
    return absl::OkStatus();
  }

 private:
  grpc::ServerWriter<v1::ExportMapResponse>& writer_;
  Call& call_;
  v1::ExportMapResponse message_;
};

}  // namespace

grpc::Status AdminServiceHandler::ExportMap(grpc::ServerContext* context, const v1::ExportMapRequest* request,
                                            grpc::ServerWriter<v1::ExportMapResponse>* writer) {
  return runner_.Stream("ExportMap", *context, *request, [&](Call& call) -> Status {
    ExportWriter out(*writer, call);
    MAPP_RETURN_IF_ERROR(service_.ExportMap(
        call.context, request->name(), request->at(),
        [&](const MapRecord& map, const std::vector<FrameRecord>& frames) { return out.AddFrames(map, frames); },
        [&](const std::vector<PointRecord>& points) { return out.AddPoints(points); }));
    return out.Flush();
  });
}

}  // namespace mapp
