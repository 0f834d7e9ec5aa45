// Kills a process that writes, at random moments, and looks at what it left.
#include "mapp/base/rng.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "storage/verify.h"
#include "tests/unit/storage/numbered_keyframes.h"
#include "tests/unit/storage/store_fixture.h"

#include <csignal>
#include <poll.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace mapp {
namespace {

constexpr int kRounds = 15;
constexpr int kWriters = 4;
/// Packets of some 20 KB.
constexpr uint16_t kFeaturesPerKeyframe = 500;

/// The child: each thread uploads to a session of its own and reports what was acknowledged, until killed.
[[noreturn]] void WriteUntilKilled(const std::string& file, int pipe_end) {
  const auto store = Value(OpenSqliteMapStore(file));
  std::vector<std::jthread> writers;
  for (int i = 0; i < kWriters; ++i) {
    writers.emplace_back([&] {
      SessionRecord session;
      Check(store->Write({}, [&](MapWriter& writer) {
        const Scene scene = AddScene(writer, "map " + std::to_string(Value(writer.ListMaps()).size()));
        session = Value(writer.GetSession(scene.session));
        return absl::OkStatus();
      }));
      for (uint32_t number = 0;; ++number) {
        Check(store->Write(
            {}, [&](MapWriter& writer) { return AddNumberedKeyframe(writer, session, number, kFeaturesPerKeyframe); }));
        const NumberedUpload acknowledged{session.id.value(), number};
        if (write(pipe_end, &acknowledged, sizeof(acknowledged)) != sizeof(acknowledged)) std::abort();
      }
    });
  }
  writers.clear();
  std::abort();
}

/// Collects acknowledgements: until `enough` have come, then on until `extra` has passed.
void Collect(int pipe_end, size_t enough, std::chrono::milliseconds extra, std::vector<NumberedUpload>* acknowledged) {
  const size_t target = acknowledged->size() + enough;
  auto end = std::chrono::steady_clock::time_point::max();
  for (;;) {
    if (acknowledged->size() >= target && end == std::chrono::steady_clock::time_point::max()) {
      end = std::chrono::steady_clock::now() + extra;
    }
    const auto now = std::chrono::steady_clock::now();
    if (now >= end) return;
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - now).count();
    pollfd readable{.fd = pipe_end, .events = POLLIN, .revents = 0};
    if (poll(&readable, 1, static_cast<int>(std::min<int64_t>(left, 1000))) <= 0) continue;
    NumberedUpload one;
    ASSERT_EQ(read(pipe_end, &one, sizeof(one)), static_cast<ssize_t>(sizeof(one))) << "the writing process has ended";
    acknowledged->push_back(one);
  }
}

/// What was acknowledged before the kill and not read yet.
void Drain(int pipe_end, std::vector<NumberedUpload>* acknowledged) {
  NumberedUpload one;
  while (read(pipe_end, &one, sizeof(one)) == static_cast<ssize_t>(sizeof(one))) acknowledged->push_back(one);
}

TEST(StorageCrashTest, KeepsWhatItAcknowledgedWhenKilled) {
  const TempFolder folder;
  const std::string file = folder.File("maps.db");
  std::vector<NumberedUpload> acknowledged;
  Rng rng(20240917);
  for (int round = 0; round < kRounds; ++round) {
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    // No other thread runs here: the store of the round before is closed.
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      close(ends[0]);
      WriteUntilKilled(file, ends[1]);
    }
    close(ends[1]);
    Collect(ends[0], 1 + rng.Below(20), std::chrono::milliseconds(rng.Below(150)), &acknowledged);
    kill(child, SIGKILL);
    int how = 0;
    ASSERT_EQ(waitpid(child, &how, 0), child);
    ASSERT_TRUE(WIFSIGNALED(how) && WTERMSIG(how) == SIGKILL) << "the writing process ended by itself";
    Drain(ends[0], &acknowledged);
    close(ends[0]);

    const auto store = Value(OpenSqliteMapStore(file));
    EXPECT_THAT(FindLostKeyframes(*Value(store->Read()), acknowledged, kFeaturesPerKeyframe), testing::IsEmpty());
    Check(store->Close());
    for (const Violation& violation : Value(VerifyDatabase({}, file)).violations) {
      ADD_FAILURE() << violation.check << ": " << violation.message;
    }
  }
  RecordProperty("acknowledged", static_cast<int>(acknowledged.size()));
}

}  // namespace
}  // namespace mapp
