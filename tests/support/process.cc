#include "tests/support/process.h"

#include "mapp/base/check.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <fstream>
#include <poll.h>
#include <sstream>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

namespace mapp {
namespace {

constexpr int kExecFailed = 127;

/// In the child, between fork and exec: only calls that are safe there.
[[noreturn]] void ExecChild(char* const* arguments, int output_fd, int error_fd, pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(kExecFailed);  // the parent died before prctl
  const int null_fd = open("/dev/null", O_RDONLY);
  dup2(null_fd, STDIN_FILENO);
  dup2(output_fd, STDOUT_FILENO);
  dup2(error_fd, STDERR_FILENO);
  execv(arguments[0], arguments);
  _exit(kExecFailed);
}

int CreateFile(const std::filesystem::path& file) {
  const int fd = open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  MAPP_CHECK(fd >= 0);
  return fd;
}

}  // namespace

TempFolder::TempFolder() {
  std::string pattern = (std::filesystem::temp_directory_path() / "mapp_test_XXXXXX").string();
  MAPP_CHECK(mkdtemp(pattern.data()) != nullptr);
  path_ = pattern;
}

TempFolder::~TempFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

Process::Process(const std::vector<std::string>& command, const std::filesystem::path& folder) {
  static std::atomic<int> next_number = 0;
  const int number = next_number++;
  output_file_ = folder / fmt::format("process_{}.out", number);
  error_file_ = folder / fmt::format("process_{}.err", number);
  std::vector<std::string> copies = command;
  std::vector<char*> arguments;
  arguments.reserve(copies.size() + 1);
  for (std::string& argument : copies) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  const int output_fd = CreateFile(output_file_);
  const int error_fd = CreateFile(error_file_);
  const pid_t parent = getpid();
  pid_ = fork();
  MAPP_CHECK(pid_ >= 0);
  if (pid_ == 0) ExecChild(arguments.data(), output_fd, error_fd, parent);
  close(output_fd);
  close(error_fd);
  pid_fd_ = static_cast<int>(syscall(SYS_pidfd_open, pid_, 0));  // glibc 2.36's declaration is C only
  MAPP_CHECK(pid_fd_ >= 0);
}

Process::~Process() {
  Signal(SIGKILL);
  if (!exit_code_) waitpid(pid_, nullptr, 0);
  close(pid_fd_);
}

std::optional<int> Process::Wait(std::chrono::milliseconds timeout) {
  if (exit_code_) return exit_code_;
  pollfd ended{pid_fd_, POLLIN, 0};
  if (poll(&ended, 1, static_cast<int>(timeout.count())) <= 0) return std::nullopt;
  int status = 0;
  MAPP_CHECK(waitpid(pid_, &status, 0) == pid_);
  exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return exit_code_;
}

void Process::Signal(int signal) {
  if (!exit_code_) kill(pid_, signal);
}

std::string Process::StandardOutput() const { return ReadFile(output_file_); }
std::string Process::StandardError() const { return ReadFile(error_file_); }

Finished RunCommand(const std::vector<std::string>& command, std::chrono::milliseconds timeout) {
  const TempFolder folder;
  Process process(command, folder.path());
  const std::optional<int> exit_code = process.Wait(timeout);
  if (!exit_code) ADD_FAILURE() << command[0] << " did not end within " << timeout.count() << " ms";
  return {exit_code.value_or(-1), process.StandardOutput(), process.StandardError()};
}

std::string ReadFile(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream content;
  content << stream.rdbuf();
  return std::move(content).str();
}

void WriteFile(const std::filesystem::path& file, const std::string& content) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << content;
}

}  // namespace mapp
