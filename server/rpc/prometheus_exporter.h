#pragma once

#include "mapp/base/status.h"
#include "server/rpc/call_recorder.h"

#include <memory>
#include <string>

namespace mapp {

/// Serves the calls' counts, latencies and sizes at http://ADDRESS/metrics in Prometheus' text format. Thread-safe.
///
/// mapp_rpc_calls_total{method,code}, mapp_rpc_bytes_total{method}, mapp_rpc_seconds{method} (histogram),
/// mapp_sessions_quarantined_total{finding}, mapp_loops_closed_total.
class PrometheusExporter final : public CallObserver {
 public:
  /// INVALID_ARGUMENT or UNAVAILABLE naming the address when it cannot be listened on.
  static StatusOr<std::unique_ptr<PrometheusExporter>> Listen(const std::string& address);
  ~PrometheusExporter() override;

  void OnCall(const std::string& method, const std::string& code, std::chrono::nanoseconds latency,
              uint64_t bytes) override;
  /// `finding`: "own-points", "elsewhere", ... (service/keyframe_evidence.h).
  void OnSessionQuarantined(const std::string& finding);
  void OnLoopClosed();

 private:
  struct Impl;
  explicit PrometheusExporter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mapp
