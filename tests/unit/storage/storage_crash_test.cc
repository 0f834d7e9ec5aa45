// Kills a process that writes, at random moments, and looks at what it left.
#include "mapp/base/rng.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/storage/store_fixture.h"

#include <sqlite3.h>

#include <csignal>
#include <map>
#include <poll.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace mapp {
namespace {

constexpr int kRounds = 15;
constexpr int kWriters = 4;
constexpr size_t kPacketBytes = 20'000;
constexpr int kPointsPerKeyframe = 10;

/// One acknowledged upload, as the child reports it.
struct Acknowledgement {
  uint64_t session;
  uint32_t number;
};

uint64_t PacketSeed(uint64_t session, uint32_t number) { return session * 1'000'000 + number; }

Status Upload(MapStore& store, const Scene& scene, uint32_t number) {
  return store.Write({}, [&](MapWriter& writer) -> Status {
    MAPP_RETURN_IF_ERROR(
        writer
            .InsertFrame(TestFrame(scene.map, scene.session, scene.camera, number, PoseAt(number, 0, 0)),
                         TestBytes(PacketSeed(scene.session.value(), number), kPacketBytes), {})
            .status());
    for (int i = 0; i < kPointsPerKeyframe; ++i) {
      MAPP_RETURN_IF_ERROR(
          writer.InsertPoint(scene.map, TestPoint(scene.session, number * kPointsPerKeyframe + i, {1.0 * number, 1, 1}))
              .status());
    }
    return absl::OkStatus();
  });
}

/// The child: each thread uploads to a session of its own and reports what was acknowledged, until killed.
[[noreturn]] void WriteUntilKilled(const std::string& file, int pipe_end) {
  const auto store = Value(OpenSqliteMapStore(file));
  std::vector<std::jthread> writers;
  for (int i = 0; i < kWriters; ++i) {
    writers.emplace_back([&] {
      Scene scene;
      Check(store->Write({}, [&](MapWriter& writer) {
        scene = AddScene(writer, "map " + std::to_string(Value(writer.ListMaps()).size()));
        return absl::OkStatus();
      }));
      for (uint32_t number = 0;; ++number) {
        Check(Upload(*store, scene, number));
        const Acknowledgement acknowledged{scene.session.value(), number};
        if (write(pipe_end, &acknowledged, sizeof(acknowledged)) != sizeof(acknowledged)) std::abort();
      }
    });
  }
  writers.clear();
  std::abort();
}

/// Collects acknowledgements: until `enough` have come, then on until `extra` has passed.
void Collect(int pipe_end, size_t enough, std::chrono::milliseconds extra, std::vector<Acknowledgement>* acknowledged) {
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
    Acknowledgement one;
    ASSERT_EQ(read(pipe_end, &one, sizeof(one)), static_cast<ssize_t>(sizeof(one))) << "the writing process has ended";
    acknowledged->push_back(one);
  }
}

/// What was acknowledged before the kill and not read yet.
void Drain(int pipe_end, std::vector<Acknowledgement>* acknowledged) {
  Acknowledgement one;
  while (read(pipe_end, &one, sizeof(one)) == static_cast<ssize_t>(sizeof(one))) acknowledged->push_back(one);
}

void ExpectSound(const std::string& file) {
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &db), SQLITE_OK);
  std::string answer;
  sqlite3_exec(
      db, "PRAGMA integrity_check",
      [](void* text, int, char** values, char**) {
        *static_cast<std::string*>(text) += values[0];
        return 0;
      },
      &answer, nullptr);
  sqlite3_close(db);
  EXPECT_EQ(answer, "ok");
}

/// Every acknowledged keyframe is there once, whole, with its points; what else is there is whole, too.
void ExpectAllThere(MapReader& reader, const std::vector<Acknowledgement>& acknowledged) {
  std::map<std::pair<uint64_t, uint32_t>, int> stored;
  for (const MapRecord& map : Value(reader.ListMaps())) {
    const std::vector<FrameRecord> frames = Value(reader.ListFrames(map.id, std::nullopt));
    for (const FrameRecord& frame : frames) {
      ++stored[{frame.session.value(), frame.number}];
      EXPECT_EQ(Value(reader.GetPacket(frame.id)),
                TestBytes(PacketSeed(frame.session.value(), frame.number), kPacketBytes));
    }
    EXPECT_EQ(map.revision.value(), frames.size());
    EXPECT_EQ(map.num_frames, static_cast<int64_t>(frames.size()));
    EXPECT_EQ(map.num_points, static_cast<int64_t>(kPointsPerKeyframe * frames.size()));
    for (const SessionRecord& session : Value(reader.ListSessions(map.id))) {
      EXPECT_EQ(Value(reader.PointsOfSession(session.id)).size(), kPointsPerKeyframe * frames.size());
    }
  }
  for (const Acknowledgement& one : acknowledged) {
    EXPECT_EQ((stored[{one.session, one.number}]), 1) << "session " << one.session << " keyframe " << one.number;
  }
}

TEST(StorageCrashTest, KeepsWhatItAcknowledgedWhenKilled) {
  const TempFolder folder;
  const std::string file = folder.File("maps.db");
  std::vector<Acknowledgement> acknowledged;
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
    ExpectAllThere(*Value(store->Read()), acknowledged);
    Check(store->Close());
    ExpectSound(file);
  }
  RecordProperty("acknowledged", static_cast<int>(acknowledged.size()));
}

}  // namespace
}  // namespace mapp
