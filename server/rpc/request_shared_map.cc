#include "api/convert/convert.h"
#include "server/rpc/map_service_handler.h"

#include <fmt/format.h>

namespace mapp {
namespace {

/// alpha of the paper: what 0 in the request stands for.
constexpr double kDefaultOversharing = 1.3;
/// A device that holds more tiles than this should name those nearest to it.
constexpr int kMaxHeldTiles = 65536;

StatusOr<std::vector<HeldTile>> DecodeHeldTiles(const v1::RequestSharedMapRequest& request) {
  if (request.held_tiles_size() > kMaxHeldTiles) {
    return absl::InvalidArgumentError(
        fmt::format("held_tiles: at most {}, got {}", kMaxHeldTiles, request.held_tiles_size()));
  }
  std::vector<HeldTile> held;
  held.reserve(static_cast<size_t>(request.held_tiles_size()));
  for (int i = 0; i < request.held_tiles_size(); ++i) {
    const v1::HeldTile& tile = request.held_tiles(i);
    MAPP_ASSIGN_OR_RETURN(const TileKey key, TileKeyFromProto(tile.key(), fmt::format("held_tiles[{}].key", i)));
    held.push_back({.key = key, .revision = Revision(tile.revision())});
    if (tile.has_crc32c()) held.back().crc32c = tile.crc32c();
  }
  return held;
}

LookAhead Decode(const v1::LookAhead& look_ahead) {
  const v1::Point3& motion = look_ahead.motion();
  return {.distance_m = look_ahead.distance_m(),
          .motion = {motion.x_m(), motion.y_m(), motion.z_m()},
          .earlier_ways = look_ahead.earlier_ways()};
}

StatusOr<SharedMapInput> Decode(const v1::RequestSharedMapRequest& request) {
  SharedMapInput input;
  MAPP_ASSIGN_OR_RETURN(input.session, SessionIdFromProto(request.session_id(), "session_id"));
  MAPP_ASSIGN_OR_RETURN(input.view, DecodeViewQuery(request.view()));
  input.oversharing = request.oversharing() == 0 ? kDefaultOversharing : request.oversharing();
  MAPP_RETURN_IF_ERROR(ValidateRange(request.overlap(), 0, 1, "overlap"));
  MAPP_ASSIGN_OR_RETURN(input.held_tiles, DecodeHeldTiles(request));
  input.max_bytes = request.max_bytes();
  input.min_seen_by_others = request.min_seen_by_others();
  input.look_ahead = Decode(request.look_ahead());
  return input;
}

template <typename Writer>
Status Send(const v1::RequestSharedMapResponse& message, Writer& writer, Call& call) {
  if (!writer.Write(message)) return absl::CancelledError("the caller is gone");
  call.streamed_bytes += message.ByteSizeLong();
  return absl::OkStatus();
}

}  // namespace

grpc::Status MapServiceHandler::RequestSharedMap(grpc::ServerContext* context,
                                                 const v1::RequestSharedMapRequest* request,
                                                 grpc::ServerWriter<v1::RequestSharedMapResponse>* writer) {
  return runner_.Stream("RequestSharedMap", *context, *request, [&](Call& call) -> Status {
    MAPP_ASSIGN_OR_RETURN(const SharedMapInput input, Decode(*request));
    v1::RequestSharedMapResponse message;
    const auto send_tile = [&](const std::string& tile) {
      message.set_tile(tile);
      return Send(message, *writer, call);
    };
    MAPP_ASSIGN_OR_RETURN(const SharedMapResult result, service_.RequestSharedMap(call.context, input, send_tile));
    message.Clear();
    v1::SharedMapSummary& summary = *message.mutable_summary();
    summary.set_map_revision(result.map_revision.value());
    summary.set_num_tiles_sent(result.num_tiles_sent);
    summary.set_num_tiles_unchanged(result.num_tiles_unchanged);
    summary.set_num_tiles_over_budget(result.num_tiles_over_budget);
    summary.set_is_own_map(result.is_own_map);
    summary.mutable_unchanged_held_tiles()->Add(result.unchanged_held.begin(), result.unchanged_held.end());
    summary.mutable_outdated_held_tiles()->Add(result.outdated_held.begin(), result.outdated_held.end());
    summary.set_num_tiles_sent_ahead(result.num_tiles_sent_ahead);
    return Send(message, *writer, call);
  });
}

}  // namespace mapp
