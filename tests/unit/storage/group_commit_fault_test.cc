// Many writers share commits on a disk that fails, fills up or loses power: each is told the truth about its own.
#include "mapp/base/mutex.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "storage/verify.h"
#include "tests/unit/storage/fault_vfs.h"
#include "tests/unit/storage/numbered_keyframes.h"
#include "tests/unit/storage/store_fixture.h"

#include <fmt/format.h>

#include <atomic>
#include <barrier>
#include <iostream>
#include <thread>
#include <tuple>
#include <utility>

namespace mapp {
namespace {

constexpr int kSharingWriters = 6;
constexpr uint32_t kKeyframesAWriter = 6;
constexpr int kMaxAttempts = 20;
constexpr int kFaultsAKind = 40;

/// Writers with a session each, all of whose keyframes must get in unless the power goes.
class GroupCommitRun {
 public:
  explicit GroupCommitRun(const DiskFault& fault) : disk_(DiskUnderSqlite()) {
    disk_.Start(folder_.path().string());
    Open();
    for (int i = 0; i < kSharingWriters; ++i) {
      Check(store_->Write({}, [&](MapWriter& writer) {
        sessions_.push_back(Value(writer.GetSession(AddScene(writer, fmt::format("map {}", i)).session)));
        return absl::OkStatus();
      }));
    }
    disk_.Insert(fault);
  }

  void Run() {
    {
      std::vector<std::jthread> writers;
      for (const SessionRecord& session : sessions_) {
        writers.emplace_back([this, &session] { Upload(session); });
      }
    }
    num_operations_ = disk_.num_operations();
    num_syncs_ = disk_.num_syncs();
    struck_ = disk_.struck();
    if (!disk_.is_off()) {
      EXPECT_EQ(acknowledged_.size(), kSharingWriters * kKeyframesAWriter);
      EXPECT_EQ(num_published_, static_cast<int>(acknowledged_.size())) << "on_commit runs for what is acknowledged";
    }
    disk_.CutPower();
    store_.reset();
    disk_.Reboot();
    Open();
    EXPECT_THAT(FindLostKeyframes(*Value(store_->Read()), acknowledged_), testing::IsEmpty());
    Check(store_->Close());
    for (const Violation& violation : Value(VerifyDatabase({}, file_)).violations) {
      ADD_FAILURE() << violation.check << ": " << violation.message;
    }
  }

  int64_t num_operations() const { return num_operations_; }
  int64_t num_syncs() const { return num_syncs_; }
  int num_refused() const { return num_refused_; }
  const std::string& struck() const { return struck_; }

 private:
  void Open() { store_ = Value(OpenSqliteMapStore(file_, {.page_size_bytes = 1024})); }

  void Upload(const SessionRecord& session) {
    const bool leads = session.id == sessions_[0].id;
    for (uint32_t number = 0; number < kKeyframesAWriter; ++number) {
      // All come to an end before the next begin; then the leader's change lasts until the others queue up behind it.
      next_.arrive_and_wait();
      bool is_counted = !leads;
      if (is_counted) std::ignore = queued_.arrive();
      const bool stored = Insist([&](MapWriter& writer) {
        if (!std::exchange(is_counted, true)) queued_.arrive_and_wait();
        return AddNumberedKeyframe(writer, session, number);
      });
      if (!is_counted) std::ignore = queued_.arrive();
      if (!stored) continue;
      const MutexLock lock(mutex_);
      acknowledged_.push_back({session.id.value(), number});
    }
  }

  /// False when the power is gone.
  bool Insist(const std::function<Status(MapWriter&)>& change) {
    for (int attempt = 1; !disk_.is_off(); ++attempt) {
      const Status status = store_->Write({}, change, [this] { ++num_published_; });
      if (status.ok()) return true;
      if (disk_.is_off()) return false;
      ++num_refused_;
      // ALREADY_EXISTS would be of one that was refused and yet stored.
      EXPECT_TRUE(absl::IsUnavailable(status) || absl::IsResourceExhausted(status)) << status;
      if (attempt == kMaxAttempts / 2) disk_.Heal();
      if (attempt == kMaxAttempts) {
        ADD_FAILURE() << "still refused: " << status;
        return false;
      }
    }
    return false;
  }

  FaultDisk& disk_;
  const TempFolder folder_;
  const std::string file_ = folder_.File("maps.db");
  std::unique_ptr<MapStore> store_;
  std::vector<SessionRecord> sessions_;
  std::barrier<> next_{kSharingWriters};
  std::barrier<> queued_{kSharingWriters};
  Mutex mutex_;
  std::vector<NumberedUpload> acknowledged_ ABSL_GUARDED_BY(mutex_);
  std::atomic<int> num_published_ = 0;
  std::atomic<int> num_refused_ = 0;
  int64_t num_operations_ = 0;
  int64_t num_syncs_ = 0;
  std::string struck_;
};

TEST(GroupCommitFaultTest, TellsEveryWriterTheTruth) {
  GroupCommitRun sound({});
  sound.Run();
  EXPECT_EQ(sound.num_refused(), 0);
  EXPECT_LT(sound.num_syncs(), kSharingWriters * kKeyframesAWriter / 2) << "commits are shared";
  int num_struck = 0, num_refused = 0;
  for (const auto kind : {DiskFault::Kind::kFail, DiskFault::Kind::kFailFrom, DiskFault::Kind::kFull,
                          DiskFault::Kind::kShortWrite, DiskFault::Kind::kPowerCut}) {
    for (int i = 0; i < kFaultsAKind; ++i) {
      const DiskFault fault{.kind = kind,
                            .at = (2 * i + 1) * sound.num_operations() / (2 * kFaultsAKind),
                            .seed = static_cast<uint64_t>(i)};
      SCOPED_TRACE(fmt::format("kind {} at {} seed {}", static_cast<int>(kind), fault.at, fault.seed));
      GroupCommitRun run(fault);
      run.Run();
      num_struck += !run.struck().empty();
      num_refused += run.num_refused();
    }
  }
  std::cout << sound.num_operations() << " operations, " << sound.num_syncs() << " syncs, " << num_struck << " faults, "
            << num_refused << " changes refused\n";
  EXPECT_GT(num_struck, 2 * kFaultsAKind) << "with shared commits a run has fewer operations now and then";
}

}  // namespace
}  // namespace mapp
