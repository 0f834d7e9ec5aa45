#pragma once

#include "storage/map_store.h"

#include <string>

namespace mapp {

/// tests/golden/db/schema_NNNN.db
std::string GoldenDatabaseFile(int schema);
/// What every golden database holds.
void WriteGoldenContent(MapStore& store);
void ExpectGoldenContent(MapReader& reader);

}  // namespace mapp
