// Writes the database of the current schema that tests/golden/db keeps. Run it once when a schema is released:
//   write_golden_database tests/golden/db/schema_NNNN.db
#include "storage/sqlite/sqlite_map_store.h"
#include "tests/unit/storage/golden_database.h"
#include "tests/unit/storage/store_fixture.h"

#include <cstdio>
#include <exception>
#include <filesystem>

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: write_golden_database FILE\n");
    return 2;
  }
  try {
    // Small pages, because the file is kept in the repository; a fixed time, so that it comes out the same again.
    mapp::SqliteOptions options;
    options.page_size_bytes = 512;
    options.unix_now_ns = [] { return int64_t{1'700'000'000'000'000'000}; };
    const auto store = mapp::Value(mapp::OpenSqliteMapStore(argv[1], options));
    mapp::WriteGoldenContent(*store);
    mapp::Check(store->Close());
    std::filesystem::remove(std::string(argv[1]) + ".lock");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
