#include "eval/process/child_process.h"

#include "mapp/base/check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <limits>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

namespace mapp {
namespace {

/// Closes with the scope.
class FileDescriptor {
 public:
  explicit FileDescriptor(int fd) : fd_(fd) {}
  ~FileDescriptor() { Close(); }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  int get() const { return fd_; }
  void Close() {
    if (fd_ >= 0) close(fd_);
    fd_ = -1;
  }

 private:
  int fd_;
};

Status SystemError(int error, const std::string& what) {
  const std::string message = fmt::format("{}: {}", what, std::strerror(error));
  switch (error) {
    case ENOENT:
    case ENOTDIR:
      return absl::NotFoundError(message);
    case EACCES:
    case EPERM:
    case EISDIR:
    case ENOEXEC:
      return absl::PermissionDeniedError(message);
    case EAGAIN:
    case ENOMEM:
    case EMFILE:
    case ENFILE:
    case ENOSPC:
      return absl::ResourceExhaustedError(message);
    default:
      return absl::InternalError(message);
  }
}

double Seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

std::vector<char*> Pointers(std::vector<std::string>& strings) {
  std::vector<char*> pointers;
  pointers.reserve(strings.size() + 1);
  for (std::string& text : strings) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

std::string NameOf(const std::string& assignment) { return assignment.substr(0, assignment.find('=')); }

std::vector<std::string> Environment(const std::vector<std::string>& added) {
  std::vector<std::string> environment = added;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string name = NameOf(*entry);
    if (std::ranges::none_of(added, [&](const std::string& own) { return NameOf(own) == name; })) {
      environment.emplace_back(*entry);
    }
  }
  return environment;
}

struct ChildSetup {
  char* const* arguments;
  char* const* environment;
  int output_fd;
  int error_fd;
  int failure_fd;  // closed by a successful exec; else takes errno
  pid_t parent;
};

/// In the child, between fork and exec: only calls that are safe there.
[[noreturn]] void ExecChild(const ChildSetup& setup) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != setup.parent) _exit(127);  // the parent died before prctl
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  const int null_fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
  dup2(null_fd, STDIN_FILENO);
  dup2(setup.output_fd, STDOUT_FILENO);
  dup2(setup.error_fd, STDERR_FILENO);
  execve(setup.arguments[0], setup.arguments, setup.environment);
  const int error = errno;
  const ssize_t written = write(setup.failure_fd, &error, sizeof(error));
  _exit(written == sizeof(error) ? 127 : 126);
}

/// 0 once the child runs its program, else why it could not.
int ReadExecError(int failure_fd) {
  int error = 0;
  ssize_t size = 0;
  do {
    size = read(failure_fd, &error, sizeof(error));
  } while (size < 0 && errno == EINTR);
  return size == sizeof(error) ? error : 0;
}

int CreateFile(const std::string& file) {
  return open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_TRUNC | O_CLOEXEC, 0644);
}

}  // namespace

StatusOr<std::unique_ptr<ChildProcess>> ChildProcess::Start(const ChildOptions& options) {
  if (options.command.empty()) return absl::InvalidArgumentError("command: must name a program");
  std::vector<std::string> command = options.command;
  std::vector<std::string> environment = Environment(options.environment);
  const std::vector<char*> arguments = Pointers(command);
  const std::vector<char*> variables = Pointers(environment);
  const FileDescriptor output(CreateFile(options.output_file));
  if (output.get() < 0) return SystemError(errno, options.output_file);
  const FileDescriptor error(CreateFile(options.error_file));
  if (error.get() < 0) return SystemError(errno, options.error_file);
  int failure_pipe[2];
  if (pipe2(failure_pipe, O_CLOEXEC) != 0) return SystemError(errno, "pipe2");
  const FileDescriptor failure_read(failure_pipe[0]);
  FileDescriptor failure_write(failure_pipe[1]);

  const ChildSetup setup{arguments.data(), variables.data(), output.get(), error.get(), failure_write.get(), getpid()};
  const uint64_t rss_before_bytes = GetProcessUsage().rss_bytes;
  const pid_t pid = fork();
  if (pid < 0) return SystemError(errno, "fork");
  if (pid == 0) ExecChild(setup);
  failure_write.Close();
  const uint64_t rss_bytes = std::max(rss_before_bytes, GetProcessUsage().rss_bytes);
  const int exec_error = ReadExecError(failure_read.get());
  // glibc 2.36's declaration of pidfd_open is C only.
  const int pid_fd = exec_error == 0 ? static_cast<int>(syscall(SYS_pidfd_open, pid, 0)) : -1;
  if (pid_fd < 0) {
    const int reason = exec_error == 0 ? errno : exec_error;
    kill(pid, SIGKILL);
    waitpid(pid, nullptr, 0);
    return SystemError(reason, exec_error == 0 ? "pidfd_open" : options.command[0]);
  }
  return std::unique_ptr<ChildProcess>(new ChildProcess(pid, pid_fd, rss_bytes));
}

ChildProcess::~ChildProcess() {
  Signal(SIGKILL);
  if (!exit_code_) Reap();
  close(pid_fd_);
}

std::optional<int> ChildProcess::Wait(std::chrono::milliseconds timeout) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point deadline = Clock::now() + timeout;
  while (!exit_code_) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()).count();
    pollfd ended{pid_fd_, POLLIN, 0};
    const int num_ready =
        poll(&ended, 1, static_cast<int>(std::clamp<int64_t>(left, 0, std::numeric_limits<int>::max())));
    if (num_ready > 0) {
      Reap();
    } else if (num_ready == 0 || errno != EINTR) {  // a signal to this process is no reason to give up
      return std::nullopt;
    }
  }
  return exit_code_;
}

void ChildProcess::Signal(int signal) {
  if (!exit_code_) kill(pid_, signal);
}

StatusOr<ProcessUsage> ChildProcess::Usage() const {
  if (exit_code_) return final_usage_;
  return ReadProcessUsage(pid_);
}

void ChildProcess::Reap() {
  int status = 0;
  rusage usage{};
  pid_t reaped = 0;
  do {
    reaped = wait4(pid_, &status, 0, &usage);
  } while (reaped < 0 && errno == EINTR);
  MAPP_CHECK(reaped == pid_);
  exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  final_usage_.cpu_s = Seconds(usage.ru_utime) + Seconds(usage.ru_stime);
  const uint64_t greatest_bytes = static_cast<uint64_t>(usage.ru_maxrss) * 1024;  // Linux counts in KiB
  // The kernel's two counts of resident pages differ by what each processor has not yet added up.
  constexpr uint64_t kCountingSlackBytes = uint64_t{1} << 20;
  if (greatest_bytes > starter_rss_bytes_ + kCountingSlackBytes) final_usage_.peak_rss_bytes = greatest_bytes;
}

}  // namespace mapp
