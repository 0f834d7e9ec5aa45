#include "eval/link/namespace_link.h"

#include "eval/process/child_process.h"

#include <fmt/format.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <optional>
#include <sched.h>
#include <thread>
#include <unistd.h>
#include <vector>

namespace mapp {
namespace {

constexpr std::chrono::seconds kSystemToolTimeout{10};

/// Runs `ip` or `tc` in the calling thread's namespace.
Status RunTool(const std::vector<std::string>& command) {
  ChildOptions options;
  options.command = command;
  options.output_file = options.error_file = "/dev/null";
  StatusOr<std::unique_ptr<ChildProcess>> child = ChildProcess::Start(options);
  if (!child.ok()) return absl::FailedPreconditionError(child.status().message());
  const std::optional<int> exit_code = (*child)->Wait(kSystemToolTimeout);
  if (exit_code == 0) return absl::OkStatus();
  return absl::FailedPreconditionError(
      fmt::format("{} {} {}: {}", command[0], command[1], command[2],
                  exit_code ? fmt::format("exit code {}", *exit_code) : std::string("did not end")));
}

std::optional<std::string> FindTool(const char* name) {
  for (const char* folder : {"/usr/sbin/", "/sbin/", "/usr/bin/", "/bin/"}) {
    const std::string path = std::string(folder) + name;
    if (access(path.c_str(), X_OK) == 0) return path;
  }
  return std::nullopt;
}

}  // namespace

/// The thread that is the namespace's only member: the namespace ends with it, and with the namespace the pair.
struct NamespaceLink::Impl {
  std::mutex mutex;
  std::condition_variable changed;
  const std::function<Status()>* job = nullptr;  ///< what is to be run
  std::optional<Status> outcome;                 ///< of the job
  pid_t thread_id = 0;
  std::jthread thread;

  /// Starts the thread and moves it into a new namespace.
  Status Enter() {
    std::optional<Status> entered;
    thread = std::jthread([this, &entered](const std::stop_token& stop) {
      {
        const std::lock_guard lock(mutex);
        thread_id = gettid();
        entered = unshare(CLONE_NEWNET) == 0
                      ? absl::OkStatus()
                      : absl::FailedPreconditionError(fmt::format("network namespace: {}", std::strerror(errno)));
      }
      changed.notify_all();
      Serve(stop);
    });
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return entered.has_value(); });
    return *entered;
  }

  void Serve(const std::stop_token& stop) {
    const std::stop_callback wake(stop, [this] {
      const std::lock_guard lock(mutex);
      changed.notify_all();
    });
    std::unique_lock lock(mutex);
    while (true) {
      changed.wait(lock, [&] { return job != nullptr || stop.stop_requested(); });
      if (job == nullptr) return;
      outcome = (*job)();
      job = nullptr;
      changed.notify_all();
    }
  }

  Status Run(const std::function<Status()>& function) {
    std::unique_lock lock(mutex);
    outcome.reset();
    job = &function;
    changed.notify_all();
    changed.wait(lock, [&] { return outcome.has_value(); });
    return *outcome;
  }
};

NamespaceLink::NamespaceLink() : impl_(std::make_unique<Impl>()) {}
NamespaceLink::~NamespaceLink() = default;

Status NamespaceLink::RunInside(const std::function<Status()>& function) { return impl_->Run(function); }

StatusOr<std::unique_ptr<NamespaceLink>> NamespaceLink::Create(double rate_mbit_s) {
  const auto ip = FindTool("ip");
  const auto tc = FindTool("tc");
  if (!ip || !tc) return absl::FailedPreconditionError("ip and tc (package iproute2) are needed for a namespace");
  std::unique_ptr<NamespaceLink> link(new NamespaceLink());
  MAPP_RETURN_IF_ERROR(link->impl_->Enter());
  // Of this process's own, and of this link's: the kernel takes the last one's away at its leisure.
  static std::atomic<int> next_number{0};
  const int number = next_number++ % 64;
  const int id = getpid();
  const std::string near = fmt::format("mpn{}x{}", id, number);
  const std::string far = fmt::format("mpf{}x{}", id, number);
  const std::string net = fmt::format("10.{}.{}.", 128 + id / 256 % 64, id % 256);
  const std::string near_address = fmt::format("{}{}", net, 4 * number + 1);
  link->far_address_ = fmt::format("{}{}", net, 4 * number + 2);
  MAPP_RETURN_IF_ERROR(RunTool({*ip, "link", "add", near, "type", "veth", "peer", "name", far, "netns",
                                std::to_string(link->impl_->thread_id)}));
  MAPP_RETURN_IF_ERROR(RunTool({*ip, "addr", "add", near_address + "/30", "dev", near}));
  MAPP_RETURN_IF_ERROR(RunTool({*ip, "link", "set", near, "up"}));
  const auto set_up_far_end = [&]() -> Status {
    MAPP_RETURN_IF_ERROR(RunTool({*ip, "addr", "add", link->far_address_ + "/30", "dev", far}));
    return RunTool({*ip, "link", "set", far, "up"});
  };
  MAPP_RETURN_IF_ERROR(link->RunInside(set_up_far_end));
  // A queue that drops nothing for minutes: the wait is what is measured.
  MAPP_RETURN_IF_ERROR(RunTool({*tc, "qdisc", "add", "dev", near, "root", "tbf", "rate",
                                fmt::format("{:.3f}mbit", rate_mbit_s), "burst", "32kb", "limit", "64mb"}));
  return link;
}

}  // namespace mapp
