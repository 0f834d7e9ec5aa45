// A disk that fails, fills up or loses power at every operation of a run of changes, backups and openings.
#include "tests/unit/storage/fault_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <iostream>

namespace mapp {
namespace {

using Kind = DiskFault::Kind;

/// How many operations of the run are hit, evenly spread: MAPP_FAULT_RUNS, 0 for each of them.
int64_t NumRuns() {
  const char* const given = std::getenv("MAPP_FAULT_RUNS");
  return given != nullptr ? std::stoll(given) : 120;
}
/// How many are enough to see a promise broken.
constexpr int64_t kRunsToSeeIt = 30;

/// From the first operation that changes something until the write-ahead log is in use.
constexpr int64_t kFirstToMakeIt = 11;
constexpr int64_t kLastToMakeIt = 38;
constexpr uint64_t kSeedsToMakeIt = 20;

struct Sweep {
  int num_runs = 0;
  int num_struck = 0;
  int num_refused = 0;
  int num_with_problems = 0;
  std::vector<std::string> problems;
};

Sweep SweepOver(DiskFault fault, int64_t num_runs, const FaultRunOptions& options = {}) {
  const int64_t num_operations = RunOnFaultyDisk({}, options).num_operations;
  const int64_t stride = num_runs > 0 ? std::max<int64_t>(1, num_operations / num_runs) : 1;
  Sweep sweep;
  // Not every time the same ones of a few operations that repeat.
  for (fault.at = static_cast<int64_t>(fault.kind) % stride; fault.at < num_operations; fault.at += stride) {
    ++fault.seed;
    const FaultRunResult run = RunOnFaultyDisk(fault, options);
    ++sweep.num_runs;
    sweep.num_struck += !run.struck.empty();
    sweep.num_refused += run.num_refused;
    sweep.num_with_problems += !run.problems.empty();
    sweep.problems.insert(sweep.problems.end(), run.problems.begin(), run.problems.end());
  }
  std::cout << num_operations << " operations, " << sweep.num_runs << " runs, " << sweep.num_struck << " faults, "
            << sweep.num_refused << " calls refused, " << sweep.num_with_problems << " runs with problems\n";
  return sweep;
}

struct Case {
  std::string name;
  Kind kind;
  bool ends_when_refused = false;
};
void PrintTo(const Case& kind, std::ostream* stream) { *stream << kind.name; }
class StorageFaultTest : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Kinds, StorageFaultTest,
                         testing::Values(Case{"OperationFails", Kind::kFail},
                                         Case{"OperationFailsAndThePowerGoes", Kind::kFail, true},
                                         Case{"AllFailFromThere", Kind::kFailFrom}, Case{"DiskIsFull", Kind::kFull},
                                         Case{"WriteStopsHalfWay", Kind::kShortWrite},
                                         Case{"PowerIsCut", Kind::kPowerCut}),
                         [](const auto& value) { return value.param.name; });

TEST_P(StorageFaultTest, KeepsExactlyWhatItAcknowledged) {
  const Sweep sweep =
      SweepOver({.kind = GetParam().kind}, NumRuns(), {.ends_when_refused = GetParam().ends_when_refused});
  EXPECT_GT(sweep.num_struck, sweep.num_runs * 9 / 10);
  EXPECT_THAT(sweep.problems, testing::IsEmpty());
}

TEST(NewDatabaseFaultTest, PowerCutWhileItIsMadeLeavesOneThatCanBeOpened) {
  // With pages as servers have them, of many sectors each.
  for (int64_t at = kFirstToMakeIt; at <= kLastToMakeIt; ++at) {
    for (uint64_t seed = 1; seed <= kSeedsToMakeIt; ++seed) {
      const FaultRunResult run = RunOnFaultyDisk({.kind = Kind::kPowerCut, .at = at, .seed = seed},
                                                 {.page_bytes = SqliteOptions().page_size_bytes});
      EXPECT_THAT(run.problems, testing::IsEmpty());
    }
  }
}

TEST(StorageFaultHarnessTest, FindsNothingWithoutAFault) {
  for (uint64_t seed = 1; seed <= 2; ++seed) {
    const FaultRunResult run = RunOnFaultyDisk({.seed = seed});
    EXPECT_THAT(run.problems, testing::IsEmpty());
    EXPECT_EQ(run.num_refused, 0);
  }
}

TEST(StorageFaultHarnessTest, SeesADiskThatLiesLoseWhatWasAcknowledged) {
  const Sweep sweep = SweepOver({.kind = Kind::kPowerCut, .ignores_syncs = true}, kRunsToSeeIt);
  EXPECT_GT(sweep.num_with_problems, sweep.num_runs / 2);
}

TEST(StorageFaultHarnessTest, SeesWhatIsNotSyncedLostAndNothingElseWrong) {
  const Sweep sweep = SweepOver({.kind = Kind::kPowerCut}, kRunsToSeeIt, {.sync_commits = false});
  EXPECT_GT(sweep.num_with_problems, sweep.num_runs / 4);
  EXPECT_THAT(sweep.problems, testing::Each(testing::EndsWith("what is left is not what was acknowledged")));
}

}  // namespace
}  // namespace mapp
