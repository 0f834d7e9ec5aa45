#include "tests/e2e/service_fixture.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>

namespace mapp {
namespace {

// Generous: sanitizers and busy machines slow everything down, and a hang is still found.
constexpr std::chrono::seconds kCommandTimeout(60);
constexpr std::chrono::seconds kReplayTimeout(600);
constexpr std::chrono::seconds kServerStartTimeout(30);

}  // namespace

std::string MappBinary() { return MAPP_BINARY; }

std::string MappServerBinary() { return MAPP_SERVER_BINARY; }

Finished RunMapp(const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {MappBinary()};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return RunCommand(command, kCommandTimeout);
}

std::string ExpectFailure(const std::vector<std::string>& arguments) {
  const Finished finished = RunMapp(arguments);
  EXPECT_EQ(finished.exit_code, 1) << finished.err;
  EXPECT_THAT(finished.err, testing::StartsWith("mapp: "));
  EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
  return finished.err;
}

std::optional<std::string> DataFolder(const std::string& name) {
  const char* configured = std::getenv("MAPP_DATA_DIR");
  const std::filesystem::path data =
      configured != nullptr ? configured : std::filesystem::path(MAPP_SOURCE_DIR) / ".." / "shared" / "data";
  const std::filesystem::path folder = data / name;
  if (!std::filesystem::is_directory(folder)) return std::nullopt;
  return folder.string();
}

std::optional<double> JsonNumber(const std::string& json, const std::string& key) {
  const std::string quoted = fmt::format("\"{}\": ", key);
  const size_t position = json.find(quoted);
  if (position == std::string::npos) return std::nullopt;
  const char* const text = json.c_str() + position + quoted.size();
  char* end = nullptr;
  const double number = std::strtod(text, &end);
  if (end == text) return std::nullopt;
  return number;
}

ServerProcess::ServerProcess(const std::string& database, const TempFolder& folder, int port,
                             const std::vector<std::string>& more) {
  const std::string port_file = folder.File("port");
  std::filesystem::remove(port_file);
  std::vector<std::string> command = {
      MAPP_SERVER_BINARY, "--db", database, "--listen", fmt::format("127.0.0.1:{}", port), "--port-file", port_file};
  command.insert(command.end(), more.begin(), more.end());
  process_ = std::make_unique<Process>(command, folder.path());
  const auto deadline = std::chrono::steady_clock::now() + kServerStartTimeout;
  while (!std::filesystem::exists(port_file) && std::chrono::steady_clock::now() < deadline) {
    if (process_->Wait(std::chrono::milliseconds(10)).has_value()) break;
  }
  port_ = std::atoi(ReadFile(port_file).c_str());
  if (port_ == 0) ADD_FAILURE() << "the server did not start: " << process_->StandardError();
}

std::string ServerProcess::address() const { return fmt::format("127.0.0.1:{}", port_); }

void ServerProcess::Kill() {
  process_->Signal(SIGKILL);
  EXPECT_EQ(process_->Wait(kCommandTimeout), 128 + SIGKILL) << "it had ended before: " << process_->StandardError();
}

std::optional<int> ServerProcess::Stop() {
  process_->Signal(SIGTERM);
  return process_->Wait(kCommandTimeout);
}

void ServiceTest::StartServer(const std::vector<std::string>& more) {
  server_arguments_ = more;
  server_ = std::make_unique<ServerProcess>(database(), folder_, /*port=*/0, server_arguments_);
}

void ServiceTest::RestartServer() {
  server_ = std::make_unique<ServerProcess>(database(), folder_, server_->port(), server_arguments_);
}

void ServiceTest::KillAndRestartServer() {
  server_->Kill();
  RestartServer();
}

std::vector<std::string> ServiceTest::ReplayArguments(const std::string& sequence, const std::string& device,
                                                      const std::vector<std::string>& more) const {
  std::vector<std::string> arguments = {"replay",
                                        "--server",
                                        server_->address(),
                                        "--map",
                                        "place",
                                        "--device",
                                        device,
                                        "--json",
                                        folder_.File(device + ".json"),
                                        "--trajectory-out",
                                        folder_.File(device + ".trajectory"),
                                        "--truth-out",
                                        folder_.File(device + ".truth"),
                                        "--frames-out",
                                        folder_.File(device + ".frames")};
  arguments.insert(arguments.end(), more.begin(), more.end());
  arguments.push_back(sequence);
  return arguments;
}

Replayed ServiceTest::Replay(const std::string& sequence, const std::string& device,
                             const std::vector<std::string>& more) {
  std::vector<std::string> command = ReplayArguments(sequence, device, more);
  command.insert(command.begin(), MappBinary());
  const Finished finished = RunCommand(command, kReplayTimeout);
  EXPECT_EQ(finished.exit_code, 0) << finished.err;
  return CollectReplay(device, finished.exit_code, finished.err);
}

Replayed ServiceTest::CollectReplay(const std::string& device, int exit_code, const std::string& err) const {
  Replayed replayed{exit_code, err, ReadFile(folder_.File(device + ".json")), folder_.File(device + ".trajectory"),
                    folder_.File(device + ".truth")};
  return replayed;
}

std::vector<std::string> ServiceTest::AlignBy(const Replayed& first) {
  return {"--align-by", first.truth_file, first.trajectory_file};
}

}  // namespace mapp
