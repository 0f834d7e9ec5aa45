#include "eval/harness/eval_server.h"

#include "text/file_io.h"

#include <fmt/format.h>

#include <csignal>
#include <sstream>

namespace mapp {
namespace {

using SteadyClock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kSlice{100};
constexpr std::chrono::seconds kStartTimeout{30};
constexpr std::chrono::seconds kStopTimeout{120};

/// The last line of a log, where programs say why they ended.
std::string LastLine(const std::string& file) {
  const StatusOr<std::string> text = ReadInput(file);
  if (!text.ok()) return {};
  std::istringstream lines(*text);
  std::string last;
  for (std::string line; std::getline(lines, line);) last = line.empty() ? last : line;
  return last;
}

}  // namespace

Status WaitFor(ChildProcess& child, const std::string& what, const std::string& log, std::chrono::milliseconds timeout,
               const std::stop_token& stop) {
  const auto deadline = SteadyClock::now() + timeout;
  while (true) {
    if (const std::optional<int> exit_code = child.Wait(kSlice)) {
      if (*exit_code == 0) return absl::OkStatus();
      return absl::AbortedError(fmt::format("{} ended with {}: {} (log: {})", what, *exit_code, LastLine(log), log));
    }
    if (stop.stop_requested()) {
      child.Signal(SIGTERM);
      return absl::CancelledError("interrupted");
    }
    if (SteadyClock::now() > deadline) {
      child.Signal(SIGTERM);
      return absl::DeadlineExceededError(
          fmt::format("{} did not end in {} s (log: {})", what, std::chrono::duration<double>(timeout).count(), log));
    }
  }
}

StatusOr<std::unique_ptr<EvalServer>> EvalServer::Start(const Programs& programs, const std::string& folder,
                                                        const std::stop_token& stop) {
  std::unique_ptr<EvalServer> server(new EvalServer());
  server->database_ = folder + "/map.db";
  server->log_ = folder + "/server.log";
  const std::string port_file = folder + "/port";
  ChildOptions options;
  options.command = {programs.mapp_server, "--db",        server->database_, "--listen",
                     "127.0.0.1:0",        "--port-file", port_file};
  options.output_file = server->log_;
  options.error_file = server->log_;
  MAPP_ASSIGN_OR_RETURN(server->process_, ChildProcess::Start(options));
  // The server writes its port once it listens.
  const auto deadline = SteadyClock::now() + kStartTimeout;
  while (server->address_.empty()) {
    const StatusOr<std::string> port = ReadInput(port_file);
    if (port.ok() && port->ends_with('\n')) {
      server->address_ = "127.0.0.1:" + port->substr(0, port->size() - 1);
    } else if (const std::optional<int> exit_code = server->process_->Wait(kSlice)) {
      return absl::AbortedError(fmt::format("mapp-server ended with {}: {}", *exit_code, LastLine(server->log_)));
    } else if (stop.stop_requested()) {
      return absl::CancelledError("interrupted");
    } else if (SteadyClock::now() > deadline) {
      return absl::DeadlineExceededError(fmt::format("mapp-server did not start (log: {})", server->log_));
    }
  }
  return server;
}

Status EvalServer::Stop(const std::stop_token& stop) {
  process_->Signal(SIGTERM);
  return WaitFor(*process_, "mapp-server", log_, kStopTimeout, stop);
}

}  // namespace mapp
