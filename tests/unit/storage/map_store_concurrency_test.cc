// Snapshots, group commit and closing, on every engine.
#include "tests/unit/storage/store_fixture.h"

#include <atomic>
#include <latch>
#include <semaphore>
#include <thread>

namespace mapp {
namespace {

using absl::StatusCode;

class MapStoreConcurrencyTest : public MapStoreTest {
 protected:
  /// Holds the writer thread inside a change until released, so that others queue up behind it.
  class Blockade {
   public:
    explicit Blockade(MapStore& store)
        : thread_([this, &store] {
            Check(store.Write({}, [this](MapWriter&) {
              begun_.count_down();
              release_.acquire();
              return absl::OkStatus();
            }));
          }) {
      begun_.wait();
    }
    ~Blockade() {
      Release();
      thread_.join();
    }
    void Release() {
      if (!released_.exchange(true)) release_.release();
    }

   private:
    std::latch begun_{1};
    std::binary_semaphore release_{0};
    std::atomic<bool> released_{false};
    std::thread thread_;
  };

  static Status AddMap(MapWriter& writer, const std::string& name) {
    MapRecord map;
    map.name = name;
    return writer.CreateMap(map).status();
  }
};
INSTANTIATE_TEST_SUITE_P(Engines, MapStoreConcurrencyTest, testing::ValuesIn(AllEngines()), EngineName);

TEST_P(MapStoreConcurrencyTest, ReaderSeesTheStateItWasOpenedOn) {
  const auto before = Read();
  NewScene("kitchen");
  const auto after = Read();
  EXPECT_TRUE(Value(before->ListMaps()).empty());
  EXPECT_EQ(Value(after->ListMaps()).size(), 1U);
  NewScene("garage");
  EXPECT_TRUE(Value(before->ListMaps()).empty());
  EXPECT_EQ(Value(after->ListMaps()).size(), 1U);
  EXPECT_EQ(Value(Read()->ListMaps()).size(), 2U);
}

TEST_P(MapStoreConcurrencyTest, ReadersDoNotWaitForTheWriter) {
  NewScene("kitchen");
  Blockade blockade(store());
  EXPECT_EQ(Value(Read()->ListMaps()).size(), 1U);
}

TEST_P(MapStoreConcurrencyTest, FailedChangeLeavesNothing) {
  const Status status = Write([](MapWriter& writer) {
    Check(AddMap(writer, "kitchen"));
    return absl::AbortedError("changed my mind");
  });
  EXPECT_THAT(status, HasCode(StatusCode::kAborted));
  EXPECT_TRUE(Value(Read()->ListMaps()).empty());
}

TEST_P(MapStoreConcurrencyTest, ThrowingChangeIsUndoneAndReported) {
  const Status status = Write([](MapWriter& writer) -> Status {
    Check(AddMap(writer, "kitchen"));
    throw std::runtime_error("broken caller");
  });
  EXPECT_THAT(status, HasCode(StatusCode::kInternal));
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("broken caller"));
  EXPECT_TRUE(Value(Read()->ListMaps()).empty());
}

TEST_P(MapStoreConcurrencyTest, OneOfManyThatFailsIsUndoneAlone) {
  constexpr int kWriters = 24;
  std::vector<Status> results(kWriters);
  {
    Blockade blockade(store());
    std::vector<std::jthread> writers;
    for (int i = 0; i < kWriters; ++i) {
      writers.emplace_back([&, i] {
        results[i] = Write([i](MapWriter& writer) {
          MAPP_RETURN_IF_ERROR(AddMap(writer, "map " + std::to_string(i)));
          return i % 5 == 3 ? absl::AbortedError("odd one") : absl::OkStatus();
        });
      });
    }
    blockade.Release();
  }
  int num_stored = 0;
  for (int i = 0; i < kWriters; ++i) {
    const bool stored = Read()->FindMap("map " + std::to_string(i)).ok();
    EXPECT_EQ(stored, i % 5 != 3) << i;
    EXPECT_EQ(results[i].ok(), stored) << i << " " << results[i];
    num_stored += stored;
  }
  EXPECT_EQ(static_cast<int>(Value(Read()->ListMaps()).size()), num_stored);
}

TEST_P(MapStoreConcurrencyTest, OnCommitRunsInCommitOrderAfterTheCommit) {
  const Scene scene = NewScene();
  constexpr int kWriters = 16;
  std::vector<uint64_t> published;  // on_commit runs on one thread
  {
    Blockade blockade(store());
    std::vector<std::jthread> writers;
    for (int i = 0; i < kWriters; ++i) {
      writers.emplace_back([&] {
        Revision revision;
        bool durable_first = false;
        Check(store().Write(
            {},
            [&](MapWriter& writer) {
              revision = Value(writer.NextRevision(scene.map));
              return absl::OkStatus();
            },
            [&] {
              durable_first = Value(Read()->GetMap(scene.map)).revision >= revision;
              published.push_back(revision.value());
            }));
        EXPECT_TRUE(durable_first);
      });
    }
    blockade.Release();
  }
  ASSERT_EQ(published.size(), static_cast<size_t>(kWriters));
  for (int i = 0; i < kWriters; ++i) EXPECT_EQ(published[i], static_cast<uint64_t>(i + 1));
}

TEST_P(MapStoreConcurrencyTest, OnCommitDoesNotRunForAFailedChange) {
  bool published = false;
  EXPECT_THAT(store().Write(
                  {}, [](MapWriter&) { return absl::AbortedError("no"); }, [&] { published = true; }),
              HasCode(StatusCode::kAborted));
  EXPECT_FALSE(published);
}

TEST_P(MapStoreConcurrencyTest, LaterChangeSeesTheEarlier) {
  Check(Write([](MapWriter& writer) { return AddMap(writer, "kitchen"); }));
  EXPECT_THAT(Write([](MapWriter& writer) { return AddMap(writer, "kitchen"); }), HasCode(StatusCode::kAlreadyExists));
}

TEST_P(MapStoreConcurrencyTest, DeadlineEndsTheWaitBeforeTheChangeBegins) {
  Blockade blockade(store());
  bool ran = false;
  const Status status = store().Write(CallContext::WithTimeout(std::chrono::milliseconds(20)), [&](MapWriter&) {
    ran = true;
    return absl::OkStatus();
  });
  EXPECT_THAT(status, HasCode(StatusCode::kDeadlineExceeded));
  blockade.Release();
  Check(Write([](MapWriter&) { return absl::OkStatus(); }));
  EXPECT_FALSE(ran);
}

TEST_P(MapStoreConcurrencyTest, CancelledChangeDoesNotRun) {
  CallContext context;
  context.is_cancelled = [] { return true; };
  bool ran = false;
  const Status status = store().Write(context, [&](MapWriter&) {
    ran = true;
    return absl::OkStatus();
  });
  EXPECT_THAT(status, HasCode(StatusCode::kCancelled));
  EXPECT_FALSE(ran);
}

TEST_P(MapStoreConcurrencyTest, AfterClosingOnlyOldReadersGoOn) {
  Check(Write([](MapWriter& writer) { return AddMap(writer, "kitchen"); }));
  const auto reader = Read();
  Check(store().Close());
  Check(store().Close());
  EXPECT_THAT(store().Read(), HasCode(StatusCode::kUnavailable));
  EXPECT_THAT(store().ReadAsOf(MapId(1), Revision(0)), HasCode(StatusCode::kUnavailable));
  EXPECT_THAT(Write([](MapWriter&) { return absl::OkStatus(); }), HasCode(StatusCode::kUnavailable));
  EXPECT_EQ(Value(reader->ListMaps()).size(), 1U) << "a reader from before stays good";
}

TEST_P(MapStoreConcurrencyTest, CloseWaitsForTheChangeThatHasBegun) {
  std::jthread closing;
  std::latch closing_begun{1};
  {
    Blockade blockade(store());  // fails the test if its change does not come through
    closing = std::jthread([&] {
      closing_begun.count_down();
      Check(store().Close());
    });
    closing_begun.wait();
  }
  closing.join();
  EXPECT_THAT(Write([](MapWriter&) { return absl::OkStatus(); }), HasCode(StatusCode::kUnavailable));
}

TEST_P(MapStoreConcurrencyTest, OneStoreAtATimeHasTheMaps) {
  NewScene("kitchen");
  EXPECT_THAT(OpenAnother(), HasCode(StatusCode::kFailedPrecondition));
  EXPECT_EQ(Value(Read()->ListMaps()).size(), 1U);
  Check(store().Close());
  EXPECT_EQ(Value(Value(Value(OpenAnother())->Read())->ListMaps()).size(), 1U);
}

TEST_P(MapStoreConcurrencyTest, ReaderOutlivesTheStore) {
  NewScene("kitchen");
  const auto reader = Read();
  Reopen();
  NewScene("garage");
  EXPECT_EQ(Value(reader->ListMaps()).size(), 1U);
}

TEST_P(MapStoreConcurrencyTest, ReadersAndWritersTogether) {
  const Scene scene = NewScene();
  std::atomic<bool> done{false};
  std::jthread reading([&] {
    while (!done) {
      const auto reader = Read();
      const MapRecord map = Value(reader->GetMap(scene.map));
      // Each change adds one point and one revision: any other state is torn.
      EXPECT_EQ(static_cast<uint64_t>(map.num_points), map.revision.value());
      EXPECT_EQ(Value(reader->PointsOfSession(scene.session)).size(), static_cast<size_t>(map.num_points));
    }
  });
  {
    std::vector<std::jthread> writers;
    for (uint64_t t = 0; t < 4; ++t) {
      writers.emplace_back([&, t] {
        for (uint64_t i = 0; i < 25; ++i) {
          Check(Write([&](MapWriter& writer) {
            return writer.InsertPoint(scene.map, TestPoint(scene.session, t * 100 + i, {1, 1, 1})).status();
          }));
        }
      });
    }
  }
  done = true;
  reading.join();
  EXPECT_EQ(Value(Read()->GetMap(scene.map)).num_points, 100);
}

}  // namespace
}  // namespace mapp
