#include "cli/interrupt.h"

#include "mapp/base/check.h"

#include <fmt/format.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <poll.h>
#include <string>
#include <sys/eventfd.h>
#include <thread>
#include <unistd.h>

namespace mapp {
namespace {

constexpr int kExitInterrupted = 130;  // what a shell reports for SIGINT
constexpr std::array kSignals = {SIGINT, SIGTERM};

/// The one thing that a signal handler can reach; -1 while nobody watches.
std::atomic<int> signal_event_fd{-1};  // NOLINT(cppcoreguidelines-avoid-non-const-global-variables)

void Notify(int event_fd) {
  const uint64_t one = 1;
  // An eventfd takes 8 bytes until its counter is about to overflow.
  static_cast<void>(!write(event_fd, &one, sizeof(one)));
}

extern "C" void OnSignal(int) {
  const int error = errno;
  Notify(signal_event_fd);
  errno = error;
}

Status ErrnoError(const std::string& operation) {
  return absl::InternalError(fmt::format("{}: error {}", operation, errno));
}

}  // namespace

struct InterruptWatcher::Impl {
  int signal_fd = -1;
  int quit_fd = -1;
  size_t num_handled = 0;  // of kSignals
  std::array<struct sigaction, kSignals.size()> previous{};
  std::stop_source source;
  std::thread thread;

  ~Impl() {
    for (size_t i = 0; i < num_handled; ++i) sigaction(kSignals[i], &previous[i], nullptr);
    signal_event_fd = -1;
    if (thread.joinable()) {
      Notify(quit_fd);
      thread.join();
    }
    if (signal_fd >= 0) close(signal_fd);
    if (quit_fd >= 0) close(quit_fd);
  }

  /// A handler, where blocking the signals and reading them from a descriptor would look simpler: libraries start
  /// threads while the program is loaded (OpenBLAS), before anything can be blocked, and one of those would get the
  /// signal and end the process.
  Status HandleSignals() {
    MAPP_CHECK(signal_event_fd == -1);  // one watcher at a time
    signal_event_fd = signal_fd;
    struct sigaction action {};
    action.sa_handler = OnSignal;
    action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    for (; num_handled < kSignals.size(); ++num_handled) {
      if (sigaction(kSignals[num_handled], &action, &previous[num_handled]) != 0) return ErrnoError("sigaction");
    }
    return absl::OkStatus();
  }

  void Run() {
    std::array<pollfd, 2> fds = {{{signal_fd, POLLIN, 0}, {quit_fd, POLLIN, 0}}};
    for (;;) {
      if (poll(fds.data(), fds.size(), -1) < 0 && errno != EINTR) return;
      if ((fds[1].revents & POLLIN) != 0) return;
      if ((fds[0].revents & POLLIN) == 0) continue;
      uint64_t num_signals = 0;
      if (read(signal_fd, &num_signals, sizeof(num_signals)) != sizeof(num_signals)) continue;
      if (!source.request_stop()) _exit(kExitInterrupted);
    }
  }
};

InterruptWatcher::InterruptWatcher(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
InterruptWatcher::~InterruptWatcher() = default;

std::stop_token InterruptWatcher::token() const { return impl_->source.get_token(); }

StatusOr<std::unique_ptr<InterruptWatcher>> InterruptWatcher::Create() {
  auto impl = std::make_unique<Impl>();
  impl->signal_fd = eventfd(0, EFD_CLOEXEC);
  if (impl->signal_fd < 0) return ErrnoError("eventfd");
  impl->quit_fd = eventfd(0, EFD_CLOEXEC);
  if (impl->quit_fd < 0) return ErrnoError("eventfd");
  MAPP_RETURN_IF_ERROR(impl->HandleSignals());
  impl->thread = std::thread([raw = impl.get()] { raw->Run(); });
  return std::unique_ptr<InterruptWatcher>(new InterruptWatcher(std::move(impl)));
}

}  // namespace mapp
