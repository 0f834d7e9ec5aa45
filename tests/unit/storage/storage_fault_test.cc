// A disk that fails, fills up or loses power at every operation of a run of changes, backups and openings.
#include "tests/unit/storage/fault_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <iostream>
#include <set>
#include <utility>

namespace mapp {
namespace {

using Kind = DiskFault::Kind;

/// How many operations of the run are hit beside the first of each kind: MAPP_FAULT_RUNS, 0 for all.
int64_t NumSpread() {
  const char* const given = std::getenv("MAPP_FAULT_RUNS");
  return given != nullptr ? std::stoll(given) : 40;
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

/// So many operations of a run, evenly spread from `first` on; all for 0.
std::set<int64_t> Spread(const std::vector<std::string>& operations, int64_t count, int64_t first) {
  const auto num_operations = static_cast<int64_t>(operations.size());
  const int64_t stride = count > 0 ? std::max<int64_t>(1, num_operations / count) : 1;
  std::set<int64_t> spread;
  for (int64_t at = first % stride; at < num_operations; at += stride) spread.insert(at);
  return spread;
}

/// The first of each kind on each file, after each other one: what happens once is soon missed.
std::set<int64_t> FirstOfEachKind(const std::vector<std::string>& operations) {
  std::set<std::pair<std::string, std::string>> seen;
  std::set<int64_t> first;
  for (size_t at = 1; at < operations.size(); ++at) {
    if (seen.emplace(operations[at - 1], operations[at]).second) first.insert(static_cast<int64_t>(at));
  }
  return first;
}

Sweep SweepOver(const std::set<int64_t>& operations, DiskFault fault, const FaultRunOptions& options = {}) {
  Sweep sweep;
  for (const int64_t at : operations) {
    fault.at = at;
    ++fault.seed;
    const FaultRunResult run = RunOnFaultyDisk(fault, options);
    ++sweep.num_runs;
    sweep.num_struck += !run.struck.empty();
    sweep.num_refused += run.num_refused;
    sweep.num_with_problems += !run.problems.empty();
    sweep.problems.insert(sweep.problems.end(), run.problems.begin(), run.problems.end());
  }
  std::cout << sweep.num_runs << " runs, " << sweep.num_struck << " faults, " << sweep.num_refused << " calls refused, "
            << sweep.num_with_problems << " runs with problems\n";
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
  const std::vector<std::string> operations = RunOnFaultyDisk({}).operations;
  // Not the same ones of a few that repeat for every kind of fault.
  std::set<int64_t> hit = Spread(operations, NumSpread(), static_cast<int64_t>(GetParam().kind));
  hit.merge(FirstOfEachKind(operations));
  const Sweep sweep = SweepOver(hit, {.kind = GetParam().kind}, {.ends_when_refused = GetParam().ends_when_refused});
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
  const std::vector<std::string> operations = RunOnFaultyDisk({}).operations;
  const Sweep sweep = SweepOver(Spread(operations, kRunsToSeeIt, 0), {.kind = Kind::kPowerCut, .ignores_syncs = true});
  EXPECT_GT(sweep.num_with_problems, sweep.num_runs / 2);
}

TEST(StorageFaultHarnessTest, SeesWhatIsNotSyncedLostAndNothingElseWrong) {
  const FaultRunOptions options{.sync_commits = false};
  const std::vector<std::string> operations = RunOnFaultyDisk({}, options).operations;
  const Sweep sweep = SweepOver(Spread(operations, kRunsToSeeIt, 0), {.kind = Kind::kPowerCut}, options);
  EXPECT_GT(sweep.num_with_problems, sweep.num_runs / 4);
  EXPECT_THAT(sweep.problems, testing::Each(testing::EndsWith("what is left is not what was acknowledged")));
}

}  // namespace
}  // namespace mapp
