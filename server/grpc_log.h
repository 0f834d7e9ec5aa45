#pragma once

namespace mapp {

/// Sends what the gRPC library logs to our log, as debug lines: what matters of it comes back to us as a status.
void RouteGrpcLog();

}  // namespace mapp
