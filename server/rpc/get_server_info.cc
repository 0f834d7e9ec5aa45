#include "mapp/base/process_usage.h"
#include "server/rpc/admin_service_handler.h"

namespace mapp {

grpc::Status AdminServiceHandler::GetServerInfo(grpc::ServerContext* context, const v1::GetServerInfoRequest* request,
                                                v1::GetServerInfoResponse* response) {
  return runner_.Unary("GetServerInfo", *context, *request, *response, [&](const Call&) -> Status {
    response->set_version(facts_.version);
    response->set_schema_version(facts_.schema_version);
    response->set_started_unix_ns(facts_.started_unix_ns);
    for (const MethodFigures& figures : runner_.recorder().Snapshot()) {
      auto& out = *response->add_methods();
      out.set_method(figures.method);
      out.set_num_calls(figures.latency.count);
      out.set_num_errors(figures.num_errors);
      out.set_mean_ms(figures.latency.mean_ms);
      out.set_median_ms(figures.latency.p50_ms);
      out.set_p95_ms(figures.latency.p95_ms);
    }
    for (const StepFigures& figures : service_.StepTimesSoFar()) {
      auto& out = *response->add_steps();
      out.set_step(figures.step);
      out.set_num_runs(figures.latency.count);
      out.set_mean_ms(figures.latency.mean_ms);
      out.set_median_ms(figures.latency.p50_ms);
      out.set_p95_ms(figures.latency.p95_ms);
    }
    const ProcessUsage usage = GetProcessUsage();
    response->set_cpu_s(usage.cpu_s);
    response->set_rss_bytes(usage.rss_bytes);
    response->set_peak_rss_bytes(usage.peak_rss_bytes);
    return absl::OkStatus();
  });
}

}  // namespace mapp
