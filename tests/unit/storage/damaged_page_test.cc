// A store one page of whose file is damaged: who needs the page fails, nobody else.
#include "storage/sqlite/backup.h"
#include "tests/unit/storage/database_fixture.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <thread>

namespace mapp {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class DamagedPageTest : public DatabaseTest {
 protected:
  /// A database of two keyframes; part of the first one's packet stands on a damaged page.
  DamagedPageTest() {
    MakeDatabase(file_, 2);
    std::string bytes = ReadBytes(file_);
    const std::string tail = Packet(0).substr(19'000, 100);
    const size_t place = bytes.find(tail);
    EXPECT_NE(place, std::string::npos);
    bytes[place] = static_cast<char>(bytes[place] ^ 1);
    WriteBytes(file_, bytes);
  }
  static std::string Packet(uint32_t number) { return TestBytes(number, 20'000); }
  static FrameId Frame(MapReader& reader, uint32_t number) {
    const MapRecord map = Value(reader.FindMap("kitchen"));
    return Value(reader.ListFrames(map.id, std::nullopt)).at(number).id;
  }
};

TEST_F(DamagedPageTest, IsNamedToWhoReadsIt) {
  const auto store = OpenStore(file_);
  const auto reader = Value(store->Read());
  for (int i = 0; i < 2; ++i) {
    const auto packet = reader->GetPacket(Frame(*reader, 0));
    EXPECT_THAT(packet, HasCode(StatusCode::kDataLoss));
    EXPECT_THAT(std::string(packet.status().message()),
                AllOf(HasSubstr("of maps.db is damaged"), Not(HasSubstr(folder_.path().string()))));
    EXPECT_EQ(Value(reader->GetPacket(Frame(*reader, 1))), Packet(1));
  }
}

TEST_F(DamagedPageTest, IsNamedWhenTheFileDoesNotBeginAsADatabase) {
  std::string bytes = ReadBytes(file_);
  bytes[3] = static_cast<char>(bytes[3] ^ 4);
  WriteBytes(file_, bytes);
  const auto store = OpenSqliteMapStore(file_);
  EXPECT_THAT(store, HasCode(StatusCode::kDataLoss));
  EXPECT_THAT(std::string(store.status().message()), AllOf(HasSubstr(file_), HasSubstr("page 1 is damaged")));
}

TEST_F(DamagedPageTest, LetsOtherWritersTryAgain) {
  constexpr int kRounds = 10;
  constexpr int kWriters = 6;
  const auto store = OpenStore(file_);
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Status> results(kWriters);
    Status damaged;
    {
      std::vector<std::jthread> writers;
      for (int i = 0; i < kWriters; ++i) {
        writers.emplace_back([&, i] {
          results[i] = store->Write({}, [&](MapWriter& writer) {
            return writer.PutTag(MapId(1), "tag " + std::to_string(round * kWriters + i), Revision(1));
          });
        });
      }
      writers.emplace_back([&] {
        damaged = store->Write({}, [](MapWriter& writer) { return writer.GetPacket(Frame(writer, 0)).status(); });
      });
    }
    EXPECT_THAT(damaged, HasCode(StatusCode::kDataLoss));
    int num_stored = 0;
    for (const Status& result : results) {
      EXPECT_TRUE(result.ok() || absl::IsUnavailable(result)) << result;
      num_stored += result.ok();
    }
    const auto reader = Value(store->Read());
    const std::vector<TagRecord> tags = Value(reader->ListTags(MapId(1)));
    EXPECT_EQ(std::count_if(tags.begin(), tags.end(),
                            [&](const TagRecord& tag) {
                              const int number = std::stoi(tag.name.substr(4));
                              return number / kWriters == round;
                            }),
              num_stored);
  }
  Check(store->Close());
}

TEST_F(DamagedPageTest, IsInNoBackup) {
  const auto made = BackUpDatabase({}, file_, {.to = folder_.File("backup.db")});
  EXPECT_THAT(made, HasCode(StatusCode::kDataLoss));
  EXPECT_THAT(std::string(made.status().message()), HasSubstr("of maps.db is damaged"));
  EXPECT_THAT(Entries(), Not(testing::Contains("backup.db")));
}

}  // namespace
}  // namespace mapp
