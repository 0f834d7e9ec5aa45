#include "mapp/base/bytes.h"
#include "mapp/base/rng.h"
#include "tests/unit/server/verify/healthy_database.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <optional>

namespace mapp::testing {
namespace {

/// Checksum of all rows of each table; nullopt when they cannot all be read.
std::optional<std::map<std::string, uint32_t>> ChecksumsOfRows(const std::string& file) {
  sqlite3* db = nullptr;
  sqlite3_open_v2(file.c_str(), &db, SQLITE_OPEN_READONLY, nullptr);
  std::map<std::string, uint32_t> checksums;
  bool readable = true;
  const auto for_each_row = [&](const std::string& sql, const auto& use) {
    sqlite3_stmt* rows = nullptr;
    int code = sqlite3_prepare_v2(db, sql.c_str(), -1, &rows, nullptr);
    while (code == SQLITE_OK || code == SQLITE_ROW) {
      code = sqlite3_step(rows);
      if (code == SQLITE_ROW) use(rows);
    }
    readable &= code == SQLITE_DONE;
    sqlite3_finalize(rows);
  };
  std::vector<std::string> tables;
  for_each_row("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name", [&](sqlite3_stmt* row) {
    tables.emplace_back(reinterpret_cast<const char*>(sqlite3_column_text(row, 0)));
  });
  for (const std::string& table : tables) {
    ByteWriter rows;
    for_each_row("SELECT * FROM \"" + table + "\"", [&](sqlite3_stmt* row) {
      for (int i = 0; i < sqlite3_column_count(row); ++i) {
        const auto* value = static_cast<const char*>(sqlite3_column_blob(row, i));
        rows.PutBytes({value, static_cast<size_t>(sqlite3_column_bytes(row, i))});
        rows.Put<uint8_t>(static_cast<uint8_t>(sqlite3_column_type(row, i)));
      }
    });
    checksums[table] = Crc32c(rows.bytes());
  }
  sqlite3_close(db);
  return readable ? std::optional(checksums) : std::nullopt;
}

void FlipBit(const std::string& file, uint64_t bit) {
  std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
  char byte = 0;
  stream.seekg(static_cast<std::streamoff>(bit / 8)).get(byte);
  stream.seekp(static_cast<std::streamoff>(bit / 8)).put(static_cast<char>(byte ^ (1 << bit % 8)));
}

TEST(BitFlipTest, VerifySurvivesAnyAndFindsAllThatMatter) {
  constexpr int kNumFlips = 200;
  constexpr uint64_t kSeed = 20;
  const DatabaseCopy copy;
  const auto healthy = ChecksumsOfRows(copy.file());
  ASSERT_TRUE(healthy.has_value());
  const uint64_t num_bits = std::filesystem::file_size(copy.file()) * 8;
  Rng rng(kSeed);
  int num_refused = 0, num_reported = 0, num_harmless = 0, num_unnoticed = 0;
  std::map<std::string, int> unnoticed_in;
  for (int i = 0; i < kNumFlips; ++i) {
    const uint64_t bit = rng.Below(num_bits);
    SCOPED_TRACE(fmt::format("seed {}, bit {} of byte {}", kSeed, bit % 8, bit / 8));
    FlipBit(copy.file(), bit);
    const auto report = Verify(copy.file());
    if (!report.ok()) {
      ++num_refused;
    } else if (report->num_violations() > 0) {
      ++num_reported;
    } else if (const auto rows = ChecksumsOfRows(copy.file()); rows == healthy) {
      ++num_harmless;
    } else {
      ++num_unnoticed;
      ASSERT_TRUE(rows.has_value()) << "what cannot be read was not reported";
      for (const auto& [table, checksum] : *healthy) unnoticed_in[table] += rows->at(table) != checksum ? 1 : 0;
    }
    FlipBit(copy.file(), bit);
  }
  fmt::print("{} bit flips: {} refused, {} reported, {} change no row, {} change one unnoticed\n", kNumFlips,
             num_refused, num_reported, num_harmless, num_unnoticed);
  for (const auto& [table, count] : unnoticed_in) {
    if (count > 0) fmt::print("  unnoticed in {}: {}\n", table, count);
  }
  const auto report = Verify(copy.file());
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->num_violations(), 0) << "each flip was undone";
  EXPECT_GT(num_reported, kNumFlips / 4);
  EXPECT_EQ(num_unnoticed, 0);
}

}  // namespace
}  // namespace mapp::testing
