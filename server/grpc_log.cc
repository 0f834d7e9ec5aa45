#include "server/grpc_log.h"

#include "log/log.h"

#include <grpc/support/log.h>

namespace mapp {

void RouteGrpcLog() {
  gpr_set_log_function([](gpr_log_func_args* line) {
    // Its assertions are told as errors before they end the process.
    const auto write = line->severity == GPR_LOG_SEVERITY_ERROR ? log::Error : log::Debug;
    write("grpc", {{"file", line->file}, {"line", line->line}, {"message", line->message}});
  });
}

}  // namespace mapp
