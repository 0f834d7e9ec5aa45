#pragma once

#include "bundle/records.h"
#include "mapp/base/status.h"

#include <string>
#include <string_view>

namespace mapp {

/// The byte in front of a record: its place in BundleRecord, from 1. Never decreases within a bundle.
uint8_t KindOf(const BundleRecord& record);
/// "frame", "point", ...; "unknown" for a kind that is none.
const char* KindName(uint8_t kind);

/// Format: docs/formats/bundle.md.
std::string EncodeRecord(const BundleRecord& record);
/// DATA_LOSS naming the field: an unknown kind, a record too short or too long, a value that cannot be.
StatusOr<BundleRecord> DecodeRecord(uint8_t kind, std::string_view bytes);

}  // namespace mapp
