#include "api/convert/convert.h"
#include "server/rpc/map_service_handler.h"

namespace mapp {
namespace {

StatusOr<OpenSessionInput> Decode(const v1::OpenSessionRequest& request) {
  OpenSessionInput input;
  MAPP_ASSIGN_OR_RETURN(input.sensor, FromProto(request.sensor(), "sensor"));
  if (!request.has_camera()) return absl::InvalidArgumentError("camera: must be set");
  MAPP_ASSIGN_OR_RETURN(input.camera, FromProto(request.camera(), "camera"));
  input.map_name = request.map_name();
  input.device = request.device();
  input.create_map = request.create_map();
  // Older clients tell none, and have the defaults.
  if (request.has_feature_settings()) {
    MAPP_ASSIGN_OR_RETURN(input.features, FromProto(request.feature_settings(), "feature_settings"));
  }
  return input;
}

}  // namespace

grpc::Status MapServiceHandler::OpenSession(grpc::ServerContext* context, const v1::OpenSessionRequest* request,
                                            v1::OpenSessionResponse* response) {
  return runner_.Unary("OpenSession", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const OpenSessionInput input, Decode(*request));
    MAPP_ASSIGN_OR_RETURN(const OpenedSession opened, service_.OpenSession(call.context, input));
    response->set_session_id(static_cast<uint32_t>(opened.session.value()));
    response->set_map_id(opened.map.id.value());
    response->set_cone_range_m(opened.map.cone_range_m);
    response->set_tile_edge_m(opened.map.tile_edge_m);
    response->set_max_features(kMaxFeatures);
    response->set_max_keyframe_bytes(max_keyframe_bytes_);
    response->set_map_revision(opened.map.revision.value());
    response->set_map_created_unix_ns(opened.map.created_ns);
    return absl::OkStatus();
  });
}

}  // namespace mapp
