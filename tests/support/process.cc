#include "tests/support/process.h"

#include "eval/process/child_process.h"
#include "mapp/base/check.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <fstream>
#include <sstream>

namespace mapp {

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
  auto child = ChildProcess::Start({command, output_file_.string(), error_file_.string(), {}});
  if (!child.ok()) std::fprintf(stderr, "%s\n", child.status().ToString().c_str());
  MAPP_CHECK(child.ok());
  child_ = std::move(*child);
}

Process::~Process() = default;

std::optional<int> Process::Wait(std::chrono::milliseconds timeout) { return child_->Wait(timeout); }
void Process::Signal(int signal) { child_->Signal(signal); }

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
