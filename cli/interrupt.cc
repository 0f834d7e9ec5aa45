#include "cli/interrupt.h"

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <poll.h>
#include <string>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <thread>
#include <unistd.h>

namespace mapp {
namespace {

constexpr int kExitInterrupted = 130;  // what a shell reports for SIGINT

Status ErrnoError(const std::string& operation) {
  return absl::InternalError(fmt::format("{}: error {}", operation, errno));
}

}  // namespace

struct InterruptWatcher::Impl {
  int signal_fd = -1;
  int quit_fd = -1;
  sigset_t previous_mask{};
  std::stop_source source;
  std::thread thread;

  ~Impl() {
    if (thread.joinable()) {
      const uint64_t one = 1;
      // An eventfd with a counter of 0 always takes an 8-byte write.
      static_cast<void>(!write(quit_fd, &one, sizeof(one)));
      thread.join();
    }
    if (signal_fd >= 0) close(signal_fd);
    if (quit_fd >= 0) close(quit_fd);
    pthread_sigmask(SIG_SETMASK, &previous_mask, nullptr);
  }

  void Run() {
    std::array<pollfd, 2> fds = {{{signal_fd, POLLIN, 0}, {quit_fd, POLLIN, 0}}};
    for (;;) {
      if (poll(fds.data(), fds.size(), -1) < 0 && errno != EINTR) return;
      if ((fds[1].revents & POLLIN) != 0) return;
      if ((fds[0].revents & POLLIN) == 0) continue;
      signalfd_siginfo info{};
      if (read(signal_fd, &info, sizeof(info)) != sizeof(info)) continue;
      if (!source.request_stop()) _exit(kExitInterrupted);
    }
  }
};

InterruptWatcher::InterruptWatcher(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
InterruptWatcher::~InterruptWatcher() = default;

std::stop_token InterruptWatcher::token() const { return impl_->source.get_token(); }

StatusOr<std::unique_ptr<InterruptWatcher>> InterruptWatcher::Create() {
  auto impl = std::make_unique<Impl>();
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  if (pthread_sigmask(SIG_BLOCK, &signals, &impl->previous_mask) != 0) return ErrnoError("blocking signals");
  impl->signal_fd = signalfd(-1, &signals, SFD_CLOEXEC);
  if (impl->signal_fd < 0) return ErrnoError("signalfd");
  impl->quit_fd = eventfd(0, EFD_CLOEXEC);
  if (impl->quit_fd < 0) return ErrnoError("eventfd");
  impl->thread = std::thread([raw = impl.get()] { raw->Run(); });
  return std::unique_ptr<InterruptWatcher>(new InterruptWatcher(std::move(impl)));
}

}  // namespace mapp
