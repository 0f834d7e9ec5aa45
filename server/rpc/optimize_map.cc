#include "server/rpc/admin_service_handler.h"

namespace mapp {

grpc::Status AdminServiceHandler::OptimizeMap(grpc::ServerContext* context, const v1::OptimizeMapRequest* request,
                                              grpc::ServerWriter<v1::OptimizeMapResponse>* writer) {
  return runner_.Stream("OptimizeMap", *context, *request, [&](Call& call) -> Status {
    const auto send = [&](const v1::OptimizeMapResponse& message) {
      if (!writer->Write(message)) return false;
      call.streamed_bytes += message.ByteSizeLong();
      return true;
    };
    const auto tell = [&](const MapOptimizationProgress& progress) {
      v1::OptimizeMapResponse message;
      v1::OptimizeMapResponse::Progress& out = *message.mutable_progress();
      out.set_num_frames(progress.num_frames);
      out.set_num_points(progress.num_points);
      out.set_pass(progress.pass);
      out.set_num_iterations(progress.num_iterations);
      out.set_cost(progress.cost);
      out.set_round(progress.round);
      send(message);  // a caller that is gone cancels call.context
    };
    MAPP_ASSIGN_OR_RETURN(const MapOptimizationFinished all, service_.OptimizeMap(call.context, request->name(), tell));
    v1::OptimizeMapResponse message;
    v1::OptimizeMapResponse::Result& result = *message.mutable_result();
    const OptimizationFinished& finished = all.adjustment;
    result.set_applied(finished.applied);
    result.set_initial_rmse_px(finished.initial_rmse_px);
    result.set_final_rmse_px(finished.final_rmse_px);
    result.set_num_frames(finished.num_frames);
    result.set_num_points(finished.num_points);
    result.set_seconds(finished.seconds);
    result.set_num_rounds(all.num_rounds);
    result.set_num_fused(all.num_fused);
    return send(message) ? absl::OkStatus() : absl::CancelledError("the caller is gone");
  });
}

}  // namespace mapp
