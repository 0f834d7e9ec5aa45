#pragma once

#include "mapp/base/bytes.h"
#include "mapp/base/status.h"
#include "storage/records.h"

#include <Eigen/Core>

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace mapp::sqlite {

// The BLOB columns with a layout of their own, specified in docs/formats/database.md. Decoders take any bytes and give
// DATA_LOSS for those that no encoder writes.

/// Order is kept; small when feature indices and point ids grow together. Ends with a CRC-32C.
std::string EncodeObservations(std::span<const Observation> observations);
StatusOr<std::vector<Observation>> DecodeObservations(std::string_view bytes);

std::string EncodeObservers(std::span<const FrameId> observers);
/// Appends to `observers`. False when malformed.
bool DecodeObservers(std::string_view bytes, std::vector<FrameId>* observers);

/// Ids that ascend, as varints of their differences from the one before, the first from 0.
template <typename IdType>
std::string EncodeAscendingIds(const std::vector<IdType>& ids) {
  ByteWriter writer;
  uint64_t last = 0;
  for (const IdType id : ids) {
    writer.PutVarint(id.value() - last);
    last = id.value();
  }
  return writer.Take();
}
/// Appends to `ids`. False when malformed: all that it decodes ascends strictly and has no id 0.
template <typename IdType>
bool DecodeAscendingIds(std::string_view bytes, std::vector<IdType>* ids) {
  ByteReader reader(bytes);
  uint64_t last = 0;
  while (reader.remaining() > 0) {
    const uint64_t id = last + reader.GetVarint();
    if (reader.failed() || id <= last) return false;
    ids->push_back(IdType(id));
    last = id;
  }
  return true;
}

/// 3 x float32. The decoder requires 12 bytes.
std::string_view DirectionBytes(const Eigen::Vector3f& direction);
bool DecodeDirection(std::string_view bytes, Eigen::Vector3f* direction);

/// n x float64.
std::string EncodeDoubles(const std::vector<double>& values);
std::vector<double> DecodeDoubles(std::string_view bytes);

}  // namespace mapp::sqlite
