// Kills processes that back up and restore, at every step, and looks at what they left.
#include "storage/sqlite/restore.h"
#include "tests/unit/storage/database_fixture.h"

#include <csignal>
#include <filesystem>
#include <sys/wait.h>
#include <unistd.h>

namespace mapp {
namespace {

namespace fs = std::filesystem;

/// Runs `work` in a child process; true when it was killed, false when it came to its end. No other thread runs here.
template <typename Work>
bool IsKilled(const Work& work) {
  const pid_t child = fork();
  if (child == 0) {
    work();
    _exit(0);
  }
  int how = 0;
  EXPECT_EQ(waitpid(child, &how, 0), child);
  EXPECT_TRUE((WIFSIGNALED(how) && WTERMSIG(how) == SIGKILL) || (WIFEXITED(how) && WEXITSTATUS(how) == 0)) << how;
  return WIFSIGNALED(how);
}

class BackupCrashTest : public DatabaseTest {};

TEST_F(BackupCrashTest, KilledAtAnyStepLeavesNothingThatLooksLikeABackup) {
  MakeDatabase(file_, 3);
  fs::create_directory(folder_.File("backups"));
  const std::string target = folder_.File("backups/copy.db");
  int num_kills = 0;
  const auto back_up = [&] {
    int num_steps = 0;
    BackupOptions options{.to = target, .pages_per_step = 1};
    options.on_progress = [&](const BackupProgress&) {
      if (num_steps++ == num_kills) raise(SIGKILL);
    };
    Check(BackUpDatabase({}, file_, options).status());
  };
  for (; IsKilled(back_up); ++num_kills) {
    ASSERT_FALSE(fs::exists(target));
    ASSERT_LT(num_kills, 10'000);
  }
  EXPECT_GT(num_kills, 10);
  EXPECT_THAT(Entries("backups"), testing::ElementsAre("copy.db")) << "what the kills left was taken over";
  EXPECT_EQ(CountKeyframes(target), 3);
}

TEST_F(BackupCrashTest, KilledAtAnyStepOfARestoreLeavesTheOldOrTheNew) {
  const std::string backup = folder_.File("backup.db");
  MakeDatabase(backup, 5);
  MakeKilledDatabase(file_, 2);
  int num_kills = 0;
  const auto restore = [&] {
    int num_steps = 0;
    const RestorePlan plan =
        Value(PlanRestore({}, backup, file_, std::chrono::system_clock::from_time_t(1'700'000'000 + num_kills)));
    Check(Restore({}, plan, [&](const RestoreProgress&) {
      if (num_steps++ == num_kills) raise(SIGKILL);
    }));
  };
  // The log is there at the first kills; a look at the database would fold it in.
  for (; IsKilled(restore); ++num_kills) {
    ASSERT_LT(num_kills, 1000);
    const TempFolder copy;
    for (const std::string& name : Entries()) fs::copy(folder_.File(name), copy.File(name));
    EXPECT_EQ(CountKeyframes(copy.File("maps.db")), 2) << "killed at step " << num_kills;
  }
  EXPECT_GE(num_kills, 5);
  EXPECT_EQ(CountKeyframes(file_), 5);
}

}  // namespace
}  // namespace mapp
