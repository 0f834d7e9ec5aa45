#include "server/rpc/prometheus_exporter.h"

#include <fmt/format.h>
#include <prometheus/counter.h>
#include <prometheus/exposer.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>

#include <exception>

namespace mapp {
namespace {

/// Seconds; from a cached overlap query (tens of microseconds) to an upload behind a slow disk.
const prometheus::Histogram::BucketBoundaries kLatencyBuckets = {0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01,
                                                                 0.025,  0.05,    0.1,    0.25,  0.5,    1,     5};

}  // namespace

struct PrometheusExporter::Impl {
  explicit Impl(const std::string& address)
      : registry(std::make_shared<prometheus::Registry>()),
        calls(prometheus::BuildCounter()
                  .Name("mapp_rpc_calls_total")
                  .Help("Finished calls by method and status code.")
                  .Register(*registry)),
        bytes(prometheus::BuildCounter()
                  .Name("mapp_rpc_bytes_total")
                  .Help("Serialised bytes of requests and responses by method.")
                  .Register(*registry)),
        seconds(prometheus::BuildHistogram()
                    .Name("mapp_rpc_seconds")
                    .Help("Time inside the server by method.")
                    .Register(*registry)),
        quarantined(prometheus::BuildCounter()
                        .Name("mapp_sessions_quarantined_total")
                        .Help("Sessions quarantined since the start by what was found.")
                        .Register(*registry)),
        loops_closed(prometheus::BuildCounter()
                         .Name("mapp_loops_closed_total")
                         .Help("Sessions corrected since the start for having come back to mapped ground.")
                         .Register(*registry)),
        exposer(address) {
    exposer.RegisterCollectable(registry);
  }

  std::shared_ptr<prometheus::Registry> registry;
  prometheus::Family<prometheus::Counter>& calls;
  prometheus::Family<prometheus::Counter>& bytes;
  prometheus::Family<prometheus::Histogram>& seconds;
  prometheus::Family<prometheus::Counter>& quarantined;
  prometheus::Family<prometheus::Counter>& loops_closed;
  prometheus::Exposer exposer;  // its web server reads the registry: ends first
};

StatusOr<std::unique_ptr<PrometheusExporter>> PrometheusExporter::Listen(const std::string& address) {
  try {
    return std::unique_ptr<PrometheusExporter>(new PrometheusExporter(std::make_unique<Impl>(address)));
  } catch (const std::exception& exception) {
    // The web server's own text only says which of its contexts failed.
    return absl::UnavailableError(fmt::format("cannot serve metrics on {}: {}", address, exception.what()));
  }
}

PrometheusExporter::PrometheusExporter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PrometheusExporter::~PrometheusExporter() = default;

void PrometheusExporter::OnCall(const std::string& method, const std::string& code, std::chrono::nanoseconds latency,
                                uint64_t bytes) {
  impl_->calls.Add({{"method", method}, {"code", code}}).Increment();
  impl_->bytes.Add({{"method", method}}).Increment(static_cast<double>(bytes));
  impl_->seconds.Add({{"method", method}}, kLatencyBuckets).Observe(std::chrono::duration<double>(latency).count());
}

void PrometheusExporter::OnSessionQuarantined(const std::string& finding) {
  impl_->quarantined.Add({{"finding", finding}}).Increment();
}

void PrometheusExporter::OnLoopClosed() { impl_->loops_closed.Add({}).Increment(); }

}  // namespace mapp
