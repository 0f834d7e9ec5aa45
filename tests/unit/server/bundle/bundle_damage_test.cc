// Bundles that are not what was exported: refused by name, and nothing is changed.

#include "bundle/bundle_check.h"
#include "bundle/record_codec.h"
#include "mapp/base/rng.h"
#include "storage/memory/memory_map_store.h"
#include "tests/unit/server/bundle/bundle_fixture.h"

namespace mapp::testing {
namespace {

using absl::StatusCode;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;

class BundleDamageTest : public ::testing::Test {
 protected:
  /// What importing it says; the store must stay empty.
  Status Refusal(const std::string& bundle) {
    const auto imported = ImportFromString(*store_, bundle);
    EXPECT_TRUE(Value(Value(store_->Read())->ListMaps()).empty());
    const Status checked = CheckBundle({}, SourceOf(bundle), {}).status();
    EXPECT_EQ(imported.status(), checked);
    return imported.status();
  }

  const SmallMap small_;
  const std::string& whole_ = small_.bundle();
  std::unique_ptr<MapStore> store_ = Value(OpenMemoryMapStore(CreateMemoryDatabase()));
};

TEST_F(BundleDamageTest, CutShortAtEveryByte) {
  ASSERT_LT(whole_.size(), 10'000U);
  EXPECT_THAT(Refusal({}), AllOf(HasCode(StatusCode::kInvalidArgument)));
  for (size_t size = 1; size < whole_.size(); ++size) {
    const Status status = Refusal(whole_.substr(0, size));
    ASSERT_THAT(status, HasCode(StatusCode::kDataLoss)) << size;
    ASSERT_THAT(std::string(status.message()),
                HasSubstr("cut short, it ends after " + std::to_string(size) + " bytes: copy it anew"));
  }
}

TEST_F(BundleDamageTest, EveryFlippedBit) {
  for (size_t bit = 0; bit < 8 * whole_.size(); ++bit) {
    std::string flipped = whole_;
    flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
    // Importing writes a file each time.
    const Status status = bit % 17 == 0 ? Refusal(flipped) : CheckBundle({}, SourceOf(flipped), {}).status();
    ASSERT_FALSE(status.ok()) << bit;
    const std::string message(status.message());
    ASSERT_THAT(message, AnyOf(HasSubstr("damaged at byte"), HasSubstr("cut short"), HasSubstr("not a map bundle"),
                               HasSubstr("is of format")))
        << bit;
  }
}

TEST_F(BundleDamageTest, MissingDoubledAndFollowingBytes) {
  Rng rng(1);
  for (int i = 0; i < 300; ++i) {
    const size_t begin = rng.Below(whole_.size());
    const size_t count = 1 + rng.Below(whole_.size() - begin);
    std::string missing = whole_;
    missing.erase(begin, count);
    EXPECT_FALSE(Refusal(missing).ok());
    std::string doubled = whole_;
    doubled.insert(begin, whole_.substr(begin, count));
    EXPECT_FALSE(Refusal(doubled).ok());
  }
  EXPECT_THAT(std::string(Refusal(whole_ + 'x').message()), HasSubstr("something follows its end"));
  EXPECT_THAT(std::string(Refusal(whole_ + whole_).message()), HasSubstr("something follows its end"));
}

TEST_F(BundleDamageTest, LengthsThatNobodyCanMeanAreNotAllocated) {
  std::string huge = whole_;
  // Behind magic, version and kind.
  for (size_t i = 13; i < 17; ++i) huge[i] = '\xff';
  EXPECT_THAT(std::string(Refusal(huge).message()), HasSubstr("a record of 4294967295 bytes"));
}

TEST_F(BundleDamageTest, NothingWithRightChecksumsBreaksTheServer) {
  Rng rng(2);
  int num_taken = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string bundle;
    const auto append = [&bundle](std::string_view bytes) {
      bundle += bytes;
      return absl::OkStatus();
    };
    BundleWriter writer(append);
    for (const BundleRecord& record : small_.records()) {
      std::string payload = EncodeRecord(record);
      if (rng.Below(8) == 0) payload[rng.Below(payload.size())] = static_cast<char>(rng.Below(256));
      const auto spoiled = DecodeRecord(KindOf(record), payload);
      Check(writer.Add(spoiled.ok() ? *spoiled : record));
    }
    Check(writer.Finish());
    const auto store = Value(OpenMemoryMapStore(CreateMemoryDatabase()));
    const auto imported = ImportFromString(*store, bundle);
    EXPECT_EQ(Value(Value(store->Read())->ListMaps()).size(), imported.ok() ? 1U : 0U);
    num_taken += imported.ok() ? 1 : 0;
    EXPECT_NE(imported.status().code(), StatusCode::kInternal) << imported.status();
  }
  EXPECT_GT(num_taken, 100) << "or it would never get to the writing";
}

TEST_F(BundleDamageTest, AnotherFormatIsNamedByNumber) {
  std::string newer = whole_;
  newer[8] = 7;
  const Status status = Refusal(newer);
  EXPECT_THAT(status, HasCode(StatusCode::kFailedPrecondition));
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("is of format 7, and this program reads format 1: use a newer one"));
}

TEST_F(BundleDamageTest, OtherFilesAreNoBundles) {
  for (const std::string& other : {std::string("SQLite format 3\0..................", 34), std::string("ply\nformat"),
                                   std::string(100'000, '\0'), std::string("M?")}) {
    const Status status = Refusal(other);
    EXPECT_THAT(status, HasCode(StatusCode::kInvalidArgument));
    EXPECT_THAT(std::string(status.message()), HasSubstr("not a map bundle"));
  }
}

}  // namespace
}  // namespace mapp::testing
