#include "mapp/codec/occupancy_codec.h"

#include "bit_coder.h"
#include "mapp/base/bytes.h"

#include <fmt/format.h>

#include <array>

namespace mapp {
namespace {

/// Surfaces go on: whether a bin is occupied is foretold by the bin before it in the column, and by the columns to the
/// left and above, at the same depth or next to it.
class Contexts {
 public:
  BitModel& Of(const OccupancyGrid& grid, int column, int row, int depth) {
    const int before = grid.IsOccupied(column, row, depth - 1) ? 1 : 0;
    return models_.at(static_cast<size_t>((before * 3 + Like(grid, column - 1, row, depth)) * 3 +
                                          Like(grid, column, row - 1, depth)));
  }

 private:
  /// 2: occupied at this depth, 1: next to it, 0: neither.
  static int Like(const OccupancyGrid& grid, int column, int row, int depth) {
    if (grid.IsOccupied(column, row, depth)) return 2;
    return grid.IsOccupied(column, row, depth - 1) || grid.IsOccupied(column, row, depth + 1) ? 1 : 0;
  }

  std::array<BitModel, 18> models_;
};

/// Calls `visit(column, row, depth)` for every bin in the order on the wire.
template <typename Visit>
void ForEachBin(const OccupancyGrid& grid, const Visit& visit) {
  for (int row = 0; row < grid.rows(); ++row) {
    for (int column = 0; column < grid.columns(); ++column) {
      const OccupancyGrid::DepthRange depths = grid.DepthsOf(column, row);
      for (int i = 0; i < depths.count; ++i) visit(column, row, depths.first + i);
    }
  }
}

bool IsResolution(int value) { return value >= 1 && value <= OccupancyResolution::kMax; }

}  // namespace

std::string EncodeOccupancy(const OccupancyGrid& grid) {
  ByteWriter writer;
  writer.Put(static_cast<uint8_t>(grid.resolution().subdivision));
  writer.Put(static_cast<uint8_t>(grid.resolution().depth_steps));
  writer.PutVarint(grid.num_occupied());
  if (grid.num_occupied() == 0) return writer.Take();
  Contexts contexts;
  BitEncoder encoder;
  ForEachBin(grid, [&](int column, int row, int depth) {
    encoder.Put(grid.IsOccupied(column, row, depth), contexts.Of(grid, column, row, depth));
  });
  writer.PutBytes(std::move(encoder).Finish());
  return writer.Take();
}

StatusOr<OccupancyGrid> DecodeOccupancy(std::string_view bytes, const DepthSketch& sketch) {
  ByteReader reader(bytes);
  OccupancyResolution resolution;
  resolution.subdivision = reader.Get<uint8_t>();
  resolution.depth_steps = reader.Get<uint8_t>();
  const uint64_t num_occupied = reader.GetVarint();
  if (reader.failed() || !IsResolution(resolution.subdivision) || !IsResolution(resolution.depth_steps)) {
    return absl::InvalidArgumentError(
        fmt::format("occupied_bins: {} bytes do not begin with a resolution of 1 to {} and a count", bytes.size(),
                    OccupancyResolution::kMax));
  }
  OccupancyGrid grid(sketch, resolution);
  if (num_occupied > 0) {
    Contexts contexts;
    BitDecoder decoder(reader.GetBytes(reader.remaining()));
    ForEachBin(grid, [&](int column, int row, int depth) {
      // The model is chosen before the bit is known, as on the other side.
      BitModel& model = contexts.Of(grid, column, row, depth);
      if (decoder.Get(model)) grid.Occupy(column, row, depth);
    });
  }
  if (reader.remaining() > 0 || grid.num_occupied() != num_occupied) {
    return absl::InvalidArgumentError(fmt::format("occupied_bins: {} of {} bins, where {} were announced",
                                                  grid.num_occupied(), grid.num_bins(), num_occupied));
  }
  return grid;
}

}  // namespace mapp
