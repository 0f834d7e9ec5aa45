// ListMaps, GetMap and DeleteMap.

#include "api/convert/convert.h"
#include "server/rpc/admin_service_handler.h"
#include "server/rpc/record_protos.h"

namespace mapp {

grpc::Status AdminServiceHandler::ListMaps(grpc::ServerContext* context, const v1::ListMapsRequest* request,
                                           v1::ListMapsResponse* response) {
  return runner_.Unary("ListMaps", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const std::vector<MapRecord> maps, service_.ListMaps(call.context));
    for (const MapRecord& map : maps) *response->add_maps() = ToProto(map);
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::GetMap(grpc::ServerContext* context, const v1::GetMapRequest* request,
                                         v1::GetMapResponse* response) {
  return runner_.Unary("GetMap", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const MapState map, service_.GetMap(call.context, request->name(), request->at()));
    v1::MapInfo& info = *response->mutable_map();
    info = ToProto(map.record);
    info.set_num_tiles(map.tiles.size());
    const TileGrid grid{.edge_m = map.record.tile_edge_m};
    Aabb bounds;
    for (const TileRecord& tile : map.tiles) bounds.extend(grid.BoxOf(tile.key));
    if (!map.tiles.empty()) *info.mutable_bounds() = ToProto(bounds);
    return absl::OkStatus();
  });
}

grpc::Status AdminServiceHandler::DeleteMap(grpc::ServerContext* context, const v1::DeleteMapRequest* request,
                                            v1::DeleteMapResponse* response) {
  return runner_.Unary("DeleteMap", *context, *request, *response, [&](const Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const MapRecord deleted, service_.DeleteMap(call.context, request->name(), request->force()));
    response->set_num_frames(static_cast<uint64_t>(deleted.num_frames));
    response->set_num_points(static_cast<uint64_t>(deleted.num_points));
    return absl::OkStatus();
  });
}

}  // namespace mapp
