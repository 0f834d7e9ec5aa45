#include "server/rpc/admin_service_handler.h"
#include "server/rpc/record_protos.h"

#include <unordered_map>

namespace mapp {

grpc::Status AdminServiceHandler::ListSessions(grpc::ServerContext* context, const v1::ListSessionsRequest* request,
                                               v1::ListSessionsResponse* response) {
  return runner_.Unary("ListSessions", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const std::vector<SessionRecord> sessions,
                          service_.ListSessions(call.context, request->map_name()));
    MAPP_ASSIGN_OR_RETURN(const std::vector<MapRecord> maps, service_.ListMaps(call.context));
    std::unordered_map<MapId, std::string> names;
    for (const MapRecord& map : maps) names[map.id] = map.name;
    // A map deleted between the two reads leaves its sessions without a name.
    for (const SessionRecord& session : sessions) *response->add_sessions() = ToProto(session, names[session.map]);
    return absl::OkStatus();
  });
}

}  // namespace mapp
