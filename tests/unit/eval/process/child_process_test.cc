#include "eval/process/child_process.h"

#include "tests/support/process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <sys/wait.h>
#include <unistd.h>

namespace mapp {
namespace {

using std::chrono_literals::operator""ms;
using std::chrono_literals::operator""s;
using testing::HasSubstr;

constexpr auto kPatience = 60s;

class ChildProcessTest : public testing::Test {
 protected:
  ChildOptions Shell(const std::string& script) const {
    return {{"/bin/sh", "-c", script}, folder_.File("out"), folder_.File("err"), {}};
  }
  std::unique_ptr<ChildProcess> Start(const ChildOptions& options) {
    auto child = ChildProcess::Start(options);
    EXPECT_TRUE(child.ok()) << child.status();
    return std::move(child).value();
  }
  TempFolder folder_;
};

TEST_F(ChildProcessTest, ReportsExitCodeAndOutput) {
  const auto child = Start(Shell("echo said; echo complained >&2; exit 7"));
  EXPECT_EQ(child->Wait(kPatience), 7);
  EXPECT_EQ(child->Wait(0ms), 7);
  EXPECT_EQ(ReadFile(folder_.File("out")), "said\n");
  EXPECT_EQ(ReadFile(folder_.File("err")), "complained\n");
}

TEST_F(ChildProcessTest, OutputAndErrorMayShareAFile) {
  ChildOptions options = Shell("echo one; echo two >&2; echo three");
  options.error_file = options.output_file;
  EXPECT_EQ(Start(options)->Wait(kPatience), 0);
  EXPECT_EQ(ReadFile(folder_.File("out")), "one\ntwo\nthree\n");
}

TEST_F(ChildProcessTest, WaitGivesUpAtItsDeadlineAndASignalEnds) {
  const auto child = Start(Shell("exec sleep 600"));
  EXPECT_EQ(child->Wait(20ms), std::nullopt);
  child->Signal(SIGTERM);
  EXPECT_EQ(child->Wait(kPatience), 128 + SIGTERM);
  child->Signal(SIGTERM);  // of no consequence: its id may be another's by now
}

TEST_F(ChildProcessTest, IsKilledWithItsObject) {
  auto child = Start(Shell("exec sleep 600"));
  const pid_t pid = child->pid();
  ASSERT_EQ(kill(pid, 0), 0);
  child.reset();
  EXPECT_EQ(waitpid(pid, nullptr, WNOHANG), -1);  // reaped: no child of ours any more
  EXPECT_EQ(ReadProcessUsage(pid).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(ChildProcessTest, TakesEnvironmentAndAnEmptyInput) {
  ASSERT_EQ(setenv("MAPP_TEST_INHERITED", "parent", 1), 0);
  ASSERT_EQ(setenv("MAPP_TEST_CHANGED", "parent", 1), 0);
  ChildOptions options = Shell("echo $MAPP_TEST_INHERITED $MAPP_TEST_CHANGED $MAPP_TEST_ADDED; cat");
  options.environment = {"MAPP_TEST_CHANGED=child", "MAPP_TEST_ADDED=a=b"};
  EXPECT_EQ(Start(options)->Wait(kPatience), 0);
  EXPECT_EQ(ReadFile(folder_.File("out")), "parent child a=b\n");
}

TEST_F(ChildProcessTest, SaysWhatCannotBeRunOrWritten) {
  ChildOptions options = Shell("true");
  options.command = {folder_.File("absent")};
  EXPECT_EQ(ChildProcess::Start(options).status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(ChildProcess::Start(options).status().message()), HasSubstr("absent"));
  options.command = {folder_.path().string()};
  EXPECT_EQ(ChildProcess::Start(options).status().code(), absl::StatusCode::kPermissionDenied);
  options.command = {};
  EXPECT_EQ(ChildProcess::Start(options).status().code(), absl::StatusCode::kInvalidArgument);
  options = Shell("true");
  options.output_file = folder_.File("no/such/folder/out");
  EXPECT_EQ(ChildProcess::Start(options).status().code(), absl::StatusCode::kNotFound);
}

// The children's own counting loops: exact figures are the machine's affair, that they are counted is not.
TEST_F(ChildProcessTest, CountsTheCpuTimeOfAFinishedChild) {
  const auto busy = Start(Shell("i=0; while [ $i -lt 300000 ]; do i=$((i+1)); done"));
  const auto idle = Start(Shell("exit 0"));
  ASSERT_EQ(busy->Wait(kPatience), 0);
  ASSERT_EQ(idle->Wait(kPatience), 0);
  const auto busy_usage = busy->Usage();
  const auto idle_usage = idle->Usage();
  ASSERT_TRUE(busy_usage.ok()) << busy_usage.status();
  ASSERT_TRUE(idle_usage.ok()) << idle_usage.status();
  EXPECT_GT(busy_usage->cpu_s, 0.01);
  EXPECT_GT(busy_usage->cpu_s, 4 * idle_usage->cpu_s);
  EXPECT_EQ(busy_usage->rss_bytes, 0);
}

TEST_F(ChildProcessTest, TellsTheMemoryOfAFinishedChildUnlessItsStarterHidesIt) {
  constexpr size_t kChildBytes = size_t{100} << 20;
  const std::string script = "text=$(head -c 104857600 /dev/zero | tr '\\0' a)";
  const auto large = Start(Shell(script));
  ASSERT_EQ(large->Wait(kPatience), 0);
  const auto usage = large->Usage();
  ASSERT_TRUE(usage.ok()) << usage.status();
  EXPECT_GE(usage->peak_rss_bytes, kChildBytes);
  EXPECT_LE(usage->peak_rss_bytes, 6 * kChildBytes);  // the shell copies what it reads

  const std::vector<char> memory(kChildBytes, 1);  // which a child inherits until it runs its own program
  const auto hidden = Start(Shell("exit 0"));
  ASSERT_EQ(hidden->Wait(kPatience), 0);
  EXPECT_EQ(hidden->Usage()->peak_rss_bytes, 0);
  EXPECT_EQ(memory.back(), 1);
}

TEST(ProcessUsageTest, ReadsARunningProcess) {
  const auto before = ReadProcessUsage(getpid());
  ASSERT_TRUE(before.ok()) << before.status();
  EXPECT_GT(before->rss_bytes, 0);
  EXPECT_GE(before->peak_rss_bytes, before->rss_bytes);
  // 64 MB that are touched are resident.
  constexpr size_t kTouchedBytes = size_t{64} << 20;
  std::vector<char> memory(kTouchedBytes, 1);
  const clock_t start = clock();
  while (clock() - start < CLOCKS_PER_SEC / 10) memory[static_cast<size_t>(clock()) % memory.size()] ^= 1;
  const auto after = ReadProcessUsage(getpid());
  ASSERT_TRUE(after.ok()) << after.status();
  EXPECT_GT(after->rss_bytes, before->rss_bytes + kTouchedBytes / 2);
  EXPECT_GE(after->cpu_s - before->cpu_s, 0.08);  // 0.1 s, less two ticks of 10 ms
}

TEST(ProcessUsageTest, ThereIsNoProcessOfAnAbsurdId) {
  EXPECT_EQ(ReadProcessUsage(999'999'999).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace mapp
