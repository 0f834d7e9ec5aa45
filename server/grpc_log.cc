#include "server/grpc_log.h"

#include "log/log.h"

#include <grpc/support/log.h>

namespace mapp {

void RouteGrpcLog() {
  gpr_set_log_function([](gpr_log_func_args* line) {
    log::Debug("grpc", {{"file", line->file}, {"line", line->line}, {"message", line->message}});
  });
}

}  // namespace mapp
