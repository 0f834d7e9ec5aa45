#include "server/service/compaction.h"

#include "storage/map_store.h"
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/storage/store_fixture.h"

#include <vector>

namespace mapp {
namespace {

using absl::StatusCode;

constexpr int64_t kDayNs = int64_t{24} * 3600 * 1'000'000'000;
constexpr int64_t kFirstDayNs = 1000 * kDayNs;

/// A map that gets one revision a day, from the first day on, in which its only point moves.
class CompactionTest : public testing::Test {
 protected:
  CompactionTest() {
    store_ = Value(OpenSqliteMapStore(folder_.File("maps.db"),
                                      {.sync_commits = false, .unix_now_ns = [this] { return now_ns_; }}));
    Check(store_->Write({}, [this](MapWriter& writer) {
      scene_ = AddScene(writer, "kitchen");
      return absl::OkStatus();
    }));
    for (int day = 0; day < 6; ++day, now_ns_ += kDayNs) {
      Check(store_->Write({}, [&](MapWriter& writer) -> Status {
        const PointRecord point = TestPoint(scene_.session, 1, {1.0 + day, 2, 3});
        if (day == 0) return writer.InsertPoint(scene_.map, point).status();
        PointRecord moved = Value(writer.PointsOfSession(scene_.session)).at(0);
        moved.position = point.position;
        return writer.UpdatePoint(moved);
      }));
    }
  }

  StatusOr<Compaction> Compact(CompactionRequest request) {
    request.map_name = "kitchen";
    return CompactMap(*store_, {}, request, now_ns_,
                      [this](const CompactionProgress& progress) { progress_.push_back(progress); });
  }
  void Tag(const std::string& name, uint64_t revision) {
    Check(store_->Write({}, [&](MapWriter& writer) { return writer.PutTag(scene_.map, name, Revision(revision)); }));
  }
  bool CanRead(uint64_t revision) { return store_->ReadAsOf(scene_.map, Revision(revision)).ok(); }

  TempFolder folder_;
  int64_t now_ns_ = kFirstDayNs;  ///< in the end the day after the last revision
  std::unique_ptr<MapStore> store_;
  Scene scene_;
  std::vector<CompactionProgress> progress_;
};

TEST_F(CompactionTest, KeepsSoManyRevisionsBeforeThePresentOne) {
  const Compaction done = Value(Compact({.map_name = {}, .keep_revisions = 2, .keep_days = {}}));
  EXPECT_EQ(done.oldest_before, Revision(0));
  EXPECT_EQ(done.oldest, Revision(4));
  EXPECT_EQ(done.num_rows, 3);
  EXPECT_FALSE(CanRead(3));
  for (uint64_t revision = 4; revision <= 6; ++revision) EXPECT_TRUE(CanRead(revision));
  ASSERT_FALSE(progress_.empty());
  EXPECT_EQ(progress_.back().rows_done, 3);
  EXPECT_EQ(progress_.back().bytes_left, 0);
}

TEST_F(CompactionTest, KeepsTheStateOfSoManyDaysAgo) {
  // Revision 4 is three days old: it was the present one two and a half days ago.
  EXPECT_EQ(Value(Compact({.map_name = {}, .keep_revisions = {}, .keep_days = 2.5})).oldest, Revision(4));
  EXPECT_EQ(Value(Compact({.map_name = {}, .keep_revisions = {}, .keep_days = 2.0})).oldest, Revision(5));
}

TEST_F(CompactionTest, KeepsWhatOneOfBothNeeds) {
  EXPECT_EQ(Value(Compact({.map_name = {}, .keep_revisions = 3, .keep_days = 1})).oldest, Revision(3));
  EXPECT_EQ(Value(Compact({.map_name = {}, .keep_revisions = 0, .keep_days = 900})).oldest, Revision(3))
      << "what is gone does not come back";
}

TEST_F(CompactionTest, TaggedRevisionsStay) {
  Tag("moved-in", 3);
  Tag("later", 5);
  const Compaction kept = Value(Compact({.map_name = {}, .keep_revisions = 0, .keep_days = {}}));
  EXPECT_EQ(kept.oldest, Revision(3));
  ASSERT_TRUE(kept.kept_for.has_value());
  EXPECT_EQ(kept.kept_for->name, "moved-in");
  EXPECT_TRUE(CanRead(3));
}

TEST_F(CompactionTest, DryRunOnlyTells) {
  const Compaction would = Value(Compact({.map_name = {}, .keep_revisions = 0, .keep_days = {}, .dry_run = true}));
  EXPECT_EQ(would.oldest, Revision(6));
  EXPECT_EQ(would.num_rows, 5);
  EXPECT_TRUE(CanRead(0));
}

TEST_F(CompactionTest, RefusesWhatSaysNothing) {
  EXPECT_THAT(Compact({}), HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(Compact({.map_name = {}, .keep_revisions = {}, .keep_days = -1}), HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(CompactMap(*store_, {}, {.map_name = "cellar", .keep_revisions = 1, .keep_days = {}}, now_ns_, {}),
              HasCode(StatusCode::kNotFound));
  EXPECT_TRUE(CanRead(0));
}

TEST_F(CompactionTest, EndsWhereItIsStoppedAndGoesOnNextTime) {
  bool stopped = false;
  CallContext context;
  context.is_cancelled = [&stopped] { return stopped; };
  const CompactionRequest request{.map_name = "kitchen", .keep_revisions = 1, .keep_days = {}};
  const auto stop = [&](const CompactionProgress& progress) { stopped = progress.rows_done > 0; };
  EXPECT_THAT(CompactMap(*store_, context, request, now_ns_, stop), HasCode(StatusCode::kCancelled));
  EXPECT_EQ(Value(CompactMap(*store_, {}, request, now_ns_, {})).oldest, Revision(5));
  EXPECT_EQ(Value(Value(store_->Read())->CountHistory(scene_.map, Revision(5))), 0);
}

}  // namespace
}  // namespace mapp
